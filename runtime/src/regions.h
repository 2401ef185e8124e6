// The receivers' stage of a frame: which receivers are computed, in regions of two to eight batches that
// share one look at all clusters.
#pragma once

#include "frame_data.h"

namespace nusselt {

// A run of a mesh's receivers, or of its duplicates.
struct Region {
    const MeshSlice& slice;
    const uint32_t* vertices;
    const uint32_t* originals; // of duplicates; null for receivers
    uint32_t count;
};
Region region_of(const Frame& frame, uint32_t region);
// Whether the region's i-th vertex needs a result, and one of its own.
bool is_wanted(const Region& region, uint32_t i);

// A sphere and a cone around all receivers of several batches, from the batches' bounds.
kernels::ReceiverBounds unite(const kernels::ReceiverBounds* batches, uint32_t count);

// Tasks of the frame's graph; `context` is the Frame.
void shadow_regions(void* context, uint32_t begin, uint32_t end, uint32_t slot);
// The same in the history's order: turns, of which there are at most eight a region.
void shadow_turns(void* context, uint32_t begin, uint32_t end, uint32_t slot);

} // namespace nusselt
