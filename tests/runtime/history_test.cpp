// Histories: what is kept is what would have been computed, bit for bit, and what did not change costs
// nothing.
#include "tests/runtime/fixture.h"

#include "tests/jobs/executors.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstring>
#include <limits>
#include <thread>

#include <glm/geometric.hpp>
#include <glm/gtc/matrix_transform.hpp>
#include <glm/mat3x3.hpp>

namespace nusselt::test {

namespace {

struct Remembering {
    Context* context;
    FrameDesc settings;

    explicit Remembering(Context* c, Quality quality = Quality::standard) : context(c) {
        settings.quality = quality;
        const Status status = create_history(context, &settings.history);
        EXPECT_TRUE(status.ok()) << status.text;
    }
    ~Remembering() { EXPECT_TRUE(remove_history(context, settings.history).ok()); }
    Remembering(const Remembering&) = delete;
    Remembering& operator=(const Remembering&) = delete;

    Outputs frame(const std::vector<Posed>& meshes) { return run_frame(context, meshes, settings); }
};

void expect_all_reused(const FrameStats& s) {
    EXPECT_EQ(s.receivers_computed, 0u);
    EXPECT_EQ(s.receivers_reused + s.receivers_copied, s.receivers);
    EXPECT_EQ(s.receivers_written, s.receivers);
    EXPECT_EQ(s.receivers_stale, 0u);
    EXPECT_EQ(s.clusters_tested, 0u);
    EXPECT_EQ(s.triangles_considered, 0u);
    EXPECT_EQ(s.fan_triangles, 0u);
    EXPECT_EQ(s.blocks_uniform + s.blocks_partial, 0u);
}

TEST(History, WhatStandsStillCostsNothing) {
    Engine engine;
    for (const char* name : {"hand", "chess"}) {
        const scenes::Scene scene = scenes::builtin(name);
        const std::vector<MeshId> ids = add_all(engine.context, scene);
        const std::vector<Posed> frame = posed(scene, ids, 0.3 * scene.duration);
        for (const Quality quality : {Quality::draft, Quality::paper}) {
            const Outputs plain = run_frame(engine.context, frame, quality);
            Remembering memory(engine.context, quality);
            const Outputs first = memory.frame(frame);
            EXPECT_EQ(first, plain);
            EXPECT_EQ(first.stats.receivers_computed, plain.stats.receivers_computed);
            EXPECT_EQ(first.stats.receivers_reused, 0u);
            for (const bool same_pose : {false, true}) {
                memory.settings.same_pose = same_pose;
                const Outputs again = memory.frame(frame);
                EXPECT_EQ(again, plain);
                expect_all_reused(again.stats);
                EXPECT_LT(again.stats.cpu_ms, 0.2 * first.stats.cpu_ms);
            }
        }
        for (const MeshId id : ids)
            EXPECT_TRUE(remove_mesh(engine.context, id).ok());
    }
}

// One thing moves in a room: what cannot see it is kept.
TEST(History, WhatCannotSeeTheMovementIsKept) {
    Engine engine;
    const scenes::Mesh floor = scenes::plane(16, 80);
    scenes::Mesh near = scenes::torus(0.1f, 0.04f, 24, 12), far = near;
    std::vector<Posed> frame{at_rest(add(engine.context, floor), floor),
                             at_rest(add(engine.context, near), near),
                             at_rest(add(engine.context, far), far)};
    for (glm::vec3& p : frame[1].positions)
        p += glm::vec3(-6, 0.15f, -6);
    for (glm::vec3& p : frame[2].positions)
        p += glm::vec3(6, 0.05f, 6);
    Remembering memory(engine.context);
    memory.frame(frame);
    for (int step = 0; step < 6; ++step) {
        for (glm::vec3& p : frame[1].positions)
            p.x += 0.01f;
        const Outputs kept = memory.frame(frame);
        EXPECT_EQ(kept, run_frame(engine.context, frame));
        EXPECT_GT(kept.stats.receivers_reused, kept.stats.receivers / 2);
        EXPECT_GT(kept.stats.receivers_computed, near.rest_positions.size() / 2);
        EXPECT_GT(kept.stats.clusters_kept, 0u);
    }
    // As little as can be seen.
    for (glm::vec3& p : frame[2].positions)
        p.y += 1e-4f;
    EXPECT_EQ(memory.frame(frame), run_frame(engine.context, frame));
}

struct Script {
    std::vector<Posed> frame;
    Random random;

    Posed& some_mesh() { return frame[random.below(uint32_t(frame.size()))]; }

    void move_mesh() {
        const glm::vec3 by = 0.1f * random.direction();
        for (glm::vec3& p : some_mesh().positions)
            p += by;
    }
    void move_vertices() {
        Posed& mesh = some_mesh();
        const uint32_t count = uint32_t(mesh.positions.size()), first = random.below(count);
        for (uint32_t i = 0; i < 1 + random.below(8); ++i)
            mesh.positions[(first + i) % count] += 0.02f * random.direction();
    }
    void turn_normals() {
        Posed& mesh = some_mesh();
        for (uint32_t i = 0; i < 1 + random.below(4); ++i)
            mesh.normals[random.below(uint32_t(mesh.normals.size()))] = random.direction();
    }
    void break_vertex() {
        Posed& mesh = some_mesh();
        const uint32_t v = random.below(uint32_t(mesh.positions.size()));
        const float bad[] = {std::numeric_limits<float>::quiet_NaN(), std::numeric_limits<float>::infinity(),
                             3e38f};
        (random.below(2) ? mesh.positions : mesh.normals)[v][int(random.below(3))] = bad[random.below(3)];
    }
    void mend(const std::vector<Posed>& rest) {
        for (size_t m = 0; m < frame.size(); ++m) {
            for (size_t v = 0; v < frame[m].positions.size(); ++v) {
                if (!(glm::length(frame[m].positions[v]) < 100)) frame[m].positions[v] = rest[m].positions[v];
                if (!(glm::length(frame[m].normals[v]) < 100)) frame[m].normals[v] = rest[m].normals[v];
            }
        }
    }
    void change_needs() {
        Posed& mesh = some_mesh();
        if (random.below(3) == 0) {
            mesh.needed.clear();
            return;
        }
        mesh.needed.assign((mesh.positions.size() + 31) / 32, 0);
        for (uint32_t& word : mesh.needed)
            word = uint32_t(random.engine()) | (random.below(2) ? 0xFFFF0000u : 0);
    }
    void edit(const std::vector<Posed>& rest) {
        switch (random.below(9)) {
        case 0:
        case 1:
            return move_mesh();
        case 2:
        case 3:
            return move_vertices();
        case 4:
            return turn_normals();
        case 5:
            return break_vertex();
        case 6:
            return mend(rest);
        case 7:
            return change_needs();
        default:
            return; // nothing at all
        }
    }
};

// Random edits; after each one, the kept and the newly computed together are the whole frame.
TEST(History, RandomEditsAreInvisible) {
    scenes::Mesh floor = scenes::plane(4, 12), ball = scenes::sphere(2),
                 ring = scenes::torus(0.5f, 0.2f, 20, 10);
    for (size_t v = 0, count = ball.rest_positions.size(); v < count; v += 2) { // with duplicates
        ball.rest_positions.push_back(ball.rest_positions[v]);
        ball.rest_normals.push_back(ball.rest_normals[v]);
    }
    Engine engine;
    uint64_t reused = 0, computed = 0;
    for (uint32_t seed = 0; seed < 40; ++seed) {
        const Quality quality = seed % 4 == 0   ? Quality::paper
                                : seed % 4 == 1 ? Quality::draft
                                                : Quality::standard;
        Script script{{}, Random(seed)};
        std::vector<Posed>& frame = script.frame;
        for (const scenes::Mesh* mesh : {&floor, &ball, &ring})
            frame.push_back(at_rest(add(engine.context, *mesh), *mesh));
        for (glm::vec3& p : frame[1].positions)
            p = p * 0.3f + glm::vec3(0.7f, 0.4f, 0);
        for (glm::vec3& p : frame[2].positions)
            p += glm::vec3(-0.6f, 0.3f, 0.2f);
        const std::vector<Posed> rest = frame;
        frame[2].receives = seed % 3 != 0;
        Remembering memory(engine.context, quality);
        const float origin[3] = {0, 0, 0};
        if (seed % 2) memory.settings.origin = origin;
        for (uint32_t step = 0; step < 25; ++step) {
            FrameDesc whole = memory.settings;
            whole.history = {};
            const Outputs kept = memory.frame(frame), expected = run_frame(engine.context, frame, whole);
            ASSERT_EQ(kept, expected) << "seed " << seed << " step " << step;
            const FrameStats& s = kept.stats;
            ASSERT_EQ(s.receivers_computed + s.receivers_reused + s.receivers_copied, s.receivers);
            ASSERT_EQ(s.triangles_invalid, expected.stats.triangles_invalid);
            reused += s.receivers_reused;
            computed += s.receivers_computed;
            script.edit(rest);
        }
        for (const Posed& mesh : frame)
            EXPECT_TRUE(remove_mesh(engine.context, mesh.mesh).ok());
    }
    EXPECT_GT(reused, computed / 4);
}

// One vertex alone: whatever a level's distances are measured from has to be known as moved.
TEST(History, OneVertexAtATimeIsInvisible) {
    scenes::Mesh ring = scenes::torus(0.5f, 0.2f, 60, 30);
    Random random(20);
    for (glm::vec3& p : ring.rest_positions)
        p += 0.02f * random.direction();
    Engine engine;
    std::vector<Posed> frame = {at_rest(add(engine.context, ring), ring)};
    const std::vector<glm::vec3> rest = frame[0].positions;
    Remembering memory(engine.context, Quality::standard);
    FrameDesc whole = memory.settings;
    whole.history = {};
    uint32_t last = 0;
    for (uint32_t step = 0; step < cases(200); ++step) {
        frame[0].positions[last] = rest[last];
        last = random.below(static_cast<uint32_t>(rest.size()));
        frame[0].positions[last] += random.between(0.05f, 0.3f) * random.direction();
        ASSERT_EQ(memory.frame(frame), run_frame(engine.context, frame, whole)) << "step " << step;
    }
}

TEST(History, ScenesInMotion) {
    TestExecutor own({"pool", Order::fifo, 2, 3}); // where there is no oneTBB, as for the thread sanitizer
    Executor executor;
    const bool tbb = create_tbb_executor(3, &executor).ok();
    if (!tbb) executor = own.hook();
    {
        ContextDesc desc;
        desc.executor = executor;
        Engine engine(desc);
        for (const char* name : {"chess", "fight"}) {
            const scenes::Scene scene = scenes::builtin(name);
            const std::vector<MeshId> ids = add_all(engine.context, scene);
            Remembering memory(engine.context, Quality::draft);
            for (int i = 0; i < 6; ++i) {
                const std::vector<Posed> frame = posed(scene, ids, (0.3 + 0.01 * (i / 2)) * scene.duration);
                const Outputs kept = memory.frame(frame);
                ASSERT_EQ(kept, run_frame(engine.context, frame, Quality::draft)) << name << " " << i;
                if (i % 2) expect_all_reused(kept.stats);
            }
            for (const MeshId id : ids)
                EXPECT_TRUE(remove_mesh(engine.context, id).ok());
        }
    }
    if (tbb) destroy_executor(&executor);
}

// Whatever a history's frames differ in, the results are those of a frame without one.
TEST(History, AnotherGroupBeginsAnew) {
    Engine engine;
    const scenes::Mesh torus = scenes::torus(1, 0.4f, 20, 10), ball = scenes::sphere(2);
    const MeshId a = add(engine.context, torus), b = add(engine.context, ball);
    Remembering memory(engine.context);
    const auto expect_new = [&](const std::vector<Posed>& frame) {
        const Outputs out = memory.frame(frame);
        EXPECT_EQ(out, run_frame(engine.context, frame, memory.settings.quality));
        EXPECT_EQ(out.stats.receivers_reused, 0u);
        expect_all_reused(memory.frame(frame).stats);
    };
    std::vector<Posed> both{at_rest(a, torus), at_rest(b, ball)};
    expect_new({at_rest(a, torus)});
    expect_new({at_rest(b, ball)});
    expect_new(both);
    both[1].receives = false;
    expect_new(both);
    std::swap(both[0], both[1]);
    expect_new(both);
    memory.settings.quality = Quality::fine;
    expect_new(both);
    memory.settings.quality = Quality::standard;
    expect_new(both);
    // The same slot, another mesh.
    EXPECT_TRUE(remove_mesh(engine.context, b).ok());
    both[0].mesh = add(engine.context, ball);
    EXPECT_EQ(both[0].mesh.slot, b.slot);
    expect_new(both);
}

Status submit_and_wait(Context* context, const FrameDesc& desc, FrameStats* stats = nullptr) {
    FrameId id;
    const Status started = submit(context, desc, &id);
    return started.ok() ? wait(context, id, stats) : started;
}

// A rigid motion of the whole: the mesh stays in its own space, and only the light turns.
TEST(History, RigidMotionTurnsTheLight) {
    Engine engine;
    const scenes::Scene scene = scenes::builtin("hand");
    const std::vector<MeshId> ids = add_all(engine.context, scene);
    const std::vector<Posed> object = posed(scene, ids, 0.2);
    Remembering memory(engine.context);
    const Outputs first = memory.frame(object);

    const glm::mat3 turn(glm::rotate(glm::mat4(1), 0.7f, glm::normalize(glm::vec3(1, 2, 3))));
    std::vector<Posed> world = object;
    for (glm::vec3& p : world[0].positions)
        p = turn * p + glm::vec3(3, -2, 1);
    for (glm::vec3& n : world[0].normals)
        n = turn * n;
    const Outputs in_world = run_frame(engine.context, world);

    // Positions are not even read.
    const size_t count = object[0].positions.size();
    Output kept;
    kept.transfer.resize(count);
    FrameMesh mesh;
    mesh.mesh = ids[0];
    mesh.transfer = {kept.transfer[0].data(), count, 100};
    kept.masks.resize(32 * count);
    mesh.masks = {kept.masks.data(), count, 128};
    FrameDesc desc = memory.settings;
    desc.meshes = &mesh;
    desc.mesh_count = 1;
    desc.same_pose = true;
    FrameStats stats;
    ASSERT_TRUE(submit_and_wait(engine.context, desc, &stats).ok());
    expect_all_reused(stats);
    EXPECT_EQ(kept, first.meshes[0]);

    float light[75] = {};
    Random random(5);
    for (float& value : light)
        value = random.between(-0.2f, 0.2f);
    for (int c = 0; c < 3; ++c)
        light[c] = 3;
    const float object_to_world[9] = {turn[0][0], turn[1][0], turn[2][0], turn[0][1], turn[1][1],
                                      turn[2][1], turn[0][2], turn[1][2], turn[2][2]};
    float turned[75];
    turn_light(object_to_world, light, turned);
    std::vector<float> one(3 * count), other(3 * count);
    ASSERT_TRUE(shade(engine.context, turned, mesh.transfer, {}, one.data()).ok());
    const TransferView world_view{const_cast<float*>(in_world.meshes[0].transfer[0].data()), count, 100};
    ASSERT_TRUE(shade(engine.context, light, world_view, {}, other.data()).ok());
    double error = 0;
    for (size_t i = 0; i < one.size(); ++i)
        error += std::fabs(double(one[i]) - double(other[i]));
    // The world's masks are sampled in other directions.
    EXPECT_LT(error / double(one.size()), 0.01);
}

// Holds a frame at the n-th piece of a stage, until it is let go.
struct Hold {
    const char* zone = "";
    std::atomic<int> at = 0, seen = 0;
    std::atomic<bool> held = false;

    Profiler hook() {
        return {this,
                [](void* user, const char* name) {
                    Hold& hold = *static_cast<Hold*>(user);
                    if (std::strcmp(name, hold.zone) != 0 || ++hold.seen != hold.at) return;
                    hold.held = true;
                    while (hold.held)
                        std::this_thread::yield();
                },
                [](void*, const char*) {}};
    }
};

TEST(History, CancelledFramesLeaveNothingBehind) {
    TestExecutor executor({"", Order::fifo, 1, 1});
    Hold hold;
    ContextDesc with;
    with.executor = executor.hook();
    with.profiler = hold.hook();
    Engine engine(with);
    const scenes::Mesh torus = scenes::torus(1, 0.4f, 60, 30);
    const size_t count = torus.rest_positions.size();
    std::vector<Posed> frame{at_rest(add(engine.context, torus), torus)};
    Remembering memory(engine.context);
    memory.frame(frame);
    std::vector<float> transfer(25 * count);
    std::vector<uint32_t> masks(32 * count);
    for (const char* zone : {"nusselt points", "nusselt clusters", "nusselt changes", "nusselt receivers"}) {
        for (glm::vec3& p : frame[0].positions)
            p.y *= 1.1f;
        const FrameMesh mesh{frame[0].mesh,
                             {&frame[0].positions[0].x, count, 12},
                             {&frame[0].normals[0].x, count, 12},
                             {transfer.data(), count, 100},
                             {masks.data(), count, 128}};
        FrameDesc desc = memory.settings;
        desc.meshes = &mesh;
        desc.mesh_count = 1;
        hold.zone = zone;
        hold.seen = 0;
        hold.at = 1;
        FrameId id;
        FrameStats stats;
        ASSERT_TRUE(submit(engine.context, desc, &id).ok());
        while (!hold.held)
            std::this_thread::yield();
        ASSERT_TRUE(cancel(engine.context, id).ok());
        hold.at = 0;
        hold.held = false;
        ASSERT_TRUE(wait(engine.context, id, &stats).ok());
        EXPECT_LT(stats.receivers_written, stats.receivers) << zone;
        desc.same_pose = true;
        EXPECT_EQ(submit(engine.context, desc, &id).code, StatusCode::invalid_argument);
        EXPECT_EQ(memory.frame(frame), run_frame(engine.context, frame)) << zone;
        expect_all_reused(memory.frame(frame).stats);
    }
    EXPECT_EQ(executor.broken(), "");
}

TEST(History, HandlesAndArguments) {
    Engine engine;
    HistoryId id, other;
    EXPECT_EQ(create_history(nullptr, &id).code, StatusCode::invalid_argument);
    EXPECT_EQ(create_history(engine.context, nullptr).code, StatusCode::invalid_argument);
    ASSERT_TRUE(create_history(engine.context, &id).ok());
    ASSERT_TRUE(create_history(engine.context, &other).ok());
    EXPECT_EQ(remove_history(nullptr, id).code, StatusCode::invalid_argument);
    EXPECT_EQ(remove_history(engine.context, {}).code, StatusCode::stale_handle);
    EXPECT_TRUE(remove_history(engine.context, other).ok());
    EXPECT_EQ(remove_history(engine.context, other).code, StatusCode::stale_handle);

    const scenes::Mesh torus = scenes::torus(1, 0.4f, 20, 10);
    const MeshId a = add(engine.context, torus), b = add(engine.context, torus);
    const Vec3View positions{&torus.rest_positions[0].x, torus.rest_positions.size(), 12},
        normals{&torus.rest_normals[0].x, torus.rest_normals.size(), 12};
    std::vector<float> transfer(25 * positions.count);
    FrameMesh mesh{a, positions, normals, {transfer.data(), positions.count, 100}, {}};
    FrameDesc desc;
    desc.meshes = &mesh;
    desc.mesh_count = 1;
    FrameId frame, second;
    const auto code = [&](const FrameDesc& d) { return submit(engine.context, d, &second).code; };

    desc.same_pose = true;
    EXPECT_EQ(code(desc), StatusCode::invalid_argument); // no history
    desc.history = id;
    EXPECT_EQ(code(desc), StatusCode::invalid_argument); // no pose yet
    desc.same_pose = false;
    desc.history = other;
    EXPECT_EQ(code(desc), StatusCode::stale_handle);
    desc.history = {};
    desc.budget_us = 100;
    EXPECT_EQ(code(desc), StatusCode::invalid_argument);
    desc.history = id;
    for (const float bad : {-1.0f, std::numeric_limits<float>::quiet_NaN(), 1e30f}) {
        desc.budget_us = bad;
        EXPECT_EQ(code(desc), StatusCode::invalid_argument);
    }
    desc.budget_us = 0;
    const float nowhere[3] = {0, std::numeric_limits<float>::infinity(), 0};
    desc.origin = nowhere;
    EXPECT_EQ(code(desc), StatusCode::invalid_argument);
    desc.origin = nullptr;

    ASSERT_TRUE(submit(engine.context, desc, &frame).ok());
    FrameMesh elsewhere = mesh;
    elsewhere.mesh = b;
    FrameDesc meanwhile = desc;
    meanwhile.meshes = &elsewhere;
    EXPECT_EQ(code(meanwhile), StatusCode::busy);
    EXPECT_EQ(remove_history(engine.context, id).code, StatusCode::busy);
    ASSERT_TRUE(wait(engine.context, frame, nullptr).ok());
    desc.same_pose = true;
    EXPECT_TRUE(submit_and_wait(engine.context, desc).ok());
    std::vector<uint32_t> masks(32 * positions.count);
    mesh.masks = {masks.data(), positions.count, 128};
    EXPECT_EQ(code(desc), StatusCode::invalid_argument); // masks were not kept
    EXPECT_TRUE(remove_history(engine.context, id).ok());
    EXPECT_EQ(code(desc), StatusCode::stale_handle);
}

// ---- orders ----

TEST(Order, FewerBandsHaveTheBitsOfAll) {
    Engine engine;
    const scenes::Scene scene = scenes::builtin("fight");
    const std::vector<MeshId> ids = add_all(engine.context, scene);
    std::vector<Posed> frame = posed(scene, ids, 0.3);
    const Outputs all = run_frame(engine.context, frame);
    for (uint32_t order = 1; order <= 5; ++order) {
        Remembering memory(engine.context);
        memory.settings.order = order;
        for (const bool again : {false, true}) {
            const Outputs few = memory.frame(frame);
            if (again) expect_all_reused(few.stats);
            for (size_t m = 0; m < frame.size(); ++m) {
                ASSERT_EQ(few.meshes[m].masks, all.meshes[m].masks);
                for (size_t v = 0; v < frame[m].positions.size(); ++v) {
                    const float* t = few.meshes[m].transfer[v].data();
                    ASSERT_EQ(std::memcmp(t, all.meshes[m].transfer[v].data(), 4 * order * order), 0);
                    for (size_t i = order * order; i < 25; ++i)
                        ASSERT_TRUE(std::isnan(t[i])); // as it was
                }
            }
        }
    }
}

TEST(Order, ShadingLeavesOutWhatTheLightDoesNotHave) {
    Engine engine;
    Random random(11);
    std::vector<std::array<float, 25>> transfer(50);
    for (auto& t : transfer) {
        for (float& value : t)
            value = random.between(-1, 1);
    }
    const TransferView view{transfer[0].data(), transfer.size(), 100};
    for (uint32_t order = 1; order <= 5; ++order) {
        float light[75] = {};
        for (uint32_t i = 0; i < 3 * order * order; ++i)
            light[i] = random.between(-1, 1);
        std::vector<float> rgb(150), packed_rgb(150), packed;
        ASSERT_TRUE(shade(engine.context, light, view, {}, rgb.data()).ok());
        for (size_t v = 0; v < transfer.size(); ++v) {
            packed.insert(packed.end(), transfer[v].begin(), transfer[v].begin() + order * order);
            for (uint32_t c = 0; c < 3; ++c) {
                float sum = 0;
                for (uint32_t i = 0; i < 25; ++i)
                    sum += light[3 * i + c] * transfer[v][i];
                EXPECT_EQ(rgb[3 * v + c], sum);
            }
        }
        // As a frame of that order writes them.
        ASSERT_TRUE(shade(engine.context, light, {packed.data(), transfer.size(), 4 * order * order}, {},
                          packed_rgb.data(), order)
                        .ok());
        EXPECT_EQ(rgb, packed_rgb);
    }
}

// ---- budgets ----

// A clock that goes on by a step at every look.
struct Mock {
    uint64_t now = 0, step = 0;

    Clock hook() {
        return {this, [](void* user) {
                    Mock& mock = *static_cast<Mock*>(user);
                    return mock.now += mock.step;
                }};
    }
};

struct Budgeted {
    Mock mock;
    Engine engine;
    scenes::Mesh torus = scenes::torus(1, 0.4f, 60, 30);
    std::vector<Posed> frame;
    Remembering memory;
    uint32_t step = 0;

    explicit Budgeted(float budget_us, uint64_t step_ns = 1000)
        : mock{0, step_ns}, engine(desc()), frame{at_rest(add(engine.context, torus), torus)},
          memory(engine.context, Quality::draft) {
        memory.settings.budget_us = budget_us;
    }
    ContextDesc desc() {
        ContextDesc d;
        d.clock = mock.hook();
        return d;
    }
    void move() {
        ++step;
        for (size_t v = 0; v < torus.rest_positions.size(); ++v)
            frame[0].positions[v] = torus.rest_positions[v] *
                                    (1 + 0.2f * std::sin(0.1f * float(step) + torus.rest_positions[v].x));
    }
    Outputs whole() { return run_frame(engine.context, frame, Quality::draft); }
};

// Every vertex's result is, bit for bit, that of a whole frame: this one's where it was computed, that of the
// frame in which it last was where it wasn't. And nobody waits for ever.
TEST(Budget, NoVertexIsTornAndNoneStarves) {
    for (const float budget : {0.5f, 3.5f, 20.5f}) { // by this clock that many batches
        Budgeted b(budget);
        const size_t count = b.torus.rest_positions.size(), batches = (count + 15) / 16;
        std::vector<Outputs> whole;
        std::vector<size_t> from(count, SIZE_MAX); // the frame of each vertex's result
        uint32_t most_stale = 0;
        for (uint32_t t = 0; t < 3 * batches; ++t) {
            b.move();
            whole.push_back(b.whole());
            const Outputs now = b.memory.frame(b.frame);
            uint32_t computed = 0, stale = 0, unshadowed = 0;
            for (size_t v = 0; v < count; ++v) {
                if (same_result(now.meshes[0], whole[t].meshes[0], v)) {
                    from[v] = t;
                    ++computed;
                    continue;
                }
                ++stale;
                if (from[v] == SIZE_MAX) {
                    ++unshadowed;
                    ASSERT_EQ(blocked_bits(now.meshes[0], v), 0u);
                    continue;
                }
                ASSERT_TRUE(same_result(now.meshes[0], whole[from[v]].meshes[0], v)) << v << " at " << t;
            }
            const FrameStats& s = now.stats;
            // Some results are those of the whole frame by chance: nothing blocks.
            EXPECT_GE(computed, s.receivers_computed);
            EXPECT_LE(stale, s.receivers_stale);
            EXPECT_LE(unshadowed, s.receivers_unshadowed);
            EXPECT_EQ(s.receivers_computed + s.receivers_stale + s.receivers_reused, s.receivers);
            EXPECT_EQ(s.receivers_written, s.receivers);
            EXPECT_GE(s.receivers_computed, uint32_t(count % 16));        // a batch, be it the short one
            EXPECT_LE(s.receivers_computed, 16 * (1 + uint32_t(budget))); // the first without a look
            EXPECT_LE(s.stale_frames_mean, double(s.stale_frames_max));
            most_stale = std::max(most_stale, s.stale_frames_max);
            if (t >= batches) {
                EXPECT_EQ(s.receivers_unshadowed, 0u);
            }
        }
        // Everything moves all the time: each waits until all others have had their turn.
        const double at_once = 1 + std::floor(double(budget));
        EXPECT_GE(most_stale, uint32_t(0.9 * double(batches) / at_once));
        EXPECT_LE(most_stale, uint32_t(1.4 * double(batches) / at_once) + 2);
    }
}

TEST(Budget, CatchesUpWhenThereIsTime) {
    Budgeted b(4.5f);
    b.move();
    b.memory.frame(b.frame);
    const Outputs whole = b.whole();
    uint32_t stale = UINT32_MAX;
    for (int t = 0; t < 200 && stale > 0; ++t) { // nothing moves any more
        b.memory.settings.same_pose = t % 2;
        const Outputs now = b.memory.frame(b.frame);
        EXPECT_LT(now.stats.receivers_stale, stale);
        stale = now.stats.receivers_stale;
        if (stale == 0) {
            EXPECT_EQ(now, whole);
        }
    }
    EXPECT_EQ(stale, 0u);
    b.memory.settings.budget_us = 1e6f;
    b.memory.settings.same_pose = false;
    b.move();
    const Outputs all = b.memory.frame(b.frame);
    EXPECT_EQ(all, b.whole());
    EXPECT_EQ(all.stats.receivers_stale, 0u);
    EXPECT_EQ(all.stats.stale_frames_max, 0u);
}

// Equally stale: the one that moved most goes first.
TEST(Budget, MostChangedFirst) {
    Mock mock{0, 1000};
    ContextDesc desc;
    desc.clock = mock.hook();
    Engine engine(desc);
    const scenes::Mesh torus = scenes::torus(1, 0.4f, 40, 20);
    std::vector<Posed> frame;
    for (int i = 0; i < 4; ++i) {
        frame.push_back(at_rest(add(engine.context, torus), torus));
        for (glm::vec3& p : frame.back().positions)
            p += glm::vec3(4 * i, 0, 0);
    }
    Remembering memory(engine.context, Quality::draft);
    const Outputs before = memory.frame(frame);
    const float stretch[] = {0.01f, 0.02f, 0.3f, 0.03f};
    for (size_t m = 0; m < 4; ++m) {
        for (glm::vec3& p : frame[m].positions)
            p.y *= 1 + stretch[m];
    }
    memory.settings.budget_us = 8.5f;
    const Outputs after = memory.frame(frame);
    EXPECT_GE(after.stats.receivers_computed, 4u * 16);
    for (size_t m = 0; m < 4; ++m) {
        size_t updated = 0;
        for (size_t v = 0; v < torus.rest_positions.size(); ++v)
            updated += !same_result(before.meshes[m], after.meshes[m], v);
        EXPECT_EQ(updated > 0, m == 2) << m << " " << updated;
    }
}

TEST(Budget, WithoutOneTheClockDoesNotMatter) {
    Mock mock{0, 1000000000};
    ContextDesc desc;
    desc.clock = mock.hook();
    Engine engine(desc);
    const scenes::Mesh torus = scenes::torus(1, 0.4f, 20, 10);
    Remembering memory(engine.context);
    const Posed frame = at_rest(add(engine.context, torus), torus);
    EXPECT_EQ(memory.frame({frame}), run_frame(engine.context, {frame}));
    EXPECT_EQ(mock.now, 0u);
}

} // namespace

} // namespace nusselt::test
