// The peer's sample grids and rotations, against closed forms.
#include "kernels/kernels.h"
#include "tools/compare/grid.h"
#include "tools/trace/sh.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace nusselt::tools {
namespace {

TEST(Grid, CellsSumToTheHemisphere) {
    for (const SampleGrid& grid : {concentric_grid(4), concentric_grid(32), scattered_grid(4), mask_grid(32),
                                   mask_grid(64), disk_grid(32)}) {
        for (size_t i = 0; i < 25; ++i) {
            double cells = 0, blocks = 0;
            for (size_t cell = 0; cell < grid.used.size(); ++cell)
                cells += grid.weights[cell * 25 + i];
            for (size_t block = 0; block < grid.used.size() / 16; ++block)
                blocks += grid.block[block * 32 + i];
            EXPECT_NEAR(cells, grid.total[i], 1e-12);
            EXPECT_NEAR(blocks, grid.total[i], 1e-5);
        }
    }
}

TEST(Grid, SupersamplingIsFine) {
    // What was spread over the cells to make the sum exact is small: half the grid is half the hemisphere.
    const SampleGrid grid = concentric_grid(32);
    double half = 0;
    for (size_t cell = 0; cell < grid.used.size(); ++cell)
        if (grid.x[cell] > 0) half += grid.weights[cell * 25];
    EXPECT_NEAR(half, grid.total[0] / 2, 1e-9);
}

TEST(Grid, ScatteredSamplesAreTheLibrarys) {
    for (const uint32_t side : {32u, 64u}) {
        const SampleGrid grid = mask_grid(side);
        const kernels::MaskLayout layout = side == 32 ? kernels::standard_layout : kernels::fine_layout;
        ASSERT_EQ(layout.side, side);
        for (uint32_t cell = 0; cell < side * side; ++cell) {
            const uint32_t x = cell / 16 % (side / 4) * 4 + cell % 4,
                           y = cell / 16 / (side / 4) * 4 + cell % 16 / 4;
            double direction[3];
            ASSERT_TRUE(kernels::sample_direction(layout, kernels::bit_of_cell(layout, x, y), direction));
            ASSERT_NEAR(grid.x[cell], direction[0], 1e-6) << cell;
            ASSERT_NEAR(grid.y[cell], direction[1], 1e-6) << cell;
            ASSERT_NEAR(grid.z[cell], direction[2], 1e-6) << cell;
        }
    }
}

TEST(Grid, ScatteredSamplesWeighWhatIsNearest) {
    // A point of the hemisphere belongs to one sample; the weights of the first term are their shares of it.
    const SampleGrid grid = scattered_grid(16);
    std::mt19937 random(5);
    std::uniform_real_distribution<double> value;
    std::vector<double> share(256);
    constexpr int points = 400'000;
    for (int k = 0; k < points; ++k) {
        const double r = std::sqrt(value(random)), p = 6.283185307179586 * value(random);
        const double x = r * std::cos(p), y = r * std::sin(p), z = std::sqrt(1 - r * r);
        size_t nearest = 0;
        for (size_t cell = 1; cell < 256; ++cell)
            if (x * grid.x[cell] + y * grid.y[cell] + z * grid.z[cell] >
                x * grid.x[nearest] + y * grid.y[nearest] + z * grid.z[nearest])
                nearest = cell;
        share[nearest] += 1.0 / points;
    }
    for (size_t cell = 0; cell < 256; ++cell)
        EXPECT_NEAR(grid.weights[cell * 25] / grid.total[0], share[cell], 6 * std::sqrt(0.004 / points))
            << cell;
}

TEST(Grid, ConcentricCellsAreEqual) {
    const SampleGrid grid = concentric_grid(16);
    for (size_t cell = 0; cell < grid.used.size(); ++cell) {
        EXPECT_NEAR(grid.weights[cell * 25], grid.total[0] / 256, 1e-9);
        EXPECT_NEAR(grid.x[cell] * grid.x[cell] + grid.y[cell] * grid.y[cell] + grid.z[cell] * grid.z[cell],
                    1, 1e-6);
    }
}

TEST(Grid, RotationTakesTheNormalAlong) {
    std::mt19937 random(3);
    std::normal_distribution<double> value;
    LaneRotation rotation{};
    float in[25][16], out[25][16];
    double normals[16][3];
    for (int lane = 0; lane < 16; ++lane) {
        double n[3] = {value(random), value(random), value(random)};
        // The poles too.
        if (lane < 2) n[0] = n[1] = 0;
        if (lane < 2) n[2] = lane ? -1 : 1;
        const double length = std::sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]);
        for (int k = 0; k < 3; ++k)
            normals[lane][k] = n[k] / length;
        const double across = std::hypot(normals[lane][0], normals[lane][1]);
        rotation.cos_a[lane] = static_cast<float>(normals[lane][2]);
        rotation.sin_a[lane] = static_cast<float>(across);
        rotation.cos_p[lane] = static_cast<float>(across > 0 ? normals[lane][0] / across : 1);
        rotation.sin_p[lane] = static_cast<float>(across > 0 ? normals[lane][1] / across : 0);
        for (auto& term : in)
            term[lane] = static_cast<float>(value(random));
    }
    rotate_lanes(rotation, in, out);
    for (int lane = 0; lane < 16; ++lane) {
        // A function of local direction s has the same value at the turned direction.
        const double* n = normals[lane];
        const double across = std::hypot(n[0], n[1]), c = across > 0 ? n[0] / across : 1,
                     s = across > 0 ? n[1] / across : 0;
        const double local[3] = {0.36, -0.48, 0.8};
        const double turned[3] = {local[0] * n[2] * c - local[1] * s + local[2] * n[0],
                                  local[0] * n[2] * s + local[1] * c + local[2] * n[1],
                                  -local[0] * across + local[2] * n[2]};
        double before[25], after[25], own[25], own_turned[25], a = 0, b = 0, d = 0;
        sh_basis(local[0], local[1], local[2], before);
        sh_basis(turned[0], turned[1], turned[2], after);
        for (int i = 0; i < 25; ++i)
            own[i] = in[i][lane];
        rotate_to_normal(n[0], n[1], n[2], own, own_turned);
        for (int i = 0; i < 25; ++i) {
            a += in[i][lane] * before[i];
            b += out[i][lane] * after[i];
            d += own_turned[i] * after[i];
        }
        EXPECT_NEAR(a, b, 1e-5) << lane;
        EXPECT_NEAR(a, d, 1e-10) << lane;
    }
}

} // namespace
} // namespace nusselt::tools
