// Times of our frames.
#pragma once

#include "tools/commands/engine.h"

#include <vector>

namespace nusselt::tools {

struct Time {
    double min = 0, median = 0;
};
Time time_of(std::vector<double> values);

// A frame of ours with the time of the whole call. With one thread that thread's own clock tells the
// processor time, whatever the library's account leaves out; with more, the library's account is all there
// is.
FrameStats timed_frame(Engine& engine, const scenes::Pose& pose, Quality quality,
                       std::vector<float>& transfer);

void add_stats(FrameStats& sum, const FrameStats& frame);

} // namespace nusselt::tools
