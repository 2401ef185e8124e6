// The binary part of a glTF file: buffers, views, accessors. Nothing is read before its range was proven.
#pragma once

#include "tools/load/document.h"
#include "tools/load/file.h"

#include <cstdint>
#include <span>
#include <string>
#include <vector>

namespace nusselt::load {

struct Buffers {
    std::vector<Bytes> owned;                    // files, data URIs, decompressed views
    std::vector<std::span<const uint8_t>> views; // one for each buffer view
};

// Reads all buffers, decompresses what is compressed, and checks every buffer view and every accessor, sparse
// indices included. `binary_chunk` is a GLB's, and outlives the result; data() null where there is none.
// Takes the data URIs out of the document.
Buffers read_buffers(Document& document, const std::string& asset_path, std::span<const uint8_t> binary_chunk,
                     const LoadLimits& limits);

int component_count(const tinygltf::Accessor& accessor);

// All elements as floats, tightly packed; integers as they are, or mapped to [0, 1] or [-1, 1] where
// normalized.
std::vector<float> read_floats(const Document& document, const Buffers& buffers, int accessor);

// A SCALAR or VEC4 of unsigned integers. The caller has checked the component type.
std::vector<uint32_t> read_integers(const Document& document, const Buffers& buffers, int accessor);

} // namespace nusselt::load
