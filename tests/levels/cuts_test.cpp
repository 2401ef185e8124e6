// The graph of clusters: whatever is selected covers the surface once and without a crack.
#include "meshes.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdio>
#include <ctime>
#include <random>

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

void check_tables(const Built& b, const Clusters& c) {
    ASSERT_EQ(c.vertex_begin.size(), c.count() + 1);
    ASSERT_EQ(c.edge_begin.size(), c.count() + 1);
    ASSERT_EQ(c.triangle_begin.size(), c.count() + 1);
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

void check_graph(const TriangleMesh& m, const Built& b) {
    const Clusters& c = b.data.clusters;
    const Groups& g = b.data.groups;
    ASSERT_EQ(g.cluster_begin.size(), g.count() + 1);
    for (uint32_t i = 0; i < c.count(); ++i) {
        ASSERT_TRUE(c.own_group[i] == no_group || c.own_group[i] < c.parent_group[i]);
        ASSERT_EQ(c.own_group[i] == no_group, c.level[i] == 0);
    }
    const Bounds bounds = bounds_of(m, b);
    for (uint32_t i = 0; i < g.count(); ++i) {
        for (uint32_t k = g.cluster_begin[i]; k < g.cluster_begin[i + 1]; ++k) {
            const uint32_t member = g.clusters[k];
            ASSERT_EQ(c.parent_group[member], i);
            const auto inside = [&](const Sphere& s) {
                const Sphere& o = bounds.groups[i];
                return length(Vec3f{s.x - o.x, s.y - o.y, s.z - o.z}) + s.radius <= o.radius * 1.00001f;
            };
            ASSERT_TRUE(inside(bounds.clusters[member]));
            const uint32_t child = c.own_group[member];
            if (child == no_group) continue;
            ASSERT_TRUE(inside(bounds.groups[child]));
            // The plain product is monotone already, up to rounding; the refit makes it exact.
            ASSERT_GE(g.relative_error[i] * bounds.groups[i].radius,
                      0.9999f * g.relative_error[child] * bounds.groups[child].radius);
            ASSERT_GE(bounds.errors[i], bounds.errors[child]);
        }
    }
}

// A cluster is drawn where its own group is fine enough and its parent is not.
std::vector<uint32_t> cut(const Built& b, const std::vector<uint8_t>& fine) {
    std::vector<uint32_t> out;
    const Clusters& c = b.data.clusters;
    for (uint32_t i = 0; i < c.count(); ++i) {
        const bool own = c.own_group[i] == no_group || fine[c.own_group[i]];
        const bool parent = c.parent_group[i] != no_group && fine[c.parent_group[i]];
        if (own && !parent) out.push_back(i);
    }
    return out;
}

std::vector<Triple> cut_triples(const Built& b, const std::vector<uint8_t>& fine) {
    std::vector<Triple> out;
    for (const uint32_t i : cut(b, fine)) {
        for (const Triple& t : cluster_triples(b.data.clusters, i)) {
            out.push_back(t);
        }
    }
    return out;
}

// As a receiver decides: error against distance from a point.
std::vector<uint8_t> by_distance(const Bounds& bounds, Vec3f eye, float threshold) {
    std::vector<uint8_t> fine(bounds.groups.size());
    for (size_t g = 0; g < fine.size(); ++g) {
        const Sphere& s = bounds.groups[g];
        const float distance = std::max(0.0f, length(Vec3f{s.x, s.y, s.z} - eye) - s.radius);
        fine[g] = bounds.errors[g] <= threshold * distance;
    }
    return fine;
}

// Any choice at all in which a group is fine only if those beneath it are.
std::vector<uint8_t> by_chance(const Built& b, std::mt19937& random, double chance) {
    const Groups& g = b.data.groups;
    std::vector<uint8_t> fine(g.count());
    std::bernoulli_distribution coin(chance);
    for (uint32_t i = 0; i < g.count(); ++i) {
        fine[i] = coin(random);
        for (uint32_t k = g.cluster_begin[i]; k < g.cluster_begin[i + 1]; ++k) {
            const uint32_t child = b.data.clusters.own_group[g.clusters[k]];
            if (child != no_group && !fine[child]) fine[i] = 0;
        }
    }
    return fine;
}

void check_mesh(const TriangleMesh& m, bool closed, uint32_t cuts) {
    SCOPED_TRACE(m.name);
    const Built b = build(m);
    check_tables(b, b.data.clusters);
    check_tables(b, b.data.coarse_clusters);
    check_graph(m, b);

    const std::vector<Triple> full = full_triples(b);
    std::vector<Triple> leaves = cut_triples(b, std::vector<uint8_t>(b.data.groups.count(), 0));
    for (Triple& t : leaves) {
        t = rotated(t);
    }
    std::sort(leaves.begin(), leaves.end());
    ASSERT_EQ(leaves, full); // every triangle in exactly one leaf cluster
    if (!closed) return;

    ASSERT_EQ(b.info.closed_components, b.info.components);
    std::mt19937 random(7);
    std::uniform_real_distribution<float> unit(0, 1);
    size_t fewest = full.size();
    for (uint32_t i = 0; i < cuts; ++i) {
        const std::vector<Triple> chance = cut_triples(b, by_chance(b, random, 0.3 + 0.7 * unit(random)));
        ASSERT_EQ(open_edges(chance), 0u);
        const Bounds bounds = bounds_of(m, b);
        const Vec3f eye = m.positions[random() % m.positions.size()];
        const std::vector<Triple> near =
            cut_triples(b, by_distance(bounds, eye, std::exp2(-8 * unit(random))));
        ASSERT_EQ(open_edges(near), 0u);
        fewest = std::min({fewest, chance.size(), near.size()});
    }
    const std::vector<Triple> roots = cut_triples(b, std::vector<uint8_t>(b.data.groups.count(), 1));
    EXPECT_EQ(open_edges(roots), 0u);
    std::vector<Triple> coarse;
    for (uint32_t i = 0; i < b.data.coarse_clusters.count(); ++i) {
        for (const Triple& t : cluster_triples(b.data.coarse_clusters, i)) {
            coarse.push_back(t);
        }
    }
    EXPECT_EQ(open_edges(coarse), 0u);
    std::printf("  %-16s %6zu triangles, cuts down to %5zu, roots %4zu, coarse %4zu\n", m.name.c_str(),
                full.size(), fewest, roots.size(), coarse.size());
}

TEST(Cuts, ProceduralMeshes) {
    check_mesh(torus(60, 30), true, 40);
    check_mesh(sphere(64, 40), true, 40);
    check_mesh(bumpy_sphere(90, 60), true, 40);
    check_mesh(cube(true), true, 4);
    check_mesh(grid(40, 30), false, 0);
    check_mesh(moebius(200), false, 0);
    TriangleMesh two = bumpy_sphere(40, 30);
    two.append(torus(40, 20), {2.5f, 0, 0});
    two.name = "two parts";
    check_mesh(two, true, 40);
    TriangleMesh many;
    for (uint32_t i = 0; i < 60; ++i) {
        many.append(sphere(8, 6), {static_cast<float>(3 * (i % 8)), static_cast<float>(3 * (i / 8)), 0});
    }
    many.name = "many parts";
    check_mesh(many, true, 20);
}

TEST(Cuts, RealModels) {
    const std::string folder = std::string(NUSSELT_SHARED_DIR) + "/data/models/classic/";
    TriangleMesh m;
    if (!load_obj(folder + "spot_cow/spot.obj", m)) GTEST_SKIP() << "no models in " << folder;
    check_mesh(m, true, 20);
    ASSERT_TRUE(load_obj(folder + "armadillo/armadillo.obj", m));
    check_mesh(m, true, 10);
    ASSERT_TRUE(load_obj(folder + "stanford_bunny/bunny.obj", m));
    check_mesh(m, false, 0);
}

// Mixed closed and open components: never in one cluster, and the closed part of every cut is closed.
TEST(Cuts, ClosedAndOpenDoNotMix) {
    TriangleMesh m = bumpy_sphere(40, 30);
    m.append(grid(40, 40), {-0.5f, -0.5f, 1.2f});
    const Built b = build(m);
    EXPECT_EQ(b.info.components, 2u);
    EXPECT_EQ(b.info.closed_components, 1u);
    std::mt19937 random(3);
    for (int i = 0; i < 20; ++i) {
        std::vector<Triple> closed;
        for (const uint32_t c : cut(b, by_chance(b, random, 0.9))) {
            if (b.data.clusters.two_sided[c]) continue;
            for (const Triple& t : cluster_triples(b.data.clusters, c)) {
                closed.push_back(t);
            }
        }
        ASSERT_EQ(open_edges(closed), 0u);
    }
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

// The largest group error of a cut bounds how far the full mesh's surface lies from it.
TEST(Errors, BoundSampledDistances) {
    std::mt19937 random(11);
    std::uniform_real_distribution<float> unit(0, 1);
    for (const TriangleMesh& m : {bumpy_sphere(50, 40), torus(60, 30)}) {
        const Built b = build(m);
        const Bounds bounds = bounds_of(m, b);
        const auto at = [&](uint32_t w) { return m.positions[b.data.weld_source[w]]; };
        for (const float limit : {0.002f, 0.01f, 0.04f}) {
            std::vector<uint8_t> fine(b.data.groups.count());
            float error = 0;
            for (size_t g = 0; g < fine.size(); ++g) {
                fine[g] = bounds.errors[g] <= limit;
                if (fine[g]) error = std::max(error, bounds.errors[g]);
            }
            const std::vector<Triple> drawn = cut_triples(b, fine);
            double at_vertices = 0, anywhere = 0;
            const auto nearest = [&](Vec3f p) {
                double best = 1e30;
                for (const Triple& t : drawn) {
                    best = std::min(best, distance_to(p, at(t[0]), at(t[1]), at(t[2])));
                }
                return best;
            };
            for (int i = 0; i < 500; ++i) {
                const size_t t = random() % (m.indices.size() / 3);
                const Vec3f a = m.positions[m.indices[3 * t]], p = m.positions[m.indices[3 * t + 1]],
                            q = m.positions[m.indices[3 * t + 2]];
                const float u = std::sqrt(unit(random)), v = unit(random);
                at_vertices = std::max(at_vertices, nearest(a));
                anywhere = std::max(anywhere, nearest(a * (1 - u) + p * (u * (1 - v)) + q * (u * v)));
            }
            std::printf(
                "  %-12s limit %.3f: %5zu triangles, error %.4f, sampled %.4f at vertices, %.4f anywhere\n",
                m.name.c_str(), limit, drawn.size(), error, at_vertices, anywhere);
            EXPECT_LE(at_vertices, error * 1.0001);
            EXPECT_LE(anywhere, error * 1.5 + 1e-6);
        }
    }
}

TEST(Levels, SameInputSameBits) {
    const TriangleMesh m = bumpy_sphere(60, 50);
    const Built a = build(m), b = build(m);
    EXPECT_EQ(a.data.receivers, b.data.receivers);
    EXPECT_EQ(a.data.clusters.vertices, b.data.clusters.vertices);
    EXPECT_EQ(a.data.clusters.parent_group, b.data.clusters.parent_group);
    EXPECT_EQ(a.data.groups.relative_error, b.data.groups.relative_error);
    EXPECT_EQ(a.data.coarse_clusters.vertices, b.data.coarse_clusters.vertices);
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
        const Built b = build(scaled);
        EXPECT_EQ(a.data.clusters.vertices, b.data.clusters.vertices);
        EXPECT_EQ(a.data.groups.relative_error, b.data.groups.relative_error);
        EXPECT_EQ(a.data.receivers, b.data.receivers);
    }
}

TEST(Levels, LargeSphere) {
    const TriangleMesh m = sphere(320, 157);
    const std::clock_t start = std::clock(); // CPU time: the machine is shared
    const Built b = build(m);
    const double ms = 1e3 * static_cast<double>(std::clock() - start) / CLOCKS_PER_SEC;
    std::printf("  %u triangles, %u vertices: %.1f ms, %.1f ms for 10,000 vertices, %u levels, %u clusters\n",
                b.info.triangles, b.info.vertices, ms, ms * 1e4 / b.info.vertices, b.info.levels,
                b.info.clusters);
    EXPECT_GE(b.info.levels, 8u);
    for (uint32_t i = 1; i + 1 < b.info.levels; ++i) {
        EXPECT_LT(b.info.level_triangles[i], b.info.level_triangles[i - 1]);
    }
}

} // namespace
} // namespace nusselt::test
