// Occlusion that fades with distance (FrameDesc::falloff).
#pragma once

#include "batches.h"

namespace nusselt {

Status check_falloff(const FrameDesc& desc);
// In frame space.
kernels::Fade make_fade(const Falloff& falloff, float scale);

// Draws the selected clusters: what lies before the fade's beginning into worker.masks, which hold the masks
// of digits behind them, and those of what is hidden in part. The job list may hold jobs. Leaves
// worker.selected in disorder.
void draw_fading(const Frame& frame, const kernels::Batch& batch, uint32_t selected, Worker& worker,
                 kernels::JobList& jobs, StageClock& clock);

// Integrates `order` bands of the masks and the digits into worker.local. The masks then hold all samples of
// which a digit is hidden.
void integrate_fading(const Frame& frame, const kernels::Batch& batch, uint32_t order, Worker& worker);

} // namespace nusselt
