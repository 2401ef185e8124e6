// What a history remembers of its last frame: plain arrays, sized when its group is new.
#pragma once

#include "float_array.h"
#include "kernels/kernels.h"
#include "nusselt/frame.h"

#include <cstdint>

namespace nusselt {

// Bounds of clusters that can be looked at like a frame's (kernels::ClusterBounds).
struct ClusterBoundsArrays {
    explicit ClusterBoundsArrays(const Allocator& a)
        : centre{FloatArray(a), FloatArray(a), FloatArray(a)},
          radius(a), cone{FloatArray(a), FloatArray(a), FloatArray(a)}, cone_cos(a), cone_sin(a), nearest(a),
          farthest(a) {}

    FloatArray centre[3], radius, cone[3], cone_cos, cone_sin, nearest, farthest;

    void resize(size_t count);
    kernels::ClusterBounds view(uint32_t count) const;
};

// Of a cluster's samples: the sum of their squared distances, and the largest distance, that of its bridge
// and of the finer clusters under it included; and the distance of its bridge, 0 for none.
struct LevelError {
    float squares, most, bridge;
};

// What a history belongs to: where a frame differs, it begins anew.
struct GroupMember {
    MeshId mesh;
    bool receives, masks, back_receives, back_masks;
    uint32_t object;
};

struct History {
    explicit History(const Allocator& a)
        : members(HostAllocator<GroupMember>(a)), moved(HostAllocator<float>(a)),
          chunk_moved(HostAllocator<uint8_t>(a)), touched(HostAllocator<uint8_t>(a)),
          normals(HostAllocator<float>(a)), transfer(HostAllocator<float>(a)),
          masks(HostAllocator<uint8_t>(a)), wanted(HostAllocator<uint16_t>(a)),
          current(HostAllocator<uint16_t>(a)), known(HostAllocator<uint16_t>(a)),
          fresh(HostAllocator<uint16_t>(a)), stale_frames(HostAllocator<uint32_t>(a)),
          change(HostAllocator<float>(a)), turns(HostAllocator<Turn>(a)),
          invalid_triangles(HostAllocator<uint32_t>(a)), level_errors(HostAllocator<LevelError>(a)),
          before(a), clearance_before(HostAllocator<float>(a)), disturbed(a),
          disturbed_by(HostAllocator<float>(a)) {}

    uint32_t generation = 1;

    Vector<GroupMember> members; // none: no frame yet
    Quality quality = Quality::standard;
    bool watertight = false;
    uint32_t order = 0;
    bool same_group = false; // this frame's group is the last one's: what was computed then may be reused
    bool same_pose = false;  // this frame's positions and normals are the last one's
    bool pose_whole = false; // the arrays of the frame are those of a pose; false after a cancelled one

    Vector<float> moved;         // by welded vertex of the group: how far, in frame space; 0: not a bit
    Vector<uint8_t> chunk_moved; // by chunk of them: some were
    Vector<uint8_t> touched;     // by cluster: some of its vertices were
    // By vertex of the meshes that receive (MeshSlice::first_vertex): normal as last given, and results
    // (order^2 terms).
    Vector<float> normals, transfer;
    Vector<uint8_t> masks;

    // By batch, eight a region; bits are lanes.
    Vector<uint16_t> wanted;       // needs a result of its own in this frame
    Vector<uint16_t> current;      // the result is that of this pose
    Vector<uint16_t> known;        // there is a result, of some pose
    Vector<uint16_t> fresh;        // computed in this frame
    Vector<uint32_t> stale_frames; // for how many frames a wanted result has not been current
    Vector<float> change;          // radians, since it was: how much the view has turned, roughly

    // The order of batches under a budget: batches of one region that are equally stale go together.
    struct Turn {
        uint32_t region, batches; // one bit a batch of the region
        uint32_t stale_frames;
        float change;
    };
    Vector<Turn> turns;
    uint32_t turn_count = 0;

    Vector<uint32_t> invalid_triangles; // by cluster
    Vector<LevelError> level_errors;    // by cluster, as measured
    ClusterBoundsArrays before;         // by cluster, of the last frame
    Vector<float> clearance_before;
    ClusterBoundsArrays disturbed; // as they were and as they are, of those that changed
    Vector<float> disturbed_by;    // how far their centres moved
    uint32_t disturbed_count = 0;
};

} // namespace nusselt
