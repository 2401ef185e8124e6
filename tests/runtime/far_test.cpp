// Objects that are far from the receivers of a region or a mesh: seen from one point for all of them.
#include "tests/runtime/crowd.h"

#include <glm/geometric.hpp>

#include <algorithm>
#include <cmath>

namespace nusselt::test {

namespace {

// A row so long that its ends see one another from their middles alone.
TEST(Far, TheFarthestAreDrawnOnceAMesh) {
    Engine engine;
    std::vector<Posed> ends = crowd(engine.context, 2, 1.2f);
    for (Posed& mesh : ends) {
        for (glm::vec3& p : mesh.positions)
            p.x += mesh.object == 1 ? 6.0f : 0.0f; // some seven radii
    }
    const Outputs exact = run_frame(engine.context, as_one(ends)), far = run_far(engine.context, ends);
    EXPECT_LT(difference(far, exact), 0.005);
    // Their own triangles, and the other's six times a mesh rather than for each receiver.
    uint64_t own = 0;
    for (const Posed& mesh : ends)
        own += run_frame(engine.context, {mesh}).stats.triangles_rasterized;
    const Outputs drawn = run_frame(engine.context, ends);
    EXPECT_LT(far.stats.triangles_rasterized - own, (drawn.stats.triangles_rasterized - own) / 20);
}

// How far is told in radii of the receivers' mesh: a small ball sees a large one from its middle although
// that hides much of its sky.
TEST(Far, TheFarthestHideAsMuchAsTheyDo) {
    Engine engine;
    const scenes::Mesh small = scenes::sphere(3, 0.1f), large = scenes::sphere(4);
    for (const float distance : {1.45f, 2.0f}) { // 3.5 and 9 radii between the two
        std::vector<Posed> meshes{
            moved(at_rest(add(engine.context, small), small), {distance, 0, 0}, 1),
            moved(at_rest(add(engine.context, large), large), {0, 0, 0}, 2),
        };
        const auto of_the_small = [](Outputs out) {
            out.meshes.resize(1);
            return out;
        };
        const Outputs exact = of_the_small(run_frame(engine.context, as_one(meshes))),
                      far = of_the_small(run_far(engine.context, meshes)),
                      alone = of_the_small(run_frame(engine.context, {meshes[0]}));
        EXPECT_LT(difference(far, exact), 0.12 * difference(alone, exact)) << distance;
    }
}

// A vertex of no triangle, right over another object's top and far from its own mesh, looks down at it.
TEST(Far, LooseReceiversSeeFromWhereTheyAre) {
    Engine engine;
    const scenes::Mesh ball = scenes::sphere(3);
    scenes::Mesh with_loose = ball;
    with_loose.rest_positions.push_back({12, 1.2f, 0});
    with_loose.rest_normals.push_back({0, -1, 0});
    const Outputs out =
        run_far(engine.context, {moved(at_rest(add(engine.context, with_loose), with_loose), {0, 0, 0}, 1),
                                 moved(at_rest(add(engine.context, ball), ball), {12, 0, 0}, 2)});
    EXPECT_LT(out.meshes[0].transfer.back()[0] / 0.28209479f, 0.35f);
    EXPECT_GT(out.meshes[0].transfer.front()[0] / 0.28209479f, 0.95f);
}

// Seen once for a region of receivers.
TEST(Far, FarOnesAreMultipliedIn) {
    Engine engine;
    for (const float spacing : {1.2f, 2.5f}) {
        const std::vector<Posed> meshes = crowd(engine.context, 4, spacing);
        const Outputs exact = run_frame(engine.context, as_one(meshes)),
                      drawn = run_frame(engine.context, meshes), far = run_far(engine.context, meshes);
        EXPECT_LT(difference(far, exact), 0.035) << spacing;
        EXPECT_LT(far.stats.triangles_rasterized, drawn.stats.triangles_rasterized) << spacing;
        EXPECT_GT(difference(each_alone(engine.context, meshes), exact), 2 * difference(far, exact))
            << spacing;
    }
    // A ball high over a floor, against the part of the sky that it takes from the floor's middle.
    const scenes::Mesh floor = scenes::plane(2, 8), ball = scenes::sphere(4);
    const std::vector<Posed> meshes{moved(at_rest(add(engine.context, floor), floor), {0, 0, 0}, 1),
                                    moved(at_rest(add(engine.context, ball), ball), {0, 6, 0}, 2)};
    const Outputs out = run_far(engine.context, meshes);
    for (size_t v = 0; v < floor.rest_positions.size(); ++v) {
        const glm::vec3 to = glm::vec3(0, 6, 0) - floor.rest_positions[v];
        const float distance = glm::length(to), seen = 1 - to.y / distance / (distance * distance);
        EXPECT_NEAR(out.meshes[0].transfer[v][0] / 0.28209479f, seen, 0.01f) << v;
    }
}

// What is far from a region or a mesh is told from all of their receivers: what nearly touches one of
// them is drawn into its mask, as it is in a frame that has no views.
TEST(Far, WhatIsNearIsDrawn) {
    Engine engine;
    Random random(41);
    scenes::Mesh floor = scenes::plane(4, 80); // 6,561 receivers, a twentieth apart
    const scenes::Mesh ball = scenes::sphere(3, 0.25f);
    const MeshId floor_id = add(engine.context, floor), ball_id = add(engine.context, ball);
    uint32_t near = 0, far = 0;
    for (int at = 0; at < 12; ++at) {
        const glm::vec3 centre(random.between(-2.2f, 2.2f), random.between(0.26f, 0.5f),
                               random.between(-2.2f, 2.2f));
        Posed below = at_rest(floor_id, floor);
        below.object = 1;
        const std::vector<Posed> meshes{below, moved(at_rest(ball_id, ball), centre, 2)};
        const Outputs drawn = run_frame(engine.context, meshes), out = run_far(engine.context, meshes);
        for (size_t v = 0; v < floor.rest_positions.size(); ++v) {
            const bool same = out.meshes[0].transfer[v] == drawn.meshes[0].transfer[v];
            if (glm::distance(floor.rest_positions[v], centre) < 0.25f + 0.05f) {
                EXPECT_TRUE(same) << at << " " << v;
                ++near;
            }
            far += !same;
        }
    }
    EXPECT_GT(near, 12u);
    EXPECT_GT(far, 12u * 1000); // by views
}

// Meshes that hide nothing and receive nothing, wherever they stand in the list, change no region;
// nor does the order of the list.
TEST(Far, MeshesWithoutReceiversAndOrderChangeNothing) {
    Engine engine;
    const std::vector<Posed> meshes = crowd(engine.context, 4, 1.3f);
    const float origin[3] = {0.1f, 0.2f, 0.3f}; // not that of the mesh that comes first
    FrameDesc settings;
    settings.origin = origin;
    const Outputs plain = run_far(engine.context, meshes, settings);
    scenes::Mesh bare = scenes::sphere(3);
    bare.indices.clear();
    Posed idle = at_rest(add(engine.context, bare), bare);
    idle.receives = false;
    idle.object = 9;
    for (size_t place = 0; place <= meshes.size(); ++place) {
        std::vector<Posed> more = meshes;
        more.insert(more.begin() + ptrdiff_t(place), idle);
        Outputs out = run_far(engine.context, more, settings);
        out.meshes.erase(out.meshes.begin() + ptrdiff_t(place));
        EXPECT_EQ(out.meshes, plain.meshes) << place;
    }
    Outputs backwards = run_far(engine.context, {meshes.rbegin(), meshes.rend()}, settings);
    std::reverse(backwards.meshes.begin(), backwards.meshes.end());
    EXPECT_EQ(backwards.meshes, plain.meshes);
    // One that only hides still hides.
    std::vector<Posed> one = meshes;
    for (size_t m = 1; m < one.size(); ++m)
        one[m].receives = false;
    EXPECT_LT(difference(run_far(engine.context, {one[0]}), run_far(engine.context, {meshes[0]})), 1e-9);
    Outputs first = run_far(engine.context, one);
    first.meshes.resize(1);
    Outputs wanted = run_frame(engine.context, as_one(meshes));
    wanted.meshes.resize(1);
    EXPECT_LT(difference(first, wanted), 0.035);
}

// Strips of all lengths: there are one to four regions of receivers and as many of duplicates, and the
// last region is seldom full.
TEST(Far, RegionsThatAreNotFull) {
    Engine engine;
    const scenes::Mesh ball = scenes::sphere(3);
    for (uint32_t length = 1; length < 60; length += 3) {
        scenes::Mesh strip;
        for (uint32_t i = 0; i <= length; ++i) {
            // Each corner twice, with two normals: half of them are duplicates.
            for (const float z : {0.0f, 1.0f}) {
                for (const float tilt : {0.0f, 0.3f}) {
                    strip.rest_positions.emplace_back(0.1f * float(i), 0, z);
                    strip.rest_normals.push_back(glm::normalize(glm::vec3(tilt, 1, 0)));
                }
            }
            if (i == 0) continue;
            const uint32_t a = 4 * (i - 1), b = a + 2, c = a + 4, d = a + 6;
            strip.indices.insert(strip.indices.end(), {a, b, c, c, b, d});
        }
        const MeshId id = add(engine.context, strip), ball_id = add(engine.context, ball);
        Posed receiver = at_rest(id, strip);
        receiver.object = 1;
        const std::vector<Posed> meshes{receiver, moved(at_rest(ball_id, ball), {3, 7, 0}, 2)};
        const Outputs far = run_far(engine.context, meshes), drawn = run_frame(engine.context, meshes);
        for (size_t v = 0; v < strip.rest_positions.size(); ++v)
            EXPECT_LT(norm(far.meshes[0].transfer[v], drawn.meshes[0].transfer[v]), 0.02)
                << length << " " << v;
        EXPECT_TRUE(remove_mesh(engine.context, id).ok());
        EXPECT_TRUE(remove_mesh(engine.context, ball_id).ok());
    }
}

// A receiver that is nowhere leaves its region's others what they were.
TEST(Far, RegionsWithReceiversThatAreNowhere) {
    Engine engine;
    std::vector<Posed> meshes = crowd(engine.context, 2, 1.3f);
    scenes::Mesh loose = scenes::plane(1, 40);
    const size_t last = loose.rest_positions.size();
    loose.rest_positions.push_back({0.1f, 0, 0.1f});
    loose.rest_normals.push_back({0, 1, 0});
    Posed floor = moved(at_rest(add(engine.context, loose), loose), {0, -0.05f, 0}, 7);
    meshes.push_back(floor);
    const Outputs whole = run_far(engine.context, meshes);
    for (const float nowhere : {NAN, INFINITY, -INFINITY}) {
        meshes.back().positions[last].x = nowhere;
        const Outputs out = run_far(engine.context, meshes);
        EXPECT_EQ(out.stats.receivers_invalid, 1u);
        for (size_t v = 0; v < last; ++v)
            EXPECT_LT(norm(out.meshes.back().transfer[v], whole.meshes.back().transfer[v]), 0.02) << v;
    }
    // All of a mesh's: nothing to see from, and the others see as without it.
    for (glm::vec3& p : meshes.back().positions)
        p.y = NAN;
    Outputs out = run_far(engine.context, meshes);
    out.meshes.pop_back();
    meshes.back().receives = true;
    std::vector<Posed> rest(meshes.begin(), meshes.end() - 1);
    EXPECT_LT(difference(out, run_far(engine.context, rest)), 0.01);
}

// Views from a mesh's middle are for both of its sides.
TEST(Far, BothSidesShareAView) {
    Engine engine;
    scenes::Mesh sheet = scenes::plane(2, 30);
    const scenes::Mesh ball = scenes::sphere(3);
    Posed upper = at_rest(add(engine.context, sheet), sheet);
    upper.object = 1;
    const MeshId above = add(engine.context, ball), below = add(engine.context, ball);
    std::vector<Posed> meshes{upper, moved(at_rest(above, ball), {0.5f, 3, 0}, 2),
                              moved(at_rest(below, ball), {-1, -4, 1}, 3)};
    const Outputs front = run_far(engine.context, meshes);
    meshes[0].back_receives = true;
    const Outputs both = run_far(engine.context, meshes);
    meshes[0].receives = false;
    const Outputs back = run_far(engine.context, meshes);
    EXPECT_EQ(both.meshes, front.meshes);
    EXPECT_EQ(both.backs[0], back.backs[0]);
    for (glm::vec3& n : meshes[0].normals)
        n = -n;
    meshes[0].receives = true;
    meshes[0].back_receives = false;
    EXPECT_EQ(run_far(engine.context, meshes).meshes[0], both.backs[0]);
    EXPECT_FALSE(both.meshes[0] == both.backs[0]);
}

// A history keeps single receivers, so its frames have no views: all others are drawn, and what a region
// keeps while its neighbours move is what a history that begins there computes.
TEST(Far, HistoriesHaveNoViews) {
    Engine engine;
    Random random(12);
    std::vector<Posed> meshes = crowd(engine.context, 3, 1.5f);
    FrameDesc settings;
    settings.quality = Quality::draft;
    ASSERT_TRUE(create_history(engine.context, &settings.history).ok());
    uint32_t reused = 0;
    for (int step = 0; step < 8; ++step) {
        Posed& mesh = meshes[random.below(uint32_t(meshes.size()))];
        if (step % 3 == 2) {
            mesh.receives = !mesh.receives;
        } else {
            for (uint32_t i = 0; i < (step % 3 ? 4 : mesh.positions.size()); ++i)
                mesh.positions[i] += 0.01f * random.direction();
        }
        const Outputs kept = run_far(engine.context, meshes, settings);
        FrameDesc cold = settings;
        ASSERT_TRUE(create_history(engine.context, &cold.history).ok());
        EXPECT_EQ(kept, run_far(engine.context, meshes, cold)) << step;
        EXPECT_TRUE(remove_history(engine.context, cold.history).ok());
        const Outputs drawn = run_frame(engine.context, meshes, Quality::draft);
        for (size_t m = 0; m < meshes.size(); ++m)
            EXPECT_EQ(kept.meshes[m].transfer, drawn.meshes[m].transfer) << step << " " << m;
        reused += kept.stats.receivers_reused;
    }
    EXPECT_GT(reused, 0u);
    EXPECT_TRUE(remove_history(engine.context, settings.history).ok());
}

} // namespace

} // namespace nusselt::test
