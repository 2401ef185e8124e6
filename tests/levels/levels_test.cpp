// The chain of levels: each one a surface of its own over the vertices of the one before it, and the samples
// that tell how far it lies from the full mesh.
#include "meshes.h"

#include "runtime/src/simplify.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <ctime>
#include <random>
#include <set>

namespace nusselt::test {
namespace {

// Welded triangle with its lowest corner first, so that equal ones compare equal.
Triple rotated(Triple t) {
    std::rotate(t.begin(), std::min_element(t.begin(), t.end()), t.end());
    return t;
}

std::vector<Triple> full_triples(const Built& b) {
    std::vector<Triple> out;
    for (size_t i = 0; i < b.data.full_triangles.size(); i += 3) {
        out.push_back(
            rotated({b.data.full_triangles[i], b.data.full_triangles[i + 1], b.data.full_triangles[i + 2]}));
    }
    std::sort(out.begin(), out.end());
    return out;
}

std::vector<Triple> coarse_triples(const Built& b) {
    std::vector<Triple> out;
    for (uint32_t c = 0; c < b.data.coarse_clusters.count(); ++c) {
        const std::vector<Triple> own = cluster_triples(b.data.coarse_clusters, c);
        out.insert(out.end(), own.begin(), own.end());
    }
    return out;
}

std::set<uint32_t> vertices_of(const std::vector<Triple>& triangles) {
    std::set<uint32_t> out;
    for (const Triple& t : triangles) {
        out.insert(t.begin(), t.end());
    }
    return out;
}

void check_tables(const Built& b, const Clusters& c) {
    ASSERT_EQ(c.vertex_begin.size(), c.count() + 1);
    ASSERT_EQ(c.edge_begin.size(), c.count() + 1);
    ASSERT_EQ(c.triangle_begin.size(), c.count() + 1);
    ASSERT_EQ(c.two_sided.size(), c.count());
    ASSERT_EQ(c.vertex_begin.back(), c.vertices.size());
    ASSERT_EQ(c.edge_begin.back(), c.edges.size());
    ASSERT_EQ(c.triangle_begin.back(), c.triangles.size());
    for (uint32_t i = 0; i < c.count(); ++i) {
        const uint32_t vertices = c.vertex_begin[i + 1] - c.vertex_begin[i];
        const uint32_t edges = c.edge_begin[i + 1] - c.edge_begin[i];
        ASSERT_LE(vertices, 64u);
        ASSERT_LE(edges, 128u);
        ASSERT_GE(c.triangle_begin[i + 1], c.triangle_begin[i] + 1);
        ASSERT_LE(c.triangle_begin[i + 1], c.triangle_begin[i] + 32);
        ASSERT_TRUE(i == 0 || c.level[i] >= c.level[i - 1]);
        std::vector<uint32_t> unique(c.vertices.begin() + c.vertex_begin[i],
                                     c.vertices.begin() + c.vertex_begin[i + 1]);
        std::sort(unique.begin(), unique.end());
        ASSERT_TRUE(std::adjacent_find(unique.begin(), unique.end()) == unique.end());
        ASSERT_LT(unique.back(), b.info.welded_vertices);
        std::set<std::pair<uint8_t, uint8_t>> ends;
        for (uint32_t e = c.edge_begin[i]; e < c.edge_begin[i + 1]; ++e) {
            ASSERT_LT(std::max(c.edges[e].from, c.edges[e].to), vertices);
            ASSERT_TRUE(ends.insert(std::minmax(c.edges[e].from, c.edges[e].to)).second);
        }
        for (uint32_t t = c.triangle_begin[i]; t < c.triangle_begin[i + 1]; ++t) {
            const ClusterTriangle& k = c.triangles[t];
            for (uint32_t e = 0; e < 3; ++e) {
                ASSERT_LT(k.edge[e], edges);
                const ClusterEdge edge = c.edges[c.edge_begin[i] + k.edge[e]];
                const bool flipped = k.flipped >> e & 1;
                ASSERT_EQ(flipped ? edge.to : edge.from, k.corner[e]);
                ASSERT_EQ(flipped ? edge.from : edge.to, k.corner[(e + 1) % 3]);
            }
        }
    }
}

// Each vertex that a level lacks and the one before it has is sampled once, on a triangle of the level.
void check_samples(const Built& b) {
    const LevelSamples& s = b.data.samples;
    ASSERT_EQ(level_count(s), b.info.levels);
    ASSERT_EQ(s.begin[0], 0u);
    ASSERT_EQ(s.begin[1], 0u);
    ASSERT_EQ(s.begin.back(), s.vertex.size());
    ASSERT_EQ(s.corner.size(), 3 * s.vertex.size());
    ASSERT_EQ(s.weight.size(), 3 * s.vertex.size());
    std::vector<Triple> triangles = level_triples(b, 0);
    for (uint32_t level = 1; level < b.info.levels; ++level) {
        const std::set<uint32_t> before = vertices_of(triangles);
        triangles = level_triples(b, level);
        const std::set<uint32_t> now = vertices_of(triangles);
        ASSERT_TRUE(std::includes(before.begin(), before.end(), now.begin(), now.end()));
        std::vector<uint32_t> gone,
            sampled(s.vertex.begin() + s.begin[level], s.vertex.begin() + s.begin[level + 1]);
        std::set_difference(before.begin(), before.end(), now.begin(), now.end(), std::back_inserter(gone));
        std::sort(sampled.begin(), sampled.end());
        ASSERT_EQ(sampled, gone);
        std::set<Triple> own;
        for (const Triple& t : triangles) {
            own.insert(rotated(t));
        }
        for (uint32_t i = s.begin[level]; i < s.begin[level + 1]; ++i) {
            const uint32_t* corner = s.corner.data() + 3 * size_t(i);
            const float* weight = s.weight.data() + 3 * size_t(i);
            ASSERT_TRUE(own.count(rotated({corner[0], corner[1], corner[2]})));
            ASSERT_NEAR(weight[0] + weight[1] + weight[2], 1, 1e-5);
            ASSERT_GE(std::min({weight[0], weight[1], weight[2]}), 0);
        }
    }
    // Cluster by cluster, each on its own triangles.
    const Clusters& c = b.data.clusters;
    ASSERT_EQ(s.cluster_begin.size(), c.count() + 1);
    ASSERT_EQ(s.cluster_begin[0], 0u);
    ASSERT_EQ(s.cluster_begin.back(), s.vertex.size());
    for (uint32_t k = 0; k < c.count(); ++k) {
        std::set<Triple> own;
        for (uint32_t t = c.triangle_begin[k]; t < c.triangle_begin[k + 1]; ++t) {
            const auto corner = [&](uint32_t i) {
                return c.vertices[c.vertex_begin[k] + c.triangles[t].corner[i]];
            };
            own.insert(rotated({corner(0), corner(1), corner(2)}));
        }
        for (uint32_t i = s.cluster_begin[k]; i < s.cluster_begin[k + 1]; ++i) {
            ASSERT_EQ(own.count(rotated({s.corner[3 * i], s.corner[3 * i + 1], s.corner[3 * i + 2]})), 1u);
        }
    }
}

void check_mesh(const TriangleMesh& m, bool closed) {
    SCOPED_TRACE(m.name);
    const Built b = build(m);
    check_tables(b, b.data.clusters);
    check_tables(b, b.data.coarse_clusters);
    check_samples(b);
    std::vector<Triple> first = level_triples(b, 0);
    for (Triple& t : first) {
        t = rotated(t);
    }
    std::sort(first.begin(), first.end());
    ASSERT_EQ(first, full_triples(b)); // every triangle in exactly one cluster of level 0
    for (uint32_t level = 0; level < b.info.levels; ++level) {
        ASSERT_EQ(level_triples(b, level).size(), b.info.level_triangles[level]);
        ASSERT_TRUE(level == 0 || b.info.level_triangles[level] < b.info.level_triangles[level - 1]);
        if (closed) {
            ASSERT_EQ(open_edges(level_triples(b, level)), 0u) << "level " << level;
        }
    }
    if (!closed) return;
    ASSERT_EQ(b.info.closed_components, b.info.components);
    ASSERT_EQ(open_edges(coarse_triples(b)), 0u);
}

TEST(Levels, ProceduralMeshes) {
    check_mesh(torus(60, 30), true);
    check_mesh(sphere(64, 40), true);
    check_mesh(bumpy_sphere(90, 60), true);
    check_mesh(cube(true), true);
    check_mesh(grid(40, 30), false);
    check_mesh(moebius(200), false);
    TriangleMesh two = bumpy_sphere(40, 30);
    two.append(torus(40, 20), {2.5f, 0, 0});
    two.name = "two parts";
    check_mesh(two, true);
}

TEST(Levels, RealModels) {
    const std::string folder = std::string(NUSSELT_SHARED_DIR) + "/data/models/classic/";
    TriangleMesh m;
    if (!load_obj(folder + "spot_cow/spot.obj", m)) GTEST_SKIP() << "no models in " << folder;
    check_mesh(m, true);
    ASSERT_TRUE(load_obj(folder + "armadillo/armadillo.obj", m));
    check_mesh(m, true);
    ASSERT_TRUE(load_obj(folder + "stanford_bunny/bunny.obj", m));
    check_mesh(m, true);
}

// Closed and open components: never in one cluster, and what blocks from one side is closed in every level.
TEST(Levels, ClosedAndOpenDoNotMix) {
    TriangleMesh m = bumpy_sphere(40, 30);
    const uint32_t sphere_vertices = static_cast<uint32_t>(m.positions.size());
    m.append(grid(40, 40), {-0.5f, -0.5f, 1.2f});
    m.name = "closed and open";
    check_mesh(m, false);
    const Built b = build(m);
    EXPECT_EQ(b.info.components, 2u);
    EXPECT_EQ(b.info.closed_components, 1u);
    std::vector<std::vector<Triple>> closed(b.info.levels);
    const auto check = [&](const Clusters& clusters, uint32_t c) {
        for (const Triple& t : cluster_triples(clusters, c)) {
            for (const uint32_t w : t) {
                ASSERT_EQ(b.data.weld_source[w] >= sphere_vertices, clusters.two_sided[c] == 1);
            }
        }
    };
    for (uint32_t c = 0; c < b.data.clusters.count(); ++c) {
        check(b.data.clusters, c);
        if (b.data.clusters.two_sided[c]) continue;
        for (const Triple& t : cluster_triples(b.data.clusters, c)) {
            closed[b.data.clusters.level[c]].push_back(t);
        }
    }
    for (uint32_t c = 0; c < b.data.coarse_clusters.count(); ++c) {
        check(b.data.coarse_clusters, c);
    }
    for (const std::vector<Triple>& triangles : closed) {
        EXPECT_GT(triangles.size(), 0u);
        EXPECT_EQ(open_edges(triangles), 0u);
    }
}

// What keeps its topology can't get coarse: holes of the size of a pattern, handles and parts close or become
// flat in levels whose error they are below, and what bounded a solid still does.
TEST(Levels, SmallHolesClose) {
    const TriangleMesh whole = grid(96, 96);
    TriangleMesh m = whole;
    m.name = "pierced";
    m.indices.clear();
    uint32_t holes = 0;
    for (size_t i = 0; i < whole.indices.size(); i += 6) { // a cell
        const size_t cell = i / 6, column = cell % 96, row = cell / 96;
        const bool pierced = column % 4 == 2 && row % 4 == 2;
        holes += pierced;
        if (pierced) continue;
        m.indices.insert(m.indices.end(), whole.indices.begin() + i, whole.indices.begin() + i + 6);
    }
    ASSERT_EQ(holes, 576u); // kept, they would need more than two triangles each
    check_mesh(m, false);
    const MeshInfo info = build(m).info;
    EXPECT_LT(info.level_triangles[info.levels - 1], 100u);
}

TEST(Levels, HandlesAndPartsBecomeFlat) {
    TriangleMesh m;
    for (uint32_t i = 0; i < 64; ++i) {
        const float x = 3.0f * float(i % 8), y = 3.0f * float(i / 8);
        m.append(torus(24, 12), {x, y, 0});
    }
    m.name = "rings";
    check_mesh(m, true);
    const MeshInfo info = build(m).info;
    EXPECT_EQ(info.closed_components, 64u);
    EXPECT_LT(info.level_triangles[info.levels - 1], 64u * 7); // a ring needs 14 triangles to stay one
}

// Triangles that can't go don't have the others crushed for them: the level ends early.
TEST(Levels, LooseTrianglesCrushNothing) {
    TriangleMesh m = bumpy_sphere(60, 40);
    const uint32_t sphere_triangles = static_cast<uint32_t>(m.indices.size() / 3);
    const uint32_t first = static_cast<uint32_t>(m.positions.size()), loose = 400;
    for (uint32_t i = 0; i < loose; ++i) {
        const float x = 3 + 0.1f * float(i % 20), y = 0.1f * float(i / 20);
        m.positions.insert(m.positions.end(), {{x, y, 0}, {x + 0.05f, y, 0}, {x, y + 0.05f, 0}});
        m.triangle(first + 3 * i, first + 3 * i + 1, first + 3 * i + 2);
    }
    m.name = "sphere and loose triangles";
    check_mesh(m, false);
    const MeshInfo info = build(m).info;
    ASSERT_GT(info.levels, 2u);
    EXPECT_LT(info.level_triangles[1], (sphere_triangles + loose) / 3);
    EXPECT_GT(info.level_triangles[2] - loose, 200u); // to three tenths the sphere would keep 70
}

// A large triangle makes its whole cluster be drawn near: it shares one with others like it.
TEST(Levels, LargeTrianglesApart) {
    TriangleMesh m = grid(64, 64);
    const uint32_t first = static_cast<uint32_t>(m.positions.size());
    for (uint32_t i = 0; i < 24; ++i) { // strips through the middle of the small ones
        const float y = 0.1f + 0.03f * float(i);
        m.positions.insert(m.positions.end(), {{0.1f, y, 0.2f}, {0.9f, y, 0.2f}, {0.9f, y + 0.01f, 0.2f}});
        m.triangle(first + 3 * i, first + 3 * i + 1, first + 3 * i + 2);
    }
    m.name = "strips over a grid";
    check_mesh(m, false);
    const Built b = build(m);
    uint32_t with_strips = 0, small_beside = 0;
    for (uint32_t c = 0; c < b.data.clusters.count() && b.data.clusters.level[c] == 0; ++c) {
        uint32_t strips = 0, small = 0;
        for (const Triple& t : cluster_triples(b.data.clusters, c))
            ++(b.data.weld_source[t[0]] >= first ? strips : small);
        with_strips += strips > 0;
        small_beside += strips > 0 ? small : 0;
    }
    EXPECT_GT(with_strips, 0u);
    EXPECT_EQ(small_beside, 0u);
}

double distance_to(Vec3f p, Vec3f a, Vec3f b, Vec3f c) {
    // Projection if inside, otherwise the nearest point of the three edges.
    const Vec3d q = to_double(p), k[3] = {to_double(a), to_double(b), to_double(c)};
    const Vec3d n = cross(k[1] - k[0], k[2] - k[0]);
    double best = 1e30;
    bool inside = true;
    for (int i = 0; i < 3; ++i) {
        const Vec3d e = k[(i + 1) % 3] - k[i], d = q - k[i];
        inside = inside && dot(cross(e, d), n) >= 0;
        const double t = std::clamp(dot(d, e) / dot(e, e), 0.0, 1.0);
        best = std::min(best, length(d - e * t));
    }
    return inside ? std::abs(dot(q - k[0], n)) / length(n) : best;
}

// The simplifier alone: every vertex that it removes is a point of one triangle, within the distance that it
// reports.
TEST(Simplify, PointsLieWithinTheReportedDistance) {
    for (const TriangleMesh& m : {bumpy_sphere(50, 40), torus(60, 30), grid(40, 30)}) {
        const Built b = build(m);
        std::vector<Vec3f> positions;
        for (const uint32_t v : b.data.weld_source) {
            positions.push_back(m.positions[v]);
        }
        Simplifier s(Allocator{}, b.info.welded_vertices);
        s.triangles = b.data.full_triangles;
        size_t before = positions.size();
        for (const uint32_t share : {2u, 8u, 40u}) {
            SimplifyOptions options;
            options.target_triangles = static_cast<uint32_t>(b.data.full_triangles.size() / 3 / share);
            const float reported = simplify(s, positions.data(), options);
            ASSERT_LE(s.triangles.size(), 3 * options.target_triangles);
            const std::set<uint32_t> kept(s.triangles.begin(), s.triangles.end());
            std::set<uint32_t> points;
            double farthest = 0;
            for (size_t t = 0; t < s.points.size(); ++t) {
                const uint32_t* k = s.triangles.data() + 3 * t;
                for (uint32_t p = s.points[t]; p != none; p = s.point_next[p]) {
                    ASSERT_TRUE(points.insert(p).second);
                    ASSERT_FALSE(kept.count(p));
                    farthest = std::max(farthest, distance_to(positions[p], positions[k[0]], positions[k[1]],
                                                              positions[k[2]]));
                }
            }
            ASSERT_EQ(points.size() + kept.size(), before);
            before = kept.size();
            EXPECT_LE(farthest, double(reported) * 1.0001) << m.name;
            EXPECT_GT(farthest, 0.5 * double(reported)) << m.name;
        }
    }
}

// A sample's weights give the point of its triangle that lies nearest to its vertex, in the rest pose.
TEST(Levels, SamplesAreTheNearestPoints) {
    const TriangleMesh m = bumpy_sphere(50, 40);
    const Built b = build(m);
    const LevelSamples& s = b.data.samples;
    const auto at = [&](uint32_t w) { return m.positions[b.data.weld_source[w]]; };
    for (size_t i = 0; i < s.vertex.size(); ++i) {
        const Vec3f k[3] = {at(s.corner[3 * i]), at(s.corner[3 * i + 1]), at(s.corner[3 * i + 2])};
        const Vec3f q = k[0] * s.weight[3 * i] + k[1] * s.weight[3 * i + 1] + k[2] * s.weight[3 * i + 2];
        ASSERT_NEAR(length(at(s.vertex[i]) - q), distance_to(at(s.vertex[i]), k[0], k[1], k[2]), 1e-6);
    }
}

void expect_equal(const Clusters& a, const Clusters& b) {
    EXPECT_EQ(a.vertices, b.vertices);
    EXPECT_EQ(a.vertex_begin, b.vertex_begin);
    EXPECT_EQ(a.triangle_begin, b.triangle_begin);
    EXPECT_EQ(a.level, b.level);
    EXPECT_EQ(a.two_sided, b.two_sided);
}

void expect_equal(const MeshData& a, const MeshData& b) {
    EXPECT_EQ(a.receivers, b.receivers);
    expect_equal(a.clusters, b.clusters);
    expect_equal(a.coarse_clusters, b.coarse_clusters);
    EXPECT_EQ(a.samples.begin, b.samples.begin);
    EXPECT_EQ(a.samples.cluster_begin, b.samples.cluster_begin);
    EXPECT_EQ(a.samples.vertex, b.samples.vertex);
    EXPECT_EQ(a.samples.corner, b.samples.corner);
    EXPECT_EQ(a.samples.weight, b.samples.weight);
    ASSERT_EQ(a.samples.bridges.size(), b.samples.bridges.size());
    for (size_t c = 0; c < a.samples.bridges.size(); ++c) {
        EXPECT_EQ(a.samples.bridges[c].vertex, b.samples.bridges[c].vertex) << c;
        EXPECT_EQ(a.samples.bridges[c].part, b.samples.bridges[c].part) << c;
    }
}

TEST(Levels, SameInputSameBits) {
    const TriangleMesh m = bumpy_sphere(60, 50);
    const Built a = build(m), b = build(m);
    expect_equal(a.data, b.data);
}

// The unit of length is the caller's: a power of two changes no bit.
TEST(Levels, ScaleDoesNotMatter) {
    TriangleMesh m = bumpy_sphere(40, 30);
    const Built a = build(m);
    for (const float scale : {0x1p-60f, 0x1p-20f, 0x1p20f, 0x1p60f}) {
        TriangleMesh scaled = m;
        for (Vec3f& p : scaled.positions) {
            p = p * scale;
        }
        expect_equal(a.data, build(scaled).data);
    }
}

// Poles take no longer for all their triangles (n^3 steps would be a minute). Around a hub of n clusters, or
// among random triangles whose vertices become hubs, each cluster would have as many over it: the lists stay
// short, and a hub's clusters are covered through their other vertices.
TEST(Levels, CoversStayFewAroundHubsAndInRandomTriangles) {
    const auto longest = [](const Clusters& c) {
        uint32_t most = 0;
        for (uint32_t i = 0; i < c.count(); ++i)
            most = std::max(most, c.cover_begin[i + 1] - c.cover_begin[i]);
        return most;
    };
    const Built ball = build(sphere(4000, 3)); // poles of 4,000 triangles
    const Clusters& c = ball.data.clusters;
    EXPECT_LE(longest(c), 16u);
    for (uint32_t i = 0; i < c.count(); ++i) {
        if (c.level[i] + 1u < ball.info.levels) {
            ASSERT_GT(c.cover_begin[i + 1], c.cover_begin[i]) << i;
        }
    }
    TriangleMesh loose;
    std::minstd_rand random(5);
    for (uint32_t v = 0; v < 4000; ++v)
        loose.positions.push_back({float(random() % 1000), float(random() % 1000), float(random() % 1000)});
    for (uint32_t t = 0; t < 6000; ++t) {
        const auto any = [&] { return static_cast<uint32_t>(random() % 4000); };
        loose.triangle(any(), any(), any());
    }
    const Built net = build(loose);
    EXPECT_GT(net.info.levels, 1u);
    EXPECT_LE(longest(net.data.clusters), 64u);
    EXPECT_LE(net.data.clusters.covers.size(), 6 * loose.indices.size());
}

TEST(Levels, LargeSphere) {
    const TriangleMesh m = sphere(320, 157);
    const std::clock_t start = std::clock(); // CPU time: the machine is shared
    const Built b = build(m);
    const double ms = 1e3 * static_cast<double>(std::clock() - start) / CLOCKS_PER_SEC;
    std::printf("  %u triangles, %u vertices: %.1f ms, %.1f ms for 10,000 vertices, %u levels, %u clusters\n",
                b.info.triangles, b.info.vertices, ms, ms * 1e4 / b.info.vertices, b.info.levels,
                b.info.clusters);
    EXPECT_GE(b.info.levels, 6u);
    EXPECT_LE(b.info.levels, max_levels);
}

} // namespace
} // namespace nusselt::test
