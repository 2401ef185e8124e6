// Masks that are nearly closed.
#pragma once

#include "frame_data.h"

namespace nusselt {

// Decides the last open samples of each receiver's mask (kernels/last_samples.h) against the clusters in
// worker.selected, `selected` of them, and what the receiver's own triangles hide below themselves.
void cover_last_samples(const Frame& frame, const MeshSlice& slice, const uint32_t* receivers,
                        const kernels::Batch& batch, uint32_t selected, Worker& worker);

} // namespace nusselt
