// Builds a mesh's static data: welding, components, fans, receiver batches, clusters and levels of detail.
#pragma once

#include "mesh_data.h"
#include "nusselt/mesh.h"

namespace nusselt {

struct LevelOptions {
    uint32_t cluster_triangles = 32; // at most, and at most 64 vertices and 128 edges
    float level_ratio = 0.3f;        // triangles of a level over those of the one before it
    uint32_t least_triangles = 16;   // no level has fewer
    uint32_t coarse_triangles = 400; // target of the quality `paper`
};

// `desc` has been checked (counts, strides, indices). Fills all of `mesh` and `info` except info.bytes.
// Deterministic. Throws std::bad_alloc and nothing else.
void build_mesh(const MeshDesc& desc, const LevelOptions& options, const Allocator& allocator, MeshData& mesh,
                MeshInfo& info);

} // namespace nusselt
