#include "meshes.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>

namespace nusselt::test {
namespace {

// Every vertex is a receiver or repeats one.
void check_receivers(const TriangleMesh& m, const Built& b) {
    std::vector<uint32_t> all(b.data.receivers.begin(), b.data.receivers.end());
    all.insert(all.end(), b.data.duplicates.begin(), b.data.duplicates.end());
    std::sort(all.begin(), all.end());
    ASSERT_EQ(all.size(), m.positions.size());
    for (uint32_t v = 0; v < all.size(); ++v) {
        ASSERT_EQ(all[v], v);
    }
    ASSERT_EQ(b.data.duplicates.size(), b.data.duplicate_of.size());
    for (size_t i = 0; i < b.data.duplicates.size(); ++i) {
        const uint32_t v = b.data.duplicates[i], r = b.data.duplicate_of[i];
        ASSERT_EQ(b.data.weld[v], b.data.weld[r]);
        ASSERT_NE(std::find(b.data.receivers.begin(), b.data.receivers.end(), r), b.data.receivers.end());
    }
}

TEST(Receivers, SplitNormalsAreReceiversOfTheirOwn) {
    TriangleMesh m = cube(true);
    EXPECT_EQ(build(m).data.receivers.size(), 24u);
    m.positions.push_back(m.positions[3]);
    m.normals.push_back(m.normals[3]);
    const Built b = build(m);
    check_receivers(m, b);
    EXPECT_EQ(b.data.receivers.size(), 24u);
    ASSERT_EQ(b.data.duplicates.size(), 1u);
    EXPECT_EQ(b.data.duplicate_of[0], 3u);
}

TEST(Receivers, WithoutNormalsOneForEachPosition) {
    TriangleMesh m = cube(true);
    m.normals.clear();
    const Built b = build(m);
    check_receivers(m, b);
    EXPECT_EQ(b.data.receivers.size(), 8u);
}

TEST(Receivers, NotFiniteOnesComeLast) {
    TriangleMesh m = sphere(20, 10);
    m.positions[17].y = std::nanf("");
    m.positions[3].x = INFINITY;
    const Built b = build(m);
    check_receivers(m, b);
    EXPECT_EQ(b.data.receivers[b.data.receivers.size() - 2], 3u);
    EXPECT_EQ(b.data.receivers.back(), 17u);
}

TEST(Receivers, BatchesLieTogether) {
    TriangleMesh m = bumpy_sphere(100, 80);
    const Built b = build(m);
    check_receivers(m, b);
    double radius = 0;
    size_t batches = 0;
    for (size_t i = 0; i + batch_receivers <= b.data.receivers.size(); i += batch_receivers) {
        Vec3f centre;
        for (uint32_t k = 0; k < batch_receivers; ++k) {
            centre = centre + m.positions[b.data.receivers[i + k]] * (1.0f / batch_receivers);
        }
        float r = 0;
        for (uint32_t k = 0; k < batch_receivers; ++k) {
            r = std::max(r, length(m.positions[b.data.receivers[i + k]] - centre));
        }
        radius += r;
        ++batches;
    }
    radius /= static_cast<double>(batches);
    // A disc of 16 vertices' share of the surface.
    const double disc = std::sqrt(4 * 3.14159 * 16 / static_cast<double>(m.positions.size()) / 3.14159);
    EXPECT_LT(radius, 1.6 * disc);
}

} // namespace
} // namespace nusselt::test
