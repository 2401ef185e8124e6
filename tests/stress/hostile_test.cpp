// Hostile geometry through whole frames: G1 to G17 of the catalogue. Each has one stated result, and a
// counter that tells. Level: the library's own, masks of the table against one another bit for bit, or what
// is known of the scene; where a test compares with whole numbers it says so. What the loaders do with
// hostile files is tests/load's; single bad vertices are tests/runtime's.
#include "tests/runtime/fixture.h"
#include "tests/stress/ledger.h"
#include "tests/stress/oracle.h"

#include <algorithm>
#include <atomic>
#include <bit>
#include <cfloat>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <ctime>
#include <functional>
#include <limits>
#include <memory>

#include <glm/geometric.hpp>
#include <sys/mman.h>
#include <unistd.h>

namespace nusselt::test {

namespace {

constexpr float nan_value = std::numeric_limits<float>::quiet_NaN();
constexpr float infinite = std::numeric_limits<float>::infinity();

const glm::vec3 up(0, 0, 1);

uint32_t bits_at_origin(Engine& engine, const scenes::Mesh& blocker, FrameStats* stats = nullptr) {
    const Outputs out = run_at_rest(engine.context, {points({{0, 0, 0}}, {up}), blocker});
    if (stats) *stats = out.stats;
    return blocked_bits(out.meshes[0], 0);
}

// What the one receiver at the origin has of a blocker's triangles: looked at, drawn, of its own fan.
struct Counts {
    uint64_t considered, rasterized, fan;
    bool operator==(const Counts&) const = default;
};
std::ostream& operator<<(std::ostream& out, const Counts& c) {
    return out << c.considered << " considered, " << c.rasterized << " rasterized, " << c.fan << " fan";
}
Counts counts_at_origin(Engine& engine, const scenes::Mesh& blocker) {
    const scenes::Mesh eye = points({{0, 0, 0}}, {up});
    std::vector<Posed> frame{at_rest(add(engine.context, eye), eye),
                             at_rest(add(engine.context, blocker), blocker)};
    frame[1].receives = false;
    const FrameStats s = run_frame(engine.context, frame).stats;
    for (const Posed& m : frame)
        EXPECT_TRUE(remove_mesh(engine.context, m.mesh).ok());
    return {s.triangles_considered, s.triangles_rasterized, s.fan_triangles};
}

// The counters that tell of what is left out. A triangle is no triangle from the start (MeshInfo, and none is
// looked at), or is looked at and not drawn: no area, a corner at the receiver, the receiver in its plane and
// not in it, below the tangent plane. All others are drawn.
TEST(Hostile, CountersTellWhatIsLeftOut) {
    Engine engine;
    const glm::vec3 a(1, 0, 1), b(0, 1, 1), c(-1, -1, 2);
    const auto expect = [&](const char* what, const std::vector<glm::vec3>& corners, Counts counts) {
        EXPECT_EQ(counts_at_origin(engine, soup(corners)), counts) << what;
    };
    expect("a triangle", {a, b, c}, {1, 1, 0});
    expect("two of them", {a, b, c, a, b, c}, {2, 2, 0});
    expect("two equal corners", {a, a, b}, {0, 0, 0});
    expect("three equal corners", {a, a, a}, {0, 0, 0});
    expect("corners in a line", {a, a * 2.0f, a * 4.0f}, {1, 0, 0});
    expect("corners in a line past the receiver", {{1, 0, 1}, {1, 2, 1}, {1, 4, 1}}, {1, 0, 0});
    expect("a corner at the receiver", {{0, 0, 0}, a, b}, {1, 0, 0});
    expect("upright, the receiver in its plane", {{1, 0, 1}, {2, 0, 1}, {2, 0, 3}}, {1, 0, 0});
    expect("in the tangent plane", {{1, 0, 0}, {2, 1, 0}, {2, -1, 0}}, {1, 0, 0});
    expect("below the tangent plane, beside one above", {{1, 0, -1}, {2, 1, -1}, {2, -1, -1}, a, b, c},
           {2, 1, 0});
    expect("through the tangent plane", {{1, 0, -1}, {2, 1, 1}, {2, -1, 1}}, {1, 1, 0});
    // Its own: one triangle at the receiver that rises, and one that lies in its tangent plane.
    const scenes::Mesh own = [&] {
        scenes::Mesh m = soup({{0, 0, 0}, a, b});
        m.rest_positions.push_back({1, -1, 0});
        m.rest_positions.push_back({1, -2, 0});
        m.indices.insert(m.indices.end(), {0, 3, 4});
        m.rest_normals.assign(5, up);
        return m;
    }();
    Posed posed = at_rest(add(engine.context, own), own);
    posed.needed = {1};
    EXPECT_EQ(run_frame(engine.context, {posed}).stats.fan_triangles, 1u);
}

void expect_finite(const Outputs& out) {
    for (const Output& mesh : out.meshes) {
        for (const auto& transfer : mesh.transfer) {
            for (const float value : transfer)
                ASSERT_TRUE(std::isfinite(value));
        }
    }
}

// G1. Two or three equal corners, corners in a line: nothing, whichever way the line runs.
TEST(Hostile, G1TrianglesWithoutArea) {
    Engine engine;
    for (uint64_t i = 0; i < stress_cases(); ++i) {
        Random random(stress_seed() + i);
        const glm::vec3 a = random.direction() + up, b = random.direction() + up;
        const float k = std::ldexp(1.0f, int(random.below(4)) - 2);
        ASSERT_EQ(bits_at_origin(engine, soup({a, a, b})), 0u) << i;
        ASSERT_EQ(bits_at_origin(engine, soup({a, a, a})), 0u) << i;
        if (i % 20 == 0) {
            ASSERT_EQ(counts_at_origin(engine, soup({a, a, b})).considered, 0u) << i;
        }
        // Exactly in a line: multiples of powers of two.
        const glm::vec3 whole(std::round(b.x * 64), std::round(b.y * 64), 64);
        ASSERT_EQ(bits_at_origin(engine, soup({whole, whole * 2.0f, whole * (2 + k)})), 0u) << i;
    }
}

// G1. Slivers add no more than the cells of their three planes: a strip of half a cell to either side.
TEST(Hostile, G1Slivers) {
    Engine engine;
    uint64_t bits = 0, most = 0, count = 0;
    // So few hide anything that the mean of a few thousand says nothing.
    for (uint64_t i = 0; i < std::max<uint64_t>(stress_cases(), 20000); ++i) {
        Random random(stress_seed() * 3 + i);
        const glm::vec3 a = random.direction() + up * 1.2f, b = random.direction() + up * 1.2f;
        const float thin = std::pow(10.0f, -random.between(3, 12));
        const uint32_t got = bits_at_origin(engine, soup({a, b, 0.5f * (a + b) + random.direction() * thin}));
        bits += got;
        most = std::max<uint64_t>(most, got);
        ++count;
    }
    figure("G1 slivers of 1e-3 to 1e-12: bits per triangle, mean", double(bits) / double(count), "bits");
    figure("G1 slivers of 1e-3 to 1e-12: bits of a triangle, most", double(most), "bits");
    EXPECT_LE(double(bits) / double(count), 0.01); // a ten-thousandth of the samples of one in ten slivers
    EXPECT_LE(most, 24u);
}

// G2. A receiver at a corner of another mesh's triangle: that triangle hides nothing of it.
TEST(Hostile, G2CornerAtTheReceiver) {
    Engine engine;
    for (uint64_t i = 0; i < stress_cases(); ++i) {
        Random random(stress_seed() * 5 + i);
        const glm::vec3 a = random.direction() + up, b = random.direction() + up;
        ASSERT_EQ(bits_at_origin(engine, soup({glm::vec3(0), a, b})), 0u) << i;
        if (i % 20 == 0) {
            ASSERT_EQ(counts_at_origin(engine, soup({glm::vec3(0), a, b})).rasterized, 0u) << i;
        }
    }
}

// G3, G4. A floor of another mesh through the receiver, and a hair above and below: wholly hidden above, open
// in the plane and below, and the change happens once.
TEST(Hostile, G3G4FloorThroughTheReceiver) {
    Engine engine;
    const scenes::Mesh receivers = [] {
        std::vector<glm::vec3> at, n;
        for (int y = -4; y <= 4; ++y) {
            for (int x = -4; x <= 4; ++x) {
                at.push_back({float(x) * 0.37f, float(y) * 0.41f, 0});
                n.push_back(up);
            }
        }
        return points(at, n);
    }();
    const auto bits = [&](float height) {
        const scenes::Mesh floor = soup({{-100, -100, height},
                                         {100, -100, height},
                                         {100, 100, height},
                                         {-100, -100, height},
                                         {100, 100, height},
                                         {-100, 100, height}});
        const Outputs out = run_at_rest(engine.context, {receivers, floor});
        std::vector<uint32_t> all;
        for (size_t v = 0; v < receivers.rest_positions.size(); ++v)
            all.push_back(blocked_bits(out.meshes[0], v));
        return all;
    };
    const auto all_are = [](const std::vector<uint32_t>& all, uint32_t value) {
        return std::all_of(all.begin(), all.end(), [&](uint32_t b) { return b == value; });
    };
    EXPECT_TRUE(all_are(bits(0), 0));
    for (float height = 1e-9f; height < 0.1f; height *= 3) {
        EXPECT_TRUE(all_are(bits(-height), 0)) << height;
        const std::vector<uint32_t> above = bits(height);
        EXPECT_TRUE(all_are(above, 0) || all_are(above, 1024)) << height; // no speckle
        EXPECT_TRUE(height < 1e-3f || all_are(above, 1024)) << height;    // from 1e-6 of the floor's size on
    }
    uint32_t changes = 0;
    bool covered = false;
    for (float height = 1e-7f; height < 0.1f; height *= 1.1f) {
        const bool now = all_are(bits(height), 1024);
        changes += now != covered;
        covered = now;
    }
    EXPECT_EQ(changes, 1u);
}

// Two layers in one plane of any direction, the second shifted within it so that receivers lie inside its
// triangles; `first` is a mesh that comes before them, if any. How many receivers see any bit, and how many
// go dark.
struct LayerCounts {
    uint64_t receivers = 0, touched = 0, dark = 0;
};
LayerCounts layers(Engine& engine, uint64_t seed, float distance_of_first) {
    Random random(seed);
    const float size = std::ldexp(1.0f, int(random.below(8)) - 6);
    const glm::vec3 n = random.direction(), x = glm::normalize(glm::cross(n, random.direction())),
                    y = glm::cross(n, x), at = random.direction() * (2 * size);
    const auto layer = [&](float shift) {
        scenes::Mesh mesh;
        constexpr uint32_t side = 9;
        for (uint32_t k = 0; k < side * side; ++k) {
            const float u = float(k % side) - 4 + shift, v = float(k / side) - 4 + 0.7f * shift;
            mesh.rest_positions.push_back(at + size * (u * x + v * y));
            mesh.rest_normals.push_back(n);
        }
        for (uint32_t k = 0; k + side + 1 < side * side; ++k) {
            if (k % side == side - 1) continue;
            for (const uint32_t index : {k, k + 1, k + side, k + 1, k + side + 1, k + side})
                mesh.indices.push_back(index);
        }
        return mesh;
    };
    std::vector<scenes::Mesh> meshes{layer(0), layer(0.37f)};
    if (distance_of_first > 0)
        meshes.insert(meshes.begin(), points({random.direction() * (distance_of_first * size)}, {n}));
    const Outputs out = run_at_rest(engine.context, meshes);
    LayerCounts counts;
    for (size_t m = meshes.size() - 2; m < meshes.size(); ++m) {
        for (size_t v = 0; v < out.meshes[m].transfer.size(); ++v) {
            const uint32_t bits = blocked_bits(out.meshes[m], v);
            ++counts.receivers;
            counts.touched += bits > 0;
            counts.dark += bits > 512;
        }
    }
    return counts;
}

// G4. Layers in one plane, in any direction: every receiver stays open. An error of rounding would hide the
// whole hemisphere, and beside a mesh that is far away the positions themselves are rounded off the plane.
TEST(Hostile, G4LayersInOneTiltedPlane) {
    Engine engine;
    for (const float far : {0.0f, 100.0f, 10000.0f}) {
        LayerCounts all;
        for (uint64_t i = 0; i < stress_cases() / 40; ++i) {
            const LayerCounts one = layers(engine, stress_seed() * 13 + i, far);
            all.receivers += one.receivers;
            all.touched += one.touched;
            all.dark += one.dark;
        }
        const std::string name = "G4 two layers in one tilted plane, the scene " +
                                 std::to_string(int(std::max(far, 10.0f))) + " triangles across: receivers ";
        figure(name + "with any bit", 100 * double(all.touched) / double(all.receivers), "%");
        figure(name + "that turn dark", 100 * double(all.dark) / double(all.receivers), "%");
        EXPECT_EQ(all.touched, 0u);
        EXPECT_EQ(all.dark, 0u);
    }
}

// A number whose exponent is that of 1, of either sign, or none: times any power of two from 2^-126 to 2^126
// it stays a normal float, and the difference of two of them loses no bit.
float plain_number(Random& random) {
    if (random.below(8) == 0) return 0;
    const float size = 1 + float(random.below(1u << 23)) * 0x1p-23f;
    return random.below(2) ? size : -size;
}

// M5. Times any power of two at which the numbers stay normal floats, in the mesh as it is added and in its
// pose: the same bits, in masks and transfer.
TEST(Hostile, M5AnyPowerOfTwo) {
    Engine engine;
    uint64_t bits = 0;
    for (uint64_t i = 0; i < stress_cases(); ++i) {
        Random random(stress_seed() * 41 + i);
        std::vector<glm::vec3> at(10);
        for (glm::vec3& p : at)
            p = {plain_number(random), plain_number(random), plain_number(random)};
        const glm::vec3 n = random.direction();
        // The ends more often than the rest.
        const int ends[] = {-126, -125, 125, 126};
        const int k = random.below(8) ? int(random.below(253)) - 126 : ends[random.below(4)];
        const auto result = [&](float scale) {
            std::vector<glm::vec3> scaled = at;
            for (glm::vec3& p : scaled)
                p *= scale;
            return run_at_rest(engine.context,
                               {points({scaled[0]}, {n}), soup({scaled.begin() + 1, scaled.end()})})
                .meshes[0];
        };
        const Output expected = result(1);
        ASSERT_EQ(result(std::ldexp(1.0f, k)), expected) << "case " << i << ", 2^" << k;
        bits += blocked_bits(expected, 0);
    }
    EXPECT_GT(bits, stress_cases() * 10);
}

// M6. Translations that are exact, as all coordinates lie on a grid of 2^-4 below 2^20: the same bits.
TEST(Hostile, M6ExactTranslation) {
    Engine engine;
    uint64_t bits = 0;
    for (uint64_t i = 0; i < stress_cases(); ++i) {
        Random random(stress_seed() * 43 + i);
        const auto on_grid = [&](int reach) {
            return glm::vec3(int(random.below(uint32_t(2 * reach))) - reach,
                             int(random.below(uint32_t(2 * reach))) - reach,
                             int(random.below(uint32_t(2 * reach))) - reach) /
                   16.0f;
        };
        const glm::vec3 by = on_grid(1 << (5 + random.below(19))), n = random.direction();
        std::vector<glm::vec3> here, there;
        for (int k = 0; k < 10; ++k) {
            here.push_back(on_grid(128));
            there.push_back(here.back() + by);
            ASSERT_EQ(there.back() - by, here.back());
        }
        const auto result = [&](const std::vector<glm::vec3>& p) {
            return run_at_rest(engine.context, {points({p[0]}, {n}), soup({p.begin() + 1, p.end()})})
                .meshes[0];
        };
        const Output expected = result(here);
        ASSERT_EQ(result(there), expected) << "case " << i << ", by " << by.x << " " << by.y << " " << by.z;
        bits += blocked_bits(expected, 0);
    }
    EXPECT_GT(bits, stress_cases() * 10);
}

// M6. Any translation: what the scene is after the host has rounded it, and no more. Against the rounded
// scene moved back, which is exact (the differences of close floats are), the bits are the same.
TEST(Hostile, M6AnyTranslation) {
    Engine engine;
    for (uint64_t i = 0; i < stress_cases(); ++i) {
        Random random(stress_seed() * 17 + i);
        const float distance = std::pow(10.0f, random.between(1, 6));
        const glm::vec3 by = random.direction() * distance;
        std::vector<glm::vec3> corners{glm::vec3(0)};
        for (int k = 0; k < 9; ++k)
            corners.push_back(random.direction() * random.between(0.5f, 2));
        for (glm::vec3& c : corners)
            c += by; // the host's rounding
        std::vector<glm::vec3> back = corners;
        for (glm::vec3& c : back)
            c -= corners[0];
        const glm::vec3 n = random.direction();
        const auto masks = [&](const std::vector<glm::vec3>& p) {
            const Outputs out =
                run_at_rest(engine.context, {points({p[0]}, {n}), soup({p.begin() + 1, p.end()})});
            return out.meshes[0].masks;
        };
        ASSERT_EQ(masks(corners), masks(back)) << "case " << i << ", " << distance;
    }
}

// A box of whole numbers, n along each edge, its walls in squares of two triangles; fronts outwards.
scenes::Mesh room_of(int n) {
    scenes::Mesh room;
    for (int axis = 0; axis < 3; ++axis) {
        for (const int at : {0, n}) {
            const auto first = uint32_t(room.rest_positions.size()), row = uint32_t(n + 1);
            for (uint32_t k = 0; k < row * row; ++k) {
                glm::vec3 p;
                p[axis] = float(at);
                p[(axis + 1) % 3] = float(k % row);
                p[(axis + 2) % 3] = float(k / row);
                room.rest_positions.push_back(p);
            }
            for (uint32_t k = 0; k + row < row * row; ++k) {
                if (k % row == row - 1) continue;
                const uint32_t a = first + k, b = a + 1, c = a + row, d = c + 1;
                for (const uint32_t index : at ? std::array{a, b, d, a, d, c} : std::array{a, d, b, a, c, d})
                    room.indices.push_back(index);
            }
        }
    }
    scenes::compute_normals(room.rest_positions, room.indices, room.rest_normals);
    return room;
}

// Closed prisms of sixteen sides and seven rings of corners, of radius 1 and length 8 along z, seven of them
// side by side and so near that neighbours reach into one another; fronts outwards.
constexpr float bundle_distance = 1.9f;

scenes::Mesh bundle_of_cylinders() {
    constexpr uint32_t sides = 16, rings = 7;
    scenes::Mesh mesh;
    for (int cylinder = 0; cylinder < 7; ++cylinder) {
        const float away = cylinder ? bundle_distance : 0.0f, turn = 1.0471976f * float(cylinder);
        const glm::vec3 middle(away * std::cos(turn), away * std::sin(turn), 0);
        const auto first = uint32_t(mesh.rest_positions.size());
        for (uint32_t ring = 0; ring < rings; ++ring) {
            for (uint32_t side = 0; side < sides; ++side) {
                const float angle = 0.3926991f * (float(side) + 0.11f * float(cylinder));
                mesh.rest_positions.push_back(
                    middle + glm::vec3(std::cos(angle), std::sin(angle), 8 * float(ring) / (rings - 1) - 4));
            }
        }
        const auto low = first + rings * sides, high = low + 1;
        mesh.rest_positions.push_back(middle - glm::vec3(0, 0, 4));
        mesh.rest_positions.push_back(middle + glm::vec3(0, 0, 4));
        for (uint32_t side = 0; side < sides; ++side) {
            const uint32_t next = (side + 1) % sides;
            for (uint32_t ring = 0; ring + 1 < rings; ++ring) {
                const uint32_t a = first + ring * sides + side, b = first + ring * sides + next;
                for (const uint32_t index : {a, b, b + sides, a, b + sides, a + sides})
                    mesh.indices.push_back(index);
            }
            const uint32_t top = first + (rings - 1) * sides;
            for (const uint32_t index : {first + next, first + side, low, top + side, top + next, high})
                mesh.indices.push_back(index);
        }
    }
    scenes::compute_normals(mesh.rest_positions, mesh.indices, mesh.rest_normals);
    return mesh;
}

// M11. What is known. In a closed part that faces outwards, all samples are blocked for every receiver,
// wherever the scene lies: spheres of up to 20,480 triangles turned at random, a bundle of cylinders that
// reach into one another, and a room of whole numbers with receivers on its lattice, whose rays run along
// edges and through corners. 1e5 away corners are rounded by a 250th of an edge of the finest sphere.
void expect_closed_parts_are_dark(Quality quality, uint64_t spheres) {
    const uint32_t bits = quality_mask_bits(quality);
    uint64_t tests = 0;
    const auto expect_dark = [&](Engine& engine, scenes::Mesh shell, std::vector<glm::vec3> at,
                                 const std::vector<glm::vec3>& normals, const glm::vec3& by) {
        for (std::vector<glm::vec3>* all : {&shell.rest_positions, &at}) {
            for (glm::vec3& p : *all)
                p += by;
        }
        const Outputs out = run_at_rest(engine.context, {points(at, normals), shell}, quality);
        for (size_t v = 0; v < at.size(); ++v) {
            ASSERT_EQ(blocked_bits(out.meshes[0], v, quality), bits) << v;
            for (const float t : out.meshes[0].transfer[v])
                ASSERT_EQ(t, 0.0f) << v;
        }
        tests += bits * at.size();
    };
    Random random(stress_seed() * 19);
    const auto turned = [&](scenes::Mesh mesh, glm::vec3 axes[3]) {
        axes[0] = random.direction();
        axes[1] = glm::normalize(glm::cross(axes[0], random.direction()));
        axes[2] = glm::cross(axes[0], axes[1]);
        for (glm::vec3& p : mesh.rest_positions)
            p = p.x * axes[0] + p.y * axes[1] + p.z * axes[2];
        return mesh;
    };
    for (const float offset : {0.0f, 1e5f}) {
        const std::string place = std::string(quality_name(quality)) + ", offset " + std::to_string(offset);
        glm::vec3 axes[3];
        for (const uint32_t subdivisions : {1u, 3u, 5u}) {
            Engine engine;
            for (uint64_t i = 0; i < spheres; ++i) {
                const scenes::Mesh sphere = turned(scenes::sphere(subdivisions, 100), axes);
                std::vector<glm::vec3> at, n;
                for (int k = 0; k < 500; ++k) {
                    at.push_back(random.direction() * random.between(0, 40));
                    n.push_back(random.direction());
                }
                SCOPED_TRACE("sphere " + std::to_string(subdivisions) + ", " + place);
                expect_dark(engine, sphere, at, n, random.direction() * offset);
            }
        }
        for (uint64_t i = 0; i < spheres; ++i) {
            Engine engine;
            scenes::Mesh bundle = turned(bundle_of_cylinders(), axes);
            for (glm::vec3& p : bundle.rest_positions)
                p *= 30.0f; // 1e5 away, too, its edges are many times the rounding
            std::vector<glm::vec3> at, n;
            for (int k = 0; k < 350; ++k) {
                const float away = k % 7 ? bundle_distance : 0.0f, turn = 1.0471976f * float(k % 7),
                            angle = random.between(-3.1416f, 3.1416f), r = random.between(0, 0.9f);
                const glm::vec3 p = 30.0f * glm::vec3(away * std::cos(turn) + r * std::cos(angle),
                                                      away * std::sin(turn) + r * std::sin(angle),
                                                      random.between(-3.6f, 3.6f));
                at.push_back(p.x * axes[0] + p.y * axes[1] + p.z * axes[2]);
                n.push_back(random.direction());
            }
            SCOPED_TRACE("bundle of cylinders, " + place);
            expect_dark(engine, bundle, at, n, random.direction() * offset);
        }
        Engine engine;
        std::vector<glm::vec3> at, n;
        for (int k = 0; k < 343; ++k) {
            glm::vec3 axis(0);
            axis[k % 3] = k % 2 ? 1.0f : -1.0f;
            at.push_back({1 + k % 7, 1 + k / 7 % 7, 1 + k / 49});
            n.push_back(axis);
        }
        SCOPED_TRACE("room, " + place);
        expect_dark(engine, room_of(8), at, n, glm::vec3(offset));
    }
    figure(std::string("M11 inside closed parts, whole frames, ") + quality_name(quality) +
               ": samples tested, none open",
           double(tests), "samples");
}

TEST(Hostile, M11InsideClosedPartsNoSampleIsOpen) {
    const uint64_t some = std::max<uint64_t>(stress_cases() / 4000, 1);
    expect_closed_parts_are_dark(Quality::standard, some);
    expect_closed_parts_are_dark(Quality::draft, std::max<uint64_t>(some / 2, 1));
    expect_closed_parts_are_dark(Quality::fine, std::max<uint64_t>(some / 2, 1));
}

// M11. What is known. A sphere whose fronts look inward is no closed part, and its levels leave gaps near its
// wall: in a watertight frame all samples are blocked all the same, for receivers as near as a tenth of the
// radius, wherever the scene lies.
TEST(Hostile, M11InsideOutSpheresNoSampleIsOpenInWatertightFrames) {
    const uint64_t receivers = std::max<uint64_t>(stress_cases() / 12, 40); // ten million samples in stress
    Random random(stress_seed() * 23);
    for (const Quality quality : {Quality::draft, Quality::standard, Quality::fine}) {
        uint64_t tests = 0, loose_open = 0;
        for (const float offset : {0.0f, 1e5f}) {
            for (const uint32_t subdivisions : {1u, 3u, 5u}) {
                SCOPED_TRACE(std::string(quality_name(quality)) + ", sphere " + std::to_string(subdivisions) +
                             ", offset " + std::to_string(offset));
                scenes::Mesh sphere = scenes::sphere(subdivisions, 100);
                const glm::vec3 by = random.direction() * offset;
                for (glm::vec3& p : sphere.rest_positions)
                    p += by;
                for (size_t k = 0; k < sphere.indices.size(); k += 3)
                    std::swap(sphere.indices[k], sphere.indices[k + 1]);
                std::vector<glm::vec3> at, n;
                for (uint64_t k = 0; k < receivers; ++k) {
                    at.push_back(by + random.direction() * (k % 2 ? 85.0f : random.between(0, 85)));
                    n.push_back(random.direction());
                }
                Engine engine;
                const scenes::Mesh eyes = points(at, n);
                Posed walls = at_rest(add(engine.context, sphere), sphere);
                walls.receives = false;
                const std::vector<Posed> frame{at_rest(add(engine.context, eyes), eyes), walls};
                FrameDesc settings;
                settings.quality = quality;
                const Outputs loose = run_frame(engine.context, frame, settings);
                settings.watertight = true;
                const Outputs tight = run_frame(engine.context, frame, settings);
                const uint32_t bits = quality_mask_bits(quality);
                for (size_t v = 0; v < at.size(); ++v) {
                    ASSERT_EQ(blocked_bits(tight.meshes[0], v, quality), bits) << v;
                    loose_open += bits - blocked_bits(loose.meshes[0], v, quality);
                    tests += bits;
                }
            }
        }
        const std::string name = std::string("M11 inside-out spheres, ") + quality_name(quality) + ": ";
        figure(name + "samples tested in watertight frames, none open", double(tests), "samples");
        figure(name + "open per million without it", 1e6 * double(loose_open) / double(tests), "samples");
    }
}

// The walls of a room of 32 x 32 x 16, each of 8 x 8 squares, fronts inward; the door is left out: two
// squares by one of the wall at x = 16, from 2 above the floor to 4. Coordinates are whole.
scenes::Mesh room_with_a_door() {
    scenes::Mesh mesh;
    const auto wall = [&](glm::vec3 at, glm::vec3 along, glm::vec3 across, bool has_door) {
        const auto first = uint32_t(mesh.rest_positions.size());
        for (int j = 0; j <= 8; ++j) {
            for (int i = 0; i <= 8; ++i)
                mesh.rest_positions.push_back(at + along * float(i) + across * float(j));
        }
        for (uint32_t j = 0; j < 8; ++j) {
            for (uint32_t i = 0; i < 8; ++i) {
                if (has_door && j == 1 && (i == 3 || i == 4)) continue;
                const uint32_t k = first + 9 * j + i;
                for (const uint32_t v : {k, k + 1, k + 10, k, k + 10, k + 9})
                    mesh.indices.push_back(v);
            }
        }
    };
    const glm::vec3 x(4, 0, 0), y(0, 4, 0), z(0, 0, 2), low(-16, -16, 0);
    wall(low, x, y, false);
    wall(low + 8.0f * z, y, x, false);
    wall(low, z, x, false);
    wall(low + 8.0f * y, x, z, false);
    wall(low, y, z, false);
    wall(low + 8.0f * x + 8.0f * y, -y, z, true);
    scenes::compute_normals(mesh.rest_positions, mesh.indices, mesh.rest_normals);
    return mesh;
}

// M11, of a room that is not closed, sample by sample against its walls in whole numbers. In a watertight
// frame a receiver that sees nothing through the door sees nothing; one that does loses nothing of what it
// sees, and may keep what the table leaves open beside that (the first sample that is truly open ends the
// asking).
TEST(Hostile, M11ARoomWithADoorIsDarkBesideTheDoor) {
    const scenes::Mesh walls = room_with_a_door();
    const uint64_t count = std::max<uint64_t>(stress_cases() / 25, 100);
    Random random(stress_seed() * 29);
    std::vector<glm::vec3> at, n;
    for (uint64_t k = 0; k < count; ++k) {
        const auto any = [&](int low, int high) {
            return float(low * 16 + int(random.below(uint32_t(high - low) * 16))) / 16;
        };
        at.push_back({any(-15, 12), any(-15, 15), any(1, 2)});
        n.push_back(up); // whose tangent frame are the axes
    }
    Engine engine;
    const scenes::Mesh eyes = points(at, n);
    Posed blockers = at_rest(add(engine.context, walls), walls);
    blockers.receives = false;
    const std::vector<Posed> frame{at_rest(add(engine.context, eyes), eyes), blockers};
    for (const Quality quality : {Quality::standard, Quality::fine}) {
        const kernels::MaskLayout& layout =
            quality == Quality::fine ? kernels::fine_layout : kernels::standard_layout;
        const Samples samples(layout);
        FrameDesc settings;
        settings.quality = quality;
        const Outputs loose = run_frame(engine.context, frame, settings);
        settings.watertight = true;
        const Outputs tight = run_frame(engine.context, frame, settings);
        uint64_t lit = 0, shut = 0, seen = 0, leaks = 0, leaks_of_shut = 0, lost = 0;
        for (size_t v = 0; v < at.size(); ++v) {
            std::vector<uint8_t> truth(samples.bits / 8, 0);
            for (size_t i = 0; i < walls.indices.size(); i += 3) {
                std::array<std::array<int32_t, 3>, 3> local{};
                for (size_t k = 0; k < 3; ++k) {
                    const glm::vec3 from = walls.rest_positions[walls.indices[i + k]] - at[v];
                    for (int axis = 0; axis < 3; ++axis)
                        local[k][size_t(axis)] = int32_t(from[axis] * 16);
                }
                cover_exactly(samples, local, truth.data());
            }
            const auto sees = [&](const Outputs& out, uint32_t bit) {
                return !(out.meshes[0].masks[v * samples.bits / 32 + bit / 32] >> bit % 32 & 1);
            };
            const uint32_t before = samples.bits - blocked_bits(loose.meshes[0], v, quality);
            if (before > samples.bits / 16) continue; // beside the door: it is not asked for
            uint64_t open = 0, leaking = 0, leaking_before = 0;
            for (uint32_t bit = 0; bit < samples.bits; ++bit) {
                const bool is_open = !(truth[bit / 8] >> bit % 8 & 1);
                open += is_open;
                leaking += sees(tight, bit) && !is_open;
                leaking_before += sees(loose, bit) && !is_open;
                lost += !sees(tight, bit) && is_open;
                ASSERT_EQ(sees(tight, bit) && is_open, sees(loose, bit) && is_open) << "receiver " << v;
            }
            if (open == 0) {
                ASSERT_EQ(leaking, 0u) << "receiver " << v;
                leaks_of_shut += leaking_before;
            }
            ++(open > 0 ? lit : shut);
            seen += open;
            leaks += leaking;
        }
        const std::string name = std::string("M11 a room with a door, ") + quality_name(quality) + ": ";
        figure(name + "receivers that light reaches", double(lit), "receivers");
        figure(name + "samples through the door", double(seen), "samples");
        figure(name + "samples of these that the table hides", double(lost), "samples");
        figure(name + "samples that it leaves open beside them", double(leaks), "samples");
        figure(name + "receivers that no light reaches, and that see none", double(shut), "receivers");
        figure(name + "samples open to these without it", double(leaks_of_shut), "samples");
        EXPECT_LT(leaks, seen / 10);
        EXPECT_LT(lost, seen / 10);
        EXPECT_GT(lit, count / 5);
        EXPECT_GT(shut, count / 10);
    }
}

// G5. What lies in the tangent plane adds nothing; what goes through it, its upper part.
TEST(Hostile, G5TangentPlane) {
    Engine engine;
    EXPECT_EQ(bits_at_origin(engine, soup({{1, 0, 0}, {2, 1, 0}, {2, -1, 0}})), 0u);
    for (uint64_t i = 0; i < stress_cases(); ++i) {
        Random random(stress_seed() * 7 + i);
        // A wall of the tangent plane's height: as the part of it above.
        const float x = random.between(0.2f, 2), w = random.between(0.2f, 2), h = random.between(0.5f, 3);
        const auto wall = [&](float low) {
            return soup({{x, -w, low}, {x, w, low}, {x, w, h}, {x, -w, low}, {x, w, h}, {x, -w, h}});
        };
        const uint32_t whole = bits_at_origin(engine, wall(0)), through = bits_at_origin(engine, wall(-h));
        ASSERT_LE(std::abs(int(whole) - int(through)), 16) << i; // other planes, other cells
    }
}

// G7. Open, non-manifold and self-crossing meshes block from both sides.
TEST(Hostile, G7BrokenTopologyBlocksFromBothSides) {
    Engine engine;
    const glm::vec3 a(-2, -2, 1), b(2, -2, 1), c(2, 2, 1), d(-2, 2, 1), e(0, 0, 2);
    const auto mesh = [](std::vector<glm::vec3> p, std::vector<uint32_t> i) {
        scenes::Mesh m;
        m.rest_positions = std::move(p);
        m.indices = std::move(i);
        scenes::compute_normals(m.rest_positions, m.indices, m.rest_normals);
        return m;
    };
    const uint32_t one = bits_at_origin(engine, mesh({a, b, c, d}, {0, 1, 2, 0, 2, 3}));
    EXPECT_GT(one, 500u);
    EXPECT_EQ(bits_at_origin(engine, mesh({a, b, c, d}, {2, 1, 0, 3, 2, 0})), one);
    EXPECT_EQ(bits_at_origin(engine, mesh({a, b, c, d}, {0, 1, 2, 3, 2, 0})), one); // inconsistent
    // A third triangle at an edge, hidden behind the first two.
    EXPECT_EQ(bits_at_origin(engine, mesh({a, b, c, d, e}, {0, 1, 2, 0, 2, 3, 0, 2, 4})), one);
    EXPECT_EQ(bits_at_origin(engine, mesh({a, b, c, d}, {0, 1, 2, 0, 2, 3, 0, 1, 2, 2, 1, 0})), one); // twice
}

// G8. The scene times 2^k for every k at which its numbers stay normal floats: the same bits.
TEST(Hostile, G8PowersOfTwo) {
    Engine engine;
    // Two numbers alone, so that none leaves the range: 1 and 1.5, or 0.
    const scenes::Mesh receiver = points({{0, 0, 0}}, {up});
    const scenes::Mesh blocker = soup({{1, 0, 1}, {-1, 1.5f, 1}, {-1, -1.5f, 1}});
    const std::vector<Posed> frame{at_rest(add(engine.context, receiver), receiver),
                                   at_rest(add(engine.context, blocker), blocker)};
    const Outputs expected = run_frame(engine.context, frame);
    ASSERT_GT(blocked_bits(expected.meshes[0], 0), 50u);
    for (int k = -126; k <= 126; ++k) {
        std::vector<Posed> scaled = frame;
        for (Posed& p : scaled) {
            for (glm::vec3& v : p.positions)
                v *= std::ldexp(1.0f, k);
        }
        EXPECT_EQ(run_frame(engine.context, scaled), expected) << "2^" << k;
    }
    // Denormal, huge, and both in one triangle: an answer, finite, never everything hidden by accident.
    for (const float size : {1e-42f, 1e-38f, 1e-20f, 1e20f, 3e38f}) {
        std::vector<Posed> odd = frame;
        odd[1].positions[0] *= size;
        const Outputs out = run_frame(engine.context, odd);
        expect_finite(out);
        EXPECT_LT(blocked_bits(out.meshes[0], 0), 1024u) << size;
        for (glm::vec3& v : odd[1].positions)
            v = glm::normalize(v) * size;
        const Outputs all = run_frame(engine.context, odd);
        expect_finite(all);
        EXPECT_LT(blocked_bits(all.meshes[0], 0), 1024u) << size;
    }
}

double best_ms(Engine& engine, const std::vector<Posed>& frame, Outputs& out, int rounds = 5) {
    double best = 1e30;
    for (int i = 0; i < rounds; ++i) {
        out = run_frame(engine.context, frame);
        best = std::min(best, out.stats.cpu_ms);
    }
    return best;
}

// G9. NaN or infinity in any coordinate, on any instruction set: the same finite bits, told in the counters,
// and each in at most one and a half times the clean frame's processor time. The least of rounds that take
// turns; where it is above, of more rounds, up to 400: what is slow by itself stays so, what another program
// slowed does not.
TEST(Hostile, G9NotFinite) {
    constexpr int rounds = 8;
    const scenes::Mesh mesh = scenes::torus(1, 0.4f, 24, 12);
    std::vector<double> times;
    std::vector<Outputs> first;
    for (const Isa isa : available_isas()) {
        Engine engine(with_isa(isa));
        const Posed good = at_rest(add(engine.context, mesh), mesh);
        Outputs out, ignored;
        size_t number = 0;
        for (const float bad : {nan_value, -nan_value, infinite, -infinite}) {
            for (int k = 0; k < 6; ++k) { // positions, normals
                Posed broken = good;
                for (size_t v = 0; v < good.positions.size(); v += 97)
                    (k < 3 ? broken.positions : broken.normals)[v][k % 3] = bad;
                double clean_ms = 1e30, broken_ms = 1e30;
                for (int round = 0; round < (broken_ms <= 1.5 * clean_ms ? rounds : 400); ++round) {
                    clean_ms = std::min(clean_ms, best_ms(engine, {good}, ignored, 1));
                    broken_ms = std::min(broken_ms, best_ms(engine, {broken}, out, 1));
                }
                times.push_back(broken_ms / clean_ms);
                EXPECT_LE(broken_ms, 1.5 * clean_ms) << isa_name(isa) << ", " << bad << " at " << k;
                expect_finite(out);
                EXPECT_EQ(out.stats.receivers_invalid, (good.positions.size() + 96) / 97);
                EXPECT_EQ(out.stats.triangles_invalid > 0, k < 3);
                for (size_t v = 0; v < good.positions.size(); v += 97) {
                    for (const float t : out.meshes[0].transfer[v])
                        ASSERT_EQ(t, 0.0f);
                }
                if (first.size() <= number) first.push_back(out);
                EXPECT_EQ(out, first[number]) << isa_name(isa);
                ++number;
            }
        }
    }
    std::sort(times.begin(), times.end());
    figure("G9 frame with numbers that are not finite, against clean, median", times[times.size() / 2],
           "times");
    figure("G9 frame with numbers that are not finite, against clean, slowest", times.back(), "times");
}

// G11. Normals around the poles of the tangent frame: neighbours hide about the same.
TEST(Hostile, G11NormalsNearThePoles) {
    Engine engine;
    const scenes::Mesh blocker = soup({{1, -0.5f, 2},
                                       {1.3f, 1.1f, 2},
                                       {-1.2f, 0.3f, 2}, //
                                       {1, -0.5f, -2},
                                       {1.3f, 1.1f, -2},
                                       {-1.2f, 0.3f, -2}});
    for (const float pole : {1.0f, -1.0f}) {
        // A ring of azimuths: the frame turns with them, so the bits move, and their number by a cell or two.
        std::vector<glm::vec3> at, n;
        for (int exponent = -45; exponent <= -8; ++exponent) {
            for (int k = 0; k < 8; ++k) {
                const float angle = 0.7853982f * float(k), size = std::pow(10.0f, float(exponent));
                at.push_back({0, 0, 0});
                n.push_back({size * std::cos(angle), size * std::sin(angle), pole});
            }
        }
        const Outputs out = run_at_rest(engine.context, {points(at, n), blocker});
        std::vector<uint32_t> bits;
        for (size_t v = 0; v < n.size(); ++v)
            bits.push_back(blocked_bits(out.meshes[0], v));
        const auto [low, high] = std::minmax_element(bits.begin(), bits.end());
        EXPECT_LE(*high - *low, 24u) << pole; // each azimuth has its own cells
        EXPECT_GT(*low, 50u);
        // The transfer is in the scene's space: it hardly knows of the frame.
        for (size_t v = 1; v < n.size(); ++v) {
            for (size_t i = 0; i < 25; ++i)
                ASSERT_NEAR(out.meshes[0].transfer[v][i], out.meshes[0].transfer[0][i], 0.03f) << v;
        }
    }
}

// G13. A mesh that collapses for a frame leaves nothing behind.
TEST(Hostile, G13CollapseAndRecovery) {
    Engine engine, fresh;
    const scenes::Mesh mesh = scenes::torus(1, 0.4f, 40, 20);
    const Posed good = at_rest(add(engine.context, mesh), mesh);
    const Outputs expected = run_at_rest(fresh.context, {mesh});
    const std::function<glm::vec3(glm::vec3)> collapses[] = {
        [](glm::vec3) { return glm::vec3(0.3f); }, [](glm::vec3 p) { return glm::vec3(p.x, 0, 0); },
        [](glm::vec3 p) { return glm::vec3(p.x, 0, p.z); }, [](glm::vec3) { return glm::vec3(nan_value); },
        [](glm::vec3 p) { return p * 1e30f; }};
    for (const auto& collapse : collapses) {
        Posed broken = good;
        for (glm::vec3& p : broken.positions)
            p = collapse(p);
        expect_finite(run_frame(engine.context, {broken}));
        EXPECT_EQ(run_frame(engine.context, {good}), expected);
    }
}

// An array that ends where a page that may not be touched begins.
uint64_t guarded_arrays = 0; // that were made
template<class T>
struct Guarded {
    char* base = nullptr;
    size_t size = 0;
    T* data = nullptr;

    explicit Guarded(size_t count) {
        const size_t page = size_t(sysconf(_SC_PAGESIZE)),
                     need = (count * sizeof(T) + page - 1) / page * page;
        size = need + page;
        base = static_cast<char*>(
            mmap(nullptr, size, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0));
        if (base == MAP_FAILED || mprotect(base + need, page, PROT_NONE) != 0) std::abort();
        data = reinterpret_cast<T*>(base + need) - count;
        ++guarded_arrays;
    }
    ~Guarded() { munmap(base, size); }
    Guarded(const Guarded&) = delete;
    Guarded& operator=(const Guarded&) = delete;
};

// G14. Meshes of 1 to 70 vertices on every instruction set, each array at the edge of a page that may not be
// read.
TEST(Hostile, G14NothingIsReadPastTheLastElement) {
    for (const Isa isa : available_isas()) {
        Engine engine(with_isa(isa));
        for (uint32_t count = 1; count <= 70; ++count) {
            const uint32_t triangles = count < 3 ? 0 : 2 * count;
            Guarded<float> positions(3 * count), normals(3 * count), transfer(25 * count);
            Guarded<uint32_t> masks(32 * count), indices(3 * triangles);
            Random random(count);
            for (uint32_t i = 0; i < 3 * count; ++i) {
                positions.data[i] = random.between(-1, 1);
                normals.data[i] = random.between(-1, 1);
            }
            for (uint32_t i = 0; i < 3 * triangles; ++i)
                indices.data[i] = random.below(count);
            MeshId id;
            ASSERT_TRUE(
                add_mesh(
                    engine.context,
                    {{positions.data, count, 12}, {normals.data, count, 12}, indices.data, 3 * triangles},
                    &id)
                    .ok());
            const FrameMesh mesh{id,
                                 {positions.data, count, 12},
                                 {normals.data, count, 12},
                                 {transfer.data, count, 100},
                                 {masks.data, count, 128}};
            FrameId frame;
            ASSERT_TRUE(submit(engine.context, {&mesh, 1, Quality::standard}, &frame).ok());
            ASSERT_TRUE(wait(engine.context, frame, nullptr).ok());
            for (uint32_t i = 0; i < 25 * count; ++i)
                ASSERT_TRUE(std::isfinite(transfer.data[i]));
            std::vector<float> rgb(3 * count);
            const float light[75] = {1};
            ASSERT_TRUE(shade(engine.context, light, {transfer.data, count, 100}, {}, rgb.data()).ok());
            ASSERT_TRUE(remove_mesh(engine.context, id).ok());
        }
        // Indices that point nowhere are refused.
        const float position[9] = {0, 0, 0, 1, 0, 0, 0, 1, 0};
        for (const uint32_t bad : {3u, 4u, 0x7FFFFFFFu, 0x80000000u, 0xFFFFFFFFu}) {
            const uint32_t index[3] = {0, 1, bad};
            MeshId id;
            EXPECT_EQ(add_mesh(engine.context, {{position, 3, 12}, {}, index, 3}, &id).code,
                      StatusCode::invalid_argument);
        }
    }
}

// G14. All arrays that a frame borrows, each at the edge of a page that may not be touched: both sides'
// masks, transfer and needed bits, every kind of output in every format, and the numbers of materials.
TEST(Hostile, G14EveryArrayOfAFrame) {
    constexpr OutputKind kinds[] = {OutputKind::transfer,    OutputKind::ambient_occlusion,
                                    OutputKind::bent_normal, OutputKind::glossy,
                                    OutputKind::radiance,    OutputKind::direct};
    constexpr OutputFormat formats[] = {OutputFormat::float32, OutputFormat::float16, OutputFormat::packed8};
    const float light[75] = {1, 1, 1, 0.5f};
    const std::vector<float> sky(3 * 8 * 4, 1.0f);
    const float red[3] = {0.9f, 0.3f, 0.1f};
    const Material materials[2] = {metallic_roughness(red, 1, 0.3f), metallic_roughness(red, 0, 0.6f)};
    guarded_arrays = 0;
    for (const Isa isa : available_isas()) {
        Engine engine(with_isa(isa));
        for (const Quality quality : {Quality::draft, Quality::standard, Quality::fine}) {
            const uint32_t bits = quality_mask_bits(quality);
            Environment* environment = nullptr;
            ASSERT_TRUE(create_environment(engine.context, {sky.data(), 8, 4, bits}, &environment).ok());
            for (const uint32_t count : {1u, 15u, 16u, 17u, 33u, 64u, 70u}) {
                SCOPED_TRACE(std::string(isa_name(isa)) + ", " + quality_name(quality) + ", " +
                             std::to_string(count));
                const uint32_t triangles = count < 3 ? 0 : 2 * count;
                Guarded<float> positions(3 * count), normals(3 * count);
                Guarded<uint32_t> indices(3 * triangles), needed((count + 31) / 32),
                    back_needed((count + 31) / 32);
                Guarded<uint16_t> material_of(count);
                Random random(count);
                for (uint32_t i = 0; i < 3 * count; ++i) {
                    positions.data[i] = random.between(-1, 1);
                    normals.data[i] = random.between(-1, 1);
                }
                for (uint32_t i = 0; i < 3 * triangles; ++i)
                    indices.data[i] = random.below(count);
                for (uint32_t v = 0; v < count; ++v)
                    material_of.data[v] = uint16_t(v % 2);
                for (uint32_t word = 0; word < (count + 31) / 32; ++word)
                    needed.data[word] = back_needed.data[word] =
                        0xFFFFFFFF; // those past the last mean nothing
                FrameMesh mesh;
                ASSERT_TRUE(
                    add_mesh(
                        engine.context,
                        {{positions.data, count, 12}, {normals.data, count, 12}, indices.data, 3 * triangles},
                        &mesh.mesh)
                        .ok());
                // Transfer and masks of both sides, with the fewest words a vertex that hold them.
                for (const uint32_t order : {5u, 3u, 1u}) {
                    Guarded<float> front(order * order * count), back(order * order * count);
                    Guarded<uint32_t> front_masks(bits / 32 * count), back_masks(bits / 32 * count);
                    FrameMesh both = mesh;
                    both.positions = {positions.data, count, 12};
                    both.normals = {normals.data, count, 12};
                    both.transfer = {front.data, count, 4 * order * order};
                    both.masks = {front_masks.data, count, bits / 8};
                    both.needed = needed.data;
                    both.back = {{back.data, count, 4 * order * order},
                                 {back_masks.data, count, bits / 8},
                                 back_needed.data};
                    FrameDesc desc{&both, 1, quality};
                    desc.order = order;
                    FrameId frame;
                    ASSERT_TRUE(submit(engine.context, desc, &frame).ok());
                    ASSERT_TRUE(wait(engine.context, frame, nullptr).ok());
                    for (uint32_t i = 0; i < order * order * count; ++i)
                        ASSERT_TRUE(std::isfinite(front.data[i]) && std::isfinite(back.data[i])) << i;
                }
                for (const OutputKind kind : kinds) {
                    for (const OutputFormat format : formats) {
                        const bool whole = kind == OutputKind::transfer || kind == OutputKind::glossy;
                        const uint32_t bands = whole ? 1 + random.below(5) : 5;
                        const size_t bytes = output_bytes(kind, format, bands);
                        if (format == OutputFormat::packed8 &&
                            (kind == OutputKind::radiance || kind == OutputKind::direct))
                            continue;
                        Guarded<char> front(bytes * count), back(bytes * count);
                        nusselt::Output streams[2];
                        for (nusselt::Output& stream : streams) {
                            stream.kind = kind;
                            stream.format = format;
                            stream.data = &stream == streams ? front.data : back.data;
                            stream.count = count;
                            stream.bands = whole ? bands : 0;
                        }
                        const Gloss gloss{{4, 0, 4}, 0, materials, 2, material_of.data};
                        FrameMesh seen = mesh;
                        seen.positions = {positions.data, count, 12};
                        seen.normals = {normals.data, count, 12};
                        seen.outputs = streams;
                        seen.output_count = 1;
                        seen.back.outputs = streams + 1;
                        seen.back.output_count = 1;
                        if (kind == OutputKind::glossy || kind == OutputKind::radiance) seen.gloss = &gloss;
                        FrameDesc desc{&seen, 1, quality};
                        desc.light = light;
                        desc.environment = environment;
                        FrameId frame;
                        const Status started = submit(engine.context, desc, &frame);
                        ASSERT_TRUE(started.ok())
                            << started.text << ": kind " << int(kind) << ", format " << int(format);
                        ASSERT_TRUE(wait(engine.context, frame, nullptr).ok());
                    }
                }
                ASSERT_TRUE(remove_mesh(engine.context, mesh.mesh).ok());
            }
            destroy_environment(engine.context, environment);
        }
    }
    figure("G14 arrays of frames that end at a page's edge", double(guarded_arrays), "arrays");
}

// G15. As many ribbons, coincident layers and dust as ordinary triangles cost at most 1.2 times as much: in
// memory, and in the least processor time of being added and of a frame, in rounds that take turns (more of
// them where it is above, as in G9: a hundred thousand triangles share the caches with whatever else runs).
void expect_the_cost_of_ordinary_triangles(uint32_t count) {
    Engine engine;
    const auto make = [&](const std::function<void(Random&, glm::vec3[3])>& triangle) {
        Random random(7);
        std::vector<glm::vec3> corners;
        for (uint32_t t = 0; t < count; ++t) {
            glm::vec3 c[3];
            triangle(random, c);
            corners.insert(corners.end(), c, c + 3);
        }
        return soup(corners);
    };
    const scenes::Mesh receivers = [] {
        std::vector<glm::vec3> at, n;
        Random random(9);
        for (int i = 0; i < 160; ++i) {
            at.push_back(random.direction() * 0.5f);
            n.push_back(random.direction());
        }
        return points(at, n);
    }();
    const Posed eyes = at_rest(add(engine.context, receivers), receivers);
    struct Cost {
        scenes::Mesh mesh;
        double bytes = 0, added = 1e30, frame = 1e30; // least times, seconds and ms of processor
    };
    const auto measure = [&](Cost& cost) {
        const std::clock_t start = std::clock();
        Posed blocker = at_rest(add(engine.context, cost.mesh), cost.mesh);
        cost.added = std::min(cost.added, double(std::clock() - start) / CLOCKS_PER_SEC);
        blocker.receives = false;
        MeshInfo info;
        EXPECT_TRUE(mesh_info(engine.context, blocker.mesh, &info).ok());
        cost.bytes = double(info.bytes);
        Outputs out;
        cost.frame = std::min(cost.frame, best_ms(engine, {eyes, blocker}, out));
        expect_finite(out);
        EXPECT_TRUE(remove_mesh(engine.context, blocker.mesh).ok());
    };
    Cost plain{make([](Random& r, glm::vec3 c[3]) {
        const glm::vec3 centre = r.direction() * r.between(0.6f, 1);
        for (int k = 0; k < 3; ++k)
            c[k] = centre + r.direction() * 0.02f;
    })};
    const std::pair<const char*, std::function<void(Random&, glm::vec3[3])>> kinds[] = {
        {"ribbons",
         [](Random& r, glm::vec3 c[3]) {
             c[0] = r.direction() * r.between(0.6f, 1);
             c[1] = c[0] + r.direction() * 0.1f;
             c[2] = c[0] + r.direction() * 1e-4f;
         }},
        {"coincident layers",
         [](Random&, glm::vec3 c[3]) {
             c[0] = {1, 0, 0}, c[1] = {0, 1, 0}, c[2] = {0, 0, 1};
         }},
        {"dust", [](Random& r, glm::vec3 c[3]) {
             const glm::vec3 centre = r.direction() * r.between(0.6f, 1);
             for (int k = 0; k < 3; ++k)
                 c[k] = centre + r.direction() * 1e-6f;
         }}};
    for (const auto& [name, kind] : kinds) {
        Cost cost{make(kind)};
        const auto dear = [&] { return cost.added > 1.2 * plain.added || cost.frame > 1.2 * plain.frame; };
        const int rounds = count > 10000 ? 3 : 10;
        for (int round = 0; round < rounds || (dear() && round < 10 * rounds); ++round) {
            measure(plain);
            measure(cost);
        }
        const std::string what = "G15 " + std::to_string(count) + " " + name + " against plain triangles: ";
        figure(what + "memory", cost.bytes / plain.bytes, "times");
        figure(what + "time to add", cost.added / plain.added, "times");
        figure(what + "time of a frame", cost.frame / plain.frame, "times");
        EXPECT_LE(cost.bytes, 1.2 * plain.bytes) << name;
        EXPECT_LE(cost.added, 1.2 * plain.added) << name;
        EXPECT_LE(cost.frame, 1.2 * plain.frame) << name;
    }
}

TEST(Hostile, G15RibbonsLayersDust) {
    expect_the_cost_of_ordinary_triangles(2000);
    if (stress_cases() >= 20000) expect_the_cost_of_ordinary_triangles(100000);
}

// G16's numbers: of every third all bits are random.
float any_number(Random& random) {
    if (random.below(3)) return random.between(-1, 1);
    return std::bit_cast<float>(uint32_t(random.engine()));
}

bool finite(const glm::vec3& p) {
    return std::isfinite(p.x) && std::isfinite(p.y) && std::isfinite(p.z);
}

// What the counters of a frame of garbage must be: an oracle that knows the meshes and their pose alone. A
// triangle is none from the start where two of its corners are one, or a corner is no number; in a frame it
// is left out where a corner is no number in the pose, in the frame's space, as a receiver is there or where
// its normal is none.
struct Left {
    std::vector<uint32_t> degenerate; // of each mesh
    uint32_t triangles = 0, receivers = 0;
};
Left left_out(const std::vector<scenes::Mesh>& meshes, const std::vector<Posed>& frame) {
    glm::vec3 origin(0);
    bool found = false;
    for (const Posed& mesh : frame) {
        for (const glm::vec3& p : mesh.positions) {
            if (!found && finite(p)) origin = p;
            found = found || finite(p);
        }
    }
    float largest = 0; // that is finite in size, and what brings it to 1
    for (const Posed& mesh : frame) {
        for (const glm::vec3& p : mesh.positions) {
            for (int k = 0; k < 3; ++k) {
                const float size = std::fabs(p[k] - origin[k]);
                if (std::isfinite(size)) largest = std::max(largest, size);
            }
        }
    }
    int exponent = 0;
    std::frexp(largest, &exponent);
    const float scale = std::ldexp(1.0f, std::clamp(-exponent, -126, 126));
    Left left;
    for (size_t m = 0; m < meshes.size(); ++m) {
        const scenes::Mesh& mesh = meshes[m];
        std::vector<uint8_t> placed;
        for (size_t v = 0; v < frame[m].positions.size(); ++v) {
            placed.push_back(finite((frame[m].positions[v] - origin) * scale));
            const glm::vec3 n = frame[m].normals[v];
            left.receivers += !(placed[v] && finite(n) && n != glm::vec3(0));
        }
        uint32_t degenerate = 0;
        for (size_t i = 0; i < mesh.indices.size(); i += 3) {
            const uint32_t* const corner = &mesh.indices[i];
            const glm::vec3 a = mesh.rest_positions[corner[0]], b = mesh.rest_positions[corner[1]],
                            c = mesh.rest_positions[corner[2]];
            const bool none = a == b || b == c || c == a || !finite(a) || !finite(b) || !finite(c);
            degenerate += none;
            left.triangles += !none && !(placed[corner[0]] && placed[corner[1]] && placed[corner[2]]);
        }
        left.degenerate.push_back(degenerate);
    }
    return left;
}

// G16. Random bits for coordinates, random indices: every instruction set gives the same finite bits, and
// counts the triangles and receivers that it left out as an oracle does. In every second scene the meshes are
// sound as they are added, and their pose is not; each quality has its turns.
TEST(Hostile, G16GarbageScenes) {
    const uint64_t scenes_wanted = stress_cases() >= 20000 ? 1000 : 64;
    constexpr Quality qualities[] = {Quality::standard, Quality::draft, Quality::standard, Quality::paper,
                                     Quality::standard, Quality::fine,  Quality::standard, Quality::draft};
    std::vector<std::unique_ptr<Engine>> engines;
    for (const Isa isa : available_isas())
        engines.push_back(std::make_unique<Engine>(with_isa(isa)));
    uint64_t bits = 0, bad_triangles = 0, bad_receivers = 0;
    for (uint64_t seed = 0; seed < scenes_wanted; ++seed) {
        SCOPED_TRACE("scene " + std::to_string(seed) + ", seed " + std::to_string(stress_seed()));
        Random random(stress_seed() * 11 + seed);
        const bool sound = seed / 8 % 2;
        std::vector<scenes::Mesh> meshes(1 + random.below(20));
        std::vector<Posed> frame(meshes.size());
        for (size_t m = 0; m < meshes.size(); ++m) {
            const uint32_t count = 1 + random.below(64);
            for (uint32_t v = 0; v < count; ++v) {
                const auto garbage = [&] {
                    return glm::vec3(any_number(random), any_number(random), any_number(random));
                };
                frame[m].positions.push_back(garbage());
                frame[m].normals.push_back(garbage());
                meshes[m].rest_positions.push_back(sound ? random.direction() : frame[m].positions[v]);
                meshes[m].rest_normals.push_back(sound ? random.direction() : frame[m].normals[v]);
            }
            const uint32_t triangles = random.below(257);
            for (uint32_t i = 0; i < 3 * triangles; ++i)
                meshes[m].indices.push_back(random.below(32) ? std::min(i % count, count - 1)
                                                             : random.below(count));
        }
        const Left left = left_out(meshes, frame);
        Outputs first;
        for (const auto& engine : engines) {
            for (size_t m = 0; m < meshes.size(); ++m) {
                frame[m].mesh = add(engine->context, meshes[m]);
                MeshInfo info;
                ASSERT_TRUE(mesh_info(engine->context, frame[m].mesh, &info).ok());
                ASSERT_EQ(info.degenerate_triangles, left.degenerate[m]);
            }
            const Outputs out = run_frame(engine->context, frame, qualities[seed % 8]);
            for (const Posed& mesh : frame)
                ASSERT_TRUE(remove_mesh(engine->context, mesh.mesh).ok());
            expect_finite(out);
            if (engine == engines[0]) first = out;
            ASSERT_EQ(out, first) << isa_name(context_isa(engine->context));
            ASSERT_EQ(out.stats.triangles_invalid, first.stats.triangles_invalid);
            if (qualities[seed % 8] != Quality::paper) { // which counts those of a coarse mesh
                ASSERT_EQ(out.stats.triangles_invalid, left.triangles);
            }
            ASSERT_EQ(out.stats.receivers_copied, 0u);
            ASSERT_EQ(out.stats.receivers_invalid, left.receivers);
        }
        bad_triangles += left.triangles;
        bad_receivers += left.receivers;
        for (size_t m = 0; m < meshes.size(); ++m) {
            for (size_t v = 0; v < frame[m].positions.size(); ++v) {
                const glm::vec3 p = frame[m].positions[v], n = frame[m].normals[v];
                if (finite(p) && finite(n) && n != glm::vec3(0)) continue;
                for (const float t : first.meshes[m].transfer[v])
                    ASSERT_EQ(t, 0.0f);
            }
        }
        for (const Output& mesh : first.meshes) {
            for (const uint32_t word : mesh.masks)
                bits += uint64_t(std::popcount(word));
        }
    }
    EXPECT_GT(bits, 0u);
    EXPECT_GT(bad_triangles, scenes_wanted);
    EXPECT_GT(bad_receivers, scenes_wanted);
    figure("G16 garbage scenes on every instruction set", double(scenes_wanted), "scenes");
    figure("G16 triangles left out of these, as an oracle counts", double(bad_triangles), "triangles");
    figure("G16 receivers of these that are none, as an oracle counts", double(bad_receivers), "receivers");
}

// G17. Counts that lie: refused before an index is read or anything is asked of the allocator.
TEST(Hostile, G17CountsThatLie) {
    uint64_t requests = 0;
    ContextDesc desc;
    desc.allocator = {&requests,
                      [](void* user, size_t size, size_t alignment) -> void* {
                          ++*static_cast<uint64_t*>(user);
                          return std::aligned_alloc(alignment,
                                                    (size + alignment - 1) / alignment * alignment);
                      },
                      [](void*, void* memory, size_t, size_t) { std::free(memory); }};
    Engine engine(desc);
    const float positions[9] = {0, 0, 0, 1, 0, 0, 0, 1, 0};
    const uint32_t indices[3] = {0, 1, 2};
    const uint64_t before = requests;
    MeshId id;
    MeshMemory memory;
    for (const size_t count : {size_t(3) << 27, size_t(3) << 31, size_t(3) << 62, ~size_t(0) / 3 * 3}) {
        const MeshDesc lie{{positions, 3, 12}, {}, indices, count + 3};
        EXPECT_EQ(add_mesh(engine.context, lie, &id).code, StatusCode::invalid_argument) << count;
        EXPECT_EQ(mesh_memory_bound(engine.context, lie, &memory).code, StatusCode::invalid_argument)
            << count;
    }
    for (const size_t count : {(size_t(1) << 27) + 1, size_t(1) << 32, size_t(1) << 61, ~size_t(0)}) {
        const MeshDesc lie{{positions, count, 12}, {}, indices, 3};
        EXPECT_EQ(add_mesh(engine.context, lie, &id).code, StatusCode::invalid_argument) << count;
        EXPECT_EQ(mesh_memory_bound(engine.context, lie, &memory).code, StatusCode::invalid_argument)
            << count;
    }
    EXPECT_EQ(requests, before);
}

#if !defined(NUSSELT_SANITIZED)
// G17. As many triangles as a mesh may have, 2^27, in an index array of a gigabyte and a half of which no
// page is there: all are looked at, and none is one. Where the host has less memory, that is the answer, and
// nothing is kept.
TEST(Hostile, G17AsManyTrianglesAsAMeshMayHave) {
    if (stress_cases() < 20000) GTEST_SKIP() << "two seconds: in the stress run";
    struct Host {
        size_t held = 0, most = SIZE_MAX;
    } host;
    ContextDesc desc;
    desc.allocator = {&host,
                      [](void* user, size_t size, size_t alignment) -> void* {
                          Host& self = *static_cast<Host*>(user);
                          if (size > self.most) return nullptr;
                          self.held += size;
                          return std::aligned_alloc(alignment,
                                                    (size + alignment - 1) / alignment * alignment);
                      },
                      [](void* user, void* memory, size_t size, size_t) {
                          static_cast<Host*>(user)->held -= size;
                          std::free(memory);
                      }};
    Engine engine(desc);
    constexpr size_t count = size_t(3) << 27;
    void* const zeros =
        mmap(nullptr, count * 4, PROT_READ, MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
    ASSERT_NE(zeros, MAP_FAILED);
    const float positions[9] = {0, 0, 0, 1, 0, 0, 0, 1, 0};
    const auto unmap = [](void* memory) { munmap(memory, count * 4); };
    const std::unique_ptr<void, decltype(unmap)> mapped(zeros, unmap);
    const MeshDesc most{{positions, 3, 12}, {}, static_cast<const uint32_t*>(zeros), count};
    const size_t before = host.held;
    MeshId id;
    host.most = 64 << 20;
    EXPECT_EQ(add_mesh(engine.context, most, &id).code, StatusCode::out_of_memory);
    EXPECT_EQ(host.held, before);
    host.most = SIZE_MAX;
    ASSERT_TRUE(add_mesh(engine.context, most, &id).ok());
    MeshInfo info;
    ASSERT_TRUE(mesh_info(engine.context, id, &info).ok());
    EXPECT_EQ(info.degenerate_triangles, 1u << 27);
    EXPECT_LT(host.held - before, 1u << 20);
    EXPECT_TRUE(remove_mesh(engine.context, id).ok());
}
#endif

// G17. A large mesh, ten million triangles in the stress run: memory by the triangle, and a frame with it.
TEST(Hostile, G17MemoryOfALargeMesh) {
    struct Held {
        std::atomic<size_t> now{0}, peak{0};
    } held;
    ContextDesc desc;
    desc.allocator = {
        &held,
        [](void* user, size_t size, size_t alignment) -> void* {
            Held& h = *static_cast<Held*>(user);
            const size_t now = h.now += size;
            for (size_t peak = h.peak; peak < now && !h.peak.compare_exchange_weak(peak, now);) {
            }
            return std::aligned_alloc(alignment, (size + alignment - 1) / alignment * alignment);
        },
        [](void* user, void* memory, size_t size, size_t) {
            static_cast<Held*>(user)->now -= size;
            std::free(memory);
        }};
    Engine engine(desc);
    const bool all = stress_cases() >= 20000;
    const scenes::Mesh mesh = scenes::torus(1, 0.4f, all ? 3200 : 200, all ? 1600 : 200);
    const double triangles = double(mesh.indices.size() / 3);
    const size_t before = held.now;
    const MeshId id = add(engine.context, mesh);
    MeshInfo info;
    ASSERT_TRUE(mesh_info(engine.context, id, &info).ok());
    ASSERT_EQ(double(info.triangles), triangles);
    const double each = double(held.now - before) / triangles, most = double(held.peak - before) / triangles;
    figure("G17 triangles of the largest mesh", triangles, "");
    figure("G17 memory of a mesh, levels and receivers included", each, "bytes a triangle");
    figure("G17 memory at most while it is added", most, "bytes a triangle");
    EXPECT_LE(each, 300); // the catalogue's 80 + 256 / 2 a receiver, and the levels
    EXPECT_LE(most, 464);

    const scenes::Mesh eyes = points({{0, 0, 0}, {0, 0, 0}}, {{1, 0, 0}, {0, 0, 1}});
    Posed blocker = at_rest(id, mesh);
    blocker.receives = false;
    const Outputs out = run_frame(engine.context, {at_rest(add(engine.context, eyes), eyes), blocker});
    const double with_frame = double(held.now - before) / triangles;
    figure("G17 memory of the mesh and a frame", with_frame, "bytes a triangle");
    expect_finite(out);
    EXPECT_GT(blocked_bits(out.meshes[0], 0) + blocked_bits(out.meshes[0], 1), 100u);
    EXPECT_LE(with_frame, 300);
}

} // namespace

} // namespace nusselt::test
