// Which clusters of the next coarser level lie over a cluster: what must take over where its band ends.
#pragma once

#include "mesh_data.h"

namespace nusselt {

// Fills clusters.cover_begin and clusters.covers from the clusters and samples of all levels. At most 64 a
// cluster, whatever the mesh.
void build_covers(const Allocator& allocator, MeshData& mesh);

} // namespace nusselt
