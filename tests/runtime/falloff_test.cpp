// Occlusion that fades with distance, through whole frames: closed forms, sizes of triangles, bad input.
#include "tests/runtime/fixture.h"

#include <algorithm>
#include <cfloat>
#include <cmath>

#include <glm/geometric.hpp>

namespace nusselt::test {

namespace {

using Stream = nusselt::Output;

// Cosine-weighted part of the hemisphere that is seen.
double seen_of(const std::array<float, 25>& transfer) {
    return double(transfer[0]) / 0.28209479177387814;
}

// Ambient occlusion of the first mesh.
std::vector<float> run(Context* context, const std::vector<Posed>& meshes, const Falloff& falloff,
                       StatusCode wanted = StatusCode::ok, Quality quality = Quality::standard) {
    std::vector<float> seen(meshes[0].positions.size());
    Stream s;
    s.kind = OutputKind::ambient_occlusion;
    s.data = seen.data();
    s.count = seen.size();
    std::vector<FrameMesh> frame = frame_of(meshes);
    frame[0].outputs = &s;
    frame[0].output_count = 1;
    FrameDesc desc;
    desc.meshes = frame.data();
    desc.mesh_count = uint32_t(frame.size());
    desc.quality = quality;
    desc.falloff = falloff;
    FrameId id;
    const Status started = submit(context, desc, &id);
    EXPECT_EQ(started.code, wanted) << started.text;
    if (started.ok()) {
        EXPECT_TRUE(wait(context, id, nullptr).ok());
    }
    return seen;
}

// A ceiling over the origin, in n x n squares.
scenes::Mesh ceiling(float height, float half, uint32_t n) {
    scenes::Mesh mesh;
    for (uint32_t y = 0; y <= n; ++y) {
        for (uint32_t x = 0; x <= n; ++x) {
            mesh.rest_positions.emplace_back(half * (2 * float(x) / float(n) - 1),
                                             half * (2 * float(y) / float(n) - 1), height);
            mesh.rest_normals.emplace_back(0, 0, -1);
        }
    }
    for (uint32_t y = 0; y < n; ++y) {
        for (uint32_t x = 0; x < n; ++x) {
            const uint32_t a = y * (n + 1) + x, b = a + 1, c = a + n + 1, d = c + 1;
            mesh.indices.insert(mesh.indices.end(), {a, c, b, b, c, d});
        }
    }
    return mesh;
}

// Of the hemisphere's cosine, what a ceiling at that height within that distance hides.
double hidden(double height, double distance) {
    return distance > height ? 1 - height * height / (distance * distance) : 0;
}

double faded(double height, double from, double to) {
    double sum = 0;
    for (int i = 0; i < 2000; ++i) { // the integral of -w'(r) hidden(r)
        const double t = (i + 0.5) / 2000;
        sum += 6 * t * (1 - t) * hidden(height, from + (to - from) * t) / 2000;
    }
    return sum;
}

FrameDesc fading(const Falloff& falloff, Quality quality = Quality::standard) {
    FrameDesc desc;
    desc.quality = quality;
    desc.falloff = falloff;
    return desc;
}

TEST(Falloff, ACeilingFadesAsItsDistanceDoes) {
    Engine engine;
    const scenes::Mesh receiver = points({{0, 0, 0}}, {{0, 0, 1}});
    const Posed at = at_rest(add(engine.context, receiver), receiver);
    for (const uint32_t n : {1u, 7u, 400u}) { // two huge triangles; many small ones
        const scenes::Mesh mesh = ceiling(1, 100, n);
        const Posed over = at_rest(add(engine.context, mesh), mesh);
        EXPECT_NEAR(run(engine.context, {at, over}, {})[0], 0, 0.01) << n;
        for (const float distance : {0.5f, 0.9f, 1.5f, 2.0f, 5.0f, 20.0f})
            EXPECT_NEAR(run(engine.context, {at, over}, {distance, distance})[0], 1 - hidden(1, distance),
                        0.01)
                << n << " " << distance;
        for (const Falloff& f :
             {Falloff{0, 2}, Falloff{0, 10}, Falloff{1, 4}, Falloff{3, 6}, Falloff{0.2f, 0.9f}})
            EXPECT_NEAR(run(engine.context, {at, over}, f)[0], 1 - faded(1, f.from, f.to), 0.01)
                << n << " " << f.from << " " << f.to;
    }
}

// Everything is at one distance: all of the light but what is hidden there.
TEST(Falloff, ADomeHidesWhatItsDistanceDoes) {
    scenes::Mesh dome = scenes::sphere(4);
    for (size_t t = 0; t < dome.indices.size(); t += 3) // seen from inside
        std::swap(dome.indices[t], dome.indices[t + 1]);
    dome.indices.resize(dome.indices.size() - 3); // open: its inside is no solid
    const scenes::Mesh receiver = points({{0, 0, 0}}, {{0, 0.6f, 0.8f}});
    Engine engine;
    const std::vector<Posed> meshes = {at_rest(add(engine.context, receiver), receiver),
                                       at_rest(add(engine.context, dome), dome)};
    for (const Quality quality : {Quality::draft, Quality::standard, Quality::fine}) {
        for (float to = 0.9f; to < 4; to += 0.17f) {
            const double t = std::clamp((double(to) - 1) / double(to), 0.0, 1.0);
            // Rounded to sixteenths; the triangles' middles are a little nearer, coarse ones more.
            EXPECT_NEAR(run(engine.context, meshes, {0, to}, StatusCode::ok, quality)[0],
                        1 - t * t * (3 - 2 * t), 0.05)
                << to;
        }
    }
}

// All results, bit for bit, on every instruction set; and a fade that begins far off is none, however long.
TEST(Falloff, WhatIsWhollyNearIsAsWithout) {
    for (const char* name : {"fight", "cloth"}) {
        const scenes::Scene scene = scenes::builtin(name);
        for (const Isa isa : available_isas()) {
            Engine engine(with_isa(isa));
            const std::vector<Posed> meshes = posed(scene, add_all(engine.context, scene), 0.4);
            const uint64_t without = hash(run_frame(engine.context, meshes));
            for (const Falloff& f : {Falloff{1e6f, 1e6f}, Falloff{1e3f, 2e3f}, Falloff{1e6f, FLT_MAX},
                                     Falloff{FLT_MAX, FLT_MAX}})
                EXPECT_EQ(hash(run_frame(engine.context, meshes, fading(f))), without)
                    << name << " " << isa_name(isa) << " " << f.from;
        }
    }
}

// As a fade moves out it hides as much as none in the end, and there is no step on the way.
TEST(Falloff, MovesOutWithoutAStep) {
    const scenes::Scene scene = scenes::builtin("hand");
    Engine engine;
    const std::vector<Posed> meshes = posed(scene, add_all(engine.context, scene), 0.4);
    const std::vector<float> all = run(engine.context, meshes, {});
    std::vector<float> last(all.size(), 1.0f);
    for (float to = 1e-3f; to < 64; to *= 1.25f) {
        const std::vector<float> seen = run(engine.context, meshes, {0.5f * to, to});
        double step = 0;
        for (size_t v = 0; v < seen.size(); ++v)
            step += std::fabs(double(seen[v]) - double(last[v])) / double(seen.size());
        EXPECT_LT(step, 0.1) << to;
        last = seen;
    }
    EXPECT_EQ(last, all);
}

// Whoever shares a batch, a triangle that ends far behind its fade is its near part.
TEST(Falloff, HostileSizes) {
    Engine engine;
    std::vector<glm::vec3> at;
    for (int i = 0; i < 40; ++i)
        at.emplace_back(0.01f * float(i % 8), 0.01f * float(i / 8), 0.0f);
    const scenes::Mesh receivers = points(at, std::vector<glm::vec3>(at.size(), {0, 0, 1}));
    const Posed below = at_rest(add(engine.context, receivers), receivers);
    const scenes::Mesh wide = ceiling(0.5f, 1e4f, 1);
    const Posed over = at_rest(add(engine.context, wide), wide);
    for (const float seen : run(engine.context, {below, over}, {0.6f, 1}))
        EXPECT_NEAR(seen, 1 - faded(0.5, 0.6, 1), 0.02);
    // Coordinates have steps of 0.06 there: what is as near touches, or does not.
    const scenes::Mesh wider = ceiling(0.5f, 1e6f, 1);
    for (const float seen :
         run(engine.context, {below, at_rest(add(engine.context, wider), wider)}, {0.6f, 1}))
        EXPECT_TRUE(seen >= -1e-5f && seen <= 1) << seen;
    const scenes::Mesh flat = ceiling(0.5f, 100, 1);
    const Posed near = at_rest(add(engine.context, flat), flat);
    for (const Falloff& f : {Falloff{0, FLT_MIN}, Falloff{0, 1e-45f}, Falloff{1e-30f, 1e-30f}}) {
        for (const float seen : run(engine.context, {below, near}, f))
            EXPECT_EQ(seen, 1.0f) << f.to;
    }
    for (const float seen : run(engine.context, {below, near}, {0, FLT_MAX}))
        EXPECT_NEAR(seen, 0, 0.01);
    // Broken corners hide nothing, and nothing else is harmed.
    const std::vector<float> before = run(engine.context, {below, near}, {0.6f, 1});
    const scenes::Mesh beside = ceiling(0.4f, 50, 3);
    Posed harmed = at_rest(add(engine.context, beside), beside);
    for (glm::vec3& p : harmed.positions)
        p.x = std::nanf("");
    EXPECT_EQ(run(engine.context, {below, near, harmed}, {0.6f, 1}), before);
}

// From whatever side a sheet is seen, and whichever object it is of.
TEST(Falloff, SheetsAndObjects) {
    Engine engine;
    const scenes::Mesh receiver = points({{0, 0, 0}, {0, 0, 2}}, {{0, 0, 1}, {0, 0, -1}});
    const scenes::Mesh mesh = ceiling(1, 100, 40);
    Posed at = at_rest(add(engine.context, receiver), receiver);
    Posed sheet = at_rest(add(engine.context, mesh), mesh);
    for (const uint32_t object : {0u, 1u}) {
        sheet.object = object;
        for (const Falloff& f : {Falloff{0, 2}, Falloff{1, 4}, Falloff{0.2f, 0.9f}}) {
            const std::vector<float> seen = run(engine.context, {at, sheet}, f);
            for (const float one : seen)
                EXPECT_NEAR(one, 1 - faded(1, f.from, f.to), 0.02) << object << " " << f.to;
        }
    }
    // Both sides of a sheet under another: each as it would be alone.
    const scenes::Mesh lower = ceiling(0.2f, 1, 12);
    Posed between = at_rest(add(engine.context, lower), lower);
    std::vector<Posed> both = {between, sheet};
    both[0].back_receives = true;
    const Outputs front = run_frame(engine.context, {between, sheet}, fading({0.5f, 2}));
    for (glm::vec3& n : between.normals)
        n = -n;
    const Outputs behind = run_frame(engine.context, {between, sheet}, fading({0.5f, 2}));
    const Outputs sides = run_frame(engine.context, both, fading({0.5f, 2}));
    for (size_t v = 0; v < between.positions.size(); ++v) {
        EXPECT_EQ(sides.meshes[0].transfer[v], front.meshes[0].transfer[v]);
        EXPECT_EQ(sides.backs[0].transfer[v], behind.meshes[0].transfer[v]);
    }
}

// A mask has the samples of which anything is hidden; and no receiver's result depends on its neighbours.
TEST(Falloff, MasksHoldWhatIsHiddenInPart) {
    const scenes::Scene scene = scenes::builtin("fight");
    Engine engine;
    std::vector<Posed> meshes = posed(scene, add_all(engine.context, scene), 0.4);
    const Outputs without = run_frame(engine.context, meshes);
    const Outputs near = run_frame(engine.context, meshes, fading({0.05f, 0.2f}));
    uint32_t in_part = 0;
    for (size_t v = 0; v < meshes[0].positions.size(); ++v) {
        const double seen = seen_of(near.meshes[0].transfer[v]);
        if (blocked_bits(near.meshes[0], v) == 0) {
            EXPECT_NEAR(seen, 1, 1e-4) << v;
        } else {
            EXPECT_LT(seen, 1 + 1e-4) << v;
            in_part += seen < 0.99 && seen > seen_of(without.meshes[0].transfer[v]) + 0.01;
        }
    }
    EXPECT_GT(in_part, meshes[0].positions.size() / 10);
    meshes[0].needed.assign(meshes[0].positions.size() / 32 + 1, 0x40100401u);
    const Outputs some = run_frame(engine.context, meshes, fading({0.05f, 0.2f}));
    for (size_t v = 0; v < meshes[0].positions.size(); ++v) {
        if (0x40100401u >> v % 32 & 1) {
            EXPECT_TRUE(same_result(some.meshes[0], near.meshes[0], v)) << v;
        }
    }
}

TEST(Falloff, FartherHidesMoreAndTheSameOnEveryInstructionSet) {
    const scenes::Scene scene = scenes::builtin("chess");
    std::vector<float> first;
    for (const Isa isa : available_isas()) {
        Engine engine(with_isa(isa));
        const std::vector<Posed> meshes = posed(scene, add_all(engine.context, scene), 0.4);
        std::vector<float> last(meshes[0].positions.size(), 1.0f), all;
        double mean = 1;
        for (const float to : {0.1f, 0.3f, 1.0f, 3.0f, 10.0f}) {
            const std::vector<float> seen = run(engine.context, meshes, {0, to});
            double sum = 0;
            for (size_t v = 0; v < seen.size(); ++v) {
                EXPECT_LE(seen[v], last[v] + 0.06f) << v << " " << to;
                sum += double(seen[v]) / double(seen.size());
            }
            EXPECT_LE(sum, mean + 1e-3);
            mean = sum;
            last = seen;
            all.insert(all.end(), seen.begin(), seen.end());
        }
        if (first.empty()) first = all;
        EXPECT_EQ(all, first) << isa_name(isa);
    }
}

TEST(Falloff, Refused) {
    Engine engine;
    const scenes::Mesh receiver = points({{0, 0, 0}}, {{0, 0, 1}});
    const std::vector<Posed> meshes = {at_rest(add(engine.context, receiver), receiver)};
    const StatusCode bad = StatusCode::invalid_argument;
    for (const Falloff& f : {Falloff{-1, 1}, Falloff{2, 1}, Falloff{0, -1}, Falloff{0, INFINITY},
                             Falloff{std::nanf(""), 1}, Falloff{0, std::nanf("")}, Falloff{1, 0}})
        run(engine.context, meshes, f, bad);
    run(engine.context, meshes, {0, 1}, bad, Quality::paper);
    EXPECT_EQ(run(engine.context, meshes, {0, 1}, StatusCode::ok, Quality::fine)[0], 1.0f);
}

} // namespace

} // namespace nusselt::test
