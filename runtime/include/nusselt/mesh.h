// Meshes: topology and levels of detail, made once; positions come with every frame.
#pragma once

#include "nusselt/context.h"
#include "nusselt/views.h"

namespace nusselt {

// A mesh by value: generational, zero is null.
struct MeshId {
    uint32_t slot = 0;
    uint32_t generation = 0;
};

struct MeshDesc {
    // Positions of the rest pose, V >= 1 of them, any unit. Vertices at exactly equal positions (-0 = +0) are
    // welded: they stay together in every pose. Levels of detail and clusters are made from these positions.
    Vec3View rest_positions;
    // V normals of the rest pose, or none (then area-weighted ones are made). Only used to put receivers that
    // look the same way into the same batch; they need not be unit length.
    Vec3View rest_normals;
    // 3 T vertex indices below V; counter-clockwise seen from outside. T may be 0 (the mesh then only
    // receives).
    const uint32_t* indices = nullptr;
    size_t index_count = 0;
};

struct MeshInfo {
    uint32_t vertices = 0;             // V
    uint32_t triangles = 0;            // T
    uint32_t welded_vertices = 0;      // distinct positions
    uint32_t degenerate_triangles = 0; // left out: two equal corners after welding, or a corner not finite
    uint32_t components = 0;           // connected by shared edges
    uint32_t closed_components = 0;  // closed and consistently wound: they block with their front faces only
    uint32_t boundary_edges = 0;     // used by one triangle
    uint32_t non_manifold_edges = 0; // used by more than two
    uint32_t flipped_edges = 0;      // two triangles run along it the same way
    uint32_t levels = 0;             // of detail, the full mesh included
    uint32_t clusters = 0;           // of all levels
    uint32_t level_triangles[16] = {}; // triangles of each level, finest first
    size_t bytes = 0;                  // memory held by the mesh
    uint32_t coarse_triangles = 0;     // of the one coarse mesh that quality `paper` takes
};

// Adds a mesh: welds, finds components, builds levels and clusters (about 100 ms for 10,000 vertices or
// less). Everything is copied; the descriptor's arrays may go away afterwards. `invalid_argument`: no
// vertices, an index out of range, an index count that is no multiple of 3, a stride too small, more than
// 2^27 vertices or triangles.
Status add_mesh(Context* context, const MeshDesc& desc, MeshId* out);

// Another handle of the same mesh, for one more that is drawn beside it: in the same frame, in another pose.
// Levels of detail and everything else that add_mesh made are shared; it takes no memory beyond the handle's.
// Each handle is removed for itself.
Status share_mesh(Context* context, MeshId mesh, MeshId* out);

// Removes a mesh. `busy` while a frame that uses it is in flight.
Status remove_mesh(Context* context, MeshId mesh);

Status mesh_info(const Context* context, MeshId mesh, MeshInfo* out);

// Bytes that add_mesh would take from the context's allocator, at most: `held` bounds MeshInfo::bytes, `peak`
// what it holds at a time.
struct MeshMemory {
    size_t held = 0;
    size_t peak = 0;
};

// Tells a mesh's memory before it is added; a hundred times quicker than adding it, with 30 bytes a vertex of
// scratch memory. Refuses what add_mesh refuses.
Status mesh_memory_bound(const Context* context, const MeshDesc& desc, MeshMemory* out);

} // namespace nusselt
