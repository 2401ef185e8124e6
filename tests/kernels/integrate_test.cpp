// Weights and integration against sums in double.
#include "tests/kernels/fixture.h"

#include <cmath>
#include <cstring>

namespace nusselt::test {

using namespace kernels;

namespace {

const Kernels& scalar() {
    return *kernels_for(Set::scalar);
}

// One mask a lane, all the same; the answer of lane 0.
std::array<float, 25> integrated(const MaskLayout& layout, const std::vector<uint8_t>& mask, bool per_block) {
    auto masks = aligned_array<uint8_t>(size_t(lanes) * mask_bytes(layout));
    std::copy(mask.begin(), mask.end(), masks.get());
    alignas(64) float local[25][lanes];
    Counters counters{};
    scalar().integrate(tables_of(layout), masks.get(), 1, per_block, 5, local, counters);
    std::array<float, 25> out;
    for (uint32_t i = 0; i < 25; ++i)
        out[i] = local[i][0];
    return out;
}

std::vector<uint8_t> random_mask(Random& random, const MaskLayout& layout) {
    std::vector<uint8_t> mask(mask_bytes(layout));
    const bool blocky = random.one_in(2);
    for (size_t i = 0; i < mask.size(); i += 2) {
        const uint32_t bits =
            blocky && random.one_in(2) ? (random.one_in(2) ? 0xFFFF : 0) : uint32_t(random.engine());
        mask[i] = uint8_t(bits);
        mask[i + 1] = uint8_t(bits >> 8);
    }
    return mask;
}

// Clamped cosine over pi in the tangent frame, from the closed form of its zonal coefficients.
constexpr double pi = 3.14159265358979323846;
double open_term(uint32_t term) {
    switch (term) {
    case 0:
        return 0.886226925 / pi;
    case 2:
        return 1.023326708 / pi;
    case 6:
        return 0.495415912 / pi;
    case 20:
        return -0.110778366 / pi;
    default:
        return 0;
    }
}

TEST(Integrate, EmptyMaskIsTheOpenHemisphere) {
    for (const NamedLayout& l : layouts) {
        // The disk grid lacks the cells that are only partly inside the disk.
        const double budget = l.layout.samples == SampleMap::scattered ? 2e-4 : 6e-3;
        for (const bool per_block : {false, true}) {
            const auto v = integrated(l.layout, std::vector<uint8_t>(mask_bytes(l.layout)), per_block);
            for (uint32_t i = 0; i < 25; ++i)
                EXPECT_NEAR(v[i], open_term(i), budget) << l.name << " " << i << " " << per_block;
        }
    }
}

TEST(Integrate, FullMaskIsExactlyZero) {
    for (const NamedLayout& l : layouts) {
        const auto v = integrated(l.layout, std::vector<uint8_t>(mask_bytes(l.layout), 0xFF), false);
        for (uint32_t i = 0; i < 25; ++i)
            EXPECT_EQ(v[i], 0.0f) << l.name << " " << i;
    }
}

// By blocks, a float sum: every used bit blocked leaves rounding alone.
TEST(Integrate, UsedBitsBlockedLeaveNothingByBlocks) {
    for (const NamedLayout& l : layouts) {
        std::vector<uint8_t> mask(mask_bytes(l.layout));
        double d[3];
        for (uint32_t bit = 0; bit < mask_bits(l.layout); ++bit) {
            if (sample_direction(l.layout, bit, d)) mask[bit / 8] = uint8_t(mask[bit / 8] | 1u << (bit % 8));
        }
        const auto v = integrated(l.layout, mask, true);
        for (uint32_t i = 0; i < 25; ++i)
            EXPECT_NEAR(v[i], 0, 1e-6) << l.name << " " << i;
    }
}

// The integrals of the basis times cosine over pi over what each bit stands for, by 16 x 16 samples a cell in
// double: what the weights are meant to be. The map is written from Shirley and Chiu's paper.
std::vector<std::array<double, 25>> bit_integrals(const MaskLayout& layout) {
    const uint32_t side = layout.side;
    const bool scattered = layout.samples == SampleMap::scattered;
    const double area = (scattered ? 1.0 : 4 / pi) / (side * side) / 256;
    std::vector<std::array<double, 25>> sums(mask_bits(layout));
    const auto bit_at = [&](uint32_t x, uint32_t y) { return bit_of_cell(layout, x, y); };
    double centre[3];
    for (uint32_t i = 0; i < 256 * side * side; ++i) {
        const uint32_t px = i % (16 * side), py = i / (16 * side), cx = px / 16, cy = py / 16;
        if (!sample_direction(layout, bit_at(cx, cy), centre)) continue;
        const double u = (px + 0.5) / (8 * side) - 1, v = (py + 0.5) / (8 * side) - 1;
        double x = u, y = v;
        if (scattered) {
            const bool wide = std::fabs(u) >= std::fabs(v);
            const double r = wide ? u : v, a = pi / 4 * (wide ? v / u : u / v);
            x = wide ? r * std::cos(a) : r * std::sin(a);
            y = wide ? r * std::sin(a) : r * std::cos(a);
        }
        if (x * x + y * y >= 1) continue;
        const double z = std::sqrt(1 - x * x - y * y);
        uint32_t bit = bit_at(cx, cy);
        double least = 8;
        for (uint32_t k = 0; scattered && k < 49; ++k) {
            const uint32_t ox = cx + k % 7 - 3, oy = cy + k / 7 - 3; // wraps below zero
            double d[3];
            if (ox >= side || oy >= side || !sample_direction(layout, bit_at(ox, oy), d)) continue;
            const double square = (d[0] - x) * (d[0] - x) + (d[1] - y) * (d[1] - y) + (d[2] - z) * (d[2] - z);
            if (square < least) least = square, bit = bit_at(ox, oy);
        }
        const float s[3] = {float(x), float(y), float(z)};
        float basis[25];
        scalar().evaluate_sh(s, s + 1, s + 2, 1, basis);
        for (uint32_t term = 0; term < 25; ++term)
            sums[bit][term] += double(basis[term]) * area;
    }
    return sums;
}

// Sums in 16-bit integers against sums in double: a half-space's edge crosses few rows of four bits, noise
// all of them, and each of those is off by up to half a step.
TEST(Integrate, IntegersAgreeWithASumInDouble) {
    for (const NamedLayout& l : layouts) {
        const Tables& t = tables_of(l.layout);
        const std::vector<std::array<double, 25>> weights = bit_integrals(l.layout);
        double worst[2] = {};
        for (uint64_t seed = 0; seed < 60; ++seed) {
            Random random(seed);
            const bool noise = seed % 2;
            std::vector<uint8_t> mask = random_mask(random, l.layout);
            if (!noise) {
                mask = mask_of_cell(l.layout, random.below(table_cells(l.layout)));
            }
            const auto v = integrated(l.layout, mask, false);
            for (uint32_t term = 0; term < 25; ++term) {
                double sum = 0;
                for (uint32_t bit = 0; bit < mask_bits(l.layout); ++bit) {
                    if (!(mask[bit / 8] >> (bit % 8) & 1)) sum += weights[bit][term];
                }
                worst[noise] = std::max(worst[noise], std::fabs(v[term] - sum) / double(t.scale[term]));
            }
        }
        // Steps of 1 / 32000 of the term's largest sum.
        const double rows = mask_bits(l.layout) / 4.0;
        EXPECT_LE(worst[0], 1.5 * std::sqrt(rows)) << l.name;
        EXPECT_LE(worst[1], 0.25 * rows) << l.name;
    }
}

// The weights against a fine quadrature of their own: an eighth of the hemisphere, cut by coordinate planes.
// A quarter of the bits stands for it, but for what scattered samples hold of their neighbours' side.
TEST(Integrate, QuadrantsAreTheIntegralsOverThem) {
    for (const NamedLayout& l : layouts) {
        if (l.layout.samples != SampleMap::scattered) continue;
        for (uint32_t quadrant = 0; quadrant < 4; ++quadrant) {
            const double sx = quadrant & 1 ? -1 : 1, sy = quadrant & 2 ? -1 : 1;
            std::vector<uint8_t> mask(mask_bytes(l.layout), 0xFF); // all blocked but the quadrant
            double d[3];
            for (uint32_t bit = 0; bit < mask_bits(l.layout); ++bit) {
                sample_direction(l.layout, bit, d);
                if (d[0] * sx > 0 && d[1] * sy > 0)
                    mask[bit / 8] = uint8_t(mask[bit / 8] & ~(1u << (bit % 8)));
            }
            double expected[25] = {};
            constexpr int n = 200; // r^2 and the azimuth: equal areas of the disk
            for (int i = 0; i < n; ++i) {
                for (int j = 0; j < n; ++j) {
                    const double r = std::sqrt((i + 0.5) / n), a = (j + 0.5) / n * pi / 2;
                    const float s[3] = {float(sx * r * std::cos(a)), float(sy * r * std::sin(a)),
                                        float(std::sqrt(1 - r * r))};
                    float basis[25];
                    scalar().evaluate_sh(s, s + 1, s + 2, 1, basis);
                    for (uint32_t term = 0; term < 25; ++term)
                        expected[term] += double(basis[term]) / (4.0 * n * n);
                }
            }
            const auto v = integrated(l.layout, mask, false);
            for (uint32_t term = 0; term < 25; ++term)
                EXPECT_NEAR(v[term], expected[term], 3.0 / (l.layout.side * l.layout.side))
                    << l.name << " " << quadrant << " " << term;
        }
    }
}

// More blocked, less light: the first term falls with every bit, but for rounding between a row of four and
// its part: 2.44 steps at most.
TEST(Integrate, EveryUsedBitWeighs) {
    for (const NamedLayout& l : layouts) {
        std::vector<uint8_t> mask(mask_bytes(l.layout));
        const float open = integrated(l.layout, mask, false)[0];
        const float step = tables_of(l.layout).scale[0];
        const std::vector<std::array<double, 25>> integrals = bit_integrals(l.layout);
        Random random(3);
        std::vector<uint32_t> order;
        double d[3];
        for (uint32_t bit = 0; bit < mask_bits(l.layout); ++bit) {
            if (sample_direction(l.layout, bit, d)) order.push_back(bit);
        }
        for (size_t i = order.size() - 1; i > 0; --i)
            std::swap(order[i], order[random.below(uint32_t(i + 1))]);
        float before = open;
        for (const uint32_t bit : order) {
            mask[bit / 8] = uint8_t(mask[bit / 8] | 1u << (bit % 8));
            const float now = integrated(l.layout, mask, false)[0];
            const double weight = integrals[bit][0];
            ASSERT_NEAR(before - now, weight, 2.6 * double(step)) << l.name << " bit " << bit;
            before = now;
        }
        EXPECT_NEAR(before, 0, double(step) * 30) << l.name;
    }
}

TEST(Integrate, DownsampledCountsSumToTheMasksBits) {
    for (const NamedLayout& l : layouts) {
        for (uint64_t seed = 0; seed < 100; ++seed) {
            Random random(seed);
            const std::vector<uint8_t> mask = random_mask(random, l.layout);
            auto aligned = aligned_array<uint8_t>(mask.size());
            std::copy(mask.begin(), mask.end(), aligned.get());
            uint8_t counts[256];
            scalar().downsample(aligned.get(), mask_blocks(l.layout), counts);
            uint32_t sum = 0, bits = 0;
            for (uint32_t block = 0; block < mask_blocks(l.layout); ++block) {
                EXPECT_LE(counts[block], 16);
                sum += counts[block];
            }
            for (const uint8_t byte : mask)
                bits += uint32_t(__builtin_popcount(byte));
            EXPECT_EQ(sum, bits) << "seed " << seed;
        }
    }
}

TEST(Integrate, UniformAndPartialBlocksAreAllBlocks) {
    for (const NamedLayout& l : layouts) {
        Random random(11);
        auto masks = aligned_array<uint8_t>(size_t(lanes) * mask_bytes(l.layout));
        for (uint32_t lane = 0; lane < lanes; ++lane) {
            const auto mask = random_mask(random, l.layout);
            std::copy(mask.begin(), mask.end(), masks.get() + size_t(lane) * mask_bytes(l.layout));
        }
        alignas(64) float local[25][lanes];
        Counters counters{};
        scalar().integrate(tables_of(l.layout), masks.get(), 0x0F0F, false, 5, local, counters);
        EXPECT_EQ(counters.blocks_uniform + counters.blocks_partial, 8u * mask_blocks(l.layout));
        EXPECT_GT(counters.blocks_uniform, 0u);
        EXPECT_GT(counters.blocks_partial, 0u);
        for (uint32_t lane = 4; lane < 8; ++lane) {
            for (uint32_t term = 0; term < 25; ++term)
                EXPECT_EQ(local[term][lane], 0.0f); // lanes that aren't valid
        }
    }
}

} // namespace

} // namespace nusselt::test
