// The stages of a frame as a task graph.
#pragma once

#include "frame_data.h"

namespace nusselt {

constexpr uint32_t most_stages = 12;

// Builds the graph of the frame's crew, anew for each frame.
void plan(Frame& frame);

} // namespace nusselt
