// What a frame costs that needn't be computed, beside one that is: standard quality, one thread, built-in
// scenes. Compare within one run, by minimum or median.
#include "bench/program.h"
#include "bench/scenes/builtin.h"
#include "bench/scenes/scene.h"
#include "nusselt/nusselt.h"

#include <benchmark/benchmark.h>

#include <algorithm>
#include <iterator>
#include <stdexcept>
#include <string>
#include <vector>

namespace nusselt::bench {
namespace {

void must(const Status& status) {
    if (!status.ok()) throw std::runtime_error(status.text);
}

// A scene with arrays of its own, two poses of it, and a history.
struct World {
    scenes::Scene scene;
    scenes::Pose poses[3];
    Context* context = nullptr;
    std::vector<std::vector<float>> transfer;
    std::vector<std::vector<uint32_t>> needed;
    std::vector<FrameMesh> meshes;
    FrameDesc desc;

    explicit World(const std::string& name) : scene(scenes::builtin(name)) {
        must(create_context({}, &context));
        for (uint32_t k = 0; k < 2; ++k)
            scene.pose((0.3 + 0.01 * k) * scene.duration, poses[k]);
        // The first pose, but for a hundredth of each mesh's vertices.
        poses[2] = poses[0];
        for (size_t i = 0; i < scene.meshes.size(); ++i) {
            const size_t vertices = poses[2].positions[i].size();
            for (size_t v = vertices / 2; v < vertices / 2 + vertices / 100; ++v) {
                poses[2].positions[i][v] = poses[1].positions[i][v];
                poses[2].normals[i][v] = poses[1].normals[i][v];
            }
        }
        for (const scenes::Mesh& mesh : scene.meshes) {
            const size_t count = mesh.rest_positions.size();
            FrameMesh m;
            must(add_mesh(context,
                          {{&mesh.rest_positions[0].x, count, 12},
                           {mesh.rest_normals.empty() ? nullptr : &mesh.rest_normals[0].x, count, 12},
                           mesh.indices.data(),
                           mesh.indices.size()},
                          &m.mesh));
            transfer.emplace_back(25 * count);
            needed.emplace_back((count + 31) / 32, 0u);
            m.transfer = {transfer.back().data(), count, 100};
            meshes.push_back(m);
        }
        must(create_history(context, &desc.history));
        desc.meshes = meshes.data();
        desc.mesh_count = static_cast<uint32_t>(meshes.size());
    }
    ~World() { static_cast<void>(destroy_context(context)); }
    World(const World&) = delete;
    World& operator=(const World&) = delete;

    // The first mesh that moves at all.
    size_t mover() const {
        size_t i = 0;
        while (i + 1 < meshes.size() && poses[0].positions[i] == poses[1].positions[i])
            ++i;
        return i;
    }
    // Meshes [begin, end) in that pose, the others in the first.
    void pose(size_t begin, size_t end, size_t number) {
        for (size_t i = 0; i < meshes.size(); ++i) {
            const scenes::Pose& p = poses[i >= begin && i < end ? number : 0];
            meshes[i].positions = {&p.positions[i][0].x, p.positions[i].size(), 12};
            meshes[i].normals = {&p.normals[i][0].x, p.normals[i].size(), 12};
        }
    }
    // What faces a viewer far away along z.
    void need_what_faces() {
        Camera camera;
        camera.clip_from_position[15] = 1; // everything in the picture's middle
        camera.eye[2] = 1;
        for (size_t i = 0; i < meshes.size(); ++i) {
            must(mark_visible(camera, meshes[i].positions, scene.meshes[i].indices.data(),
                              scene.meshes[i].indices.size(), needed[i].data()));
            meshes[i].needed = needed[i].data();
        }
    }
    FrameStats frame() {
        FrameId id;
        FrameStats stats;
        must(submit(context, desc, &id));
        must(wait(context, id, &stats));
        return stats;
    }
};

enum class Kind {
    whole,
    facing_needed,
    three_bands,
    still,
    same_pose,
    a_hundredth_moves,
    one_moves,
    all_move,
    budget
};
constexpr const char* kind_names[] = {"whole",     "facing_needed", "three_bands",
                                      "still",     "same_pose",     "a_hundredth_moves",
                                      "one_moves", "all_move",      "budget_tenth"};

void run(benchmark::State& state, const std::string& name, Kind kind) {
    World world(name);
    const HistoryId history = world.desc.history;
    world.pose(0, 0, 0);
    world.desc.history = {};
    const double whole_ms = std::min(world.frame().wall_ms, world.frame().wall_ms);
    if (kind >= Kind::still) world.desc.history = history;
    if (kind == Kind::facing_needed) world.need_what_faces();
    if (kind == Kind::three_bands) world.desc.order = 3;
    world.frame();
    if (kind == Kind::same_pose) world.desc.same_pose = true;
    if (kind == Kind::budget) world.desc.budget_us = static_cast<float>(100 * whole_ms);
    const bool moves = kind >= Kind::a_hundredth_moves;
    const size_t to = kind == Kind::a_hundredth_moves ? 2 : 1;
    const size_t first = kind == Kind::one_moves ? world.mover() : 0;
    const size_t end = kind == Kind::one_moves ? first + 1 : world.meshes.size();
    size_t turn = 0;
    double computed = 0, all = 0, stale = 0;
    for (auto _ : state) {
        if (moves) world.pose(first, end, ++turn % 2 ? to : 0);
        const FrameStats stats = world.frame();
        computed += stats.receivers_computed;
        all += stats.receivers + stats.receivers_unneeded;
        stale += stats.receivers_stale;
    }
    state.counters["computed_of_all"] = computed / all;
    state.counters["stale_of_all"] = stale / all;
}

void shade_bands(benchmark::State& state, uint32_t bands) {
    World world("hand");
    world.pose(0, 0, 0);
    world.frame();
    float light[75] = {};
    for (uint32_t i = 0; i < 3 * bands * bands; ++i)
        light[i] = 1;
    const size_t count = world.meshes[0].transfer.count;
    std::vector<float> rgb(3 * count);
    for (auto _ : state) {
        must(shade(world.context, light, world.meshes[0].transfer, {}, rgb.data()));
        benchmark::DoNotOptimize(rgb.data());
    }
    state.SetItemsProcessed(static_cast<int64_t>(state.iterations() * count));
}

} // namespace

void register_all() {
    for (const std::string& name : scenes::builtin_names()) {
        for (uint32_t kind = 0; kind < std::size(kind_names); ++kind) {
            benchmark::RegisterBenchmark(
                ("skip/" + name + "/" + kind_names[kind]).c_str(),
                [=](benchmark::State& state) { run(state, name, static_cast<Kind>(kind)); })
                ->Unit(benchmark::kMillisecond);
        }
    }
    for (const uint32_t bands : {1u, 3u, 5u})
        benchmark::RegisterBenchmark(("shade/bands:" + std::to_string(bands)).c_str(),
                                     [=](benchmark::State& state) { shade_bands(state, bands); })
            ->Unit(benchmark::kMillisecond);
}

} // namespace nusselt::bench
