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

// Positions, normals and tangent frames of 1 to 16 receivers. Lanes without one repeat the first, invalid.
void load_batch(const Frame& frame, const MeshSlice& slice, const uint32_t* receivers, uint32_t count,
                kernels::Batch& batch, Worker& worker);

// A loaded batch's masks and transfer vectors, into the caller's arrays and the
// history's. `candidates` are the clusters that may matter to it (null: all). Receivers inside closed parts
// leave the batch. A receiver's result does not depend on who shares its batch.
void shadow_batch(Frame& frame, const MeshSlice& slice, const uint32_t* receivers, uint32_t count,
                  kernels::Batch& batch, const uint32_t* candidates, uint32_t candidate_count, Worker& worker,
                  StageClock& clock);

// The same as if nothing blocked them.
void open_batch(const Frame& frame, const MeshSlice& slice, const uint32_t* receivers, uint32_t count,
                const kernels::Batch& batch, Worker& worker, StageClock& clock);

} // namespace nusselt
