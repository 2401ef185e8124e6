// What a frame computes, for whom, and that bad input stays where it is.
#include "tests/runtime/fixture.h"

#include <cmath>
#include <cstring>
#include <memory>

#include <glm/geometric.hpp>

namespace nusselt::test {

namespace {

constexpr float nan_value = std::numeric_limits<float>::quiet_NaN();
constexpr float infinity = std::numeric_limits<float>::infinity();

float seen(const Output& o, size_t vertex) { // cosine-weighted part of the hemisphere
    return o.transfer[vertex][0] / 0.28209479f;
}

TEST(Frame, ReceiversWithoutBlockersSeeAll) {
    Engine engine;
    Random random(1);
    std::vector<glm::vec3> p, n;
    for (int i = 0; i < 100; ++i) {
        p.push_back(random.direction());
        n.push_back(random.direction());
    }
    for (const Quality quality : {Quality::paper, Quality::standard, Quality::fine}) {
        const Outputs out = run_at_rest(engine.context, {points(p, n)}, quality);
        for (size_t v = 0; v < p.size(); ++v) {
            EXPECT_EQ(blocked_bits(out.meshes[0], v, quality), 0u);
            // Clamped cosine about n: 1/pi (0.886227 b0 + 1.023327 b1(n) + ...).
            const auto& t = out.meshes[0].transfer[v];
            const float budget = quality == Quality::paper ? 4e-3f : 3e-4f;
            EXPECT_NEAR(t[0], 0.2820948f, budget);
            EXPECT_NEAR(t[1], 0.3257350f * n[v].y, budget);
            EXPECT_NEAR(t[2], 0.3257350f * n[v].z, budget);
            EXPECT_NEAR(t[3], 0.3257350f * n[v].x, budget);
        }
        EXPECT_EQ(out.stats.receivers, 100u);
        EXPECT_EQ(out.stats.receivers_computed, 100u);
        EXPECT_EQ(out.stats.receivers_invalid, 0u);
        EXPECT_EQ(out.stats.triangles_rasterized, 0u);
    }
}

TEST(Frame, MeshesOfAGroupBlockEachOther) {
    Engine engine;
    const scenes::Mesh floor = scenes::plane(2, 4);
    scenes::Mesh ceiling = scenes::plane(2, 4);
    for (glm::vec3& p : ceiling.rest_positions)
        p.y += 0.1f;
    const Outputs alone = run_at_rest(engine.context, {floor}),
                  both = run_at_rest(engine.context, {floor, ceiling});
    const size_t middle = 12; // of 5 x 5
    EXPECT_EQ(blocked_bits(alone.meshes[0], middle), 0u);
    EXPECT_GT(blocked_bits(both.meshes[0], middle), 900u);
    EXPECT_EQ(blocked_bits(both.meshes[1], middle), 0u); // the sheet above looks away

    // It blocks the same when it asks for nothing itself.
    const MeshId a = add(engine.context, floor), b = add(engine.context, ceiling);
    std::vector<Posed> frame{at_rest(a, floor), at_rest(b, ceiling)};
    frame[1].receives = false;
    const Outputs blocker = run_frame(engine.context, frame);
    EXPECT_EQ(blocker.meshes[0], both.meshes[0]);
    EXPECT_EQ(blocker.stats.receivers, 25u);
}

TEST(Frame, DuplicatesCopyUnlessTheirNormalsDiffer) {
    Engine engine;
    scenes::Mesh mesh = scenes::sphere(1);
    const size_t count = mesh.rest_positions.size();
    for (size_t v = 0; v < count; ++v) { // each vertex once more
        mesh.rest_positions.push_back(mesh.rest_positions[v]);
        mesh.rest_normals.push_back(mesh.rest_normals[v]);
    }
    const scenes::Mesh floor = scenes::plane(4, 2);
    const MeshId id = add(engine.context, mesh), floor_id = add(engine.context, floor);
    std::vector<Posed> frame{at_rest(id, mesh), at_rest(floor_id, floor)};
    const Outputs same = run_frame(engine.context, frame);
    EXPECT_EQ(same.stats.receivers, 2 * count + 9);
    EXPECT_EQ(same.stats.receivers_computed, count + 9);
    for (size_t v = 0; v < count; ++v) {
        EXPECT_EQ(std::memcmp(&same.meshes[0].transfer[v], &same.meshes[0].transfer[v + count], 100), 0);
        EXPECT_EQ(blocked_bits(same.meshes[0], v), blocked_bits(same.meshes[0], v + count));
    }
    // In this frame some twins look another way: they get what a receiver of their own would.
    Random random(3);
    for (size_t v = 0; v < count; v += 3)
        frame[0].normals[v + count] = random.direction();
    const Outputs split = run_frame(engine.context, frame);
    EXPECT_EQ(split.stats.receivers_computed, count + (count + 2) / 3 + 9);
    std::swap_ranges(frame[0].normals.begin(), frame[0].normals.begin() + long(count),
                     frame[0].normals.begin() + long(count));
    const Outputs swapped = run_frame(engine.context, frame);
    for (size_t v = 0; v < 2 * count; ++v) {
        const size_t other = (v + count) % (2 * count);
        EXPECT_EQ(std::memcmp(&split.meshes[0].transfer[v], &swapped.meshes[0].transfer[other], 100), 0) << v;
    }
}

// The receivers that a change of one vertex can reach by its triangles alone: everything else must be as it
// was when those triangles are away altogether.
TEST(Frame, BadVerticesHarmNobodyElse) {
    Engine engine;
    const scenes::Scene scene = scenes::builtin("fight");
    const std::vector<MeshId> ids = add_all(engine.context, scene);
    std::vector<Posed> frame = posed(scene, ids, 0.3);
    const Outputs clean = run_frame(engine.context, frame);
    EXPECT_EQ(clean.stats.triangles_invalid, 0u);
    for (const float bad : {nan_value, infinity, -infinity}) {
        for (int axis = 0; axis < 3; ++axis) {
            std::vector<Posed> broken = frame;
            const size_t victim = 37;
            broken[0].positions[victim][axis] = bad;
            const Outputs out = run_frame(engine.context, broken);
            EXPECT_GE(out.stats.receivers_invalid, 1u);
            EXPECT_GE(out.stats.triangles_invalid, 1u);
            EXPECT_LE(out.stats.triangles_invalid, 20u);
            size_t moved = 0;
            for (size_t m = 0; m < out.meshes.size(); ++m) {
                for (size_t v = 0; v < out.meshes[m].transfer.size(); ++v) {
                    for (const float t : out.meshes[m].transfer[v])
                        ASSERT_TRUE(std::isfinite(t)) << m << " " << v;
                    moved += std::fabs(seen(out.meshes[m], v) - seen(clean.meshes[m], v)) > 0.1f;
                }
            }
            for (const float t : out.meshes[0].transfer[victim])
                EXPECT_EQ(t, 0.0f);
            EXPECT_LT(moved, 60u); // neighbours lose a blocker, no more
        }
    }
}

TEST(Frame, BadNormalsHarmTheirVertexAlone) {
    Engine engine;
    const scenes::Mesh mesh = scenes::torus(1, 0.4f, 24, 12);
    const MeshId id = add(engine.context, mesh);
    const Posed good = at_rest(id, mesh);
    const Outputs clean = run_frame(engine.context, {good});
    const glm::vec3 bad[] = {
        {nan_value, 0, 1}, {0, infinity, 0}, {0, 0, 0}, {-infinity, nan_value, 0}, {-0.0f, 0, -0.0f}};
    for (const glm::vec3& normal : bad) {
        Posed broken = good;
        broken.normals[50] = normal;
        const Outputs out = run_frame(engine.context, {broken});
        EXPECT_EQ(out.stats.receivers_invalid, 1u);
        for (size_t v = 0; v < mesh.rest_positions.size(); ++v) {
            if (v == 50) {
                for (const float t : out.meshes[0].transfer[v])
                    EXPECT_EQ(t, 0.0f);
            } else {
                ASSERT_EQ(std::memcmp(&out.meshes[0].transfer[v], &clean.meshes[0].transfer[v], 100), 0) << v;
            }
        }
    }
}

TEST(Frame, EverythingBadIsStillAnAnswer) {
    Engine engine;
    const scenes::Mesh mesh = scenes::sphere(2);
    const MeshId id = add(engine.context, mesh);
    Posed frame = at_rest(id, mesh);
    for (const glm::vec3 p : {glm::vec3(nan_value), glm::vec3(infinity), glm::vec3(0), glm::vec3(3e38f)}) {
        for (glm::vec3& q : frame.positions)
            q = p;
        for (const Quality quality : {Quality::paper, Quality::standard}) {
            const Outputs out = run_frame(engine.context, {frame}, quality);
            for (const auto& t : out.meshes[0].transfer) {
                for (const float value : t)
                    EXPECT_TRUE(std::isfinite(value));
            }
        }
    }
    // And the next good frame is as if nothing had been.
    Engine fresh;
    EXPECT_EQ(run_frame(engine.context, {at_rest(id, mesh)}), run_at_rest(fresh.context, {mesh}));
}

TEST(Frame, GarbageIsTheSameGarbageOnEveryIsa) {
    std::vector<std::unique_ptr<Engine>> engines;
    for (const Isa isa : available_isas())
        engines.push_back(std::make_unique<Engine>(with_isa(isa)));
    for (uint64_t seed = 0; seed < 12; ++seed) {
        Random random(seed);
        scenes::Mesh mesh;
        const uint32_t count = 30 + random.below(60);
        const auto any = [&]() {
            const uint32_t bits = uint32_t(random.engine());
            float value;
            std::memcpy(&value, &bits, 4);
            return random.below(3) ? random.between(-1, 1) : value;
        };
        for (uint32_t v = 0; v < count; ++v) {
            mesh.rest_positions.push_back({any(), any(), any()});
            mesh.rest_normals.push_back({any(), any(), any()});
        }
        for (uint32_t i = 0; i < 300; ++i)
            mesh.indices.push_back(random.below(count));
        Outputs first;
        for (const auto& engine : engines) {
            const Isa isa = context_isa(engine->context);
            for (const Quality quality : {Quality::paper, Quality::standard}) {
                const Outputs out = run_at_rest(engine->context, {mesh}, quality);
                for (const auto& t : out.meshes[0].transfer) {
                    for (const float value : t)
                        ASSERT_TRUE(std::isfinite(value)) << "seed " << seed;
                }
                if (quality == Quality::standard) {
                    if (engine == engines[0]) first = out;
                    ASSERT_EQ(out, first) << isa_name(isa) << " seed " << seed;
                }
            }
        }
    }
}

// Guard bytes around every element that is written; nothing past the last element is read.
TEST(Frame, StridesAndPadding) {
    Engine engine;
    const scenes::Mesh mesh = scenes::torus(1, 0.4f, 20, 10);
    const MeshId id = add(engine.context, mesh);
    for (const Quality quality : {Quality::paper, Quality::standard, Quality::fine}) {
        const Outputs packed = run_frame(engine.context, {at_rest(id, mesh)}, quality);
        const size_t count = mesh.rest_positions.size(), bytes = quality_mask_bits(quality) / 8;
        const size_t in = 12 + 20, out = 100 + 28, masks = bytes + 12;
        // The last element has no padding behind it: the sanitizers see a step too far.
        std::vector<float> positions(((count - 1) * in + 12) / 4, nan_value), normals = positions;
        std::vector<uint32_t> transfer(((count - 1) * out + 100) / 4, 0xABABABAB),
            mask(((count - 1) * masks + bytes) / 4, 0xABABABAB);
        for (size_t v = 0; v < count; ++v) {
            for (int k = 0; k < 3; ++k) {
                positions[v * in / 4 + size_t(k)] = mesh.rest_positions[v][k];
                normals[v * in / 4 + size_t(k)] = mesh.rest_normals[v][k];
            }
        }
        const FrameMesh use{id,
                            {positions.data(), count, in},
                            {normals.data(), count, in},
                            {reinterpret_cast<float*>(transfer.data()), count, out},
                            {mask.data(), count, masks}};
        FrameId frame;
        ASSERT_TRUE(submit(engine.context, {&use, 1, quality}, &frame).ok());
        ASSERT_TRUE(wait(engine.context, frame, nullptr).ok());
        for (size_t v = 0; v < count; ++v) {
            ASSERT_EQ(std::memcmp(&transfer[v * out / 4], &packed.meshes[0].transfer[v], 100), 0) << v;
            ASSERT_EQ(std::memcmp(&mask[v * masks / 4], &packed.meshes[0].masks[v * bytes / 4], bytes), 0)
                << v;
            for (size_t i = v * out / 4 + 25; i < (v + 1) * out / 4 && i < transfer.size(); ++i)
                ASSERT_EQ(transfer[i], 0xABABABAB);
            for (size_t i = (v * masks + bytes) / 4; i < (v + 1) * masks / 4 && i < mask.size(); ++i)
                ASSERT_EQ(mask[i], 0xABABABAB);
        }
    }
}

TEST(Frame, CountsAddUp) {
    Engine engine;
    const scenes::Scene scene = scenes::builtin("chess");
    for (const Quality quality : {Quality::paper, Quality::standard}) {
        const Outputs out = run_scene(engine.context, scene, 0.5, quality);
        uint32_t vertices = 0;
        for (const scenes::Mesh& mesh : scene.meshes)
            vertices += uint32_t(mesh.rest_positions.size());
        const FrameStats& s = out.stats;
        EXPECT_EQ(s.receivers, vertices);
        EXPECT_LE(s.receivers_computed, vertices);
        EXPECT_GT(s.receivers_computed, vertices / 2);
        EXPECT_EQ(s.receivers_invalid, 0u);
        EXPECT_EQ(s.blocks_uniform + s.blocks_partial, 64ull * s.receivers_computed);
        EXPECT_GT(s.triangles_rasterized, 0u);
        EXPECT_LE(s.triangles_rasterized, s.triangles_considered);
        EXPECT_LE(s.clusters_rasterized, s.clusters_tested);
        EXPECT_EQ(s.threads, 1u);
        EXPECT_GT(s.wall_ms, 0);
        EXPECT_GT(s.cpu_ms, 0);
        EXPECT_EQ(s.fan_triangles > 0, quality != Quality::paper);
    }
}

} // namespace

} // namespace nusselt::test
