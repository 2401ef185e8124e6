// One frame in which a deformation goes wrong: no crash, finite results, and the frame after it is that of a
// cold start, with and without a history.
#include "tests/runtime/fixture.h"

#include <cmath>
#include <functional>
#include <limits>

namespace nusselt::test {

namespace {

using Deform = std::function<glm::vec3(glm::vec3, Random&)>;

struct BadPose {
    const char* name;
    Deform deform;
};

constexpr float nan_value = std::numeric_limits<float>::quiet_NaN();
constexpr float infinity = std::numeric_limits<float>::infinity();

std::vector<BadPose> bad_poses() {
    return {
        {"a point", [](glm::vec3, Random&) { return glm::vec3(0.3f); }},
        {"a line", [](glm::vec3 p, Random&) { return glm::vec3(p.x, 0, 0); }},
        {"a plane", [](glm::vec3 p, Random&) { return glm::vec3(p.x, 0, p.z); }},
        {"nearly a plane", [](glm::vec3 p, Random&) { return glm::vec3(p.x, 1e-20f * p.y, p.z); }},
        {"inside out", [](glm::vec3 p, Random&) { return -p; }},
        {"a mirror image", [](glm::vec3 p, Random&) { return glm::vec3(p.x, -p.y, p.z); }},
        {"exploded", [](glm::vec3 p, Random& r) { return p + 1e3f * r.direction(); }},
        {"exploded beyond floats", [](glm::vec3, Random& r) { return 3e38f * r.direction(); }},
        {"half exploded", [](glm::vec3 p, Random& r) { return r.below(2) ? p : 1e20f * r.direction(); }},
        {"far away", [](glm::vec3 p, Random&) { return p + glm::vec3(1e7f); }},
        {"farther away", [](glm::vec3 p, Random&) { return p + glm::vec3(3e38f); }},
        {"huge", [](glm::vec3 p, Random&) { return 1e30f * p; }},
        {"tiny", [](glm::vec3 p, Random&) { return 1e-38f * p; }},
        {"not a number", [](glm::vec3, Random&) { return glm::vec3(nan_value); }},
        {"infinite here and there",
         [](glm::vec3 p, Random& r) { return r.below(3) ? p : glm::vec3(infinity, p.y, -infinity); }},
    };
}

bool all_finite(const Outputs& outputs) {
    for (const Output& o : outputs.meshes) {
        for (const auto& transfer : o.transfer) {
            for (const float value : transfer) {
                if (!std::isfinite(value)) return false;
            }
        }
    }
    return true;
}

void deform_meshes(std::vector<Posed>& frame, const BadPose& bad, size_t count) {
    Random random(1);
    for (size_t m = 0; m < count; ++m) {
        for (glm::vec3& p : frame[m].positions)
            p = bad.deform(p, random);
    }
}

class BadPoses : public testing::TestWithParam<Quality> {};

TEST_P(BadPoses, TheNextFrameIsThatOfAColdStart) {
    const scenes::Scene scene = scenes::builtin("fight");
    Engine engine;
    const std::vector<MeshId> ids = add_all(engine.context, scene);
    const std::vector<Posed> good = posed(scene, ids, 0.3 * scene.duration);
    Outputs cold;
    {
        Engine fresh;
        cold = run_frame(fresh.context, posed(scene, add_all(fresh.context, scene), 0.3 * scene.duration),
                         GetParam());
    }
    FrameDesc remembering;
    remembering.quality = GetParam();
    ASSERT_TRUE(create_history(engine.context, &remembering.history).ok());
    for (const BadPose& bad : bad_poses()) {
        for (const size_t meshes : {size_t(1), good.size()}) { // one of the group, or all of it
            std::vector<Posed> broken = good;
            deform_meshes(broken, bad, meshes);
            const Outputs out = run_frame(engine.context, broken, GetParam());
            EXPECT_TRUE(all_finite(out)) << bad.name;
            EXPECT_EQ(run_frame(engine.context, good, GetParam()), cold) << "after " << bad.name;

            EXPECT_EQ(run_frame(engine.context, broken, remembering), out) << bad.name;
            EXPECT_EQ(run_frame(engine.context, good, remembering), cold) << "after " << bad.name;
        }
    }
    EXPECT_TRUE(remove_history(engine.context, remembering.history).ok());
}

INSTANTIATE_TEST_SUITE_P(Qualities, BadPoses,
                         testing::Values(Quality::paper, Quality::draft, Quality::standard),
                         [](const auto& of) { return std::string(quality_name(of.param)); });

} // namespace

} // namespace nusselt::test
