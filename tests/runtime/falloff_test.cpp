// Occlusion that fades with distance, through whole frames: closed forms, sizes of triangles, bad input.
#include "tests/runtime/fixture.h"

#include <algorithm>
#include <cmath>

#include <glm/geometric.hpp>

namespace nusselt::test {

namespace {

using Stream = nusselt::Output;

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

TEST(Falloff, ACeilingFadesAsItsDistanceDoes) {
    Engine engine;
    const scenes::Mesh receiver = points({{0, 0, 0}}, {{0, 0, 1}});
    const Posed at = at_rest(add(engine.context, receiver), receiver);
    for (const uint32_t n : {1u, 400u}) { // two huge triangles; many that are small beside the shells
        const scenes::Mesh mesh = ceiling(1, 100, n);
        const Posed over = at_rest(add(engine.context, mesh), mesh);
        const double budget =
            n == 1 ? 0.02 : 0.12; // a stair is climbed by half a metre's triangle as a whole
        EXPECT_NEAR(run(engine.context, {at, over}, {})[0], 0, 0.01) << n;
        for (const float distance : {0.5f, 0.9f, 1.5f, 2.0f, 5.0f, 20.0f})
            EXPECT_NEAR(run(engine.context, {at, over}, {distance, distance})[0], 1 - hidden(1, distance),
                        budget)
                << n << " " << distance;
        for (const Falloff& f :
             {Falloff{0, 2}, Falloff{0, 10}, Falloff{1, 4}, Falloff{3, 6}, Falloff{0.2f, 0.9f}})
            EXPECT_NEAR(run(engine.context, {at, over}, f)[0], 1 - faded(1, f.from, f.to), budget + 0.03)
                << n << " " << f.from << " " << f.to;
    }
}

TEST(Falloff, WhatIsWhollyNearIsAsWithout) {
    const scenes::Scene scene = scenes::builtin("fight");
    for (const Isa isa : available_isas()) {
        Engine engine(with_isa(isa));
        const std::vector<Posed> meshes = posed(scene, add_all(engine.context, scene), 0.4);
        EXPECT_EQ(run(engine.context, meshes, {}), run(engine.context, meshes, {1e6f, 1e6f}))
            << isa_name(isa);
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
