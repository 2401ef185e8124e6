// Receivers inside closed parts see nothing; everyone else is left alone.
#include "tests/runtime/fixture.h"

#include <glm/geometric.hpp>

#include <cmath>
#include <limits>

namespace nusselt::test {

namespace {

using scenes::Mesh;

Mesh moved(Mesh mesh, const glm::vec3& by) {
    for (glm::vec3& p : mesh.rest_positions)
        p += by;
    return mesh;
}

Mesh turned_inside_out(Mesh mesh) {
    for (size_t i = 0; i < mesh.indices.size(); i += 3)
        std::swap(mesh.indices[i + 1], mesh.indices[i + 2]);
    for (glm::vec3& n : mesh.rest_normals)
        n = -n;
    return mesh;
}

bool is_dark(const Output& output, size_t vertex) {
    for (const float term : output.transfer[vertex]) {
        if (term != 0) return false;
    }
    return blocked_bits(output, vertex) == 1024;
}

TEST(Inside, ASphereWithinASphereIsDark) {
    Engine engine;
    const Outputs out =
        run_at_rest(engine.context, {scenes::sphere(3), moved(scenes::sphere(2, 0.4f), {0.2f, 0, 0})});
    for (size_t v = 0; v < out.meshes[0].transfer.size(); ++v)
        EXPECT_EQ(blocked_bits(out.meshes[0], v), 0u) << v;
    for (size_t v = 0; v < out.meshes[1].transfer.size(); ++v)
        EXPECT_TRUE(is_dark(out.meshes[1], v)) << v;
    EXPECT_EQ(out.stats.receivers_inside, out.meshes[1].transfer.size());
}

// Each receiver by the other sphere's equation, but for those about as near to it as a facet is deep.
TEST(Inside, OfTwoSpheresThatPassThroughOneAnother) {
    Engine engine;
    const glm::vec3 at(1.1f, 0.2f, -0.1f);
    const std::vector<Mesh> meshes{scenes::sphere(4), moved(scenes::sphere(4), at)};
    const Outputs out = run_at_rest(engine.context, meshes);
    uint32_t dark = 0, lit = 0;
    for (size_t m = 0; m < 2; ++m) {
        for (size_t v = 0; v < meshes[m].rest_positions.size(); ++v) {
            const float distance = glm::length(meshes[m].rest_positions[v] - (m == 0 ? at : glm::vec3(0)));
            if (std::fabs(distance - 1) < 0.01f) continue;
            EXPECT_EQ(is_dark(out.meshes[m], v), distance < 1) << m << " " << v;
            (distance < 1 ? dark : lit) += 1;
        }
    }
    EXPECT_GT(dark, 500u);
    EXPECT_GT(lit, 2000u);
}

// A part that is inside out is no closed part: its sides both block, and what it holds is in the dark all the
// same.
TEST(Inside, AHollowIsDark) {
    Engine engine;
    const std::vector<Mesh> meshes{scenes::sphere(3), turned_inside_out(scenes::sphere(3, 0.9f)),
                                   moved(scenes::sphere(2, 0.2f), {0.1f, 0.1f, 0}),
                                   moved(scenes::sphere(2, 0.02f), {0.95f, 0, 0})}; // in the wall
    const Outputs out = run_at_rest(engine.context, meshes);
    for (size_t v = 0; v < out.meshes[0].transfer.size(); ++v)
        EXPECT_EQ(blocked_bits(out.meshes[0], v), 0u) << v;
    for (size_t m = 1; m < 4; ++m) {
        for (size_t v = 0; v < out.meshes[m].transfer.size(); ++v)
            EXPECT_TRUE(is_dark(out.meshes[m], v)) << m << " " << v;
    }
}

// Hard edges: normals along the walls, rays that run within planes and through corners.
TEST(Inside, BoxesThatTouchAreNotDark) {
    Engine engine;
    const std::vector<Mesh> meshes{scenes::box({-2, -1, -2}, {2, 0, 2}), // a floor
                                   scenes::box({-1, 0, -1}, {0, 1, 0}),  // stands on it
                                   scenes::box({0, 0, -1}, {1, 2, 0}),   // and touches that one
                                   scenes::box({0.25f, 2, -0.75f}, {0.75f, 3, -0.25f})};
    const Outputs out = run_at_rest(engine.context, meshes);
    // The floor's corners and the top of each box stand free.
    for (size_t v = 0; v < meshes[0].rest_positions.size(); ++v)
        EXPECT_FALSE(is_dark(out.meshes[0], v)) << v;
    for (size_t m = 1; m < 4; ++m) {
        float top = 0;
        for (const glm::vec3& p : meshes[m].rest_positions)
            top = std::max(top, p.y);
        for (size_t v = 0; v < meshes[m].rest_positions.size(); ++v) {
            const bool touches = m == 1 && meshes[m].rest_positions[v].x == 0; // another box's wall
            if (meshes[m].rest_positions[v].y != top || touches) continue;
            EXPECT_FALSE(is_dark(out.meshes[m], v)) << m << " " << v;
        }
    }
}

TEST(Inside, OpenPartsHideNobody) {
    Engine engine;
    Mesh shell = scenes::sphere(3);
    shell.indices.resize(shell.indices.size() - 3); // a hole
    const Outputs out = run_at_rest(engine.context, {shell, scenes::sphere(2, 0.4f)});
    EXPECT_EQ(out.stats.receivers_inside, 0u);
}

// A broken triangle makes a hole in what is counted, so nobody behind it is called inside; the others are.
TEST(Inside, ABrokenCornerDarkensNobodyOutside) {
    Engine engine;
    const Mesh outer = scenes::sphere(3), inner = moved(scenes::sphere(2, 0.2f), {0, 2, 0});
    const std::vector<MeshId> ids{add(engine.context, outer), add(engine.context, inner)};
    std::vector<Posed> pose{at_rest(ids[0], outer), at_rest(ids[1], inner)};
    for (size_t v = 0; v < outer.rest_positions.size(); v += 40)
        pose[0].positions[v].y = std::numeric_limits<float>::quiet_NaN();
    const Outputs out = run_frame(engine.context, pose);
    for (size_t v = 0; v < inner.rest_positions.size(); ++v)
        EXPECT_FALSE(is_dark(out.meshes[1], v)) << v;
}

// The hand as a fist: the same on every instruction set, and whoever shares the batch.
TEST(Inside, TheSameOnEverySetAndAlone) {
    const scenes::Scene scene = scenes::builtin("hand");
    Outputs first;
    for (const Isa isa : available_isas()) {
        Engine engine(with_isa(isa));
        const Outputs out = run_scene(engine.context, scene, 0.6 * scene.duration);
        EXPECT_GT(out.stats.receivers_inside, 100u);
        if (first.meshes.empty()) first = out;
        EXPECT_EQ(out, first);
        EXPECT_EQ(out.stats.receivers_inside, first.stats.receivers_inside);
    }
    Engine engine;
    std::vector<Posed> pose = posed(scene, add_all(engine.context, scene), 0.6 * scene.duration);
    const size_t count = pose[0].positions.size();
    pose[0].needed.assign((count + 31) / 32, 0x04104104u); // about every sixth
    const Outputs some = run_frame(engine.context, pose);
    for (size_t v = 0; v < count; ++v) {
        if (pose[0].needed[v / 32] >> (v % 32) & 1) {
            EXPECT_EQ(some.meshes[0].transfer[v], first.meshes[0].transfer[v]) << v;
        }
    }
}

} // namespace

} // namespace nusselt::test
