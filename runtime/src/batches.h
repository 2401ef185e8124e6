// One batch of receivers through cull, planes, masks, integration, rotation and store.
#pragma once

#include "frame_data.h"

namespace nusselt {

// Adds the time since the last lap to a stage.
struct StageClock {
    Tally& tally;
    uint64_t last;

    explicit StageClock(Tally& t) : tally(t), last(ticks_now()) {}
    void lap(Stage stage) {
        const uint64_t now = ticks_now();
        tally.ticks[stage] += now - last;
        last = now;
    }
};

// A duplicate had the position and normal of another vertex when the mesh was added. It gets that one's
// result, unless their normals or materials differ in this frame or nobody needs one of them.
bool repeats(const FrameMesh& mesh, uint32_t duplicate, uint32_t original);

// Writes to the vertices that get a receiver's result: itself, and those that repeat it. Returns how many.
template<class Write>
uint32_t each_vertex(const MeshSlice& slice, uint32_t receiver, const Write& write) {
    const MeshData& mesh = *slice.mesh;
    uint32_t count = 1;
    write(receiver);
    for (uint32_t k = mesh.duplicate_begin[receiver]; k < mesh.duplicate_begin[receiver + 1]; ++k) {
        if (!repeats(slice.in, mesh.duplicates[k], receiver)) continue;
        write(mesh.duplicates[k]);
        ++count;
    }
    return count;
}

// Makes a batch's streams from worker.turned and, where they want them, its masks.
void store_outputs(const Frame& frame, const MeshSlice& slice, const uint32_t* receivers, uint32_t count,
                   const kernels::Batch& batch, Worker& worker);

// Positions, normals and tangent frames of 1 to 16 receivers. Lanes without one repeat the first, invalid.
void load_batch(const Frame& frame, const MeshSlice& slice, const uint32_t* receivers, uint32_t count,
                kernels::Batch& batch, Worker& worker);

// A loaded batch's masks and transfer vectors, into the caller's arrays and the
// history's. `candidates` are the clusters that may matter to it (null: all). Receivers inside closed parts
// leave the batch. A receiver's result does not depend on who shares its batch.
void shadow_batch(Frame& frame, const MeshSlice& slice, const uint32_t* receivers, uint32_t count,
                  kernels::Batch& batch, const uint32_t* candidates, uint32_t candidate_count, Worker& worker,
                  StageClock& clock);

// The same for both sides of a mesh (slices[1] is the other's back), whose masks are drawn together.
void shadow_both(Frame& frame, const MeshSlice* const slices[2], const uint32_t* receivers, uint32_t count,
                 kernels::Batch* const batches[2], const uint32_t* candidates, uint32_t candidate_count,
                 Worker& worker, StageClock& clock);

// Whether `behind` mirrors the tangent frames of `front`, as kernels::BothSidesJobs asks for.
bool is_mirrored(const kernels::Batch& front, const kernels::Batch& behind);

// The same as if nothing blocked them.
void open_batch(const Frame& frame, const MeshSlice& slice, const uint32_t* receivers, uint32_t count,
                const kernels::Batch& batch, Worker& worker, StageClock& clock);

} // namespace nusselt
