// Cost against size: one shape, meshed finer and finer, so that nothing but the size changes.
#pragma once

#include "tools/compare/measure.h"

#include <functional>
#include <string>
#include <vector>

namespace nusselt::tools {

struct SizePoint {
    std::string entry;
    uint64_t vertices = 0, triangles = 0, receivers = 0;
    Time us, wall_ms;                // as in Entry
    double triangles_rasterized = 0; // a receiver; ours
};

// The built-in hand, opened (the last frame but a few), from a quarter of its triangles to eight times as
// many
// (`quick`: to twice), every quality and the peer with 1024 rays. Stops when interrupted, with what is done.
std::vector<SizePoint> measure_sizes(const MeasureOptions& options, bool quick,
                                     const std::function<void(double, const char*)>& show);

} // namespace nusselt::tools
