#include "tools/compare/sizes.h"

#include "bench/scenes/builtin.h"
#include "tools/compare/grid.h"
#include "tools/compare/moment.h"
#include "tools/compare/peer.h"
#include "tools/report/stop.h"

#include <algorithm>
#include <cmath>
#include <iterator>

namespace nusselt::tools {

namespace {

// Of the hand's four seconds: opened. Three moments in turn, so that no frame repeats the one before it, or
// the one before of its quality.
constexpr double moment_times[] = {3.75, 3.8, 3.85};
constexpr uint32_t peer_side = 32;
constexpr size_t peer_receivers = 2048, peer_run = 64; // timed; scaled up to all
constexpr Quality qualities[] = {Quality::paper, Quality::draft, Quality::standard, Quality::fine};

} // namespace

std::vector<SizePoint> measure_sizes(const MeasureOptions& options, bool quick,
                                     const std::function<void(double, const char*)>& show) {
    const SampleGrid grid = scattered_grid(peer_side);
    // Triangles over those of the built-in scene, in steps of twice as many.
    const int first = -2, last = quick ? 1 : 3;
    std::vector<SizePoint> points;
    for (int step = first; step <= last && !interrupted(); ++step) {
        show(static_cast<double>(step - first) / (last + 1 - first), "sizes");
        const scenes::Scene scene =
            scenes::make_hand(scenes::hand_cell * static_cast<float>(std::exp2(-0.5 * step)));
        scenes::Pose poses[std::size(moment_times)];
        for (size_t k = 0; k < std::size(moment_times); ++k)
            scene.pose(moment_times[k], poses[k]);
        const Assembly all = assemble(scene, poses[0]);
        const std::vector<uint32_t> receivers = distinct_receivers(all);
        const std::vector<uint32_t> chosen = evenly(receivers, peer_receivers, peer_run);
        Engine engine(scene, {options.threads, options.isa, {}}, "hand");
        Peer peer(all, options.threads);
        peer.tune(all, receivers, {&grid});

        constexpr size_t ours = std::size(qualities);
        std::vector<double> us[ours + 1], wall[ours + 1];
        double rasterized[ours + 1] = {};
        std::vector<float> transfer;
        for (uint32_t repeat = 0; repeat <= options.repeats; ++repeat) {
            for (size_t k = 0; k <= ours && !interrupted(); ++k) {
                double cpu_ms = 0, wall_ms = 0, count = static_cast<double>(receivers.size());
                if (k < ours) {
                    const FrameStats stats =
                        timed_frame(engine, poses[(repeat + k) % std::size(poses)], qualities[k], transfer);
                    cpu_ms = stats.cpu_ms;
                    wall_ms = stats.wall_ms;
                    count = stats.receivers_computed;
                    rasterized[k] = static_cast<double>(stats.triangles_rasterized) / std::max(count, 1.0);
                } else if (repeat > 0) {
                    const PeerTime time = peer.frame(all, chosen, grid, PeerLoop::packets, transfer);
                    const double scale = count / static_cast<double>(std::max<size_t>(chosen.size(), 1));
                    cpu_ms = time.update_ms + (time.cpu_ms - time.update_ms) * scale;
                    wall_ms = time.update_wall_ms + (time.wall_ms - time.update_wall_ms) * scale;
                }
                // The first round warms up.
                if (repeat == 0) continue;
                us[k].push_back(1e3 * cpu_ms / std::max(count, 1.0));
                wall[k].push_back(wall_ms);
            }
        }
        if (interrupted()) break;
        for (size_t k = 0; k <= ours; ++k) {
            points.push_back({k < ours ? quality_name(qualities[k]) : "embree 1024", all.positions.size(),
                              all.indices.size() / 3, receivers.size(), time_of(us[k]), time_of(wall[k]),
                              rasterized[k]});
        }
    }
    return points;
}

} // namespace nusselt::tools
