// The receivers' stage of a frame: which receivers are computed, in regions of two to eight batches that share one
// look at all clusters.
#pragma once

#include "frame_data.h"

namespace nusselt {

// Tasks of the frame's graph; `context` is the Frame.
void shadow_regions(void* context, uint32_t begin, uint32_t end, uint32_t slot);
void copy_duplicates(void* context, uint32_t begin, uint32_t end, uint32_t slot); // chunks of 16 duplicates

} // namespace nusselt
