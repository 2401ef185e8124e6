// Properties that hold bit for bit whatever the table's error, on random triangles and receivers: M1 to M10,
// M13 to M15 of the catalogue. Each says the level that it compares; the seed is printed where it fails.
#include "tests/stress/ledger.h"
#include "tests/stress/raster.h"

#include <algorithm>
#include <cmath>

namespace nusselt::test {

namespace {

using namespace kernels;

constexpr const MaskLayout& layout = standard_layout;
constexpr uint32_t side = 32;

bool get(const uint8_t* mask, uint32_t bit) {
    return mask[bit / 8] >> bit % 8 & 1;
}

struct Case {
    uint64_t seed;
    Random random;
    BatchInput in;
    Soup soup;

    Case(uint64_t number, uint32_t triangles) : seed(stress_seed() * 1000003 + number), random(seed) {
        random_batch(random, false, 1.0f, in);
        for (auto& axis : in.batch.position) {
            for (float& c : axis)
                c *= 0.2f;
        }
        widest().prepare_batch(in.batch, in.normal);
        soup = random_soup(random, triangles);
    }
    // Receivers so close to a triangle's plane that its side may depend on the order of the corners drop out.
    void drop_edge_on() {
        for (uint32_t lane = 0; lane < lanes; ++lane) {
            for (size_t t = 0; t < soup.triangles.size(); ++t) {
                auto local = local_corners(in.batch, lane, corners_of(soup, t));
                double far = 0;
                for (const auto& c : local)
                    far = std::max(far, std::sqrt(c[0] * c[0] + c[1] * c[1] + c[2] * c[2]));
                // The library measures against the cluster: up to 6 across, here.
                if (side_of(local, 2e-5 / std::min(far, 1.0)) == Side::edge_on)
                    in.batch.valid &= ~(1u << lane);
            }
        }
    }
};

uint64_t bits_of(const Masks& masks) {
    return count_bits(masks.data(), uint32_t(masks.size()));
}

// M1. Level: table. Any order, any chunks, any first corner.
TEST(Invariants, M1OrderChunksAndFirstCorner) {
    uint64_t bits = 0;
    for (uint64_t i = 0; i < stress_cases(); ++i) {
        Case c(i, 12);
        c.drop_edge_on();
        const RasterOptions whole{false, 64};
        const Masks expected = rasterize(widest(), layout, c.in.batch, c.soup, whole);
        Soup shuffled = c.soup;
        for (size_t t = shuffled.triangles.size(); t > 1; --t)
            std::swap(shuffled.triangles[t - 1], shuffled.triangles[c.random.below(uint32_t(t))]);
        ASSERT_EQ(rasterize(widest(), layout, c.in.batch, shuffled, whole), expected) << "seed " << c.seed;
        ASSERT_EQ(rasterize(widest(), layout, c.in.batch, c.soup, {false, 1 + c.random.below(12)}), expected)
            << "seed " << c.seed;
        for (auto& t : shuffled.triangles)
            std::rotate(t.begin(), t.begin() + c.random.below(3), t.end());
        ASSERT_EQ(rasterize(widest(), layout, c.in.batch, shuffled, whole), expected) << "seed " << c.seed;
        bits += bits_of(expected);
    }
    EXPECT_GT(bits, stress_cases() * 16 * 64); // no empty experiment
}

// M2. Level: table. Blocking from both sides, winding is nothing; blocking by front faces, the two windings
// share the work between them.
TEST(Invariants, M2Winding) {
    for (uint64_t i = 0; i < stress_cases(); ++i) {
        Case c(i + (1u << 20), 12);
        c.drop_edge_on();
        Soup turned = c.soup;
        for (auto& t : turned.triangles)
            std::swap(t[1], t[2]);
        const Masks expected = rasterize(widest(), layout, c.in.batch, c.soup);
        ASSERT_EQ(rasterize(widest(), layout, c.in.batch, turned), expected) << "seed " << c.seed;
        Soup front = c.soup, back = turned;
        front.two_sided = back.two_sided = false;
        Masks either = rasterize(widest(), layout, c.in.batch, front);
        const Masks behind = rasterize(widest(), layout, c.in.batch, back);
        for (size_t k = 0; k < either.size(); ++k)
            either[k] = uint8_t(either[k] | behind[k]);
        ASSERT_EQ(either, expected) << "seed " << c.seed;
    }
}

// M3, M4. Level: table, of samples that have all of these symmetries themselves, which scattered ones
// do not. Mirrored and turned by a quarter about the normal. Bits may differ where a plane
// falls on the border of two cells, and in the part of the mask that a triangle cannot reach (it is not drawn
// there, although its planes' error could reach over): those are counted.
TEST(Invariants, M3M4Symmetries) {
    constexpr MaskLayout grid{SampleMap::disk_grid, PlaneMap::octahedral, 32, 128};
    const auto bit_at = [&](uint32_t x, uint32_t y) { return bit_of_cell(grid, x, y); };
    uint64_t lost[3] = {}, bits = 0, masks = 0;
    for (uint64_t i = 0; i < stress_cases(); ++i) {
        Case c(i + (2u << 20), 6);
        std::vector<std::array<float, 3>> up(16, {0, 0, 1}), at(16, {0, 0, 0});
        for (uint32_t lane = 0; lane < lanes; ++lane) {
            for (uint32_t k = 0; k < 3; ++k)
                at[lane][k] = c.in.batch.position[k][lane];
        }
        c.in.batch = batch_of(at, up);
        c.drop_edge_on();
        const uint32_t valid = c.in.batch.valid;
        const Masks original = rasterize(widest(), grid, c.in.batch, c.soup);
        for (int symmetry = 0; symmetry < 3; ++symmetry) {
            const auto apply = [&](std::array<float, 3>& p) {
                if (symmetry == 0) p[0] = -p[0];
                if (symmetry == 1) p[1] = -p[1];
                if (symmetry == 2) p = {-p[1], p[0], p[2]};
            };
            Soup soup = c.soup;
            for (auto& p : soup.points)
                apply(p);
            if (symmetry < 2) {
                for (auto& t : soup.triangles)
                    std::swap(t[1], t[2]);
            }
            std::vector<std::array<float, 3>> moved = at;
            for (auto& p : moved)
                apply(p);
            Batch batch = batch_of(moved, up);
            batch.valid = valid;
            const Masks got = rasterize(widest(), grid, batch, soup);
            for (uint32_t lane = 0; lane < lanes; ++lane) {
                if (!(valid >> lane & 1)) continue;
                const size_t first = lane * mask_bytes(layout);
                for (uint32_t y = 0; y < side; ++y) {
                    for (uint32_t x = 0; x < side; ++x) {
                        const uint32_t image = symmetry == 0   ? bit_at(side - 1 - x, y)
                                               : symmetry == 1 ? bit_at(x, side - 1 - y)
                                                               : bit_at(side - 1 - y, x);
                        lost[symmetry] +=
                            get(original.data() + first, bit_at(x, y)) != get(got.data() + first, image);
                    }
                }
                masks += symmetry == 0;
                bits += symmetry == 0 ? count_bits(original.data() + first, mask_bytes(layout)) : 0;
            }
        }
    }
    ASSERT_GT(bits, 0u);
    figure("M3 mirrored in x: bits that differ per mask", double(lost[0]) / double(masks), "bits");
    figure("M3 mirrored in y: bits that differ per mask", double(lost[1]) / double(masks), "bits");
    figure("M3 turned by a quarter: bits that differ per mask", double(lost[2]) / double(masks), "bits");
    EXPECT_LT(double(lost[0]) / double(masks), 0.05);
    EXPECT_LT(double(lost[1]) / double(masks), 0.05);
    EXPECT_LT(double(lost[2]) / double(masks), 1.0);
}

// M7, M8, M9. Level: table.
TEST(Invariants, M7M8M9UnionsDuplicatesAndNothing) {
    for (uint64_t i = 0; i < stress_cases(); ++i) {
        Case c(i + (3u << 20), 16);
        c.drop_edge_on(); // the margin is the cluster's
        Soup a = c.soup, b = c.soup;
        a.triangles.resize(7);
        b.triangles.erase(b.triangles.begin(), b.triangles.begin() + 7);
        const RasterOptions whole{false, 64};
        const Masks of_a = rasterize(widest(), layout, c.in.batch, a, whole),
                    of_b = rasterize(widest(), layout, c.in.batch, b, whole),
                    both = rasterize(widest(), layout, c.in.batch, c.soup, whole);
        for (size_t k = 0; k < both.size(); ++k)
            ASSERT_EQ(both[k], of_a[k] | of_b[k]) << "seed " << c.seed;
        Soup more = a;
        for (int k = 0; k < 4; ++k)
            more.triangles.push_back(a.triangles[c.random.below(7)]);
        const uint32_t one = a.triangles[0][0], two = a.triangles[1][1];
        more.triangles.push_back({one, one, two});
        more.triangles.push_back({two, two, two});
        more.points.push_back(more.points[one]);
        more.triangles.push_back({one, two, uint32_t(more.points.size() - 1)}); // no area, corners of its own
        ASSERT_EQ(rasterize(widest(), layout, c.in.batch, more, whole), of_a) << "seed " << c.seed;
    }
}

// M10. Level: exact.
TEST(Invariants, M10NothingAndBelow) {
    for (uint64_t i = 0; i < stress_cases(); ++i) {
        Case c(i + (4u << 20), 12);
        EXPECT_EQ(bits_of(rasterize(widest(), layout, c.in.batch, Soup{})), 0u);
        // Pushed below the first receiver's tangent plane.
        double highest = 0;
        const auto height = [&](const std::array<float, 3>& p) { return local_corner(c.in.batch, 0, p)[2]; };
        for (const auto& p : c.soup.points)
            highest = std::max(highest, height(p));
        for (auto& p : c.soup.points) {
            for (uint32_t k = 0; k < 3; ++k)
                p[k] -= float(highest + 1e-4) * c.in.batch.axis[2][k][0];
        }
        const Masks masks = rasterize(widest(), layout, c.in.batch, c.soup);
        ASSERT_EQ(count_bits(masks.data(), mask_bytes(layout)), 0u) << "seed " << c.seed;
    }
}

// M13. Level: integers.
TEST(Invariants, M13BitsAreTheBlocksSum) {
    for (uint64_t i = 0; i < stress_cases(); ++i) {
        Case c(i + (5u << 20), 12);
        const Masks masks = rasterize(widest(), layout, c.in.batch, c.soup);
        alignas(64) uint8_t counts[64];
        alignas(64) uint8_t mask[128];
        std::copy_n(masks.data(), 128, mask);
        widest().downsample(mask, 64, counts);
        uint32_t sum = 0;
        for (const uint8_t count : counts) {
            ASSERT_LE(count, 16);
            sum += count;
        }
        ASSERT_EQ(sum, count_bits(mask, 128)) << "seed " << c.seed;
    }
}

// What lies on the two sides of an edge.
enum class Meeting { one_cluster, two_clusters, t_junction };

// Sixteen receivers at the origin that look up, under two triangles that share an edge over them and reach
// far below the lowest sample: every sample belongs to one of the two. How many does neither hold? At a
// T-junction one of the two is split at the middle of the edge.
uint32_t open_samples(const float along[2], float tilt, Meeting meeting) {
    const float across = std::sqrt(along[0] * along[0] + along[1] * along[1]);
    const float u[2] = {along[0] / across * 50, along[1] / across * 50};
    const float x = -u[1] / 50 * tilt, y = u[0] / 50 * tilt;
    Soup soup;
    soup.points = {{x - u[0], y - u[1], 1},
                   {x + u[0], y + u[1], 1},
                   {x - 60 * u[1], y + 60 * u[0], 1},
                   {x + 60 * u[1], y - 60 * u[0], 1}};
    soup.triangles = {{0, 2, 1}, {0, 1, 3}};
    if (meeting == Meeting::t_junction) {
        soup.points.push_back({});
        for (size_t k = 0; k < 3; ++k)
            soup.points[4][k] = 0.5f * soup.points[0][k] + 0.5f * soup.points[1][k];
        soup.triangles = {{0, 2, 4}, {4, 2, 1}, {0, 1, 3}};
    }
    const Batch batch = batch_of(std::vector<std::array<float, 3>>(16, {0, 0, 0}),
                                 std::vector<std::array<float, 3>>(16, {0, 0, 1}));
    const Masks masks =
        rasterize(widest(), layout, batch, soup, {true, meeting == Meeting::two_clusters ? 1u : 64u});
    return 1024 - count_bits(masks.data(), 128);
}

// M14, G6. Level: table. A half-space and its opposite leave no sample to neither.
TEST(Invariants, M14NoHoleAlongASharedEdge) {
    for (uint64_t i = 0; i < stress_cases(); ++i) {
        Random random(stress_seed() * 1000003 + i + (6u << 20));
        float along[2];
        do {
            along[0] = random.between(-1, 1);
            along[1] = random.one_in(3) ? 0 : random.between(-1, 1);
        } while (std::fabs(along[0]) < 0.05f);
        const float tilt = random.between(0.001f, 20) * (random.one_in(2) ? 1.0f : -1.0f);
        for (const Meeting meeting : {Meeting::one_cluster, Meeting::two_clusters}) {
            ASSERT_EQ(open_samples(along, tilt, meeting), 0u) << "case " << i;
            // Straight through the zenith: the plane and its opposite have cells of their own.
            ASSERT_EQ(open_samples(along, 0, meeting), 0u) << "case " << i;
        }
    }
}

// M12. Level: table. The three planes of a T-junction are one but for their rounding, which takes one of them
// over the border of a cell now and then.
TEST(Invariants, M12TJunction) {
    uint64_t open = 0;
    for (uint64_t i = 0; i < stress_cases(); ++i) {
        Random random(stress_seed() * 1000003 + i + (8u << 20));
        const float along[2] = {random.between(0.1f, 1), random.between(-1, 1)};
        open += open_samples(along, random.between(-20, 20), Meeting::t_junction);
    }
    const double each = 1e5 * double(open) / (1024.0 * double(stress_cases()));
    figure("M12 T-junction: samples open per 100,000", each, "bits");
    EXPECT_LE(each, 1.0);
}

// M15. Levels: table, and double. Culling of clusters and at the horizon, on and off: no bit that belongs to
// the triangle may go. Bits that the table's rounding has let a low sliver gain may, and are counted.
TEST(Invariants, M15CullingLosesNothing) {
    const Samples samples(layout);
    uint64_t shed = 0, masks = 0;
    for (uint64_t i = 0; i < stress_cases(); ++i) {
        Case c(i + (7u << 20), 4);
        c.drop_edge_on();
        for (uint32_t t = 0; t < 4; ++t) {
            Soup one = c.soup;
            one.triangles = {c.soup.triangles[t]};
            const Masks culled = rasterize(widest(), layout, c.in.batch, one),
                        all = rasterize(widest(), layout, c.in.batch, one, {false, 64});
            masks += 16;
            if (culled == all) continue;
            const Masks truth = rasterize_double(samples, layout, c.in.batch, one);
            for (size_t k = 0; k < all.size(); ++k) {
                ASSERT_EQ(culled[k] & ~all[k], 0) << "seed " << c.seed;
                ASSERT_EQ(all[k] & ~culled[k] & truth[k], 0) << "seed " << c.seed;
                const uint8_t gone = uint8_t(all[k] & ~culled[k]);
                shed += count_bits(&gone, 1);
            }
        }
    }
    figure("M15 false bits that culling sheds per 1,000 masks", 1e3 * double(shed) / double(masks), "bits");
    EXPECT_LE(double(shed), 1e-3 * double(masks));
}

// Triangles whose upper edges rise to just below the elevation of tangent `horizon`, of all azimuths: the
// bits that they cover where culling at that elevation would drop them. Their planes take the cell that they
// take, so that among many are those which the table turns upwards the most, right under its lowest samples.
uint64_t bits_dropped_at(const MaskLayout& sampling, float horizon, uint64_t seed, uint64_t soups) {
    const Batch batch = batch_of(std::vector<std::array<float, 3>>(16, {0, 0, 0}),
                                 std::vector<std::array<float, 3>>(16, {0, 0, 1}));
    Random random(seed);
    uint64_t bits = 0;
    for (uint64_t i = 0; i < soups; ++i) {
        Soup soup;
        for (uint32_t t = 0; t < 16; ++t) {
            const float azimuth = random.between(-3.1416f, 3.1416f),
                        rise = horizon * random.between(0.98f, 0.9999f);
            // A point of the great circle that rises the most at `azimuth`.
            const auto on_circle = [&](float turn) {
                const float away = random.between(0.3f, 1);
                return std::array<float, 3>{away * std::cos(azimuth + turn), away * std::sin(azimuth + turn),
                                            away * rise * std::cos(turn)};
            };
            const auto first = uint32_t(soup.points.size());
            soup.points.push_back(on_circle(-random.between(0.3f, 1.2f)));
            soup.points.push_back(on_circle(random.between(0.3f, 1.2f)));
            soup.points.push_back({0.2f * std::cos(azimuth), 0.2f * std::sin(azimuth), -1});
            soup.triangles.push_back({first, first + 1, first + 2});
        }
        const uint32_t per_cluster = 1 + random.below(16);
        const Masks culled = rasterize(widest(), sampling, batch, soup, {true, per_cluster, horizon}),
                    all = rasterize(widest(), sampling, batch, soup, {false, per_cluster});
        for (uint32_t k = 0; k < mask_bytes(sampling); ++k) {
            const uint8_t gone = uint8_t(all[k] & ~culled[k]);
            bits += count_bits(&gone, 1);
        }
    }
    return bits;
}

// M15. Level: table. Culling at the horizon is invisible where the table turns a plane by its worst, too; at
// the lowest sample itself, with nothing allowed for the table, it would not be.
TEST(Invariants, M15CullingAtTheTablesWorstTurn) {
    for (const NamedLayout& named : layouts) {
        const float horizon = horizon_tangent(named.layout);
        double lowest = 1;
        for (uint32_t bit = 0; bit < mask_bits(named.layout); ++bit) {
            double d[3];
            if (sample_direction(named.layout, bit, d))
                lowest = std::min(lowest, d[2] / std::sqrt(1 - d[2] * d[2]));
        }
        const uint64_t seed = stress_seed() * 1000003 + (9u << 20), soups = stress_cases() / 4;
        EXPECT_EQ(bits_dropped_at(named.layout, horizon, seed, stress_cases()), 0u) << named.name;
        EXPECT_GT(bits_dropped_at(named.layout, float(lowest), seed, soups), 0u)
            << named.name << ": culling at the lowest sample must be seen";
        // How much of what is allowed the table takes: a search, so a quarter of the cases at each elevation.
        double least = 0;
        for (double share = 0.95; share > 0 && least == 0; share -= 0.05) {
            const auto at = float(lowest - share * (lowest - double(horizon)));
            if (bits_dropped_at(named.layout, at, seed, soups) > 0) least = share;
        }
        figure(std::string("M15 turn of planes at the horizon, of what culling allows for, ") + named.name,
               100 * least, "%");
    }
}

} // namespace

} // namespace nusselt::test
