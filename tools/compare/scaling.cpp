#include "tools/compare/scaling.h"

#include "tools/compare/timing.h"
#include "tools/report/failure.h"
#include "tools/report/stop.h"

#include <algorithm>
#include <cstring>
#include <memory>
#include <thread>

namespace nusselt::tools {

namespace {

uint64_t hash_of(const std::vector<float>& values, uint64_t hash) {
    // FNV-1a over the words.
    for (const float value : values) {
        uint32_t word;
        std::memcpy(&word, &value, 4);
        hash = (hash ^ word) * 0x100000001B3u;
    }
    return hash;
}
constexpr uint64_t hash_start = 0xCBF29CE484222325u;

} // namespace

void measure_scaling(const scenes::Scene& scene, const MeasureOptions& options,
                     const std::vector<Moment>& moments, SceneReport& report) {
    const uint32_t most =
        options.scaling_threads ? options.scaling_threads : std::max(1u, std::thread::hardware_concurrency());
    std::vector<std::unique_ptr<Engine>> engines;
    try {
        for (uint32_t threads = 1; threads <= most; threads = threads < 4 ? threads + 1 : threads * 2)
            engines.push_back(
                std::make_unique<Engine>(scene, EngineOptions{threads, options.isa, {}}, scene.name));
    } catch (const Failure& failure) {
        // A build without TBB.
        report.notes.push_back(std::string("scaling: ") + failure.what());
    }
    const Quality qualities[] = {Quality::standard, Quality::fine};
    std::vector<std::vector<double>> wall(engines.size() * 2), us(engines.size() * 2);
    std::vector<ScalingPoint> points(engines.size() * 2);
    std::vector<float> transfer;
    for (uint32_t repeat = 0; repeat <= options.repeats; ++repeat) {
        for (size_t k = 0; k < points.size(); ++k) {
            if (interrupted()) return;
            Engine& engine = *engines[k / 2];
            ScalingPoint& point = points[k];
            point.entry = quality_name(qualities[k % 2]);
            point.threads = engine.threads();
            point.hash = hash_start;
            double total_wall = 0, total_cpu = 0, receivers = 0, frames = 0;
            for (const Moment& moment : moments) {
                if (moment.follows) continue;
                const FrameStats stats = timed_frame(engine, moment.pose, qualities[k % 2], transfer);
                point.hash = hash_of(transfer, point.hash);
                point.took_part = std::max(point.took_part, stats.threads);
                total_wall += stats.wall_ms;
                total_cpu += stats.cpu_ms;
                receivers += stats.receivers_computed;
                ++frames;
            }
            // The first round warms up.
            if (repeat == 0) continue;
            wall[k].push_back(total_wall / frames);
            us[k].push_back(receivers > 0 ? 1e3 * total_cpu / receivers : 0);
        }
    }
    for (size_t k = 0; k < points.size(); ++k) {
        points[k].wall_ms = time_of(wall[k]);
        points[k].us = time_of(us[k]);
        report.scaling.push_back(points[k]);
    }
}

} // namespace nusselt::tools
