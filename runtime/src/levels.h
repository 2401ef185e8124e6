// Builds a mesh's static data: welding, components, fans, receiver batches, clusters and levels of detail.
#pragma once

#include "mesh_data.h"
#include "nusselt/mesh.h"

namespace nusselt {

struct LevelOptions {
    uint32_t cluster_triangles = 32; // at most, and at most 64 vertices and 128 edges
    uint32_t group_clusters = 8;     // about
    uint32_t coarse_triangles = 400; // target of the quality `paper`
};

// `desc` has been checked (counts, strides, indices). Fills all of `mesh` and `info` except info.bytes.
// Deterministic. Throws std::bad_alloc and nothing else.
void build_mesh(const MeshDesc& desc, const LevelOptions& options, const Allocator& allocator, MeshData& mesh,
                MeshInfo& info);

} // namespace nusselt
