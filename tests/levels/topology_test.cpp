#include "meshes.h"

#include <gtest/gtest.h>

#include <cmath>
#include <set>

namespace nusselt::test {
namespace {

TEST(Weld, ExactPositionsOnly) {
    TriangleMesh m;
    const float above = std::nextafter(1.0f, 2.0f), nan = std::nanf("");
    m.positions = {{0, 0, 0}, {-0.0f, 0, -0.0f}, {1, 0, 0},  {above, 0, 0},
                   {1, 0, 0}, {nan, 0, 0},       {nan, 0, 0}};
    const Built b = build(m);
    const std::vector<uint32_t> weld(b.data.weld.begin(), b.data.weld.end());
    EXPECT_EQ(weld, (std::vector<uint32_t>{0, 0, 1, 2, 1, 3, 4}));
    const std::vector<uint32_t> source(b.data.weld_source.begin(), b.data.weld_source.end());
    EXPECT_EQ(source, (std::vector<uint32_t>{0, 2, 3, 5, 6}));
}

TEST(Weld, TrianglesWithoutAreaByIndexOrNotFiniteAreLeftOut) {
    TriangleMesh m = cube(true);
    m.triangle(0, 0, 1);
    m.positions.push_back(m.positions[0]);
    m.triangle(0, 1, 24); // equal after welding
    m.positions.push_back({INFINITY, 0, 0});
    m.triangle(0, 1, 25);
    m.normals.clear();
    const Built b = build(m);
    EXPECT_EQ(b.info.triangles, 15u);
    EXPECT_EQ(b.info.degenerate_triangles, 3u);
    EXPECT_EQ(b.data.full_triangles.size(), 36u);
    EXPECT_EQ(b.info.closed_components, 1u);
}

TEST(Topology, SplitCubeIsClosed) {
    const Built b = build(cube(true));
    EXPECT_EQ(b.info.vertices, 24u);
    EXPECT_EQ(b.info.welded_vertices, 8u);
    EXPECT_EQ(b.info.components, 1u);
    EXPECT_EQ(b.info.closed_components, 1u);
    EXPECT_EQ(b.info.boundary_edges + b.info.non_manifold_edges + b.info.flipped_edges, 0u);
    for (const uint8_t two_sided : b.data.full_two_sided) {
        EXPECT_EQ(two_sided, 0);
    }
}

TEST(Topology, InvertedCubeBlocksFromBothSides) {
    TriangleMesh m = cube(false);
    m.flip();
    const Built b = build(m);
    EXPECT_EQ(b.info.components, 1u);
    EXPECT_EQ(b.info.closed_components, 0u);
    EXPECT_EQ(b.data.full_two_sided[0], 1);
}

TEST(Topology, OneFlippedTriangle) {
    TriangleMesh m = cube(false);
    std::swap(m.indices[0], m.indices[1]);
    const Built b = build(m);
    EXPECT_EQ(b.info.closed_components, 0u);
    EXPECT_EQ(b.info.flipped_edges, 3u);
    EXPECT_EQ(b.info.boundary_edges, 0u);
}

TEST(Topology, OpenPlane) {
    const Built b = build(grid(4, 3));
    EXPECT_EQ(b.info.components, 1u);
    EXPECT_EQ(b.info.closed_components, 0u);
    EXPECT_EQ(b.info.boundary_edges, 14u);
    EXPECT_EQ(b.info.non_manifold_edges, 0u);
}

TEST(Topology, CubesThatShareAVertexAreTwoClosedComponents) {
    TriangleMesh m = cube(false);
    m.append(cube(false), {2, 2, 2});
    const Built b = build(m);
    EXPECT_EQ(b.info.welded_vertices, 15u);
    EXPECT_EQ(b.info.components, 2u);
    EXPECT_EQ(b.info.closed_components, 2u);
}

TEST(Topology, CubesThatShareAnEdgeAreNotManifold) {
    TriangleMesh m = cube(false);
    m.append(cube(false), {2, 2, 0});
    const Built b = build(m);
    EXPECT_EQ(b.info.non_manifold_edges, 1u);
    EXPECT_EQ(b.info.components, 1u);
    EXPECT_EQ(b.info.closed_components, 0u);
}

TEST(Topology, Fin) {
    TriangleMesh m = cube(false);
    m.positions.push_back({0, 0, 3});
    m.triangle(4, 5, 8);
    const Built b = build(m);
    EXPECT_EQ(b.info.non_manifold_edges, 1u);
    EXPECT_EQ(b.info.boundary_edges, 2u);
    EXPECT_EQ(b.info.closed_components, 0u);
}

TEST(Topology, MoebiusIsNeverConsistent) {
    const Built b = build(moebius(20));
    EXPECT_EQ(b.info.components, 1u);
    EXPECT_EQ(b.info.closed_components, 0u);
    EXPECT_EQ(b.info.flipped_edges, 1u);
    EXPECT_EQ(b.info.boundary_edges, 40u);
}

TEST(Fans, CompleteAndOriented) {
    for (const TriangleMesh& m : {cube(true), grid(7, 5), sphere(12, 9)}) {
        const Built b = build(m);
        std::multiset<Triple> expected, found;
        for (size_t i = 0; i < m.indices.size(); i += 3) {
            const uint32_t t[3] = {b.data.weld[m.indices[i]], b.data.weld[m.indices[i + 1]],
                                   b.data.weld[m.indices[i + 2]]};
            for (size_t k = 0; k < 3; ++k) {
                expected.insert({t[k], t[(k + 1) % 3], t[(k + 2) % 3]});
            }
        }
        for (uint32_t w = 0; w < b.info.welded_vertices; ++w) {
            for (uint32_t k = b.data.fan_begin[w]; k < b.data.fan_begin[w + 1]; ++k) {
                found.insert({w, b.data.fan[2 * k], b.data.fan[2 * k + 1]});
            }
        }
        EXPECT_EQ(expected, found) << m.name;
    }
}

TEST(Rings, AreTheTrianglesAroundTheNeighbours) {
    const Built b = build(bumpy_sphere(14, 11));
    const auto& full = b.data.full_triangles;
    const auto touches = [&](size_t t, uint32_t w) {
        return full[3 * t] == w || full[3 * t + 1] == w || full[3 * t + 2] == w;
    };
    for (uint32_t w = 0; w < b.info.welded_vertices; ++w) {
        std::set<uint32_t> near, expected;
        for (uint32_t k = 2 * b.data.fan_begin[w]; k < 2 * b.data.fan_begin[w + 1]; ++k) {
            near.insert(b.data.fan[k]);
        }
        for (uint32_t t = 0; t < full.size() / 3; ++t) {
            for (const uint32_t u : near) {
                if (touches(t, u) && !touches(t, w)) expected.insert(t);
            }
        }
        const std::set<uint32_t> found(b.data.ring.begin() + b.data.ring_begin[w],
                                       b.data.ring.begin() + b.data.ring_begin[w + 1]);
        EXPECT_EQ(found, expected);
        EXPECT_EQ(found.size(), b.data.ring_begin[w + 1] - b.data.ring_begin[w]);
    }
}

} // namespace
} // namespace nusselt::test
