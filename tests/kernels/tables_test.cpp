// Sample directions and plane tables against an oracle in double.
#include "tests/kernels/fixture.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

namespace nusselt::test {

using namespace kernels;

namespace {

bool mask_bit(const uint8_t* mask, uint32_t bit) {
    return mask[bit / 8] >> (bit % 8) & 1;
}

uint32_t used_bits(const MaskLayout& layout) {
    uint32_t used = 0;
    double d[3];
    for (uint32_t bit = 0; bit < mask_bits(layout); ++bit)
        used += sample_direction(layout, bit, d);
    return used;
}

// The mask of the half-space inside.d >= 0 by the table, its cell found from the description in layout.h.
std::vector<uint8_t> half_space(const MaskLayout& layout, const float inside[3]) {
    const uint32_t k = layout.plane_cells;
    const auto cell = [&](double value) {
        return uint32_t(std::clamp(std::floor((value + 1) * k / 2), 0.0, double(k - 1)));
    };
    const double x = inside[0], y = inside[1], z = inside[2];
    if (layout.planes == PlaneMap::octahedral) {
        const double sum = std::fabs(x) + std::fabs(y) + std::fabs(z);
        const double turn = z < 0 ? -1 : 1;
        const auto node = [&](double value) { return uint32_t((value + 1) / 2 * (k - 1) + 0.5); };
        std::vector<uint8_t> mask =
            mask_of_cell(layout, node(turn * (x - y) / sum) * k + node(turn * (x + y) / sum));
        for (uint8_t& byte : mask)
            byte ^= z < 0 ? 0xFF : 0;
        return mask;
    }
    const double ax = std::fabs(x), ay = std::fabs(y), az = std::fabs(z);
    const uint32_t axis = ax >= ay && ax >= az ? 0 : ay >= az ? 1 : 2;
    const double major = axis == 0 ? x : axis == 1 ? y : z;
    const double u = (axis == 0 ? y : x) / std::fabs(major), v = (axis == 2 ? y : z) / std::fabs(major);
    return mask_of_cell(layout, ((axis * 2 + (major < 0)) * k + cell(v)) * k + cell(u));
}

TEST(Directions, UnitUpAndUsedAsTheMapSays) {
    for (const NamedLayout& l : layouts) {
        for (uint32_t bit = 0; bit < mask_bits(l.layout); ++bit) {
            double d[3];
            if (!sample_direction(l.layout, bit, d)) continue;
            EXPECT_NEAR(d[0] * d[0] + d[1] * d[1] + d[2] * d[2], 1, 1e-15);
            EXPECT_GT(d[2], 0);
        }
    }
    EXPECT_EQ(used_bits(standard_layout), 1024u);
    EXPECT_EQ(used_bits(fine_layout), 4096u);
    // Cells whose centre lies in the disk: pi / 4 of the square.
    EXPECT_NEAR(used_bits(paper_layout) / 1024.0, 0.785398, 0.01);
}

// Where in its cell a row or column of scattered samples lies.
double shift(uint32_t line) {
    return std::fmod((line + 0.5) * (std::sqrt(5.0) - 1) / 2, 1);
}

// Against Shirley and Chiu's formula, written with the library's sine and cosine.
TEST(Directions, AreTheMapsOwn) {
    for (const NamedLayout& l : layouts) {
        const uint32_t side = l.layout.side;
        const bool scattered = l.layout.samples == SampleMap::scattered;
        for (uint32_t cy = 0; cy < side; ++cy) {
            for (uint32_t cx = 0; cx < side; ++cx) {
                // Turned back into the part whose samples are as they are: y > 0, and of 4096 bits x > 0.
                uint32_t x = cx, y = cy, turns = 0;
                while (scattered && (2 * y < side || (side == 64 && 2 * x < side))) {
                    for (uint32_t turn = side == 64 ? 1 : 2; turn; --turn, ++turns) {
                        const uint32_t from = x;
                        x = y;
                        y = side - 1 - from;
                    }
                }
                const double low = scattered && 2 * y == side ? 0.3 : 0; // in the cell
                const double high = scattered && y + 1 == side ? 0.8 : 1;
                const double least = scattered && side == 64 ? side / 2 + 0.3 : 0.2;
                const double column = std::clamp(x + (scattered ? shift(y) : 0.5), least, side - 0.2),
                             row = y + std::clamp(scattered ? shift(x) : 0.5, low, high);
                const double u = 2 * column / side - 1, v = 2 * row / side - 1;
                double px = u, py = v, d[3];
                if (scattered) {
                    const double r = std::max(std::fabs(u), std::fabs(v));
                    const double angle = std::fabs(u) >= std::fabs(v)
                                             ? M_PI / 4 * (v / u) + (u < 0 ? M_PI : 0)
                                             : M_PI / 2 - M_PI / 4 * (u / v) + (v < 0 ? M_PI : 0);
                    px = r * std::cos(angle);
                    py = r * std::sin(angle);
                }
                for (; turns; --turns) {
                    const double from = px;
                    px = -py;
                    py = from;
                }
                const bool used = sample_direction(l.layout, bit_of_cell(l.layout, cx, cy), d);
                EXPECT_EQ(used, px * px + py * py < 1);
                if (!used) continue;
                EXPECT_NEAR(d[0], px, 1e-15);
                EXPECT_NEAR(d[1], py, 1e-15);
                EXPECT_NEAR(d[2], std::sqrt(1 - px * px - py * py), 1e-13);
            }
        }
    }
}

// What lets kernels leave out half of a mask.
TEST(Directions, LieInTheirHalfOfTheMask) {
    for (const NamedLayout& l : layouts) {
        for (uint32_t bit = 0; bit < mask_bits(l.layout); ++bit) {
            double d[3];
            if (!sample_direction(l.layout, bit, d)) continue;
            EXPECT_EQ(d[1] > 0, bit >= mask_bits(l.layout) / 2) << l.name << " " << bit;
            EXPECT_NE(d[1], 0);
        }
    }
}

TEST(Directions, OfTheGridHaveTheSquaresEightSymmetriesBitForBit) {
    for (const NamedLayout& l : layouts) {
        if (l.layout.samples != SampleMap::disk_grid) continue;
        const uint32_t side = l.layout.side;
        for (uint32_t y = 0; y < side; ++y) {
            for (uint32_t x = 0; x < side; ++x) {
                double d[3];
                const bool used = sample_direction(l.layout, bit_of_cell(l.layout, x, y), d);
                for (uint32_t symmetry = 1; symmetry < 8; ++symmetry) {
                    uint32_t sx = x, sy = y;
                    double expected[3] = {d[0], d[1], d[2]}, other[3];
                    if (symmetry & 1) {
                        sx = side - 1 - sx;
                        expected[0] = -expected[0];
                    }
                    if (symmetry & 2) {
                        sy = side - 1 - sy;
                        expected[1] = -expected[1];
                    }
                    if (symmetry & 4) {
                        std::swap(sx, sy);
                        std::swap(expected[0], expected[1]);
                    }
                    ASSERT_EQ(used, sample_direction(l.layout, bit_of_cell(l.layout, sx, sy), other));
                    if (used) {
                        ASSERT_TRUE(same_bits(expected, other, sizeof(other)))
                            << l.name << " " << x << " " << y << " " << symmetry;
                    }
                }
            }
        }
    }
}

TEST(Directions, NoneBelowTheHorizonThatCullsThem) {
    for (const NamedLayout& l : layouts) {
        const float tangent = horizon_tangent(l.layout);
        EXPECT_GE(tangent, 0);
        // The lowest sample less the error of the table, half a cell: a plane below this hides nothing.
        double lowest = 10;
        for (uint32_t bit = 0; bit < mask_bits(l.layout); ++bit) {
            double d[3];
            if (sample_direction(l.layout, bit, d))
                lowest = std::min(lowest, d[2] / std::sqrt(1 - d[2] * d[2]));
        }
        EXPECT_LT(tangent, lowest) << l.name;
    }
}

// Every bit of every cell, from an oracle that shares nothing with the table but the sample directions. Bits
// within rounding of the plane may go either way.
TEST(PlaneTable, EveryCellIsTheHalfSpaceOfItsCentre) {
    for (const NamedLayout& l : layouts) {
        const uint32_t k = l.layout.plane_cells;
        std::vector<std::array<double, 3>> directions(mask_bits(l.layout));
        std::vector<uint8_t> used(mask_bits(l.layout));
        for (uint32_t bit = 0; bit < mask_bits(l.layout); ++bit)
            used[bit] = sample_direction(l.layout, bit, directions[bit].data());
        uint64_t wrong = 0, ties = 0;
        for (uint32_t cell = 0; cell < table_cells(l.layout); ++cell) {
            double u = (cell % k + 0.5) * 2 / k - 1, v = (cell / k % k + 0.5) * 2 / k - 1;
            double n[3];
            if (l.layout.planes == PlaneMap::octahedral) { // u = x + y, v = x - y on |x| + |y| + |z| = 1
                u = 2.0 * (cell % k) / (k - 1) - 1, v = 2.0 * (cell / k % k) / (k - 1) - 1;
                n[0] = (u + v) / 2;
                n[1] = (u - v) / 2;
                n[2] = 1 - std::fabs(n[0]) - std::fabs(n[1]);
                ASSERT_GE(n[2], -1e-15);
            } else {
                const uint32_t face = cell / (k * k), axis = face / 2;
                n[axis] = face % 2 ? -1 : 1;
                n[axis == 0 ? 1 : 0] = u;
                n[axis == 2 ? 1 : 2] = v;
            }
            const std::vector<uint8_t> mask = mask_of_cell(l.layout, cell);
            for (uint32_t bit = 0; bit < mask_bits(l.layout); ++bit) {
                const auto& d = directions[bit];
                const double height = n[0] * d[0] + n[1] * d[1] + n[2] * d[2];
                const bool set = mask_bit(mask.data(), bit);
                if (!used[bit]) {
                    wrong += set;
                } else if (std::fabs(height) < 1e-14) {
                    ++ties;
                } else {
                    wrong += set != (height > 0);
                }
            }
        }
        EXPECT_EQ(wrong, 0u) << l.name;
        EXPECT_LT(ties, table_cells(l.layout) * 2u) << l.name;
    }
}

// The directions of all of a mask's bits, which must all be used.
std::vector<std::array<double, 3>> directions_of(const MaskLayout& layout) {
    std::vector<std::array<double, 3>> all(mask_bits(layout));
    for (uint32_t bit = 0; bit < mask_bits(layout); ++bit)
        EXPECT_TRUE(sample_direction(layout, bit, all[bit].data())) << bit;
    return all;
}

// About the normal, x to y.
std::array<double, 3> turned(std::array<double, 3> d, uint32_t quarters) {
    for (; quarters; --quarters)
        d = {-d[1], d[0], d[2]};
    return d;
}

// Halves by a half turn, quarters by a quarter, in the order that layout.h tells.
TEST(TurnedParts, HaveOneSetOfSamplesBitForBit) {
    for (const NamedLayout& l : layouts) {
        if (!has_turned_parts(l.layout)) continue;
        const std::vector<std::array<double, 3>> d = directions_of(l.layout);
        const uint32_t parts = mask_parts(l.layout), bits = mask_bits(l.layout) / parts;
        const uint32_t first = parts / 2; // the part that is as it is
        const auto is_of = [&](uint32_t part, const std::array<double, 3>& at) {
            return (at[1] > 0) == (part >= parts / 2) &&
                   (parts == 2 || (at[0] > 0) == (part == 1 || part == 2));
        };
        for (uint32_t part = 0; part < parts; ++part) {
            const uint32_t quarters = (part + parts - first) % parts * 4 / parts;
            EXPECT_EQ(quarters_of_part(l.layout, part), quarters) << l.name << " " << part;
            for (uint32_t i = 0; i < bits; ++i) {
                const std::array<double, 3> at = turned(d[first * bits + i], quarters);
                ASSERT_TRUE(is_of(part, at)) << l.name << " " << part << " " << i;
                ASSERT_TRUE(same_bits(at.data(), d[part * bits + i].data(), sizeof(at)))
                    << l.name << " " << part << " " << i;
            }
        }
    }
}

// Every plane of the table, of both signs, in every part: what the part's entry has in the table is the
// half-space of the plane over the part's own samples. Bit for bit, but for samples within rounding of the
// plane, which may go either way: the table has them in the plane as it is turned back.
TEST(TurnedParts, EveryEntryIsItsPlaneOverThePartsSamples) {
    for (const NamedLayout& l : layouts) {
        if (!has_turned_parts(l.layout)) continue;
        const std::vector<std::array<double, 3>> d = directions_of(l.layout);
        const uint8_t* const planes = tables_of(l.layout).planes;
        const uint32_t k = l.layout.plane_cells, parts = mask_parts(l.layout);
        const uint32_t bits = mask_bits(l.layout) / parts;
        uint64_t wrong = 0, ties = 0;
        for (uint32_t cell = 0; cell < table_cells(l.layout); ++cell) {
            const double u = 2.0 * (cell % k) / (k - 1) - 1, v = 2.0 * (cell / k) / (k - 1) - 1;
            const double x = (u + v) / 2, y = (u - v) / 2, z = 1 - std::fabs(x) - std::fabs(y);
            const uint32_t plane = cell << cell_shift(l.layout),
                           opposite = plane ^ entry_complement(l.layout);
            ASSERT_EQ(opposite, plane | 1);
            for (uint32_t part = 0; part < parts; ++part) {
                const uint32_t entry = entry_of_part(l.layout, plane, part);
                // The sign and what is no plane stay as they are.
                ASSERT_EQ(entry & 3, 0u);
                ASSERT_EQ(entry_of_part(l.layout, opposite, part), entry | 1) << l.name << " " << cell;
                ASSERT_EQ(entry_of_part(l.layout, plane | entry_invalid, part), entry | entry_invalid);
                ASSERT_EQ(entry_of_part(l.layout, opposite | entry_invalid, part), entry | 1 | entry_invalid);
                ASSERT_EQ(entry % cell_bytes(l.layout), 0u);
                ASSERT_LE(entry, last_cell(l.layout));
                const uint8_t* const mask = planes + entry;
                for (uint32_t i = 0; i < bits; ++i) {
                    const std::array<double, 3>& at = d[part * bits + i];
                    const double height = x * at[0] + y * at[1] + z * at[2];
                    const bool tie = std::fabs(height) < 1e-14;
                    ties += tie;
                    wrong += !tie && mask_bit(mask, i) != (height > 0);
                }
            }
        }
        EXPECT_EQ(wrong, 0u) << l.name;
        EXPECT_LT(ties, table_cells(l.layout) * 2u) << l.name;
    }
}

// Turned four times by a quarter, or twice by a half, an entry is itself; two quarters are a half.
TEST(TurnedParts, TurnsOfEntriesAddUp) {
    for (const NamedLayout& l : layouts) {
        if (!has_turned_parts(l.layout)) continue;
        for (uint32_t cell = 0; cell < table_cells(l.layout); ++cell) {
            for (uint32_t low = 0; low < 4; ++low) {
                const uint32_t entry = cell << cell_shift(l.layout) | low;
                const uint32_t quarter = quarter_turned(l.layout, entry), half = half_turned(l.layout, entry);
                ASSERT_EQ(quarter_turned(l.layout, quarter), half) << l.name << " " << cell;
                ASSERT_EQ(half_turned(l.layout, half), entry) << l.name << " " << cell;
            }
        }
    }
}

TEST(PlaneTable, PartsOfItAreThoseOfTheWhole) {
    for (const NamedLayout& l : layouts) {
        const size_t bytes = cell_bytes(l.layout);
        std::vector<uint8_t> part(100 * bytes);
        build_plane_table(l.layout, 1234, 1300, part.data() - 1234 * bytes);
        EXPECT_TRUE(same_bits(part.data(), tables_of(l.layout).planes + 1234 * bytes, 66 * bytes)) << l.name;
    }
}

// A plane that holds the normal halves the mask: exactly where a half of the samples is the other one turned.
TEST(PlaneTable, VerticalPlanesHalveTheMask) {
    const int budget[] = {9, 0, 0, 0}; // as `layouts`
    for (uint32_t i = 0; i < std::size(layouts); ++i) {
        const MaskLayout& layout = layouts[i].layout;
        const int half = int(used_bits(layout) / 2);
        int worst = 0;
        for (uint32_t step = 0; step < 3600; ++step) {
            const double angle = step * M_PI / 1800;
            const float inside[3] = {float(std::cos(angle)), float(std::sin(angle)), 0};
            const std::vector<uint8_t> mask = half_space(layout, inside);
            int count = 0;
            double d[3];
            for (uint32_t bit = 0; bit < mask_bits(layout); ++bit)
                count += mask_bit(mask.data(), bit) && sample_direction(layout, bit, d);
            worst = std::max(worst, std::abs(count - half));
        }
        std::printf("    upright planes, %s: off by %d bits at most\n", layouts[i].name, worst);
        EXPECT_LE(worst, budget[i]) << layouts[i].name;
    }
}

TEST(PlaneTable, BitsWrongForRandomPlanes) {
    // The largest source of error; mean and most bits that a plane of the table differs by from the exact
    // one.
    const double mean_budget[] = {1.25, 3.2, 1.6, 6.3}; // as `layouts`
    const uint32_t most_budget[] = {9, 15, 11, 25};
    for (uint32_t i = 0; i < std::size(layouts); ++i) {
        const MaskLayout& layout = layouts[i].layout;
        Random random(7);
        uint64_t sum = 0;
        uint32_t most = 0;
        constexpr uint32_t planes = 1500;
        for (uint32_t p = 0; p < planes; ++p) {
            float n[3];
            random.direction(n);
            const std::vector<uint8_t> mask = half_space(layout, n);
            uint32_t wrong = 0;
            double d[3];
            for (uint32_t bit = 0; bit < mask_bits(layout); ++bit) {
                if (!sample_direction(layout, bit, d)) continue;
                wrong += mask_bit(mask.data(), bit) != (n[0] * d[0] + n[1] * d[1] + n[2] * d[2] >= 0);
            }
            sum += wrong;
            most = std::max(most, wrong);
        }
        std::printf("    random planes, %s: %.2f bits in the mean, %u at most\n", layouts[i].name,
                    double(sum) / planes, most);
        EXPECT_LE(double(sum) / planes, mean_budget[i]) << layouts[i].name;
        EXPECT_LE(most, most_budget[i]) << layouts[i].name;
    }
}

} // namespace

} // namespace nusselt::test
