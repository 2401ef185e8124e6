// Input that no modeller would make.
#include "meshes.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <ctime>
#include <new>
#include <random>

namespace nusselt::test {
namespace {

TEST(Input, NoTriangles) {
    TriangleMesh m;
    m.positions = {{0, 0, 0}, {1, 2, 3}, {1, 2, 3}};
    const Built b = build(m);
    EXPECT_EQ(b.info.levels, 1u);
    EXPECT_EQ(b.info.clusters, 0u);
    EXPECT_EQ(b.info.components, 0u);
    EXPECT_EQ(b.data.receivers.size(), 2u);
    EXPECT_EQ(b.data.fan_begin.size(), 3u);
    EXPECT_EQ(b.data.ring_begin.size(), 3u);
    EXPECT_EQ(b.data.clusters.vertex_begin.size(), 1u);
    EXPECT_EQ(level_count(b.data.samples), 1u);
}

TEST(Input, OneTriangle) {
    TriangleMesh m;
    m.positions = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}};
    m.triangle(0, 1, 2);
    const Built b = build(m);
    EXPECT_EQ(b.info.clusters, 1u);
    EXPECT_EQ(b.info.boundary_edges, 3u);
    EXPECT_EQ(b.data.clusters.two_sided[0], 1);
    EXPECT_EQ(b.data.coarse_clusters.count(), 1u);
    EXPECT_EQ(b.info.levels, 1u);
    EXPECT_EQ(level_count(b.data.samples), 1u);
}

TEST(Input, EverythingAtOnePointOrNowhere) {
    TriangleMesh m;
    m.positions.assign(50, {1, 1, 1});
    for (uint32_t i = 0; i + 2 < 50; ++i) {
        m.triangle(i, i + 1, i + 2);
    }
    Built b = build(m);
    EXPECT_EQ(b.info.degenerate_triangles, 48u);
    EXPECT_EQ(b.info.clusters, 0u);
    for (Vec3f& p : m.positions) {
        p.z = std::nanf("");
    }
    b = build(m);
    EXPECT_EQ(b.info.degenerate_triangles, 48u);
    EXPECT_EQ(b.info.welded_vertices, 50u);
    EXPECT_EQ(b.data.receivers.size(), 50u);
}

// Costs the triangles around it, and nothing else.
TEST(Input, OneVertexNotFinite) {
    TriangleMesh m = sphere(30, 20);
    m.positions[40].y = std::nanf("");
    const Built b = build(m);
    EXPECT_EQ(b.info.degenerate_triangles, 6u);
    EXPECT_EQ(b.info.boundary_edges, 6u);
    EXPECT_GT(b.info.levels, 3u);
    const uint32_t bad = b.data.weld[40];
    EXPECT_EQ(std::count(b.data.clusters.vertices.begin(), b.data.clusters.vertices.end(), bad), 0);
    EXPECT_EQ(std::count(b.data.samples.vertex.begin(), b.data.samples.vertex.end(), bad), 0);
    for (const float w : b.data.samples.weight) {
        EXPECT_TRUE(std::isfinite(w));
    }
}

TEST(Input, CollinearTriangles) {
    TriangleMesh m;
    for (uint32_t i = 0; i < 300; ++i) {
        m.positions.push_back({static_cast<float>(i), 0, 0});
        if (i >= 2) m.triangle(i - 2, i - 1, i);
    }
    const Built b = build(m);
    EXPECT_EQ(b.info.degenerate_triangles, 0u);
    for (const float w : b.data.samples.weight) {
        EXPECT_TRUE(std::isfinite(w));
    }
}

TEST(Input, RepeatedAndMirroredTriangles) {
    TriangleMesh m = sphere(30, 20);
    const std::vector<uint32_t> once = m.indices;
    m.indices.insert(m.indices.end(), once.begin(), once.end());
    m.flip();
    m.indices.insert(m.indices.end(), once.begin(), once.end());
    const Built b = build(m);
    EXPECT_EQ(b.info.closed_components, 0u);
    EXPECT_EQ(b.info.level_triangles[0], m.indices.size() / 3);
}

TEST(Input, Soup) {
    std::mt19937 random(5);
    std::uniform_real_distribution<float> unit(-1, 1);
    for (const uint32_t vertices : {10u, 200u, 5000u}) {
        TriangleMesh m;
        for (uint32_t i = 0; i < vertices; ++i) {
            m.positions.push_back({unit(random), unit(random), unit(random)});
        }
        for (uint32_t i = 0; i < 3000; ++i) {
            const auto vertex = [&] { return static_cast<uint32_t>(random() % vertices); };
            m.triangle(vertex(), vertex(), vertex());
        }
        const Built b = build(m);
        EXPECT_EQ(b.info.level_triangles[0] + b.info.degenerate_triangles, 3000u);
        for (uint32_t c = 0; c < b.data.clusters.count(); ++c) {
            ASSERT_LE(b.data.clusters.vertex_begin[c + 1] - b.data.clusters.vertex_begin[c], 64u);
            ASSERT_LE(b.data.clusters.edge_begin[c + 1] - b.data.clusters.edge_begin[c], 128u);
        }
    }
}

// Loose triangles share no edge and no vertex.
TEST(Input, LooseTriangles) {
    TriangleMesh m;
    for (uint32_t i = 0; i < 2000; ++i) {
        const float x = static_cast<float>(i % 50), y = static_cast<float>(i / 50);
        m.positions.insert(m.positions.end(), {{x, y, 0}, {x + 0.5f, y, 0}, {x, y + 0.5f, 0}});
        m.triangle(3 * i, 3 * i + 1, 3 * i + 2);
    }
    const Built b = build(m);
    EXPECT_EQ(b.info.components, 2000u);
    EXPECT_EQ(b.info.level_triangles[0], 2000u);
}

// The rings of a hub's neighbours would hold the square of its triangles.
TEST(Input, HubOfManyTriangles) {
    TriangleMesh m;
    const uint32_t n = 60000;
    m.positions.push_back({0, 0, 0.3f});
    for (uint32_t i = 0; i < n; ++i) {
        const float a = 6.2831853f * static_cast<float>(i) / static_cast<float>(n);
        m.positions.push_back({std::cos(a), std::sin(a), 0});
        m.triangle(0, i + 1, (i + 1) % n + 1);
    }
    const Built b = build(m);
    EXPECT_EQ(b.info.components, 1u);
    EXPECT_LT(b.data.ring.size(), 16u * n);
}

// Triangles among random points, around hubs and in strips take some times as long as an ordinary mesh of as
// many (10 at most measured; a level's steps are bounded, see simplify.cpp).
TEST(Input, HostileMeshesTakeSomeTimesAnOrdinaryOne) {
    constexpr uint32_t n = 8000;
    std::mt19937 random(5);
    std::uniform_real_distribution<float> unit(-1, 1);
    const auto any = [&] { return Vec3f{unit(random), unit(random), unit(random)}; };
    const auto on_circle = [](uint32_t i) {
        const float a = 6.2831853f * static_cast<float>(i) / static_cast<float>(n);
        return Vec3f{std::cos(a), std::sin(a), 0};
    };
    std::vector<TriangleMesh> meshes;
    meshes.reserve(8); // they are referred to
    const auto begin = [&](const char* name) -> TriangleMesh& {
        meshes.emplace_back();
        meshes.back().name = name;
        return meshes.back();
    };
    for (const uint32_t points : {100u, 1000u, 4000u, 25000u}) {
        TriangleMesh& m = begin("triangles among random points");
        for (uint32_t i = 0; i < points; ++i)
            m.positions.push_back(any());
        const auto vertex = [&] { return static_cast<uint32_t>(random() % points); };
        for (uint32_t i = 0; i < n; ++i)
            m.triangle(vertex(), vertex(), vertex());
    }
    TriangleMesh& fan = begin("a fan");
    fan.positions.push_back({0, 0, 0.3f});
    TriangleMesh& book = begin("triangles at one edge");
    book.positions = {{0, 0, -1}, {0, 0, 1}};
    TriangleMesh& bow = begin("triangles at one corner");
    bow.positions.push_back({0, 0, 0});
    for (uint32_t i = 0; i < n; ++i) {
        fan.positions.push_back(on_circle(i));
        fan.triangle(0, i + 1, (i + 1) % n + 1);
        book.positions.push_back(on_circle(i));
        book.triangle(0, 1, i + 2);
        const Vec3f at = any();
        bow.positions.insert(bow.positions.end(), {at + any() * 0.02f, at + any() * 0.02f});
        bow.triangle(0, 2 * i + 1, 2 * i + 2);
    }
    TriangleMesh& strip = begin("a strip");
    for (uint32_t i = 0; i < n + 2; ++i) {
        strip.positions.push_back({1e-4f * static_cast<float>(i), static_cast<float>(i % 2), 0});
        if (i < n) strip.triangle(i, i + 1, i + 2);
    }
    const TriangleMesh ordinary = bumpy_sphere(90, 46);
    ASSERT_GT(ordinary.indices.size() / 3, size_t(n));

    const auto seconds = [](const TriangleMesh& m) {
        const std::clock_t start = std::clock(); // CPU time: the machine may be shared
        const Built b = build(m);
        return static_cast<double>(std::clock() - start) / CLOCKS_PER_SEC;
    };
    for (const TriangleMesh& m : meshes) {
        double plain = 1e30, hostile = 1e30;
        for (int round = 0; round < 3; ++round) {
            plain = std::min(plain, seconds(ordinary));
            hostile = std::min(hostile, seconds(m));
        }
        std::printf("%s (%zu points): %.1f times\n", m.name.c_str(), m.positions.size(), hostile / plain);
        EXPECT_LT(hostile, 15 * plain) << m.name;
    }
}

// All memory comes from the caller's allocator, goes back to it, and a refusal is a bad_alloc without a leak.
struct Counter {
    long blocks = 0;
    long allowed = 1L << 40;
};

TEST(Input, MemoryIsTheCallers) {
    Counter counter;
    Allocator a;
    a.user = &counter;
    a.allocate = [](void* user, size_t size, size_t alignment) -> void* {
        Counter& c = *static_cast<Counter*>(user);
        if (c.allowed-- <= 0) return nullptr;
        ++c.blocks;
        return ::operator new(size, std::align_val_t(alignment));
    };
    a.release = [](void* user, void* memory, size_t, size_t alignment) {
        --static_cast<Counter*>(user)->blocks;
        ::operator delete(memory, std::align_val_t(alignment));
    };
    const TriangleMesh m = bumpy_sphere(20, 15);
    MeshDesc desc;
    desc.rest_positions = {&m.positions[0].x, m.positions.size(), 12};
    desc.indices = m.indices.data();
    desc.index_count = m.indices.size();
    long used = 0;
    {
        MeshData data(a);
        MeshInfo info;
        build_mesh(desc, {}, a, data, info);
        used = (1L << 40) - counter.allowed;
        EXPECT_GT(counter.blocks, 0);
    }
    EXPECT_EQ(counter.blocks, 0);
    for (long allowed = 0; allowed < used; allowed += 1 + allowed / 8) {
        counter.allowed = allowed;
        {
            MeshData data(a);
            MeshInfo info;
            EXPECT_THROW(build_mesh(desc, {}, a, data, info), std::bad_alloc);
        }
        ASSERT_EQ(counter.blocks, 0);
    }
}

} // namespace
} // namespace nusselt::test
