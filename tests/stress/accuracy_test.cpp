// The four levels beside one another, and what the table's nearest cell costs: bits, leaks, lost and gained.
#include "tests/stress/ledger.h"
#include "tests/stress/raster.h"

#include <algorithm>
#include <cmath>

namespace nusselt::test {

namespace {

using namespace kernels;

constexpr const MaskLayout& standard = standard_layout;

uint32_t differing(const uint8_t* a, const uint8_t* b, uint32_t bytes) {
    uint32_t count = 0;
    for (uint32_t i = 0; i < bytes; ++i) {
        const uint8_t x = uint8_t(a[i] ^ b[i]);
        count += count_bits(&x, 1);
    }
    return count;
}

// Levels: whole numbers, double, float. Corners on a grid of 2^-10 within 2^10: what stays is rounding alone.
TEST(Oracle, DoubleIsExactAndFloatNearlySo) {
    const Samples samples(standard);
    uint64_t wrong_double = 0, wrong_float = 0, bits = 0;
    Random random(stress_seed());
    for (uint64_t i = 0; i < stress_cases(); ++i) {
        std::array<std::array<int32_t, 3>, 3> whole;
        std::array<std::array<double, 3>, 3> real;
        std::array<std::array<float, 3>, 3> single;
        const int32_t reach = 1 << (4 + random.below(17));
        for (size_t k = 0; k < 3; ++k) {
            for (size_t j = 0; j < 3; ++j) {
                whole[k][j] = int32_t(random.below(uint32_t(2 * reach))) - reach;
                real[k][j] = whole[k][j];
                single[k][j] = float(whole[k][j]);
            }
        }
        uint8_t exact[128] = {}, in_double[128] = {}, in_float[128] = {};
        cover_exactly(samples, whole, exact);
        cover<double>(samples, real, in_double);
        cover<float>(samples, single, in_float);
        bits += count_bits(exact, 128);
        wrong_double += differing(exact, in_double, 128);
        wrong_float += differing(exact, in_float, 128);
    }
    ASSERT_GT(bits, stress_cases());
    figure("oracle: bits that double gets wrong, all cases", double(wrong_double), "bits");
    figure("oracle: bits that float gets wrong per 1,000 triangles",
           1e3 * double(wrong_float) / double(stress_cases()), "bits");
    EXPECT_LE(wrong_double, stress_cases() / 20000 + 1);
    EXPECT_LE(double(wrong_float), 0.01 * double(stress_cases()) + 1);
}

// Level: whole numbers. Ties belong to both sides, so that a plane and its opposite leave nothing out.
TEST(Oracle, M14TiesBelongToBoth) {
    const Samples samples(standard);
    // Two triangles that share the edge from a sample's direction to the zenith.
    for (uint32_t bit = 0; bit < samples.bits; bit += 7) {
        const std::array<int32_t, 3> d{samples.whole[0][bit], samples.whole[1][bit], samples.whole[2][bit]};
        const std::array<int32_t, 3> up{0, 0, 1 << 20}, left{-d[1], d[0], 1 << 10},
            right{d[1], -d[0], 1 << 10};
        uint8_t a[128] = {}, b[128] = {};
        cover_exactly(samples, {d, left, up}, a);
        cover_exactly(samples, {d, up, right}, b);
        EXPECT_TRUE(a[bit / 8] & b[bit / 8] & 1u << bit % 8) << bit;
    }
}

// A normal that is a cell's own, in whole numbers (kernels/layout.h, build_plane_table), of either sign.
std::array<int64_t, 3> normal_of_a_cell(const MaskLayout& layout, Random& random) {
    const auto cells = int64_t(layout.plane_cells);
    const int64_t i = random.below(layout.plane_cells), j = random.below(layout.plane_cells);
    std::array<int64_t, 3> n{};
    if (layout.planes == PlaneMap::octahedral) { // u and v in 1 / (cells - 1)
        const int64_t u = 2 * i - (cells - 1), v = 2 * j - (cells - 1);
        n[0] = u + v;
        n[1] = u - v;
        n[2] = 2 * (cells - 1) - std::abs(n[0]) - std::abs(n[1]);
    } else { // in 1 / cells
        const size_t axis = random.below(3);
        n[axis] = cells;
        n[axis == 0 ? 1 : 0] = 2 * i + 1 - cells;
        n[axis == 2 ? 1 : 2] = 2 * j + 1 - cells;
    }
    if (random.one_in(2)) {
        for (int64_t& c : n)
            c = -c;
    }
    return n;
}

// Levels: table against whole numbers, G6 and G18. Triangles all of whose planes are cells' own are exact in
// every bit, on every instruction set, in clusters and loose: the table's rounding is all that the rasteriser
// has of error. A sample that lies in a plane may belong to either side; where two planes are upright, the
// triangle has its corner at the zenith.
TEST(Oracle, TheTableIsExactForItsOwnPlanes) {
    for (const NamedLayout& named : layouts) {
        const MaskLayout& layout = named.layout;
        const Samples samples(layout);
        const uint32_t bytes = mask_bytes(layout);
        const Batch batch = batch_of({{0, 0, 0}}, {{0, 0, 1}}); // whose tangent frame are the axes
        Random random(stress_seed() + 71);
        uint64_t triangles = 0, bits = 0, ties = 0, at_zenith = 0;
        while (triangles < stress_cases()) {
            std::array<std::array<int64_t, 3>, 3> normal, corner;
            for (auto& n : normal)
                n = normal_of_a_cell(layout, random);
            if (layout.planes == PlaneMap::octahedral && random.one_in(8)) {
                for (size_t k = 0; k < 2; ++k) { // on the rim of the table: upright
                    const int64_t cells = layout.plane_cells,
                                  at = 2 * int64_t(random.below(layout.plane_cells));
                    normal[k] = {2 * (cells - 1) - at, random.one_in(2) ? at : -at, 0};
                }
            }
            double sizes[3], least = 1;
            for (size_t k = 0; k < 3; ++k) {
                const auto &a = normal[k], &b = normal[(k + 1) % 3];
                corner[k] = {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
                const auto size = [](const std::array<int64_t, 3>& v) {
                    return std::sqrt(double(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]));
                };
                sizes[k] = size(corner[k]);
                least = std::min(least, sizes[k] / (size(a) * size(b)));
            }
            const auto &n = normal[2], &c = corner[0];
            const double volume = double(n[0] * c[0] + n[1] * c[1] + n[2] * c[2]);
            // Narrow ones out: their planes are rounded to another cell before they are looked up.
            if (least < 0.02 || std::fabs(volume) < 0.02 * sizes[0] * layout.plane_cells) continue;
            Soup soup;
            soup.triangles = {{0, 1, 2}};
            std::array<std::array<int32_t, 3>, 3> local;
            for (size_t k = 0; k < 3; ++k) {
                soup.points.push_back({});
                for (size_t axis = 0; axis < 3; ++axis) {
                    // The corner's cone, whichever way the planes lie.
                    const int64_t value = volume < 0 ? -corner[k][axis] : corner[k][axis];
                    local[k][axis] = int32_t(value);
                    soup.points[k][axis] = std::ldexp(float(value), -21);
                }
            }
            if (side_of(local_corners(batch, 0, corners_of(soup, 0)), 1e-3) == Side::edge_on) continue;
            std::vector<uint8_t> truth(bytes), in_a_plane(bytes);
            cover_exactly(samples, local, truth.data());
            for (uint32_t bit = 0; bit < samples.bits; ++bit) {
                double d[3];
                if (!sample_direction(layout, bit, d)) continue;
                for (const auto& p : normal) {
                    const double height = double(p[0]) * d[0] + double(p[1]) * d[1] + double(p[2]) * d[2];
                    if (std::fabs(height) < 1e-6 * layout.plane_cells)
                        in_a_plane[bit / 8] = uint8_t(in_a_plane[bit / 8] | 1u << bit % 8);
                }
            }
            for (const Set set : {Set::scalar, Set::sse4, Set::avx2, Set::avx512, Set::neon}) {
                const Kernels* const kernels = kernels_for(set);
                if (!kernels) continue;
                for (const Masks& got : {rasterize(*kernels, layout, batch, soup),
                                         rasterize_free(*kernels, layout, batch, soup)}) {
                    for (uint32_t k = 0; k < bytes; ++k)
                        ASSERT_EQ((got[k] ^ truth[k]) & ~in_a_plane[k], 0)
                            << named.name << ", " << kernels->name << ", triangle " << triangles << ", seed "
                            << stress_seed();
                }
            }
            ++triangles;
            bits += count_bits(truth.data(), bytes);
            ties += count_bits(in_a_plane.data(), bytes);
            for (const auto& at : local)
                at_zenith += at[0] == 0 && at[1] == 0 && at[2] > 0;
        }
        EXPECT_GT(bits, triangles * mask_bits(layout) / 20) << named.name;
        EXPECT_LT(ties, triangles) << named.name;
        EXPECT_TRUE(at_zenith > 0 || layout.planes == PlaneMap::cube) << named.name;
        figure(std::string("oracle: triangles of the table's own planes, exact in every bit, ") + named.name,
               double(triangles), "triangles");
        figure(std::string("oracle: samples in such a plane per 1,000 triangles, ") + named.name,
               1e3 * double(ties) / double(triangles), "samples");
    }
}

struct Wrong {
    uint64_t triangles = 0, bits = 0, gained = 0, lost = 0;
    uint32_t most = 0;
};

// Levels: table against double. One triangle a mask.
Wrong wrong_bits(const MaskLayout& layout, uint64_t cases, float size) {
    const Samples samples(layout);
    Wrong w;
    Random random(stress_seed() + 17);
    const uint32_t bytes = mask_bytes(layout);
    for (uint64_t i = 0; i < (cases + 15) / 16; ++i) {
        std::vector<std::array<float, 3>> at(16), up(16);
        Soup soup;
        soup.points.resize(3);
        soup.triangles = {{0, 1, 2}};
        float centre[3];
        random.direction(centre);
        for (auto& p : soup.points) {
            float d[3];
            random.direction(d);
            for (size_t k = 0; k < 3; ++k)
                p[k] = centre[k] + d[k] * size;
        }
        for (uint32_t lane = 0; lane < 16; ++lane) {
            at[lane] = {random.between(-0.1f, 0.1f), random.between(-0.1f, 0.1f),
                        random.between(-0.1f, 0.1f)};
            random.direction(up[lane].data());
        }
        const Batch batch = batch_of(at, up);
        const Masks got = rasterize(widest(), layout, batch, soup),
                    truth = rasterize_double(samples, layout, batch, soup);
        for (uint32_t lane = 0; lane < 16; ++lane) {
            const uint8_t *g = got.data() + lane * bytes, *t = truth.data() + lane * bytes;
            if (count_bits(t, bytes) + count_bits(g, bytes) == 0) continue;
            const uint32_t wrong = differing(g, t, bytes);
            ++w.triangles;
            w.bits += wrong;
            w.most = std::max(w.most, wrong);
            for (uint32_t b = 0; b < bytes; ++b) {
                const uint8_t more = uint8_t(g[b] & ~t[b]), less = uint8_t(t[b] & ~g[b]);
                w.gained += count_bits(&more, 1);
                w.lost += count_bits(&less, 1);
            }
        }
    }
    return w;
}

TEST(Accuracy, BitsOfATriangle) {
    struct Budget {
        const char* name;
        MaskLayout layout;
        float size;
        double mean;
        uint32_t most;
    };
    // What 160,000 triangles showed, and a little more: the errors are the cells' size (a prototype's, with
    // every triangle overhead, were 6.7 and 25).
    const Budget budgets[] = {{"paper, large triangles", paper_layout, 1.0f, 1.0, 17},
                              {"paper, small triangles", paper_layout, 0.1f, 0.34, 8},
                              {"draft, large triangles", draft_layout, 1.0f, 2.5, 26},
                              {"draft, small triangles", draft_layout, 0.1f, 0.66, 13},
                              {"standard, large triangles", standard, 1.0f, 1.3, 18},
                              {"standard, small triangles", standard, 0.1f, 0.38, 8},
                              {"fine, large triangles", fine_layout, 1.0f, 4.7, 44},
                              {"fine, small triangles", fine_layout, 0.1f, 0.85, 19}};
    for (const Budget& b : budgets) {
        const Wrong w = wrong_bits(b.layout, stress_cases() * 8, b.size);
        const std::string name = b.name;
        ASSERT_GT(w.triangles, stress_cases());
        const double mean = double(w.bits) / double(w.triangles);
        figure("table against double, " + name + ": bits wrong per triangle, mean", mean, "bits");
        figure("table against double, " + name + ": bits wrong per triangle, most", w.most, "bits");
        figure("table against double, " + name + ": gained less lost per triangle",
               (double(w.gained) - double(w.lost)) / double(w.triangles), "bits");
        EXPECT_LT(mean, b.mean) << name;
        EXPECT_LE(w.most, b.most) << name;
    }
}

// The part of a receiver's cosine-weighted hemisphere that a triangle wholly above its horizon holds
// (Lambert).
double form_factor(const std::array<std::array<double, 3>, 3>& local) {
    double sum = 0;
    for (size_t i = 0; i < 3; ++i) {
        const auto &a = local[i], &b = local[(i + 1) % 3];
        const double c[3] = {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
        const double size = std::sqrt(c[0] * c[0] + c[1] * c[1] + c[2] * c[2]);
        if (size > 0) sum += std::atan2(size, a[0] * b[0] + a[1] * b[1] + a[2] * b[2]) * c[2] / size;
    }
    return std::fabs(sum) / (2 * 3.14159265358979323846);
}

// G15. Level: what is known. Triangles far smaller or narrower than a cell of the table hide more than they
// hold, as their three planes move apart: by a share of a sample each, whatever their size, which is nothing
// for a surface, whose triangles overlap there, and much for thousands of loose specks or blades.
TEST(Accuracy, G15WhatSmallTrianglesGain) {
    constexpr uint32_t bytes = 128;
    struct Shape {
        const char* name;
        float length, width;
    };
    const Shape shapes[] = {{"triangles of 0.1", 0.1f, 0.1f},
                            {"specks of 1e-6", 1e-6f, 1e-6f},
                            {"blades of 0.1 by 0.01", 0.1f, 0.01f},
                            {"ribbons of 0.1 by 1e-4", 0.1f, 1e-4f}};
    for (const Shape& shape : shapes) {
        Random random(stress_seed() + 61);
        double bits = 0, held = 0, seen = 0;
        for (uint64_t i = 0; i < stress_cases(); ++i) {
            Soup soup;
            soup.triangles = {{0, 1, 2}};
            float at[3], along[3], across[3];
            random.direction(at);
            random.direction(along);
            random.direction(across);
            soup.points.resize(3);
            const float distance = random.between(0.6f, 1);
            for (size_t k = 0; k < 3; ++k) {
                soup.points[0][k] = at[k] * distance;
                soup.points[1][k] = soup.points[0][k] + shape.length * along[k];
                soup.points[2][k] = soup.points[0][k] + shape.width * across[k];
            }
            std::vector<std::array<float, 3>> from(16), up(16);
            for (uint32_t lane = 0; lane < 16; ++lane) {
                from[lane] = {random.between(-0.1f, 0.1f), random.between(-0.1f, 0.1f),
                              random.between(-0.1f, 0.1f)};
                random.direction(up[lane].data());
            }
            const Batch batch = batch_of(from, up);
            const Masks masks = rasterize(widest(), standard, batch, soup);
            for (uint32_t lane = 0; lane < 16; ++lane) {
                const auto local = local_corners(batch, lane, corners_of(soup, 0));
                const auto high = [](const std::array<double, 3>& c) {
                    return c[2] > 0.3 * std::sqrt(c[0] * c[0] + c[1] * c[1] + c[2] * c[2]);
                };
                if (!std::all_of(local.begin(), local.end(), high)) continue;
                ++seen;
                bits += count_bits(masks.data() + lane * bytes, bytes);
                held += 1024 * form_factor(local);
            }
        }
        ASSERT_GT(bits, 0);
        const std::string name = std::string("G15 ") + shape.name + ": samples of 1024 ";
        figure(name + "held, each", held / seen, "samples");
        figure(name + "gained, each", (bits - held) / seen, "samples");
        EXPECT_GT(bits - held, -0.02 * seen) << shape.name;
        EXPECT_LT(bits - held, 0.1 * seen) << shape.name;
    }
}

// The angle between a sample and the nearest vertex of the surface, as the lane sees it.
double angle_to_a_vertex(const Batch& batch, uint32_t lane, const Soup& surface, const double sample[3]) {
    double most = -1;
    for (const auto& p : surface.points) {
        const std::array<double, 3> d = local_corner(batch, lane, p);
        const double along = d[0] * sample[0] + d[1] * sample[1] + d[2] * sample[2];
        most = std::max(most, along / std::sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]));
    }
    return std::acos(std::min(most, 1.0));
}

// M11. Level: what is known. All samples are blocked inside a closed surface; a table of nearest cells leaks
// where planes meet, by its design: counted, and only there. Along the edges themselves nothing may leak.
TEST(Accuracy, M11FullEnclosure) {
    // A cell turns a plane by this at most (horizon_tangent); the planes around a vertex then pass it so far
    // off at most. 0.91 of it is reached.
    constexpr double turn = 2.5 / (standard.plane_cells - 1);
    Random random(stress_seed() + 29);
    for (const uint32_t subdivisions : {1u, 3u, 5u}) {
        const uint64_t batches = std::max<uint64_t>(stress_cases() / (subdivisions == 5 ? 32 : 16), 4);
        uint64_t leaks = 0, holed = 0, most = 0, receivers = 0, holes = 0;
        double farthest = 0;
        for (uint64_t i = 0; i < batches; ++i) {
            const Soup shell = sphere_soup(subdivisions, &random);
            Soup inside = shell;
            inside.two_sided = true;
            std::vector<std::array<float, 3>> at(16), up(16);
            for (uint32_t lane = 0; lane < 16; ++lane) {
                random.direction(up[lane].data());
                random.direction(at[lane].data());
                for (float& c : at[lane])
                    c *= 0.4f * float(random.unit());
            }
            const Batch batch = batch_of(at, up);
            const Masks masks = rasterize(widest(), standard, batch, inside);
            for (uint32_t lane = 0; lane < 16; ++lane) {
                const uint8_t* const mask = masks.data() + lane * 128;
                const uint32_t open = 1024 - count_bits(mask, 128);
                for (uint32_t bit = 0; open > 0 && bit < 1024; ++bit) {
                    if (mask[bit / 8] >> bit % 8 & 1) continue;
                    double sample[3];
                    sample_direction(standard, bit, sample);
                    farthest = std::max(farthest, angle_to_a_vertex(batch, lane, inside, sample));
                }
                leaks += open;
                holed += open > 0;
                most = std::max<uint64_t>(most, open);
                ++receivers;
            }
            const Masks decided = rasterize(widest(), standard, batch, inside, {.last_samples = true});
            holes += 16 * 1024 - count_bits(decided.data(), 16 * 128);
        }
        const std::string name =
            "M11 inside a sphere of " + std::to_string(20u << (2 * subdivisions)) + " triangles: ";
        figure(name + "leaked samples per 10 M", 1e7 * double(leaks) / (1024.0 * double(receivers)), "bits");
        figure(name + "receivers with a leak", 100.0 * double(holed) / double(receivers), "%");
        figure(name + "most leaked at a receiver", double(most), "bits");
        figure(name + "farthest leak from a vertex", farthest / turn, "turns of a cell");
        figure(name + "samples left open once the last are decided, of " + std::to_string(1024 * receivers),
               double(holes), "bits");
        EXPECT_EQ(holes, 0u);
        EXPECT_LE(farthest, 1.2 * turn);
        EXPECT_LE(double(leaks) / double(receivers), 0.25);
    }
}

// M11, M14. A room of whole numbers, receivers on a lattice, edges and corners straight above them.
TEST(Accuracy, M11LatticeRoom) {
    for (const float offset : {0.0f, 100000.0f}) {
        uint64_t leaks = 0, receivers = 0, holes = 0;
        const int n = 8;
        Soup room;
        room.two_sided = true;
        const auto add_wall = [&](int axis, int at) {
            const uint32_t first = uint32_t(room.points.size());
            for (int j = 0; j <= n; ++j) {
                for (int i = 0; i <= n; ++i) {
                    std::array<float, 3> p{};
                    p[size_t(axis)] = float(at);
                    p[size_t((axis + 1) % 3)] = float(i);
                    p[size_t((axis + 2) % 3)] = float(j);
                    room.points.push_back(p);
                }
            }
            for (uint32_t j = 0; j < uint32_t(n); ++j) {
                for (uint32_t i = 0; i < uint32_t(n); ++i) {
                    const uint32_t a = first + j * uint32_t(n + 1) + i, b = a + 1, c = a + uint32_t(n + 1),
                                   d = c + 1;
                    room.triangles.push_back({a, b, d});
                    room.triangles.push_back({a, d, c});
                }
            }
        };
        for (int axis = 0; axis < 3; ++axis) {
            add_wall(axis, 0);
            add_wall(axis, n);
        }
        std::vector<std::array<float, 3>> at, up;
        for (int i = 0; i < 343; ++i) {
            at.push_back({float(1 + i % 7), float(1 + i / 7 % 7), float(1 + i / 49)});
            up.push_back({i % 3 == 0 ? 1.0f : 0.0f, i % 3 == 1 ? 1.0f : 0.0f, i % 3 == 2 ? 1.0f : 0.0f});
        }
        // As a frame does: relative to its first point. The offset must change nothing.
        Soup moved = room;
        for (auto& p : moved.points) {
            for (float& c : p)
                c = (c + offset) - offset;
        }
        for (size_t i = 0; i + 16 <= at.size(); i += 16) {
            const Batch batch = batch_of({at.begin() + long(i), at.begin() + long(i) + 16},
                                         {up.begin() + long(i), up.begin() + long(i) + 16});
            const Masks masks = rasterize(widest(), standard, batch, moved);
            leaks += 16 * 1024 - count_bits(masks.data(), 16 * 128);
            receivers += 16;
            const Masks decided = rasterize(widest(), standard, batch, moved, {.last_samples = true});
            holes += 16 * 1024 - count_bits(decided.data(), 16 * 128);
        }
        const std::string name = offset > 0 ? "M11 lattice room at 1e5: " : "M11 lattice room: ";
        figure(name + "leaked samples per receiver", double(leaks) / double(receivers), "bits");
        figure(name + "samples left open once the last are decided", double(holes), "bits");
        EXPECT_EQ(holes, 0u);
        EXPECT_LE(double(leaks) / double(receivers), 0.03);
    }
}

// M12. Levels: table, and double. A triangle against its sixteen parts.
TEST(Accuracy, M12Subdivision) {
    const Samples samples(standard);
    uint64_t lost = 0, gained = 0, exact = 0, triangles = 0;
    uint32_t most = 0;
    for (uint64_t i = 0; i < stress_cases(); ++i) {
        Random random(stress_seed() * 7 + i);
        Soup soup;
        soup.points.resize(3);
        soup.triangles = {{0, 1, 2}};
        for (auto& p : soup.points) {
            random.direction(p.data());
            for (float& c : p) // on a grid, so that the middles of edges are exact
                c = std::round(c * 1024) / 1024;
        }
        std::vector<std::array<float, 3>> at(16, {0, 0, 0}), up(16);
        for (auto& n : up)
            random.direction(n.data());
        const Batch batch = batch_of(at, up);
        const Soup parts = subdivided(subdivided(soup));
        const Masks whole = rasterize(widest(), standard, batch, soup),
                    split = rasterize(widest(), standard, batch, parts);
        exact += differing(rasterize_double(samples, standard, batch, soup).data(),
                           rasterize_double(samples, standard, batch, parts).data(), 16 * 128);
        for (uint32_t lane = 0; lane < 16; ++lane) {
            const uint8_t *a = whole.data() + lane * 128, *b = split.data() + lane * 128;
            if (count_bits(a, 128) == 0) continue;
            uint32_t less = 0;
            for (uint32_t k = 0; k < 128; ++k) {
                const uint8_t l = uint8_t(a[k] & ~b[k]), g = uint8_t(b[k] & ~a[k]);
                less += count_bits(&l, 1);
                gained += count_bits(&g, 1);
            }
            lost += less;
            most = std::max(most, less);
            ++triangles;
        }
    }
    ASSERT_GT(triangles, 0u);
    figure("M12 triangle in 16 parts, double: bits that differ, all cases", double(exact), "bits");
    figure("M12 triangle in 16 parts, table: bits lost per triangle", double(lost) / double(triangles),
           "bits");
    figure("M12 triangle in 16 parts, table: bits gained per triangle", double(gained) / double(triangles),
           "bits");
    figure("M12 triangle in 16 parts, table: most lost", most, "bits");
    EXPECT_LE(exact, stress_cases() / 400 + 2);
    EXPECT_LE(double(lost) / double(triangles), 0.002);
    EXPECT_LE(double(gained) / double(triangles), 0.1);
}

// A plane nearer to a cell's own than to any other's, and which cell has it as it is, or as its opposite.
void plane_of_cell(const MaskLayout& layout, uint32_t cell, Random& random, double n[3]) {
    const uint32_t k = layout.plane_cells;
    const bool to_rim = layout.planes == PlaneMap::octahedral; // cells' middles on the rim of the square
    const auto at = [&](uint32_t i) {
        const double middle = to_rim ? 2.0 * i / (k - 1) - 1 : (2.0 * i + 1) / k - 1;
        return std::clamp(middle + (random.unit() - 0.5) * 2 / (to_rim ? k - 1 : k), -1.0, 1.0);
    };
    const double u = at(cell % k), v = at(cell / k % k);
    if (to_rim) {
        n[0] = (u + v) / 2;
        n[1] = (u - v) / 2;
        n[2] = 1 - std::fabs(n[0]) - std::fabs(n[1]);
        return;
    }
    const uint32_t face = cell / (k * k), axis = face / 2;
    n[axis] = face % 2 ? -1 : 1;
    n[axis == 0 ? 1 : 0] = u;
    n[axis == 2 ? 1 : 2] = v;
}

// G18. Level: table against double, every cell with planes of its own.
TEST(Accuracy, G18EveryCellOfTheTable) {
    struct Budget {
        double mean;
        uint32_t most;
    };
    const Budget budgets[] = {{1.2, 20}, {2.9, 18}, {1.5, 18}, {5.7, 36}}; // as `layouts`
    for (size_t l = 0; l < std::size(layouts); ++l) {
        const MaskLayout& layout = layouts[l].layout;
        const Samples samples(layout);
        Random random(stress_seed() + 43);
        std::vector<uint32_t> wrong;
        const uint32_t planes = stress_cases() >= 20000 ? 8 : 1;
        for (uint32_t cell = 0; cell < table_cells(layout); ++cell) {
            const std::vector<uint8_t> mask = mask_of_cell(layout, cell);
            for (uint32_t i = 0; i < planes; ++i) {
                double n[3];
                plane_of_cell(layout, cell, random, n);
                uint32_t count = 0;
                for (uint32_t bit = 0; bit < samples.bits; ++bit) {
                    const double height = n[0] * samples.direction[0][bit] +
                                          n[1] * samples.direction[1][bit] + n[2] * samples.direction[2][bit];
                    count += samples.used[bit] && (height >= 0) != (mask[bit / 8] >> bit % 8 & 1);
                }
                wrong.push_back(count);
            }
        }
        std::sort(wrong.begin(), wrong.end());
        double sum = 0;
        for (const uint32_t w : wrong)
            sum += w;
        const std::string name = std::string("G18 half-space, ") + layouts[l].name + ", bits wrong: ";
        figure(name + "mean", sum / double(wrong.size()), "bits");
        figure(name + "99 of 100 below", wrong[wrong.size() / 100 * 99], "bits");
        figure(name + "most", wrong.back(), "bits");
        EXPECT_LE(sum / double(wrong.size()), budgets[l].mean) << layouts[l].name;
        EXPECT_LE(wrong.back(), budgets[l].most) << layouts[l].name;
    }
}

} // namespace

} // namespace nusselt::test
