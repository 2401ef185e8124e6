// Same input, same bits; and what moving, scaling, turning or adding to a scene may and may not change.
// Level: the library's own, bit for bit.
#include "tests/runtime/fixture.h"

#include "tests/jobs/executors.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cfenv>
#include <cmath>
#include <cstring>

#if defined(__x86_64__)
#include <immintrin.h>
#endif

namespace nusselt::test {

namespace {

TEST(Determinism, EveryIsa) {
    for (const char* name : {"fight", "chess"}) {
        const scenes::Scene scene = scenes::builtin(name);
        for (const Quality quality : {Quality::paper, Quality::standard, Quality::fine}) {
            Outputs first;
            for (const Isa isa : available_isas()) {
                if (quality == Quality::fine && isa == Isa::scalar) continue; // slow
                Engine engine(with_isa(isa));
                const Outputs out = run_scene(engine.context, scene, 0.4, quality);
                if (first.meshes.empty()) first = out;
                EXPECT_EQ(out, first) << name << " " << isa_name(isa) << " " << quality_name(quality);
                EXPECT_EQ(out.stats.triangles_rasterized, first.stats.triangles_rasterized);
                EXPECT_EQ(out.stats.clusters_tested, first.stats.clusters_tested);
            }
        }
    }
}

// A scene's frame, and the same with a falloff.
std::array<Outputs, 2> run_both_ways(Context* context, const scenes::Scene& scene, double time) {
    FrameDesc fading;
    fading.falloff = {0.05f, 0.3f};
    return {run_scene(context, scene, time),
            run_frame(context, posed(scene, add_all(context, scene), time), fading)};
}

TEST(Determinism, EveryExecutor) {
    const scenes::Scene scene = scenes::builtin("fight");
    Engine serial;
    const std::array<Outputs, 2> expected = run_both_ways(serial.context, scene, 0.6);
    for (const ExecutorOptions& options : hostile_executors()) {
        TestExecutor hostile(options);
        {
            ContextDesc desc;
            desc.executor = hostile.hook();
            Engine engine(desc);
            for (int repeat = 0; repeat < 2; ++repeat)
                EXPECT_EQ(run_both_ways(engine.context, scene, 0.6), expected) << options.name;
        }
        EXPECT_EQ(hostile.broken(), "") << options.name;
    }
}

TEST(Determinism, EveryNumberOfTbbThreads) {
    const scenes::Scene scene = scenes::builtin("fight");
    Engine serial;
    const std::array<Outputs, 2> expected = run_both_ways(serial.context, scene, 0.6);
    for (const uint32_t threads : {1u, 2u, 3u, 8u}) {
        Executor executor;
        const Status status = create_tbb_executor(threads, &executor);
        if (status.code == StatusCode::unsupported) GTEST_SKIP() << status.text;
        ASSERT_TRUE(status.ok()) << status.text;
        {
            ContextDesc desc;
            desc.executor = executor;
            Engine engine(desc);
            for (int repeat = 0; repeat < 4; ++repeat)
                EXPECT_EQ(run_both_ways(engine.context, scene, 0.6), expected) << threads;
        }
        destroy_executor(&executor);
    }
}

TEST(Determinism, OrderOfTheMeshes) {
    Engine engine;
    const scenes::Scene scene = scenes::builtin("chess");
    const std::vector<MeshId> ids = add_all(engine.context, scene);
    std::vector<Posed> frame = posed(scene, ids, 0.7);
    ASSERT_GT(frame.size(), 2u);
    const Outputs expected = run_frame(engine.context, frame);
    // The first mesh stays: its first vertex is the origin of the frame's own space.
    std::vector<size_t> order(frame.size());
    for (size_t i = 0; i < order.size(); ++i)
        order[i] = i;
    std::reverse(order.begin() + 1, order.end());
    std::vector<Posed> shuffled;
    for (const size_t i : order)
        shuffled.push_back(frame[i]);
    const Outputs out = run_frame(engine.context, shuffled);
    for (size_t i = 0; i < order.size(); ++i)
        EXPECT_EQ(out.meshes[i], expected.meshes[order[i]]) << i;
}

TEST(Determinism, FramesLeaveNothingBehind) {
    const scenes::Scene fight = scenes::builtin("fight"), chess = scenes::builtin("chess");
    Engine used;
    run_scene(used.context, fight, 0.1);
    run_scene(used.context, chess, 0.9, Quality::fine);
    run_scene(used.context, chess, 0.2, Quality::paper);
    Engine fresh;
    EXPECT_EQ(run_scene(used.context, fight, 0.5), run_scene(fresh.context, fight, 0.5));
}

TEST(Determinism, SeveralFramesInFlight) {
    const scenes::Scene scene = scenes::builtin("chess");
    Engine serial;
    const Outputs expected = run_scene(serial.context, scene, 0.3);
    ExecutorOptions options{"random_in_finish", Order::random, 0, 3};
    TestExecutor executor(options);
    ContextDesc desc;
    desc.executor = executor.hook();
    Engine engine(desc);
    struct Flight {
        std::vector<Posed> posed;
        std::vector<std::vector<float>> transfer;
        FrameId id;
    };
    std::vector<Flight> flights(3);
    for (Flight& f : flights) {
        f.posed = posed(scene, add_all(engine.context, scene), 0.3);
        std::vector<FrameMesh> meshes;
        f.transfer.resize(f.posed.size());
        for (size_t m = 0; m < f.posed.size(); ++m) {
            const Posed& p = f.posed[m];
            f.transfer[m].resize(25 * p.positions.size());
            meshes.push_back({p.mesh,
                              {&p.positions[0].x, p.positions.size(), 12},
                              {&p.normals[0].x, p.normals.size(), 12},
                              {f.transfer[m].data(), p.positions.size(), 100},
                              {}});
        }
        ASSERT_TRUE(
            submit(engine.context, {meshes.data(), uint32_t(meshes.size()), Quality::standard}, &f.id).ok());
    }
    for (const size_t i : {1u, 2u, 0u})
        ASSERT_TRUE(wait(engine.context, flights[i].id, nullptr).ok());
    for (const Flight& f : flights) {
        for (size_t m = 0; m < f.posed.size(); ++m)
            EXPECT_EQ(std::memcmp(f.transfer[m].data(), expected.meshes[m].transfer.data(),
                                  4 * f.transfer[m].size()),
                      0);
    }
}

#if defined(__x86_64__)
// Rounding, flush to zero, denormals are zero, and traps of the host: no effect, and restored.
TEST(Determinism, FloatingPointEnvironmentOfTheHost) {
    const scenes::Scene scene = scenes::builtin("cloth");
    scenes::Pose pose;
    scene.pose(0.5, pose);
    const float direction[3] = {0.6f, 0, 0.8f};
    const auto all = [&](Context* context, const std::vector<MeshId>& ids, std::vector<float>& other) {
        std::vector<Posed> frame;
        for (size_t i = 0; i < ids.size(); ++i)
            frame.push_back({ids[i], pose.positions[i], pose.normals[i]});
        frame[0].positions[3].x = std::numeric_limits<float>::quiet_NaN();
        const Outputs out = run_frame(context, frame);
        other.assign(25 + 25 + 75, 0);
        sh_evaluate(direction[0], direction[1], direction[2], other.data());
        const float turn[9] = {0.36f, 0.48f, -0.8f, -0.8f, 0.6f, 0, 0.48f, 0.64f, 0.6f};
        sh_rotate(turn, other.data(), other.data() + 25);
        const float pixels[12] = {1, 0.1f, 0.3f, 0.7f, 2, 0, 1e-39f, 1, 1, 3, 1, 1};
        EXPECT_TRUE(sh_project_latlong(pixels, 2, 2, other.data() + 50, nullptr).ok());
        std::vector<float> rgb(3 * out.meshes[0].transfer.size());
        auto transfer = out.meshes[0].transfer;
        EXPECT_TRUE(
            shade(context, other.data() + 50, {transfer[0].data(), transfer.size(), 100}, {}, rgb.data())
                .ok());
        other.insert(other.end(), rgb.begin(), rgb.end());
        return out;
    };
    Engine engine;
    std::vector<float> expected_other;
    const Outputs expected = all(engine.context, add_all(engine.context, scene), expected_other);
    const uint32_t before = _mm_getcsr();
    for (uint32_t rounding = 0; rounding < 4; ++rounding) {
        for (uint32_t flush = 0; flush < 4; ++flush) {
            // FTZ, DAZ, and with rounding 0 also every trap but the inexact one.
            uint32_t mode = 0x1F80 | rounding << 13 | (flush & 1 ? 0x8000 : 0) | (flush & 2 ? 0x40 : 0);
            if (rounding == 0) mode &= ~uint32_t(0x80 | 0x200 | 0x400);
            Context* context = nullptr;
            std::vector<MeshId> ids;
            std::vector<float> other;
            Outputs out;
            _mm_setcsr(mode);
            const bool made = create_context({}, &context).ok();
            ids = add_all(context, scene);
            out = all(context, ids, other);
            const bool gone = destroy_context(context).ok();
            const uint32_t after = _mm_getcsr();
            _mm_setcsr(before);
            EXPECT_TRUE(made && gone);
            EXPECT_EQ(after & ~0x3Fu, mode & ~0x3Fu) << rounding << " " << flush;
            EXPECT_EQ(out, expected) << rounding << " " << flush;
            EXPECT_EQ(std::memcmp(other.data(), expected_other.data(), 4 * other.size()), 0)
                << rounding << flush;
        }
    }
}
#endif

std::vector<Posed> transformed(const std::vector<Posed>& frame, float scale, glm::vec3 offset) {
    std::vector<Posed> out = frame;
    for (Posed& p : out) {
        for (glm::vec3& v : p.positions)
            v = v * scale + offset;
    }
    return out;
}

TEST(Invariance, ScalingByPowersOfTwoChangesNoBit) {
    Engine engine;
    const scenes::Mesh mesh = scenes::torus(1, 0.4f, 24, 12), floor = scenes::plane(3, 4);
    const std::vector<Posed> frame{at_rest(add(engine.context, mesh), mesh),
                                   at_rest(add(engine.context, floor), floor)};
    const Outputs expected = run_frame(engine.context, frame);
    for (int k = -60; k <= 60; ++k)
        ASSERT_EQ(run_frame(engine.context, transformed(frame, std::ldexp(1.0f, k), {})), expected) << k;
    for (const int k : {-100, 100, 124})
        EXPECT_EQ(run_frame(engine.context, transformed(frame, std::ldexp(1.0f, k), {})), expected) << k;
    EXPECT_EQ(run_frame(engine.context, frame, Quality::paper),
              run_frame(engine.context, transformed(frame, 1024, {}), Quality::paper));
    // Added at another scale, too: no constant depends on it.
    scenes::Mesh small = mesh;
    for (glm::vec3& p : small.rest_positions)
        p *= std::ldexp(1.0f, -30);
    Engine other, original;
    EXPECT_EQ(run_at_rest(other.context, {small}), run_at_rest(original.context, {mesh}));
}

TEST(Invariance, ExactTranslationChangesNoBit) {
    Engine engine;
    scenes::Mesh mesh = scenes::torus(8, 3, 24, 12);
    for (glm::vec3& p : mesh.rest_positions)
        p = glm::vec3(std::round(p.x * 16), std::round(p.y * 16), std::round(p.z * 16)) / 16.0f;
    const std::vector<Posed> frame{at_rest(add(engine.context, mesh), mesh)};
    const Outputs expected = run_frame(engine.context, frame);
    for (const glm::vec3& offset :
         {glm::vec3(1, 2, 3), glm::vec3(-1000, 0.0625f, 77), glm::vec3(524288), glm::vec3(1e6f, -1e6f, 5e5f)})
        EXPECT_EQ(run_frame(engine.context, transformed(frame, 1, offset)), expected) << offset.x;
}

// Random triangles, fewer than 16: one level, so that nothing but their order and winding can differ. A free
// triangle blocks from both sides. Indices only: receivers are vertices of another mesh.
std::vector<glm::vec3> random_triangles(Random& random, uint32_t count) {
    std::vector<glm::vec3> corners;
    for (uint32_t t = 0; t < count; ++t) {
        const glm::vec3 centre = random.direction() * random.between(0.3f, 1);
        for (int k = 0; k < 3; ++k)
            corners.push_back(centre + random.direction() * 0.4f);
    }
    return corners;
}

scenes::Mesh random_receivers(Random& random, uint32_t count) {
    std::vector<glm::vec3> p, n;
    for (uint32_t i = 0; i < count; ++i) {
        p.push_back(random.direction() * 0.1f);
        n.push_back(random.direction());
    }
    return points(p, n);
}

TEST(Invariance, OrderAndWindingOfTriangles) {
    Engine engine;
    for (uint64_t seed = 0; seed < 40; ++seed) {
        Random random(seed);
        const scenes::Mesh receivers = random_receivers(random, 64),
                           mesh = soup(random_triangles(random, 12));
        const Output expected = run_at_rest(engine.context, {receivers, mesh}).meshes[0];
        scenes::Mesh shuffled = mesh, turned = mesh, flipped = mesh;
        for (uint32_t t = 0; t < 12; ++t) {
            for (uint32_t k = 0; k < 3; ++k) {
                shuffled.indices[3 * t + k] = mesh.indices[3 * ((t * 5 + 3) % 12) + k];
                turned.indices[3 * t + k] = mesh.indices[3 * t + (k + 1 + t % 2) % 3];
                flipped.indices[3 * t + k] = mesh.indices[3 * t + 2 - k];
            }
        }
        EXPECT_EQ(run_at_rest(engine.context, {receivers, shuffled}).meshes[0], expected) << "seed " << seed;
        EXPECT_EQ(run_at_rest(engine.context, {receivers, turned}).meshes[0], expected) << "seed " << seed;
        EXPECT_EQ(run_at_rest(engine.context, {receivers, flipped}).meshes[0], expected) << "seed " << seed;
    }
}

TEST(Invariance, AMeshOnlyAddsBitsAndMasksAreTheirUnion) {
    Engine engine;
    uint64_t bits = 0;
    for (uint64_t seed = 100; seed < 140; ++seed) {
        Random random(seed);
        const scenes::Mesh receivers = random_receivers(random, 64), a = soup(random_triangles(random, 10)),
                           b = soup(random_triangles(random, 10));
        // An extent that they share: the frame's scale is then the same.
        const scenes::Mesh extent = points({{4, 0, 0}}, {{1, 0, 0}});
        const auto masks = [&](const std::vector<scenes::Mesh>& meshes) {
            return run_at_rest(engine.context, meshes).meshes[0].masks;
        };
        const auto of_a = masks({receivers, a, extent}), of_b = masks({receivers, b, extent}),
                   both = masks({receivers, a, b, extent});
        for (size_t i = 0; i < both.size(); ++i) {
            ASSERT_EQ(both[i], of_a[i] | of_b[i]) << "seed " << seed;
            bits += uint64_t(std::popcount(both[i]));
        }
        // The same again adds nothing; a triangle without area neither.
        EXPECT_EQ(masks({receivers, a, a, extent}), of_a);
        std::vector<glm::vec3> flat = a.rest_positions;
        flat.resize(30);
        for (size_t i = 2; i < flat.size(); i += 3)
            flat[i] = flat[i - 1];
        EXPECT_EQ(masks({receivers, a, soup(flat), extent}), of_a);
    }
    EXPECT_GT(bits, 100000u);
}

TEST(Invariance, LengthOfNormalsIsIgnored) {
    Engine engine;
    const scenes::Mesh mesh = scenes::torus(1, 0.4f, 24, 12);
    const MeshId id = add(engine.context, mesh);
    const Outputs expected = run_frame(engine.context, {at_rest(id, mesh)});
    for (const float scale : {0.5f, 4.0f, std::ldexp(1.0f, -60), std::ldexp(1.0f, 60)}) {
        Posed frame = at_rest(id, mesh);
        for (glm::vec3& n : frame.normals)
            n *= scale;
        EXPECT_EQ(run_frame(engine.context, {frame}), expected) << scale;
    }
}

} // namespace

} // namespace nusselt::test
