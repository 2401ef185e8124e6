// Receivers: the vertices that are computed, in batches that lie together and look the same way.
#pragma once

#include "mesh_data.h"
#include "nusselt/mesh.h"
#include "vec3.h"

namespace nusselt {

// Fills receivers, duplicates, duplicate_of and duplicate_begin from weld, weld_source and full_triangles.
// `positions` are the welded rest positions, at most about 1 in size; not finite where the caller's are not.
void build_receivers(const MeshDesc& desc, const Vec3f* positions, const Allocator& allocator,
                     MeshData& mesh);

} // namespace nusselt
