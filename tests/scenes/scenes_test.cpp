#include "bench/scenes/scene.h"
#include "topology.h"

#include <glm/vec2.hpp>
#include <gtest/gtest.h>

#include <cstring>
#include <limits>
#include <thread>

namespace nusselt::scenes {
namespace {

struct Expected {
    const char* name;
    double vertices, triangles; // Table 1 of the paper
};

class BuiltinScene : public testing::TestWithParam<Expected> {
protected:
    // Built once a process: the cloth is a simulation.
    static const Scene& scene() {
        static std::map<std::string, Scene> scenes;
        const std::string name = GetParam().name;
        auto entry = scenes.find(name);
        if (entry == scenes.end()) entry = scenes.emplace(name, builtin(name)).first;
        return entry->second;
    }
    static double time_at(int step, int steps) { return scene().duration * step / steps; }
};

bool same_bits(const Pose& a, const Pose& b) {
    if (a.positions.size() != b.positions.size()) return false;
    for (size_t m = 0; m < a.positions.size(); ++m) {
        if (a.positions[m].size() != b.positions[m].size()) return false;
        if (std::memcmp(a.positions[m].data(), b.positions[m].data(), 12 * a.positions[m].size()))
            return false;
        if (std::memcmp(a.normals[m].data(), b.normals[m].data(), 12 * a.normals[m].size())) return false;
    }
    return true;
}

TEST_P(BuiltinScene, HasThePapersSize) {
    double vertices = 0, triangles = 0;
    for (const Mesh& mesh : scene().meshes) {
        vertices += static_cast<double>(mesh.rest_positions.size());
        triangles += static_cast<double>(mesh.indices.size()) / 3;
    }
    EXPECT_NEAR(vertices, GetParam().vertices, 0.05 * GetParam().vertices);
    EXPECT_NEAR(triangles, GetParam().triangles, 0.05 * GetParam().triangles);
}

TEST_P(BuiltinScene, ArraysAgree) {
    EXPECT_EQ(scene().name, GetParam().name);
    EXPECT_GE(scene().duration, 2);
    EXPECT_LE(scene().duration, 4);
    for (const Mesh& mesh : scene().meshes) {
        EXPECT_FALSE(mesh.name.empty());
        ASSERT_EQ(mesh.rest_normals.size(), mesh.rest_positions.size());
        ASSERT_EQ(mesh.albedo.size(), mesh.rest_positions.size());
        ASSERT_EQ(mesh.indices.size() % 3, 0u);
        for (uint32_t index : mesh.indices)
            ASSERT_LT(index, mesh.rest_positions.size());
        for (const glm::vec3& normal : mesh.rest_normals)
            ASSERT_NEAR(glm::length(normal), 1, 1e-5);
        for (const glm::vec3& albedo : mesh.albedo)
            for (int k = 0; k < 3; ++k)
                ASSERT_TRUE(albedo[k] >= 0 && albedo[k] <= 1);
    }
}

TEST_P(BuiltinScene, SkinsAndPiecesAreClosedAndTurnedOutward) {
    for (const Mesh& mesh : scene().meshes) {
        const Topology facts = topology(mesh);
        EXPECT_EQ(facts.repeated_edges, 0u) << mesh.name;
        const bool sheet = mesh.name == "cloth" || mesh.name == "floor" || mesh.name == "board";
        if (sheet) {
            EXPECT_GT(facts.boundary_edges, 0u) << mesh.name;
        } else {
            EXPECT_EQ(facts.boundary_edges, 0u) << mesh.name;
            EXPECT_GT(facts.volume, 0) << mesh.name;
        }
    }
}

TEST_P(BuiltinScene, HasFewSlivers) {
    size_t slivers = 0, triangles = 0;
    for (const Mesh& mesh : scene().meshes) {
        const auto& p = mesh.rest_positions;
        for (size_t i = 0; i < mesh.indices.size(); i += 3) {
            const double angle =
                least_angle(p[mesh.indices[i]], p[mesh.indices[i + 1]], p[mesh.indices[i + 2]]);
            EXPECT_GT(angle, 1) << mesh.name << " triangle " << i / 3;
            slivers += angle < 5;
            ++triangles;
        }
    }
    EXPECT_LT(static_cast<double>(slivers), 0.002 * static_cast<double>(triangles));
}

TEST_P(BuiltinScene, PosesAreFiniteWithUnitNormals) {
    Pose pose;
    for (int step = 0; step <= 24; ++step) {
        scene().pose(time_at(step, 24), pose);
        ASSERT_EQ(pose.positions.size(), scene().meshes.size());
        for (size_t m = 0; m < pose.positions.size(); ++m) {
            ASSERT_EQ(pose.positions[m].size(), scene().meshes[m].rest_positions.size());
            ASSERT_EQ(pose.normals[m].size(), scene().meshes[m].rest_positions.size());
            for (const glm::vec3& point : pose.positions[m])
                ASSERT_LT(glm::length(point), 1e3f);
            for (const glm::vec3& normal : pose.normals[m])
                ASSERT_NEAR(glm::length(normal), 1, 1e-5);
        }
    }
}

TEST_P(BuiltinScene, SeamsShareNormalsInEveryPose) {
    Pose pose;
    scene().pose(0.5 * scene().duration, pose);
    for (size_t m = 0; m < scene().meshes.size(); ++m) {
        const std::vector<uint32_t> weld = weld_map(scene().meshes[m].rest_positions);
        for (size_t v = 0; v < weld.size(); ++v) {
            ASSERT_EQ(pose.positions[m][v], pose.positions[m][weld[v]]);
            ASSERT_EQ(pose.normals[m][v], pose.normals[m][weld[v]]);
        }
    }
}

TEST_P(BuiltinScene, Moves) {
    Pose first, pose;
    scene().pose(0, first);
    glm::vec3 low = first.positions[0][0], high = low;
    for (const auto& mesh : first.positions) {
        for (const glm::vec3& point : mesh) {
            low = glm::min(low, point);
            high = glm::max(high, point);
        }
    }
    float farthest = 0;
    for (int step = 1; step <= 8; ++step) {
        scene().pose(time_at(step, 8), pose);
        for (size_t m = 0; m < pose.positions.size(); ++m)
            for (size_t v = 0; v < pose.positions[m].size(); ++v)
                farthest = std::max(farthest, glm::distance(pose.positions[m][v], first.positions[m][v]));
    }
    EXPECT_GT(farthest, 0.15f * glm::distance(low, high));
}

TEST_P(BuiltinScene, HasNoJumps) {
    Pose before, pose;
    constexpr int steps = 480;
    scene().pose(0, before);
    float farthest = 0, extent = 0;
    for (int step = 1; step <= steps; ++step) {
        scene().pose(time_at(step, steps), pose);
        for (size_t m = 0; m < pose.positions.size(); ++m) {
            for (size_t v = 0; v < pose.positions[m].size(); ++v) {
                farthest = std::max(farthest, glm::distance(pose.positions[m][v], before.positions[m][v]));
                extent = std::max(extent, glm::distance(pose.positions[m][v], pose.positions[m][0]));
            }
        }
        std::swap(before, pose);
    }
    EXPECT_LT(farthest, 0.08f * extent);
}

TEST_P(BuiltinScene, PoseDependsOnTimeAlone) {
    Pose a, b;
    scene().pose(0.7, a);
    for (double time : {1.9, 0.0, 0.33})
        scene().pose(time, b);
    scene().pose(0.7, b);
    EXPECT_TRUE(same_bits(a, b));
    builtin(GetParam().name).pose(0.7, b);
    EXPECT_TRUE(same_bits(a, b)) << "a second scene of the same name";
}

TEST_P(BuiltinScene, TimeIsClamped) {
    Pose a, b;
    scene().pose(-1, a);
    scene().pose(0, b);
    EXPECT_TRUE(same_bits(a, b));
    scene().pose(scene().duration + 5, a);
    scene().pose(scene().duration, b);
    EXPECT_TRUE(same_bits(a, b));
}

TEST_P(BuiltinScene, ThreadsMayPoseAtOnce) {
    Pose alone[2], together[2];
    for (int k = 0; k < 2; ++k)
        scene().pose(0.4 + k, alone[k]);
    std::thread other([&] {
        for (int repeat = 0; repeat < 8; ++repeat)
            scene().pose(0.4, together[0]);
    });
    for (int repeat = 0; repeat < 8; ++repeat)
        scene().pose(1.4, together[1]);
    other.join();
    EXPECT_TRUE(same_bits(alone[0], together[0]));
    EXPECT_TRUE(same_bits(alone[1], together[1]));
}

INSTANTIATE_TEST_SUITE_P(All, BuiltinScene,
                         testing::Values(Expected{"cloth", 1378, 2560}, Expected{"fight", 2978, 4806},
                                         Expected{"chess", 1897, 3704}, Expected{"hand", 8636, 15854}),
                         [](const auto& instance) { return std::string(instance.param.name); });

TEST(BuiltinNames, AreThePapersScenes) {
    EXPECT_EQ(builtin_names(), (std::vector<std::string>{"cloth", "fight", "chess", "hand"}));
    EXPECT_TRUE(builtin("teapot").meshes.empty());
}

TEST(Cloth, StaysAboveTheFloorAndOutsideTheBall) {
    const Scene scene = builtin("cloth");
    Pose pose;
    for (int step = 0; step <= 400; ++step) {
        scene.pose(scene.duration * step / 400, pose);
        glm::vec3 center(0);
        for (const glm::vec3& point : pose.positions[2])
            center += point / static_cast<float>(pose.positions[2].size());
        const float radius = glm::distance(center, pose.positions[2][0]);
        for (const glm::vec3& point : pose.positions[0]) {
            ASSERT_GT(point.y, 0.005f) << "step " << step;
            ASSERT_GT(glm::distance(point, center), radius) << "step " << step;
        }
        for (const glm::vec3& point : pose.positions[2])
            ASSERT_GT(point.y, 0) << "step " << step;
    }
}

TEST(Chess, PiecesNeverMeet) {
    const Scene scene = builtin("chess");
    Pose pose;
    for (int step = 0; step <= 400; ++step) {
        scene.pose(scene.duration * step / 400, pose);
        std::vector<glm::vec2> centers;
        std::vector<float> radii;
        for (size_t m = 1; m < pose.positions.size(); ++m) {
            glm::vec2 low(1e9f), high(-1e9f);
            for (const glm::vec3& point : pose.positions[m]) {
                ASSERT_GT(point.y, 0) << scene.meshes[m].name;
                low = glm::min(low, glm::vec2(point.x, point.z));
                high = glm::max(high, glm::vec2(point.x, point.z));
            }
            const glm::vec2 center = 0.5f * (low + high);
            float radius = 0;
            for (const glm::vec3& point : pose.positions[m])
                radius = std::max(radius, glm::distance(center, glm::vec2(point.x, point.z)));
            for (size_t other = 0; other < centers.size(); ++other) {
                ASSERT_GT(glm::distance(center, centers[other]), radius + radii[other])
                    << scene.meshes[m].name << " and " << scene.meshes[other + 1].name << " at step " << step;
            }
            centers.push_back(center);
            radii.push_back(radius);
        }
    }
}

TEST(Normals, AreAreaWeightedAndAlwaysUnit) {
    // A right angle between areas 1/2 (facing +z) and 1 (facing +y) along the edge 0-1; vertex 4 is unused.
    const std::vector<glm::vec3> positions{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 2}, {5, 5, 5}};
    std::vector<glm::vec3> normals;
    compute_normals(positions, {0, 1, 2, 1, 0, 3}, normals);
    EXPECT_LT(glm::distance(normals[2], glm::vec3(0, 0, 1)), 1e-6f);
    EXPECT_LT(glm::distance(normals[3], glm::vec3(0, 1, 0)), 1e-6f);
    EXPECT_LT(glm::distance(normals[0], glm::normalize(glm::vec3(0, 2, 1))), 1e-6f);
    EXPECT_EQ(normals[4], glm::vec3(0, 1, 0));
    compute_normals(std::vector<glm::vec3>(3, glm::vec3(1)), {0, 1, 2}, normals);
    EXPECT_EQ(normals[0], glm::vec3(0, 1, 0)) << "no area";
    const float bad = std::numeric_limits<float>::quiet_NaN();
    compute_normals({{bad, 0, 0}, {1, 0, 0}, {0, 1, 0}}, {0, 1, 2}, normals);
    EXPECT_EQ(normals[1], glm::vec3(0, 1, 0)) << "not finite";
    for (float scale : {1e-12f, 1e12f}) {
        compute_normals({{0, 0, 0}, {scale, 0, 0}, {0, scale, 0}}, {0, 1, 2}, normals);
        EXPECT_LT(glm::distance(normals[0], glm::vec3(0, 0, 1)), 1e-6f) << scale;
    }
}

} // namespace
} // namespace nusselt::scenes
