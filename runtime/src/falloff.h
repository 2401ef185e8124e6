// Occlusion that fades with distance (FrameDesc::falloff): blockers in shells around each receiver, a mask
// each.
#pragma once

#include "batches.h"

namespace nusselt {

Status check_falloff(const FrameDesc& desc);
// None where the falloff is off.
Shells make_shells(const Falloff& falloff);

// Rasterises the selected clusters, each triangle into the masks of the shells that it lies in; masks of the
// shells follow one another in worker.masks. The job list may hold jobs of the first shell.
void raster_shells(const Frame& frame, const kernels::Batch& batch, uint32_t selected, Worker& worker,
                   kernels::JobList& jobs, StageClock& clock);

// Adds each shell to those around it, and integrates `order` bands of them by their weights into
// worker.local; the first mask is then of all shells.
void integrate_shells(const Frame& frame, const kernels::Batch& batch, uint32_t order, Worker& worker);

} // namespace nusselt
