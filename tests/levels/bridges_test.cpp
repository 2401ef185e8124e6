// Where a level's triangles bridge the level before: the search against every triangle, and what comes of it.
#include "meshes.h"

#include "runtime/src/bridges.h"
#include "runtime/src/weld.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>

namespace nusselt::test {
namespace {

struct Soup {
    Vector<uint32_t> triangles{HostAllocator<uint32_t>(Allocator{})};
    std::vector<Vec3f> positions;
};

Soup soup_of(const std::vector<Triple>& triples, const std::vector<Vec3f>& positions) {
    Soup s;
    for (const Triple& t : triples)
        s.triangles.insert(s.triangles.end(), t.begin(), t.end());
    s.positions = positions;
    return s;
}

double brute_square(const Soup& s, Vec3d p) {
    double least = std::numeric_limits<double>::max();
    for (size_t i = 0; i < s.triangles.size(); i += 3) {
        const Vec3d a = to_double(s.positions[s.triangles[i]]),
                    b = to_double(s.positions[s.triangles[i + 1]]),
                    c = to_double(s.positions[s.triangles[i + 2]]);
        const Vec3d w = nearest_weights(p, a, b, c);
        const Vec3d away = p - (a * w.x + b * w.y + c * w.z);
        least = std::min(least, dot(away, away));
    }
    return least;
}

TEST(Bridges, TheTreeFindsWhatEveryTriangleSays) {
    const uint32_t seed = 20250;
    std::mt19937 random(seed);
    std::uniform_real_distribution<float> anywhere(-1, 1);
    for (const uint32_t count : {1u, 2u, 5u, 300u}) {
        for (const float size : {0.02f, 0.3f, 2.0f}) {
            Soup s;
            for (uint32_t t = 0; t < count; ++t) {
                const Vec3f centre{anywhere(random), anywhere(random), anywhere(random)};
                for (uint32_t k = 0; k < 3; ++k) {
                    s.triangles.push_back(3 * t + k);
                    s.positions.push_back(centre +
                                          Vec3f{anywhere(random), anywhere(random), anywhere(random)} * size);
                }
            }
            SurfaceTree tree(Allocator{});
            build_surface_tree(s.triangles, s.positions.data(), tree);
            uint32_t leaf = static_cast<uint32_t>(tree.nodes.size()) - 1;
            for (uint32_t i = 0; i < 200; ++i) {
                const Vec3d p{anywhere(random), anywhere(random), anywhere(random)};
                const double nearest = brute_square(s, p), enough = i % 2 ? 0.04 : 0.0;
                const SurfacePoint found = find_near(tree, s.positions.data(), p, enough, leaf);
                if (found.square > enough) {
                    ASSERT_EQ(found.square, nearest) << "seed " << seed << ", query " << i;
                }
                ASSERT_GE(found.square, nearest);
                ASSERT_EQ(found.square, dot(p - found.point, p - found.point));
                ASSERT_EQ(tree.nodes[leaf].second, 0u);
            }
        }
    }
}

// A plate with a square hole, its rim of 8 vertices, and one triangle that lies across the hole.
TEST(Bridges, ATriangleAcrossAHole) {
    std::vector<Vec3f> p;
    for (const float r : {0.5f, 1.0f})
        for (const Vec3f d : {Vec3f{-1, -1, 0}, {1, -1, 0}, {1, 1, 0}, {-1, 1, 0}})
            p.push_back(d * r);
    std::vector<Triple> plate;
    for (uint32_t k = 0; k < 4; ++k) {
        const uint32_t a = k, b = (k + 1) % 4, c = b + 4, d = a + 4;
        plate.push_back({a, d, c});
        plate.push_back({a, c, b});
    }
    const Soup s = soup_of(plate, p);
    SurfaceTree tree(Allocator{});
    build_surface_tree(s.triangles, s.positions.data(), tree);
    const uint32_t across[3] = {0, 1, 2}, first = 0;
    // Of its points (1/6, -1/6, 0) and three nearer to corners, the first lies 1/3 from two sides of the
    // hole.
    const Bridge bridge = find_bridge(tree, s.positions.data(), across, &first, 1, false, 0.0);
    ASSERT_NE(bridge.vertex, none);
    Vec3d at{};
    for (uint32_t k = 0; k < 3; ++k)
        at = at + to_double(p[bridge.corner[k]]) * double(bridge.weight[k]);
    const Vec3d away = at - to_double(p[bridge.vertex]);
    EXPECT_NEAR(std::sqrt(double(bridge.part) * dot(away, away)), 1.0 / 3, 1e-6);
    // In the plate's plane it lies to neither side: it counts from the largest distance on, and not before.
    EXPECT_NE(find_bridge(tree, s.positions.data(), across, &first, 1, false, 0.32 * 0.32).vertex, none);
    EXPECT_EQ(find_bridge(tree, s.positions.data(), across, &first, 1, false, 0.34 * 0.34).vertex, none);
    // Above it, it counts from three quarters on; below it, it doesn't.
    for (const float height : {0.2f, -0.2f}) {
        std::vector<Vec3f> moved = p;
        for (const uint32_t k : {0u, 1u, 2u})
            moved.push_back(p[k] + Vec3f{0, 0, height});
        const uint32_t lifted[3] = {8, 9, 10};
        const double distance = std::hypot(1.0 / 3, 0.2);
        const auto counts = [&](double most, bool two_sided = false) {
            return find_bridge(tree, moved.data(), lifted, &first, 1, two_sided,
                               most * most * distance * distance)
                       .vertex != none;
        };
        EXPECT_TRUE(counts(0.99));
        EXPECT_EQ(counts(1.3), height > 0);
        EXPECT_FALSE(counts(1.35));
        EXPECT_TRUE(counts(0.99, true));
        EXPECT_FALSE(counts(1.01, true));
    }
    // On the surface there is nothing to bridge.
    const uint32_t own[3] = {plate[0][0], plate[0][1], plate[0][2]};
    EXPECT_EQ(find_bridge(tree, s.positions.data(), own, &first, 1, false, 0.0).vertex, none);
}

// Of a mesh's levels: as far from the level before as its triangles say.
TEST(Bridges, LevelsTellHowFarTheyBridge) {
    const TriangleMesh m = bumpy_sphere(60, 50);
    const Built b = build(m);
    const Clusters& c = b.data.clusters;
    std::vector<Vec3f> positions;
    for (const uint32_t v : b.data.weld_source)
        positions.push_back(m.positions[v]);
    ASSERT_EQ(b.data.samples.bridges.size(), c.count());
    uint32_t found = 0;
    for (uint32_t i = 0; i < c.count(); ++i) {
        const Bridge& bridge = b.data.samples.bridges[i];
        if (c.level[i] == 0) {
            ASSERT_EQ(bridge.vertex, none);
        }
        if (bridge.vertex == none) continue;
        ++found;
        const Soup before = soup_of(level_triples(b, c.level[i] - 1u), positions);
        const std::vector<Triple> own = level_triples(b, c.level[i]);
        const Triple corner{bridge.corner[0], bridge.corner[1], bridge.corner[2]};
        EXPECT_NE(std::find(own.begin(), own.end(), corner), own.end()) << "no triangle of its level";
        EXPECT_EQ(std::count(before.triangles.begin(), before.triangles.end(), bridge.vertex) > 0, true);
        float sum = 0;
        for (const float w : bridge.weight) {
            EXPECT_GE(w, 1.0f / 6 - 1e-6f);
            sum += w;
        }
        EXPECT_NEAR(sum, 1, 1e-6f);
        Vec3d at{};
        for (uint32_t k = 0; k < 3; ++k)
            at = at + to_double(positions[bridge.corner[k]]) * double(bridge.weight[k]);
        const Vec3d away = at - to_double(positions[bridge.vertex]);
        const double square = brute_square(before, at);
        EXPECT_NEAR(double(bridge.part) * dot(away, away), square, 1e-4 * square + 1e-12);
    }
    EXPECT_GT(found, 10u);
}

} // namespace
} // namespace nusselt::test
