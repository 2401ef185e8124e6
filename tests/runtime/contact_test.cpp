// Receivers that lie in a surface other than their own triangles', or in the corner between two of them.
#include "tests/runtime/fixture.h"

#include <glm/geometric.hpp>
#include <glm/gtc/matrix_transform.hpp>
#include <glm/mat3x3.hpp>

#include <cmath>

namespace nusselt::test {

namespace {

using scenes::Mesh;

glm::mat3 random_rotation(Random& random) {
    const glm::vec3 axis =
        glm::normalize(glm::vec3(random.between(-1, 1), random.between(-1, 1), random.between(0.1f, 1)));
    return glm::mat3(glm::rotate(glm::mat4(1), random.between(0, 6.2f), axis));
}

Mesh turned(Mesh mesh, const glm::mat3& by) {
    for (glm::vec3& p : mesh.rest_positions)
        p = by * p;
    for (glm::vec3& n : mesh.rest_normals)
        n = by * n;
    return mesh;
}

void add_quad(const glm::vec3& a, const glm::vec3& b, const glm::vec3& c, const glm::vec3& d, Mesh& mesh) {
    const uint32_t first = static_cast<uint32_t>(mesh.rest_positions.size());
    const glm::vec3 normal = glm::normalize(glm::cross(b - a, d - a));
    for (const glm::vec3& p : {a, b, c, d}) {
        mesh.rest_positions.push_back(p);
        mesh.rest_normals.push_back(normal);
    }
    for (const uint32_t i : {0u, 1u, 2u, 0u, 2u, 3u})
        mesh.indices.push_back(first + i);
}

void add_triangle(const glm::vec3& a, const glm::vec3& b, const glm::vec3& c, Mesh& mesh) {
    for (const glm::vec3& p : {a, b, c}) {
        mesh.indices.push_back(static_cast<uint32_t>(mesh.rest_positions.size()));
        mesh.rest_positions.push_back(p);
        mesh.rest_normals.push_back(glm::normalize(glm::cross(b - a, c - a)));
    }
}

// A stair of two steps, solid, in four slices; every face has its own vertices, and its own normal.
Mesh stair() {
    const glm::vec2 profile[] = {{0, 0}, {2, 0}, {2, 1}, {1, 1}, {1, 2}, {0, 2}};
    Mesh mesh;
    for (int slice = 0; slice < 4; ++slice) {
        const float y = float(slice);
        for (int i = 0; i < 6; ++i) {
            const glm::vec2 p = profile[i], q = profile[(i + 1) % 6];
            add_quad({p.x, y, p.y}, {p.x, y + 1, p.y}, {q.x, y + 1, q.y}, {q.x, y, q.y}, mesh);
        }
    }
    for (const float y : {0.0f, 4.0f}) {
        const auto at = [&](int i) { return glm::vec3(profile[i].x, y, profile[i].y); };
        const auto cap = [&](int a, int b, int c, int d) {
            if (y == 0)
                add_quad(at(a), at(b), at(c), at(d), mesh);
            else
                add_quad(at(d), at(c), at(b), at(a), mesh);
        };
        cap(0, 1, 2, 3);
        cap(0, 3, 4, 5);
    }
    return mesh;
}

// The wall over the lower step stands upright on the receivers at its foot, and hides what is behind it: half
// of the hemisphere. However the rounding tilts it.
TEST(Contact, AtTheFootOfAnUprightWall) {
    Engine engine;
    const Mesh upright = stair();
    for (uint64_t seed = 0; seed < 40; ++seed) {
        Random random(seed);
        const Mesh mesh = turned(upright, random_rotation(random));
        const Outputs out = run_at_rest(engine.context, {mesh});
        uint32_t found = 0;
        for (size_t v = 0; v < upright.rest_positions.size(); ++v) {
            const glm::vec3 &p = upright.rest_positions[v], &n = upright.rest_normals[v];
            if (p.x != 1 || p.z != 1 || p.y < 0.5f || p.y > 3.5f) continue;
            // On the step the wall behind it, on the wall the step below it.
            EXPECT_NEAR(blocked_bits(out.meshes[0], v), 512, 24)
                << seed << " " << v << " " << n.x << " " << n.z;
            ++found;
        }
        EXPECT_EQ(out.stats.receivers_inside, 0u);
        EXPECT_EQ(found, 12u);
        for (size_t v = 0; v < upright.rest_positions.size(); ++v) {
            const glm::vec3& p = upright.rest_positions[v];
            if (p.x == 1 && p.z == 1) continue;
            const bool above_step = p.z == 1 && upright.rest_normals[v].z == 1;
            if (!above_step) {
                EXPECT_LE(blocked_bits(out.meshes[0], v), p.x == 1 ? 512u : 24u) << seed << " " << v;
            }
        }
    }
}

// A sheet that stands upright on its own corner, but for rounding, hides nothing: it is seen edge-on. To
// whichever side it leaned, a quarter of the hemisphere was under it.
TEST(Contact, AnUprightSheetHidesNothingFromItsFoot) {
    Engine engine;
    for (uint64_t seed = 0; seed < 200; ++seed) {
        Random random(seed);
        const float lean = random.between(-2e-6f, 2e-6f);
        Mesh sheet;
        sheet.rest_positions = {{0, 0, 0}, {lean, 0, 1}, {0, 1, 0}};
        sheet.rest_normals.assign(3, {0, 0, 1});
        sheet.indices = {0, 1, 2};
        const Outputs out = run_at_rest(engine.context, {turned(sheet, random_rotation(random))});
        EXPECT_LE(blocked_bits(out.meshes[0], 0), 24u) << seed << " " << lean;
    }
}

// How much of the light over a receiver reaches it past all triangles but its own, of 1.
float open_light(const Mesh& mesh, const glm::dvec3& from, const glm::dvec3& normal) {
    constexpr int rings = 16, around = 32;
    const glm::dvec3 x = glm::normalize(
        glm::cross(normal, std::fabs(normal.x) < 0.6 ? glm::dvec3(1, 0, 0) : glm::dvec3(0, 1, 0)));
    const glm::dvec3 y = glm::cross(normal, x);
    int open = 0;
    for (int i = 0; i < rings * around; ++i) {
        const double r = std::sqrt((i / around + 0.5) / rings),
                     turn = (i % around + 0.5) * 6.283185307 / around;
        const glm::dvec3 s = r * std::cos(turn) * x + r * std::sin(turn) * y + std::sqrt(1 - r * r) * normal;
        bool hidden = false;
        for (size_t t = 0; t < mesh.indices.size() && !hidden; t += 3) {
            const auto at = [&](size_t k) {
                return glm::dvec3(mesh.rest_positions[mesh.indices[t + k]]) - from;
            };
            const glm::dvec3 a = at(0), b = at(1), c = at(2), n = glm::cross(b - a, c - a);
            if (a == glm::dvec3(0) || b == glm::dvec3(0) || c == glm::dvec3(0)) continue;
            const double u = glm::dot(s, glm::cross(a, b)), v = glm::dot(s, glm::cross(b, c)),
                         w = glm::dot(s, glm::cross(c, a));
            const bool through = (u > 0 && v > 0 && w > 0) || (u < 0 && v < 0 && w < 0);
            hidden = through && glm::dot(a, n) * glm::dot(s, n) > 0;
        }
        open += !hidden;
    }
    return float(open) / float(rings * around);
}

// A vertex of a sphere moved over its neighbours, so that its triangles lie folded, some inside out. Where
// nothing else hides the sky from it, it is not dark.
TEST(Contact, AFoldedVertexSeesTheSky) {
    Engine engine;
    const Mesh sphere = scenes::sphere(1);
    int seeing = 0;
    for (uint64_t seed = 0; seed < 400; ++seed) {
        Random random(seed);
        Mesh mesh = sphere;
        const size_t v = random.below(uint32_t(mesh.rest_positions.size()));
        const glm::vec3 at = mesh.rest_positions[v];
        glm::vec3 along(random.between(-1, 1), random.between(-1, 1), random.between(-1, 1));
        along = glm::normalize(glm::cross(along, at));
        const glm::vec3 to =
            random.between(0.95f, 1.05f) * glm::normalize(at + random.between(0.3f, 1.2f) * along);
        const glm::vec3 normal = glm::normalize(to + random.between(0, 1) * at);
        for (size_t i = 0; i < mesh.rest_positions.size(); ++i) {
            if (sphere.rest_positions[i] != at) continue;
            mesh.rest_positions[i] = to;
            mesh.rest_normals[i] = normal;
        }
        if (open_light(mesh, glm::dvec3(to), glm::dvec3(normal)) < 0.9f) continue;
        const Outputs out = run_at_rest(engine.context, {mesh});
        EXPECT_LE(blocked_bits(out.meshes[0], v), 800u) << seed;
        ++seeing;
    }
    EXPECT_GT(seeing, 100);
}

// Eight closed tetrahedra with one corner in common, each a little wider than an octant: the triangles there
// fill the whole mask of each receiver, and behind them all is solid. It stays dark. (Boxes that fill their
// octants exactly share edges, four faces each, and are open parts.)
TEST(Contact, ACornerThatClosedPartsFillIsDark) {
    Engine engine;
    for (uint64_t seed = 0; seed < 40; ++seed) {
        Random random(seed);
        const glm::vec3 corner(random.between(-1, 1), random.between(-1, 1), random.between(-1, 1));
        Mesh mesh;
        for (uint32_t octant = 0; octant < 8; ++octant) {
            const glm::vec3 sign(octant & 1 ? 1 : -1, octant & 2 ? 1 : -1, octant & 4 ? 1 : -1);
            glm::vec3 tips[3];
            for (int i = 0; i < 3; ++i) {
                glm::vec3 along(-random.between(0.1f, 0.2f));
                along[i] = 1;
                tips[i] = corner + sign * along;
            }
            if (sign.x * sign.y * sign.z < 0) std::swap(tips[1], tips[2]);
            add_triangle(tips[0], tips[1], tips[2], mesh);
            for (int i = 0; i < 3; ++i)
                add_triangle(corner, tips[(i + 1) % 3], tips[i], mesh);
        }
        const Outputs out = run_at_rest(engine.context, {turned(mesh, random_rotation(random))});
        uint32_t found = 0;
        for (size_t v = 0; v < mesh.rest_positions.size(); ++v) {
            if (mesh.rest_positions[v] != corner) continue;
            EXPECT_EQ(blocked_bits(out.meshes[0], v), 1024u) << seed << " " << v;
            ++found;
        }
        EXPECT_EQ(found, 24u);
    }
}

// A box that stands on a slab, and shares no vertex with it: its sides see the slab up to their lower edge.
TEST(Contact, ABoxOnASlab) {
    Engine engine;
    const Mesh slab = scenes::box({-5, -5, -1}, {6, 7, 0}),
               box = scenes::box({-0.5f, -0.5f, 0}, {0.5f, 0.5f, 1});
    for (uint64_t seed = 0; seed < 40; ++seed) {
        Random random(seed);
        const glm::mat3 rotation = random_rotation(random);
        const Outputs out = run_at_rest(engine.context, {turned(slab, rotation), turned(box, rotation)});
        uint32_t feet = 0;
        for (size_t v = 0; v < box.rest_positions.size(); ++v) {
            if (std::fabs(box.rest_normals[v].z) > 0.5f || box.rest_positions[v].z > 0) continue;
            EXPECT_NEAR(blocked_bits(out.meshes[1], v), 512, 24) << seed << " " << v;
            ++feet;
        }
        EXPECT_EQ(feet, 8u);
    }
}

// A sheet on the slab, too thin to have a height: it sees all of the sky.
TEST(Contact, ADecalIsNotDarkened) {
    Engine engine;
    const glm::mat3 upwards(glm::vec3(1, 0, 0), glm::vec3(0, 0, 1), glm::vec3(0, -1, 0)); // y to z
    const Mesh slab = scenes::box({-5, -5, -1}, {6, 7, 0}), decal = turned(scenes::plane(2, 6), upwards);
    for (uint64_t seed = 0; seed < 40; ++seed) {
        Random random(seed);
        const glm::mat3 rotation = random_rotation(random);
        const Outputs out = run_at_rest(engine.context, {turned(slab, rotation), turned(decal, rotation)});
        for (size_t v = 0; v < decal.rest_positions.size(); ++v)
            EXPECT_LE(blocked_bits(out.meshes[1], v), 12u) << seed << " " << v;
    }
}

// An open floor hides what is under it too.
TEST(Contact, ABoxOnAnOpenFloor) {
    Engine engine;
    Mesh floor;
    add_quad({-5, -5, 0}, {6, -5, 0}, {6, 7, 0}, {-5, 7, 0}, floor);
    const Mesh box = scenes::box({-0.5f, -0.5f, 0}, {0.5f, 0.5f, 1});
    const Outputs out = run_at_rest(engine.context, {floor, box});
    for (size_t v = 0; v < box.rest_positions.size(); ++v) {
        if (std::fabs(box.rest_normals[v].z) > 0.5f || box.rest_positions[v].z > 0) continue;
        EXPECT_NEAR(blocked_bits(out.meshes[1], v), 512, 24) << v;
    }
}

} // namespace

} // namespace nusselt::test
