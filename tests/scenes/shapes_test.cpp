#include "bench/scenes/implicit.h"
#include "bench/scenes/portable_math.h"
#include "bench/scenes/shapes.h"
#include "topology.h"

#include <gtest/gtest.h>

namespace nusselt::scenes {
namespace {

void expect_closed(const Mesh& mesh, double volume, double tolerance) {
    const Topology facts = topology(mesh);
    EXPECT_EQ(facts.boundary_edges, 0u) << mesh.name;
    EXPECT_EQ(facts.repeated_edges, 0u) << mesh.name;
    EXPECT_NEAR(facts.volume, volume, tolerance * volume) << mesh.name;
    ASSERT_EQ(mesh.rest_normals.size(), mesh.rest_positions.size());
    ASSERT_EQ(mesh.albedo.size(), mesh.rest_positions.size());
    for (const glm::vec3& normal : mesh.rest_normals)
        EXPECT_NEAR(glm::length(normal), 1, 1e-5);
}

TEST(Shapes, AreClosedWithTheirVolumes) {
    expect_closed(sphere(4, 2), 4.0 / 3 * pi * 8, 0.01);
    expect_closed(torus(2, 0.5f, 64, 32), 2 * pi * pi * 2 * 0.25, 0.02);
    expect_closed(box({-1, 0, 2}, {1, 3, 6}), 24, 1e-6);
}

TEST(Shapes, HaveTheirCounts) {
    for (uint32_t level = 0; level < 4; ++level) {
        const Mesh ball = sphere(level);
        EXPECT_EQ(ball.indices.size(), 3 * 20 * (size_t{1} << 2 * level));
        EXPECT_EQ(ball.rest_positions.size(), 10 * (size_t{1} << 2 * level) + 2);
    }
    EXPECT_EQ(torus(1, 0.3f, 7, 5).rest_positions.size(), 35u);
    EXPECT_EQ(torus(1, 0.3f, 7, 5).indices.size(), 3u * 70);
    EXPECT_EQ(box(glm::vec3(0), glm::vec3(1)).indices.size(), 36u);
}

TEST(Shapes, NormalsFaceAsTheTrianglesDo) {
    for (const Mesh& mesh :
         {sphere(2), torus(1, 0.4f, 24, 12), plane(2, 3), box(glm::vec3(-1), glm::vec3(1))}) {
        for (size_t i = 0; i < mesh.indices.size(); i += 3) {
            const auto& p = mesh.rest_positions;
            const uint32_t a = mesh.indices[i], b = mesh.indices[i + 1], c = mesh.indices[i + 2];
            const glm::vec3 area = glm::cross(p[b] - p[a], p[c] - p[a]);
            EXPECT_GT(glm::dot(area, mesh.rest_normals[a]), 0) << mesh.name;
        }
    }
}

TEST(Shapes, PlaneIsASheetOfItsSize) {
    const Mesh sheet = plane(3, 4);
    EXPECT_EQ(sheet.rest_positions.size(), 25u);
    EXPECT_EQ(topology(sheet).boundary_edges, 16u);
    EXPECT_EQ(sheet.rest_positions.front(), glm::vec3(-1.5f, 0, -1.5f));
    EXPECT_EQ(sheet.rest_positions.back(), glm::vec3(1.5f, 0, 1.5f));
}

TEST(Implicit, MeshOfABallIsAClosedBall) {
    const auto field = [](const glm::vec3& point) { return glm::length(point) - 1; };
    const Surface surface = mesh_field(field, glm::vec3(-1.2f), glm::vec3(1.2f), 0.1f);
    Mesh mesh;
    mesh.rest_positions = surface.positions;
    mesh.indices = surface.indices;
    const Topology facts = topology(mesh);
    EXPECT_EQ(facts.boundary_edges, 0u);
    EXPECT_EQ(facts.repeated_edges, 0u);
    EXPECT_NEAR(facts.volume, 4.0 / 3 * pi, 0.03);
    for (const glm::vec3& point : surface.positions)
        EXPECT_NEAR(glm::length(point), 1, 1e-3);
}

TEST(Implicit, TouchingBallsStayAManifold) {
    // Gaps narrower than a cell, in directions that no axis favours.
    for (float gap : {-0.05f, 0.0f, 0.03f, 0.08f}) {
        const glm::vec3 center = glm::normalize(glm::vec3(3, 5, 7)) * (0.5f + 0.5f * gap);
        const auto field = [&](const glm::vec3& point) {
            return std::min(glm::distance(point, center), glm::distance(point, -center)) - 0.5f;
        };
        const Surface surface = mesh_field(field, glm::vec3(-1.2f), glm::vec3(1.2f), 0.1f);
        Mesh mesh;
        mesh.rest_positions = surface.positions;
        mesh.indices = surface.indices;
        const Topology facts = topology(mesh);
        EXPECT_EQ(facts.boundary_edges, 0u) << gap;
        EXPECT_EQ(facts.repeated_edges, 0u) << gap;
    }
}

TEST(PortableMath, SineAndCosineAreRight) {
    for (int step = -2000; step <= 2000; ++step) {
        const double x = 0.0137 * step;
        EXPECT_NEAR(sine(x), std::sin(x), 1e-11);
        EXPECT_NEAR(cosine(x), std::cos(x), 1e-11);
    }
}

} // namespace
} // namespace nusselt::scenes
