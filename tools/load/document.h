// The JSON part of a glTF file, checked and reduced to what geometry needs.
#pragma once

#include "tools/load/error.h"
#include "tools/load/tinygltf.h"

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace nusselt::load {

struct BufferSource {
    uint64_t bytes = 0; // byteLength
    std::optional<std::string> uri;
};

enum class MeshoptMode { attributes, triangles, indices };
enum class MeshoptFilter { none, octahedral, quaternion, exponential };

// EXT_meshopt_compression of one buffer view.
struct CompressedView {
    int buffer = 0;
    uint64_t offset = 0, bytes = 0; // of the compressed data
    uint64_t stride = 0, count = 0; // of the decompressed data
    MeshoptMode mode = MeshoptMode::attributes;
    MeshoptFilter filter = MeshoptFilter::none;
};

// Every property that is left has the right type, and every number that refers to an array is inside it.
// `gltf` has no buffers, images, textures, samplers, cameras, extras or extensions; buffers stand apart.
struct Document {
    tinygltf::Model gltf;
    std::vector<BufferSource> buffers;
    std::vector<std::optional<CompressedView>> compressed; // one for each buffer view
    std::vector<std::vector<int>> pointer_inputs; // for each animation: input accessors of pointer channels
    std::vector<std::string> warnings;
};

Document read_document(std::string_view json, const LoadLimits& limits);

} // namespace nusselt::load
