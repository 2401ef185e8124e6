// Several objects in one frame: each blocks itself as finely as alone and the others as a coarse proxy.
#include "tests/runtime/crowd.h"

#include <glm/geometric.hpp>

#include <algorithm>
#include <cmath>

namespace nusselt::test {

namespace {

TEST(Objects, OneObjectOfAnyNumberIsAGroup) {
    Engine engine;
    const std::vector<Posed> meshes = crowd(engine.context, 2, 1.2f);
    EXPECT_EQ(run_frame(engine.context, as_one(meshes, 7)), run_frame(engine.context, as_one(meshes)));
    EXPECT_FALSE(run_frame(engine.context, meshes) == run_frame(engine.context, as_one(meshes)));
    // The meshes of `paper` are coarse already.
    EXPECT_EQ(run_frame(engine.context, meshes, Quality::paper),
              run_frame(engine.context, as_one(meshes), Quality::paper));
}

TEST(Objects, ProxiesCostLittleAndHideAboutTheSame) {
    Engine engine;
    const std::vector<Posed> meshes = crowd(engine.context, 4, 1.2f);
    for (const Quality quality : {Quality::draft, Quality::standard, Quality::fine}) {
        const Outputs exact = run_frame(engine.context, as_one(meshes), quality),
                      proxies = run_frame(engine.context, meshes, quality);
        EXPECT_LT(proxies.stats.triangles_rasterized, exact.stats.triangles_rasterized)
            << quality_name(quality);
        EXPECT_LT(difference(proxies, exact), quality == Quality::fine ? 0.02 : 0.03)
            << quality_name(quality);
    }
    // What they hide of one another is much more than what proxies miss of it.
    const Outputs exact = run_frame(engine.context, as_one(meshes));
    EXPECT_GT(difference(each_alone(engine.context, meshes), exact),
              4 * difference(run_frame(engine.context, meshes), exact));
}

bool is_repeated(const Posed& mesh, size_t vertex) {
    return std::count(mesh.positions.begin(), mesh.positions.end(), mesh.positions[vertex]) > 1;
}

// What a receiver gets does not depend on who else is computed; but of several at one place, each may be
// computed with the region of its own.
TEST(Objects, NeededReceiversGetTheSame) {
    Engine engine;
    std::vector<Posed> meshes = crowd(engine.context, 4, 1.5f);
    const Outputs drawn = run_frame(engine.context, meshes), far = run_far(engine.context, meshes);
    Random random(8);
    for (Posed& mesh : meshes) {
        mesh.needed.assign((mesh.positions.size() + 31) / 32, 0);
        for (uint32_t& word : mesh.needed)
            word = uint32_t(random.engine() & random.engine());
    }
    const Outputs some_drawn = run_frame(engine.context, meshes), some_far = run_far(engine.context, meshes);
    size_t compared = 0;
    for (size_t m = 0; m < meshes.size(); ++m) {
        for (size_t v = 0; v < meshes[m].positions.size(); ++v) {
            if (!(meshes[m].needed[v / 32] >> v % 32 & 1)) continue;
            EXPECT_TRUE(same_result(some_drawn.meshes[m], drawn.meshes[m], v)) << m << " " << v;
            if (is_repeated(meshes[m], v)) continue;
            EXPECT_EQ(some_far.meshes[m].transfer[v], far.meshes[m].transfer[v]) << m << " " << v;
            ++compared;
        }
    }
    EXPECT_GT(compared, meshes[0].positions.size() / 2);
}

TEST(Objects, SmallFarOnesHideNothing) {
    Engine engine;
    const std::vector<Posed> meshes = crowd(engine.context, 2, 300);
    scenes::Mesh bare = scenes::builtin("fight").meshes[0];
    bare.indices.clear();
    std::vector<Posed> instead = meshes;
    instead[1].mesh = add(engine.context, bare);
    const Outputs both = run_frame(engine.context, meshes), alone = run_frame(engine.context, instead);
    EXPECT_EQ(both.meshes[0], alone.meshes[0]);
}

TEST(Objects, WithoutBlockersNothingIsHidden) {
    Engine engine;
    const scenes::Mesh ball = scenes::sphere(3);
    scenes::Mesh bare = ball;
    bare.indices.clear();
    const std::vector<Posed> nothing{moved(at_rest(add(engine.context, bare), bare), {0, 0, 0}, 1),
                                     moved(at_rest(add(engine.context, bare), bare), {1, 0, 0}, 2)};
    const Outputs open = run_frame(engine.context, nothing);
    for (const Output& mesh : open.meshes)
        EXPECT_TRUE(
            std::all_of(mesh.masks.begin(), mesh.masks.end(), [](uint32_t word) { return word == 0; }));
    // An object beside one that hides nothing is as alone.
    const std::vector<Posed> one{moved(at_rest(add(engine.context, ball), ball), {0, 0, 0}, 1), nothing[1]};
    EXPECT_EQ(run_frame(engine.context, one).meshes[0], run_frame(engine.context, {one[0]}).meshes[0]);
}

// Where they meet, proxies are as fine as the objects: the same receivers are inside, and what lies beside
// the seam is shadowed alike.
TEST(Objects, ThatReachIntoOneAnother) {
    Engine engine;
    const scenes::Mesh ball = scenes::sphere(4);
    for (const float distance : {1.1f, 1.9f, 2.0f, 2.05f}) {
        const std::vector<Posed> meshes{moved(at_rest(add(engine.context, ball), ball), {0, 0, 0}, 1),
                                        moved(at_rest(add(engine.context, ball), ball), {distance, 0, 0}, 2)};
        const Outputs exact = run_frame(engine.context, as_one(meshes)),
                      proxies = run_frame(engine.context, meshes);
        EXPECT_EQ(proxies.stats.receivers_inside, exact.stats.receivers_inside) << distance;
        EXPECT_LT(difference(proxies, exact), 0.02) << distance;
        const auto left = scenes::sphere(4).rest_positions;
        for (size_t v = 0; v < left.size(); ++v) {
            // Away from the seam by a few facets, where a level may take a facet's place.
            const float gap = std::fabs(glm::length(left[v] - glm::vec3(distance, 0, 0)) - 1);
            if (gap < 0.1f) continue;
            EXPECT_LT(norm(proxies.meshes[0].transfer[v], exact.meshes[0].transfer[v]), 0.06)
                << distance << " " << v;
        }
    }
}

TEST(Objects, TheSameBitsEverywhere) {
    Outputs first, first_far;
    for (const Isa isa : available_isas()) {
        Engine engine(with_isa(isa));
        const std::vector<Posed> meshes = crowd(engine.context, 3, 1.2f);
        const Outputs out = run_frame(engine.context, meshes, Quality::draft);
        if (first.meshes.empty()) first = out;
        EXPECT_EQ(out, first) << isa_name(isa);
        const Outputs far = run_far(engine.context, meshes);
        if (first_far.meshes.empty()) first_far = far;
        EXPECT_EQ(far, first_far) << isa_name(isa);
    }
}

TEST(Objects, AHistoryKeepsWhatWouldBeComputed) {
    Engine engine;
    Random random(6);
    std::vector<Posed> meshes = crowd(engine.context, 3, 1.5f);
    FrameDesc settings;
    settings.quality = Quality::draft;
    ASSERT_TRUE(create_history(engine.context, &settings.history).ok());
    uint32_t reused = 0;
    for (int step = 0; step < 12; ++step) {
        Posed& mesh = meshes[random.below(uint32_t(meshes.size()))];
        const uint32_t count = uint32_t(mesh.positions.size()), first = random.below(count);
        if (step % 4 == 3) {
            mesh.object = random.below(3);
        } else {
            for (uint32_t i = 0; i < (step % 4 == 2 ? count : 3); ++i)
                mesh.positions[(first + i) % count] += 0.01f * random.direction();
        }
        const Outputs kept = run_frame(engine.context, meshes, settings);
        EXPECT_EQ(kept, run_frame(engine.context, meshes, Quality::draft)) << step;
        reused += kept.stats.receivers_reused;
    }
    EXPECT_GT(reused, 0u);
    EXPECT_TRUE(remove_history(engine.context, settings.history).ok());
}

} // namespace

} // namespace nusselt::test
