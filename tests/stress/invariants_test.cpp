// Properties that hold bit for bit whatever the table's error, on random triangles and receivers: M1 to M4,
// M7 to M10, M13 to M15 of the catalogue, for the masks of each quality. Each says the level that it
// compares; the seed is printed where it fails.
#include "tests/stress/ledger.h"
#include "tests/stress/raster.h"

#include <algorithm>
#include <cmath>

namespace nusselt::test {

namespace {

using namespace kernels;

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
void expect_order_is_nothing(const MaskLayout& layout) {
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
    EXPECT_GT(bits, stress_cases() * mask_bits(layout)); // no empty experiment
}

TEST(Invariants, M1OrderChunksAndFirstCorner) {
    for (const NamedLayout& named : layouts) {
        SCOPED_TRACE(named.name);
        expect_order_is_nothing(named.layout);
    }
}

// M2. Level: table. Blocking from both sides, winding is nothing; blocking by front faces, the two windings
// share the work between them.
void expect_winding_is_nothing(const MaskLayout& layout) {
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

TEST(Invariants, M2Winding) {
    for (const NamedLayout& named : layouts) {
        SCOPED_TRACE(named.name);
        expect_winding_is_nothing(named.layout);
    }
}

// The symmetries of the tangent frame: mirrors, and turns about the normal by a half and by a quarter (x to
// y).
enum class Symmetry { mirror_x, mirror_y, half_turn, quarter_turn };

void apply(Symmetry symmetry, std::array<float, 3>& p) {
    switch (symmetry) {
    case Symmetry::mirror_x:
        p[0] = -p[0];
        break;
    case Symmetry::mirror_y:
        p[1] = -p[1];
        break;
    case Symmetry::half_turn:
        p = {-p[0], -p[1], p[2]};
        break;
    case Symmetry::quarter_turn:
        p = {-p[1], p[0], p[2]};
        break;
    }
}

uint32_t image_of(const MaskLayout& layout, Symmetry symmetry, uint32_t x, uint32_t y) {
    const uint32_t last = layout.side - 1;
    switch (symmetry) {
    case Symmetry::mirror_x:
        return bit_of_cell(layout, last - x, y);
    case Symmetry::mirror_y:
        return bit_of_cell(layout, x, last - y);
    case Symmetry::half_turn:
        return bit_of_cell(layout, last - x, last - y);
    case Symmetry::quarter_turn:
        break;
    }
    return bit_of_cell(layout, last - y, x);
}

// Whether rounding decides which cell of an octahedral table one of a triangle's planes takes: it lies on the
// border of two, to a five-thousandth of a cell. Then its image may take another cell than the cell's image.
// The plane as the library has it, in float, from a receiver whose tangent frame are the axes: that of a
// sliver may be far from the true one, and is as symmetric.
bool is_between_cells(const MaskLayout& layout, const Batch& batch, uint32_t lane, const Corners& corners) {
    std::array<std::array<float, 3>, 3> local;
    for (size_t k = 0; k < 3; ++k) {
        for (size_t axis = 0; axis < 3; ++axis)
            local[k][axis] = corners[k][axis] - batch.position[axis][lane];
    }
    for (size_t k = 0; k < 3; ++k) {
        const auto &a = local[k], &b = local[(k + 1) % 3];
        const float n[3] = {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
        const double x = double(n[0]), y = double(n[1]);
        const double scale = (layout.plane_cells - 1) / (2 * (std::fabs(x) + std::fabs(y) + std::fabs(n[2])));
        for (const double place : {(x + y) * scale, (x - y) * scale}) {
            // Cells' middles lie on whole numbers and a half.
            if (std::fabs(place - std::round(place)) < 2e-4) return true;
        }
    }
    return false;
}

struct Images {
    uint64_t masks = 0, bits = 0, between = 0, differing = 0, differing_between = 0;
};

// Masks of random triangles, and of the same ones mirrored or turned. `between`: of those with a plane
// between two cells.
Images images(const MaskLayout& layout, Symmetry symmetry) {
    Images sum;
    std::vector<std::pair<uint32_t, uint32_t>> pairs; // a bit, and its image
    for (uint32_t y = 0; y < layout.side; ++y) {
        for (uint32_t x = 0; x < layout.side; ++x)
            pairs.emplace_back(bit_of_cell(layout, x, y), image_of(layout, symmetry, x, y));
    }
    for (uint64_t i = 0; i < stress_cases(); ++i) {
        Case c(i + (2u << 20), 6);
        std::vector<std::array<float, 3>> up(16, {0, 0, 1}), at(16, {0, 0, 0});
        for (uint32_t lane = 0; lane < lanes; ++lane) {
            for (uint32_t k = 0; k < 3; ++k)
                at[lane][k] = c.in.batch.position[k][lane];
        }
        c.in.batch = batch_of(at, up);
        c.drop_edge_on();
        const Masks original = rasterize(widest(), layout, c.in.batch, c.soup);
        Soup soup = c.soup;
        for (auto& p : soup.points)
            apply(symmetry, p);
        if (symmetry == Symmetry::mirror_x || symmetry == Symmetry::mirror_y) {
            for (auto& t : soup.triangles)
                std::swap(t[1], t[2]);
        }
        std::vector<std::array<float, 3>> moved = at;
        for (auto& p : moved)
            apply(symmetry, p);
        Batch batch = batch_of(moved, up);
        batch.valid = c.in.batch.valid;
        const Masks got = rasterize(widest(), layout, batch, soup);
        for (uint32_t lane = 0; lane < lanes; ++lane) {
            if (!(batch.valid >> lane & 1)) continue;
            const uint8_t* const mask = original.data() + lane * mask_bytes(layout);
            const uint8_t* const image = got.data() + lane * mask_bytes(layout);
            bool between = false;
            for (size_t t = 0; t < c.soup.triangles.size(); ++t)
                between = between || is_between_cells(layout, c.in.batch, lane, corners_of(c.soup, t));
            uint32_t differing = 0;
            for (const auto& [bit, of_image] : pairs)
                differing += get(mask, bit) != get(image, of_image);
            ++sum.masks;
            sum.between += between;
            sum.bits += count_bits(mask, mask_bytes(layout));
            (between ? sum.differing_between : sum.differing) += differing;
        }
    }
    return sum;
}

// M3, M4. Level: table, of samples that have the symmetry themselves: all of them on a grid of the disk,
// of scattered ones a half turn, and of 4096 bits a quarter. Bit for bit, but for masks with a plane between
// two cells, which are counted.
TEST(Invariants, M3M4Symmetries) {
    constexpr MaskLayout grid{SampleMap::disk_grid, PlaneMap::octahedral, 32, 128};
    struct Own {
        const char* name;
        MaskLayout layout;
        Symmetry symmetry;
    };
    const Own all[] = {{"M4 mirrored in x, disk grid", grid, Symmetry::mirror_x},
                       {"M4 mirrored in y, disk grid", grid, Symmetry::mirror_y},
                       {"M3 turned by a half, disk grid", grid, Symmetry::half_turn},
                       {"M3 turned by a half, standard", standard_layout, Symmetry::half_turn},
                       {"M3 turned by a half, fine", fine_layout, Symmetry::half_turn},
                       {"M3 turned by a quarter, fine", fine_layout, Symmetry::quarter_turn}};
    for (const Own& own : all) {
        const Images sum = images(own.layout, own.symmetry);
        ASSERT_GT(sum.bits, sum.masks) << own.name;
        ASSERT_LT(double(sum.between), 0.03 * double(sum.masks)) << own.name;
        EXPECT_EQ(sum.differing, 0u) << own.name;
        EXPECT_LE(double(sum.differing_between), 0.05 * double(sum.between)) << own.name;
        figure(std::string(own.name) + ": bits that differ, of masks without a plane between two cells",
               double(sum.differing), "bits");
        figure(std::string(own.name) + ": masks with such a plane",
               100 * double(sum.between) / double(sum.masks), "%");
        figure(std::string(own.name) + ": bits that differ per mask with one",
               double(sum.differing_between) / double(std::max<uint64_t>(sum.between, 1)), "bits");
    }
    // Halves don't have a quarter turn: in one that a triangle cannot reach it is not drawn, although its
    // planes' error could reach over.
    const Images quarter = images(grid, Symmetry::quarter_turn);
    const double each = double(quarter.differing + quarter.differing_between) / double(quarter.masks);
    figure("M3 turned by a quarter, disk grid in halves: bits that differ per mask", each, "bits");
    EXPECT_LT(each, 0.05);
}

// M7, M8, M9. Level: table.
void expect_unions(const MaskLayout& layout) {
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

TEST(Invariants, M7M8M9UnionsDuplicatesAndNothing) {
    for (const NamedLayout& named : layouts) {
        SCOPED_TRACE(named.name);
        expect_unions(named.layout);
    }
}

// M10. Level: exact.
void expect_nothing_from_below(const MaskLayout& layout) {
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

TEST(Invariants, M10NothingAndBelow) {
    for (const NamedLayout& named : layouts) {
        SCOPED_TRACE(named.name);
        expect_nothing_from_below(named.layout);
    }
}

// M13. Level: integers.
TEST(Invariants, M13BitsAreTheBlocksSum) {
    for (const NamedLayout& named : layouts) {
        SCOPED_TRACE(named.name);
        const uint32_t bytes = mask_bytes(named.layout), blocks = mask_blocks(named.layout);
        for (uint64_t i = 0; i < stress_cases(); ++i) {
            Case c(i + (5u << 20), 12);
            const Masks masks = rasterize(widest(), named.layout, c.in.batch, c.soup);
            alignas(64) uint8_t counts[mask_blocks(fine_layout)];
            alignas(64) uint8_t mask[mask_bytes(fine_layout)];
            std::copy_n(masks.data(), bytes, mask);
            widest().downsample(mask, blocks, counts);
            uint32_t sum = 0;
            for (uint32_t block = 0; block < blocks; ++block) {
                ASSERT_LE(counts[block], 16);
                sum += counts[block];
            }
            ASSERT_EQ(sum, count_bits(mask, bytes)) << "seed " << c.seed;
        }
    }
}

// What lies on the two sides of an edge.
enum class Meeting { one_cluster, two_clusters, t_junction };

uint32_t used_samples(const MaskLayout& layout) {
    uint32_t used = 0;
    double ignored[3];
    for (uint32_t bit = 0; bit < mask_bits(layout); ++bit)
        used += sample_direction(layout, bit, ignored);
    return used;
}

// Sixteen receivers at the origin that look up, under two triangles that share an edge over them and reach
// far below the lowest sample: every sample that is `used` belongs to one of the two. How many does neither
// hold? At a T-junction one of the two is split at the middle of the edge.
uint32_t open_samples(const MaskLayout& layout, uint32_t used, const float along[2], float tilt,
                      Meeting meeting) {
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
    return used - count_bits(masks.data(), mask_bytes(layout));
}

// M14, G6. Level: table. A half-space and its opposite leave no sample to neither.
TEST(Invariants, M14NoHoleAlongASharedEdge) {
    for (const NamedLayout& named : layouts) {
        const uint32_t used = used_samples(named.layout);
        for (uint64_t i = 0; i < stress_cases(); ++i) {
            Random random(stress_seed() * 1000003 + i + (6u << 20));
            float along[2];
            do {
                along[0] = random.between(-1, 1);
                along[1] = random.one_in(3) ? 0 : random.between(-1, 1);
            } while (std::fabs(along[0]) < 0.05f);
            const float tilt = random.between(0.001f, 20) * (random.one_in(2) ? 1.0f : -1.0f);
            for (const Meeting meeting : {Meeting::one_cluster, Meeting::two_clusters}) {
                ASSERT_EQ(open_samples(named.layout, used, along, tilt, meeting), 0u)
                    << named.name << ", case " << i;
                // Straight through the zenith: the plane and its opposite have cells of their own.
                ASSERT_EQ(open_samples(named.layout, used, along, 0, meeting), 0u)
                    << named.name << ", case " << i;
            }
        }
    }
}

// M12. Level: table. The three planes of a T-junction are one but for their rounding, which takes one of them
// over the border of a cell now and then.
TEST(Invariants, M12TJunction) {
    for (const NamedLayout& named : layouts) {
        const uint32_t used = used_samples(named.layout);
        uint64_t open = 0;
        for (uint64_t i = 0; i < stress_cases(); ++i) {
            Random random(stress_seed() * 1000003 + i + (8u << 20));
            const float along[2] = {random.between(0.1f, 1), random.between(-1, 1)};
            open += open_samples(named.layout, used, along, random.between(-20, 20), Meeting::t_junction);
        }
        const double each = 1e5 * double(open) / (used * double(stress_cases()));
        figure(std::string("M12 T-junction, ") + named.name + ": samples open per 100,000", each, "bits");
        EXPECT_LE(each, 1.0) << named.name;
    }
}

// M15. Levels: table, and double. Culling of clusters and at the horizon, on and off: no bit that belongs to
// the triangle may go. Bits that the table's rounding has let a low sliver gain may, and are counted.
void expect_culling_loses_nothing(const NamedLayout& named) {
    const MaskLayout& layout = named.layout;
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
    figure(std::string("M15 false bits that culling sheds per 1,000 masks, ") + named.name,
           1e3 * double(shed) / double(masks), "bits");
    EXPECT_LE(double(shed), 1e-3 * double(masks));
}

TEST(Invariants, M15CullingLosesNothing) {
    for (const NamedLayout& named : layouts) {
        SCOPED_TRACE(named.name);
        expect_culling_loses_nothing(named);
    }
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
