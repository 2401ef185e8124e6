#include "bench/scenes/portable_math.h"
#include "bench/scenes/skin.h"

#include <glm/geometric.hpp>
#include <gtest/gtest.h>

namespace nusselt::scenes {
namespace {

// Two parallel limbs 1 apart, of two bones each, on bone 0.
std::vector<Chain> two_limbs() {
    std::vector<Chain> chains;
    for (int limb = 0; limb < 2; ++limb) {
        const float x = static_cast<float>(limb);
        chains.push_back({0,
                          {1 + 2 * limb, 2 + 2 * limb},
                          {{x, 0, 0}, {x, 2, 0}, {x, 4, 0}},
                          {0.2f, 0.2f, 0.2f},
                          {0.3f, 0.3f}});
    }
    return chains;
}

float weight_of(const Influence& influence, int bone) {
    float sum = 0;
    for (size_t k = 0; k < 4; ++k)
        if (influence.bone[k] == bone) sum += influence.weight[k];
    return sum;
}

TEST(ChainWeights, SumToOneAndDoNotBleedBetweenLimbs) {
    std::vector<glm::vec3> points;
    for (int i = 0; i <= 50; ++i)
        for (float x : {-0.2f, 0.0f, 0.2f, 0.8f, 1.0f, 1.2f})
            points.push_back({x, -1 + 0.1f * static_cast<float>(i), 0.1f});
    const std::vector<Influence> influences = chain_weights(points, two_limbs(), 0.3f);
    for (size_t v = 0; v < points.size(); ++v) {
        float sum = 0;
        for (float weight : influences[v].weight) {
            EXPECT_GE(weight, 0);
            sum += weight;
        }
        EXPECT_NEAR(sum, 1, 1e-5);
        const int others = points[v].x < 0.5f ? 3 : 1;
        EXPECT_EQ(weight_of(influences[v], others), 0);
        EXPECT_EQ(weight_of(influences[v], others + 1), 0);
    }
}

TEST(ChainWeights, FollowTheBoneBesideThem) {
    const std::vector<Influence> influences =
        chain_weights({{0, -1, 0}, {0, 1, 0}, {0, 3, 0}, {0, 2, 0}}, two_limbs(), 0.3f);
    EXPECT_EQ(weight_of(influences[0], 0), 1);
    EXPECT_EQ(weight_of(influences[1], 1), 1);
    EXPECT_EQ(weight_of(influences[2], 2), 1);
    EXPECT_NEAR(weight_of(influences[3], 1), 0.5, 1e-6);
    EXPECT_NEAR(weight_of(influences[3], 2), 0.5, 1e-6);
}

TEST(Skin, MovesRigidPartsRigidly) {
    const std::vector<Bone> bones{{-1, {0, 0, 0}}, {0, {0, 2, 0}}};
    std::vector<Rigid> world;
    // A quarter turn about +z at (0, 2, 0), all lifted by 1: (0, 3, 0) goes to (-1, 3, 0).
    world_transforms(bones, {glm::quat(1, 0, 0, 0), turn({0, 0, 1}, radians(90))}, {0, 1, 0}, world);
    std::vector<Influence> influences(3);
    influences[0] = {{0, 0, 0, 0}, {1, 0, 0, 0}};
    influences[1] = {{1, 0, 0, 0}, {1, 0, 0, 0}};
    influences[2] = {{0, 1, 0, 0}, {0.5f, 0.5f, 0, 0}};
    std::vector<glm::vec3> posed;
    skin({{1, 1, 0}, {0, 3, 0}, {0, 2, 0}}, influences, world, posed);
    EXPECT_LT(glm::distance(posed[0], glm::vec3(1, 2, 0)), 1e-6f);
    EXPECT_LT(glm::distance(posed[1], glm::vec3(-1, 3, 0)), 1e-6f);
    EXPECT_LT(glm::distance(posed[2], glm::vec3(0, 3, 0)), 1e-6f) << "the joint stays where it is";
}

TEST(Skin, AimTurnsOneDirectionToAnother) {
    const glm::vec3 from = glm::normalize(glm::vec3(1, 2, -1)), to = glm::normalize(glm::vec3(-2, 0.5f, 1));
    EXPECT_LT(glm::distance(aim(from, to) * from, to), 1e-6f);
    EXPECT_LT(glm::distance(aim(from, from) * to, to), 1e-6f);
}

} // namespace
} // namespace nusselt::scenes
