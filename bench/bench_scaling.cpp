// 1 ... N threads x scenes x executors. Each prints the hash of its transfer vectors as its label; a hash
// that differs from the serial executor's ends the run with a failure: results must not depend on who
// computes them.
#include "bench/scenes/scene.h"
#include "nusselt/nusselt.h"

#include <benchmark/benchmark.h>

#include <algorithm>
#include <cstdio>
#include <cstring>
#include <map>
#include <memory>
#include <string>
#include <thread>
#include <vector>

namespace nusselt::bench {
namespace {

constexpr int moments = 3;
bool differed = false;

Vec3View view(const std::vector<glm::vec3>& vectors) {
    return {vectors.empty() ? nullptr : &vectors[0].x, vectors.size(), sizeof(glm::vec3)};
}

struct Subject {
    scenes::Scene scene;
    std::vector<scenes::Pose> poses;
    uint64_t hash = 0; // of the serial executor; 0: not known yet
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

// A context with the scene's meshes, on an executor.
struct World {
    Executor executor;
    Context* context = nullptr;
    std::vector<MeshId> meshes;
    std::vector<std::vector<float>> transfer;
    const char* error = nullptr;

    World(const scenes::Scene& scene, Executor e) : executor(e) {
        ContextDesc desc;
        desc.executor = executor;
        keep(create_context(desc, &context));
        for (const scenes::Mesh& mesh : scene.meshes) {
            if (error) return;
            MeshId id;
            keep(add_mesh(context,
                          {view(mesh.rest_positions), view(mesh.rest_normals), mesh.indices.data(),
                           mesh.indices.size()},
                          &id));
            meshes.push_back(id);
            transfer.emplace_back(mesh.rest_positions.size() * 25);
        }
    }
    ~World() {
        (void)destroy_context(context);
        destroy_executor(&executor);
    }
    World(const World&) = delete;
    World& operator=(const World&) = delete;

    void keep(const Status& status) {
        if (!status.ok() && !error) error = status.text;
    }
    FrameStats frame(const scenes::Pose& pose) {
        std::vector<FrameMesh> parts(meshes.size());
        for (size_t m = 0; m < meshes.size(); ++m) {
            parts[m].mesh = meshes[m];
            parts[m].positions = view(pose.positions[m]);
            parts[m].normals = view(pose.normals[m]);
            parts[m].transfer = {transfer[m].data(), transfer[m].size() / 25, 100};
        }
        FrameStats stats;
        FrameId id;
        keep(submit(context, {parts.data(), static_cast<uint32_t>(parts.size()), Quality::standard}, &id));
        if (!error) keep(wait(context, id, &stats));
        return stats;
    }
};

uint64_t hash_frames(World& world, const Subject& s) {
    uint64_t hash = 0xCBF29CE484222325u;
    for (const scenes::Pose& pose : s.poses) {
        world.frame(pose);
        for (const std::vector<float>& values : world.transfer) {
            for (const float value : values) {
                uint32_t word;
                std::memcpy(&word, &value, 4);
                hash = (hash ^ word) * 0x100000001B3u;
            }
        }
    }
    return hash;
}

void run(benchmark::State& state, const std::string& name, uint32_t threads) {
    Subject& s = subject(name);
    Executor executor = serial_executor();
    if (threads > 0) {
        const Status status = create_tbb_executor(threads, &executor);
        if (!status.ok()) return state.SkipWithError(status.text);
    }
    World world(s.scene, executor);
    if (world.error) return state.SkipWithError(world.error);
    const uint64_t hash = hash_frames(world, s);
    if (s.hash == 0) s.hash = hash;
    char text[32];
    std::snprintf(text, sizeof text, "hash %016llx", static_cast<unsigned long long>(hash));
    state.SetLabel(text);
    if (hash != s.hash) {
        differed = true;
        return state.SkipWithError("the result's hash differs from the first executor's");
    }
    uint32_t took_part = 0;
    double receivers = 0, cpu = 0;
    size_t turn = 0;
    for (auto _ : state) {
        const FrameStats stats = world.frame(s.poses[turn++ % s.poses.size()]);
        took_part = std::max(took_part, stats.threads);
        receivers += stats.receivers_computed;
        cpu += stats.cpu_ms;
    }
    state.SetItemsProcessed(static_cast<int64_t>(receivers));
    state.counters["threads_that_took_part"] = took_part;
    state.counters["cpu_us_per_receiver"] = receivers > 0 ? 1e3 * cpu / receivers : 0;
}

void register_all() {
    const uint32_t most = std::max(1u, std::thread::hardware_concurrency());
    for (const std::string& name : scenes::builtin_names()) {
        const auto add = [&](const std::string& executor, uint32_t threads) {
            benchmark::RegisterBenchmark(("scaling/" + name + "/" + executor).c_str(),
                                         [=](benchmark::State& state) { run(state, name, threads); })
                ->Unit(benchmark::kMillisecond)
                ->UseRealTime();
        };
        add("serial", 0);
        for (uint32_t threads = 1; threads <= most; ++threads)
            add("tbb/threads:" + std::to_string(threads), threads);
    }
}

} // namespace
} // namespace nusselt::bench

int main(int argc, char** argv) {
    benchmark::AddCustomContext("configuration", nusselt::configuration());
    nusselt::bench::register_all();
    benchmark::Initialize(&argc, argv);
    if (benchmark::ReportUnrecognizedArguments(argc, argv)) return 1;
    benchmark::RunSpecifiedBenchmarks();
    benchmark::Shutdown();
    return nusselt::bench::differed ? 1 : 0;
}
