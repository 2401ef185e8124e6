// Frames with a history: what changed since the last one, in which order it is computed, and what is kept.
#pragma once

#include "context_data.h"

namespace nusselt {

// Whether the group is that of the history's last frame.
bool is_same_group(const Frame& frame, const FrameDesc& desc);
// To be called before the frame is laid out: another group's arrays are then nobody's.
void compare_group(Frame& frame, const FrameDesc& desc);
// Sizes the history's arrays, where its group is new. Throws std::bad_alloc.
void meet_history(Frame& frame, const FrameDesc& desc);

// Tasks of the frame's graph; `context` is the Frame. The mesh-wide stages (refit.h), where something moved:
void start_clock(void* context, uint32_t begin, uint32_t end, uint32_t slot);
void place_and_compare(void* context, uint32_t begin, uint32_t end, uint32_t slot);    // chunks of points
void refit_moved_clusters(void* context, uint32_t begin, uint32_t end, uint32_t slot); // clusters
void choose_moved_bands(void* context, uint32_t begin, uint32_t end, uint32_t slot);   // meshes
// What of the batches has to be computed, and in which order:
void gather_disturbed(void* context, uint32_t begin, uint32_t end, uint32_t slot); // one item
void find_changes(void* context, uint32_t begin, uint32_t end, uint32_t slot);     // regions
void order_turns(void* context, uint32_t begin, uint32_t end, uint32_t slot);      // one item
// After the receivers:
void write_kept(void* context, uint32_t begin, uint32_t end, uint32_t slot); // regions

} // namespace nusselt
