// Whole frames: scene x quality x threads, rotating over moments of the animation. Time is the call's; CPU
// microseconds a receiver are the library's own account.
#include "bench/program.h"
#include "bench/scenes/scene.h"
#include "tools/commands/engine.h"
#include "tools/report/failure.h"

#include <benchmark/benchmark.h>

#include <algorithm>
#include <cstdio>
#include <map>
#include <memory>
#include <string>
#include <thread>

namespace nusselt::bench {
namespace {

constexpr int moments = 4;

struct Subject {
    scenes::Scene scene;
    std::vector<scenes::Pose> poses;
    std::map<uint32_t, std::unique_ptr<tools::Engine>> engines; // by threads
};

Subject& subject(const std::string& name) {
    static std::map<std::string, Subject> subjects;
    Subject& made = subjects[name];
    if (made.poses.empty()) {
        made.scene = scenes::builtin(name);
        made.poses.resize(moments);
        for (int k = 0; k < moments; ++k)
            made.scene.pose(made.scene.duration * (k + 0.5) / moments, made.poses[static_cast<size_t>(k)]);
    }
    return made;
}

void run_frame(benchmark::State& state, const std::string& name, Quality quality, uint32_t threads) {
    try {
        Subject& s = subject(name);
        std::unique_ptr<tools::Engine>& engine = s.engines[threads];
        if (!engine)
            engine = std::make_unique<tools::Engine>(s.scene, tools::EngineOptions{.threads = threads}, name);
        std::vector<float> transfer;
        for (const scenes::Pose& pose : s.poses)
            engine->frame(pose, quality, transfer);
        double cpu = 0, receivers = 0, rasterized = 0;
        size_t turn = 0;
        for (auto _ : state) {
            const FrameStats stats = engine->frame(s.poses[turn++ % s.poses.size()], quality, transfer);
            cpu += stats.cpu_ms;
            receivers += stats.receivers_computed;
            rasterized += static_cast<double>(stats.triangles_rasterized);
        }
        state.SetItemsProcessed(static_cast<int64_t>(receivers));
        state.counters["cpu_us_per_receiver"] = receivers > 0 ? 1e3 * cpu / receivers : 0;
        state.counters["triangles_per_receiver"] = receivers > 0 ? rasterized / receivers : 0;
    } catch (const tools::Failure& failure) {
        state.SkipWithError(failure.what());
    }
}

} // namespace

void register_all() {
    const uint32_t most = std::max(1u, std::thread::hardware_concurrency());
    for (const std::string& name : scenes::builtin_names()) {
        for (const Quality quality : {Quality::paper, Quality::draft, Quality::standard, Quality::fine}) {
            for (uint32_t threads = 1; threads <= most; threads = threads < most ? most : most + 1) {
                benchmark::RegisterBenchmark(
                    ("frame/" + name + "/" + quality_name(quality) + "/threads:" + std::to_string(threads))
                        .c_str(),
                    [=](benchmark::State& state) { run_frame(state, name, quality, threads); })
                    ->Unit(benchmark::kMillisecond)
                    ->UseRealTime();
            }
        }
    }
}

} // namespace nusselt::bench
