// Potentially visible sets (Kautz, Lehtinen, Aila 2004, section 3.2): where an animation is known beforehand,
// the blockers that ever matter to each batch of receivers. Frames that are given a set look at nothing else.
#pragma once

#include "nusselt/frame.h"

namespace nusselt {

// A set belongs to a list of meshes, in their order, and to a quality: the levels of detail differ. It holds
// one list of blockers, or several for the segments of an animation, each some 2 bytes a vertex for every
// thousand triangles of the meshes. Masks of a pose whose frame was recorded are the same with and without
// it, bit for bit. Between recorded poses a blocker may be missed that only matters there: record densely, in
// each segment also the poses where its neighbours end. Under other animations it is wrong: shadows are
// missing.
//
// Made with the program (`nusselt pvs`), or by frames with FrameDesc::record. A frame with a set has exactly
// its meshes, all of one object, and no history and no falloff; its quality is not `paper`. Recorded frames
// are all of one kind, that of the first, which the set knows: the meshes with results of both sides, and
// whether masks are watertight. It serves frames with fewer backs and without `watertight` too; others are
// refused. Record all receivers that later frames need (FrameMesh::needed), or all.
struct VisibleSet;

struct VisibleSetInfo {
    Quality quality = Quality::standard;
    uint32_t meshes = 0;
    uint32_t segments = 0;
    uint32_t clusters = 0;   // of all levels of all meshes
    uint32_t batches = 0;    // of 16 receivers, or fewer at the end of a mesh
    double kept = 0;         // of the pairs of a batch and a cluster in a segment, the part that matters
    uint32_t backs = 0;      // meshes that were recorded with both sides
    bool watertight = false; // recorded of such frames
};

constexpr uint32_t most_segments = 4096;

// An empty set: with it nothing is hidden but by what touches the receiver, until frames were recorded.
// `invalid_argument`: no meshes, no segments or over most_segments, quality `paper`, or over 2^33 pairs of a
// batch and a cluster in all segments; `stale_handle`: a mesh is gone.
Status create_visible_set(Context* context, const MeshId* meshes, uint32_t mesh_count, Quality quality,
                          uint32_t segments, VisibleSet** out);

// Frees it; no frame in flight may use it. Null is ignored. Before the context is destroyed.
void destroy_visible_set(Context* context, VisibleSet* set);

Status visible_set_info(const VisibleSet* set, VisibleSetInfo* out);

// Where a set helps: for each vertex of its mesh of that number, the part of all clusters that its batch
// looks at in a segment, 0 to 1. `count` is the mesh's V. `invalid_argument`: null, no such segment or
// number, or another mesh or count; `stale_handle`: the mesh is gone.
Status visible_set_parts(Context* context, const VisibleSet* set, uint32_t segment, uint32_t number,
                         MeshId mesh, float* parts, size_t count);

// The set as a file holds it: versioned, with the identity of its meshes and a checksum. `size` is that of
// visible_set_bytes.
size_t visible_set_bytes(const VisibleSet* set);
Status write_visible_set(const VisibleSet* set, void* data, size_t size);

// Refuses, with the reason, what is no set, is cut short or damaged, is of another version, or was made of
// other meshes than these (vertices, triangles or their order differ, or the library makes other levels of
// detail from them). Nothing is made then.
Status read_visible_set(Context* context, const MeshId* meshes, uint32_t mesh_count, const void* data,
                        size_t size, VisibleSet** out);

} // namespace nusselt
