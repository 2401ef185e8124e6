#include "tools/compare/timing.h"

#include "tools/compare/clock.h"

#include <algorithm>
#include <cstddef>

namespace nusselt::tools {

Time time_of(std::vector<double> values) {
    if (values.empty()) return {};
    std::sort(values.begin(), values.end());
    const size_t n = values.size();
    return {values.front(), (values[(n - 1) / 2] + values[n / 2]) / 2};
}

void add_stats(FrameStats& sum, const FrameStats& s) {
    sum.receivers += s.receivers;
    sum.receivers_computed += s.receivers_computed;
    sum.receivers_copied += s.receivers_copied;
    sum.receivers_inside += s.receivers_inside;
    sum.receivers_invalid += s.receivers_invalid;
    sum.clusters_tested += s.clusters_tested;
    sum.clusters_rasterized += s.clusters_rasterized;
    sum.triangles_considered += s.triangles_considered;
    sum.triangles_rasterized += s.triangles_rasterized;
    sum.fan_triangles += s.fan_triangles;
    sum.blocks_uniform += s.blocks_uniform;
    sum.blocks_partial += s.blocks_partial;
    sum.triangles_invalid += s.triangles_invalid;
    sum.threads = std::max(sum.threads, s.threads);
    sum.wall_ms += s.wall_ms;
    sum.cpu_ms += s.cpu_ms;
    sum.refit_ms += s.refit_ms;
    sum.cull_ms += s.cull_ms;
    sum.transform_ms += s.transform_ms;
    sum.raster_ms += s.raster_ms;
    sum.integrate_ms += s.integrate_ms;
    sum.rotate_ms += s.rotate_ms;
}

FrameStats timed_frame(Engine& engine, const scenes::Pose& pose, Quality quality,
                       std::vector<float>& transfer) {
    const double wall = wall_ms(), cpu = cpu_ms();
    FrameStats stats = engine.frame(pose, quality, transfer);
    stats.wall_ms = wall_ms() - wall;
    if (engine.threads() == 1) stats.cpu_ms = cpu_ms() - cpu;
    return stats;
}

} // namespace nusselt::tools
