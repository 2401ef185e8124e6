// Shapes whose form factor is known, through whole frames: receivers are vertices of a mesh without
// triangles. Level: what is known, a formula in double. Errors in 1024ths of the cosine-weighted hemisphere,
// with masks of 1024 bits and of 4096; each is held to a tenth more than what is reached, which the test
// prints.
#include "tests/runtime/fixture.h"

#include <algorithm>
#include <cmath>

#include <glm/geometric.hpp>
#include <glm/mat3x3.hpp>

namespace nusselt::test {

namespace {

constexpr double pi = 3.14159265358979323846;

// Lambert's formula: the form factor of a polygon wholly above the horizon.
double form_factor(const glm::dvec3& p, const glm::dvec3& n, const std::vector<glm::dvec3>& corners) {
    double sum = 0;
    for (size_t i = 0; i < corners.size(); ++i) {
        const glm::dvec3 a = glm::normalize(corners[i] - p),
                         b = glm::normalize(corners[(i + 1) % corners.size()] - p), c = glm::cross(a, b);
        const double size = glm::length(c);
        if (size > 0) sum += std::atan2(size, glm::dot(a, b)) * glm::dot(c, n) / size;
    }
    return std::fabs(sum) / (2 * pi);
}

glm::mat3 random_frame(Random& random) { // a rotation; columns are the images of the axes
    const glm::vec3 x = random.direction();
    glm::vec3 y = random.direction();
    while (std::fabs(glm::dot(x, y)) > 0.9f)
        y = random.direction();
    const glm::vec3 z = glm::normalize(glm::cross(x, y));
    return {x, glm::cross(z, x), z};
}

struct Errors {
    double sum = 0, squares = 0, most = 0;
    uint32_t count = 0;
    void add(double bits, double exact) { // in bits
        const double e = bits - exact;
        sum += e;
        squares += e * e;
        most = std::max(most, std::fabs(e));
        ++count;
    }
    double mean() const { return sum / count; }
    double rms() const { return std::sqrt(squares / count); }
};

struct Limit {
    double rms, most, mean;
};

// Fine leans more in the mean than standard, by its samples and not by the table: 2.4 of 1024 too many lie
// within nine tenths of the disk's area. What is overhead hides that much more (disc, +0.67), what stands all
// around less (own fan, -0.60, open box, -0.58). Samples counted within exact circles alone give +0.57 and
// -0.58 for the disc and the fan; standard's give -0.01 and -0.04.
// `standard` and `fine`: limits of these qualities. `measure` gives one's errors.
template<class Measure>
void expect_within(const char* what, const Limit& standard, const Limit& fine, const Measure& measure) {
    for (const Quality quality : {Quality::standard, Quality::fine}) {
        const Errors e = measure(quality);
        const Limit& limit = quality == Quality::fine ? fine : standard;
        std::printf("    %s, %s: %u receivers, mean %+.2f rms %.2f most %.1f of 1024\n", what,
                    quality_name(quality), e.count, e.mean(), e.rms(), e.most);
        EXPECT_GE(e.count, 16 * cases(250)) << what;
        EXPECT_LE(e.rms(), limit.rms) << what << ", " << quality_name(quality);
        EXPECT_LE(e.most, limit.most) << what << ", " << quality_name(quality);
        EXPECT_LE(std::fabs(e.mean()), limit.mean) << what << ", " << quality_name(quality);
    }
}

// In 1024ths.
double hidden(const Output& output, size_t vertex, Quality quality) {
    return blocked_bits(output, vertex, quality) * 1024.0 / quality_mask_bits(quality);
}

scenes::Mesh rectangle(const glm::vec3& corner, const glm::vec3& u, const glm::vec3& v) {
    scenes::Mesh mesh;
    mesh.rest_positions = {corner, corner + u, corner + u + v, corner + v};
    mesh.indices = {0, 1, 2, 0, 2, 3};
    mesh.rest_normals.assign(4, glm::normalize(glm::cross(u, v)));
    return mesh;
}

// Whatever its direction: half of the samples lie on each side of any upright plane. With 4096 bits the upper
// edge, a thousandth of a degree off, may take the next cell.
TEST(ClosedForm, TangentWallHidesHalf) {
    Engine engine;
    expect_within("tangent wall", {0, 0, 0}, {0.1, 1.5, 0.02}, [&](Quality quality) {
        Errors errors;
        for (uint64_t seed = 0; seed < cases(250); ++seed) {
            Random random(seed);
            const glm::mat3 frame =
                random_frame(random); // receivers look along z, the wall stands at x = 0.02
            std::vector<glm::vec3> p, n;
            for (int i = 0; i < 16; ++i) {
                p.push_back(frame * glm::vec3(0, random.between(-1, 1), random.between(-1, 1)));
                n.push_back(frame[2]);
            }
            const scenes::Mesh wall = rectangle(frame * glm::vec3(0.02f, -1000, -1000),
                                                frame * glm::vec3(0, 2000, 0), frame * glm::vec3(0, 0, 2000));
            const Outputs out = run_at_rest(engine.context, {points(p, n), wall}, quality);
            for (size_t v = 0; v < p.size(); ++v)
                errors.add(hidden(out.meshes[0], v, quality), 512);
        }
        return errors;
    });
}

// Two walls that meet at a right angle, in any direction about the normal, and a ceiling.
TEST(ClosedForm, TwoWallsHideThreeQuartersAndACeilingAll) {
    Engine engine;
    expect_within("two walls", {2.5, 12, 0.15}, {0.1, 1, 0.02}, [&](Quality quality) {
        Errors errors;
        for (uint64_t seed = 0; seed < cases(250); ++seed) {
            Random random(seed);
            const glm::mat3 frame = random_frame(random);
            std::vector<glm::vec3> p, n;
            for (int i = 0; i < 16; ++i) {
                p.push_back(frame * glm::vec3(0, 0, random.between(-1, 1)));
                n.push_back(frame[2]);
            }
            const glm::vec3 corner = frame * glm::vec3(0.02f, 0.02f, -1000), up = frame[2] * 2000.0f;
            const scenes::Mesh x_wall = rectangle(corner, frame[1] * -2000.0f, up),
                               y_wall = rectangle(corner, frame[0] * -2000.0f, up);
            const scenes::Mesh beside = rectangle(corner, frame[1] * 2000.0f, up),
                               beyond = rectangle(corner, frame[0] * 2000.0f, up);
            const Outputs out =
                run_at_rest(engine.context, {points(p, n), x_wall, y_wall, beside, beyond}, quality);
            for (size_t v = 0; v < p.size(); ++v)
                errors.add(hidden(out.meshes[0], v, quality), 768);
        }
        return errors;
    });
    for (const Quality quality : {Quality::draft, Quality::standard, Quality::fine}) {
        for (uint64_t seed = 0; seed < cases(250); ++seed) {
            Random random(seed);
            const glm::mat3 frame = random_frame(random);
            const scenes::Mesh ceiling =
                rectangle(frame * glm::vec3(-1000, -1000, 0.02f), frame[0] * 2000.0f, frame[1] * 2000.0f);
            const Outputs out =
                run_at_rest(engine.context, {points({glm::vec3(0)}, {frame[2]}), ceiling}, quality);
            ASSERT_EQ(blocked_bits(out.meshes[0], 0, quality), quality_mask_bits(quality)) << seed;
        }
    }
}

TEST(ClosedForm, TiltedHalfSpaces) {
    Engine engine;
    expect_within("tilted half-space", {2.8, 10.5, 0.1}, {1.95, 6, 0.1}, [&](Quality quality) {
        Errors errors;
        for (uint64_t seed = 0; seed < cases(250); ++seed) {
            Random random(seed);
            const glm::mat3 frame =
                random_frame(random); // the wall stands at x = 0.02, receivers look anywhere
            std::vector<glm::vec3> p, n;
            for (int i = 0; i < 16; ++i) {
                p.push_back(frame * glm::vec3(0, random.between(-1, 1), random.between(-1, 1)));
                n.push_back(random.direction());
            }
            const scenes::Mesh wall = rectangle(frame * glm::vec3(0.02f, -1000, -1000),
                                                frame * glm::vec3(0, 2000, 0), frame * glm::vec3(0, 0, 2000));
            const Outputs out = run_at_rest(engine.context, {points(p, n), wall}, quality);
            for (size_t v = 0; v < p.size(); ++v)
                errors.add(hidden(out.meshes[0], v, quality), 512 + 512 * double(glm::dot(n[v], frame[0])));
        }
        return errors;
    });
}

TEST(ClosedForm, WhatIsBelowHidesNothing) {
    Engine engine;
    const scenes::Mesh receiver = points({{0, 0, 0}}, {{0, 0, 1}});
    for (const float height : {0.0f, -1e-6f, -0.1f, -1.0f}) {
        const scenes::Mesh floor = rectangle({-10, -10, height}, {20, 0, 0}, {0, 20, 0});
        EXPECT_EQ(blocked_bits(run_at_rest(engine.context, {receiver, floor}).meshes[0], 0), 0u) << height;
    }
}

// A ring of blockers all around, up to an elevation: it holds the sine's square, and hides nothing below the
// lowest sample (which lies at 9.07 degrees of 1024, and at 6.41 of 4096) and what the table may turn its
// edges by. A turn above the sample it is seen.
TEST(ClosedForm, ARingBelowTheLowestSampleHidesNothing) {
    Engine engine;
    const auto ring_bits = [&](Random& random, float degrees, Quality quality) {
        const glm::mat3 frame = random_frame(random);
        constexpr uint32_t sides = 7; // fewer than 16 triangles have one level
        // It rises the most in the middle of each side.
        const float top = std::tan(degrees * 0.0174532925f) * std::cos(float(pi) / sides);
        scenes::Mesh ring;
        for (uint32_t i = 0; i < sides; ++i) {
            const float angle = float(2 * pi * i / sides);
            for (const float z : {-1.0f, top})
                ring.rest_positions.push_back(frame * glm::vec3(std::cos(angle), std::sin(angle), z));
            const uint32_t a = 2 * i, b = 2 * ((i + 1) % sides);
            ring.indices.insert(ring.indices.end(), {a, b, b + 1, a, b + 1, a + 1});
        }
        scenes::compute_normals(ring.rest_positions, ring.indices, ring.rest_normals);
        const Outputs out = run_at_rest(engine.context, {points({glm::vec3(0)}, {frame[2]}), ring}, quality);
        return blocked_bits(out.meshes[0], 0, quality);
    };
    struct Lowest {
        Quality quality;
        float degrees, turn; // of the sample, and what the table's cells turn an edge by at the most
    };
    for (const Lowest& lowest :
         {Lowest{Quality::draft, 9.07f, 1.12f}, Lowest{Quality::standard, 9.07f, 0.57f},
          Lowest{Quality::fine, 6.41f, 0.57f}}) {
        for (uint64_t seed = 0; seed < cases(500); ++seed) {
            Random random(seed);
            const float below = random.between(0.5f, lowest.degrees - lowest.turn);
            ASSERT_EQ(ring_bits(random, below, lowest.quality), 0u) << below;
            ASSERT_GT(ring_bits(random, lowest.degrees + lowest.turn, lowest.quality), 0u) << seed;
        }
    }
}

TEST(ClosedForm, RandomTriangles) {
    Engine engine;
    // Small triangles grow: their three planes round apart.
    expect_within("triangles", {3.3, 12.8, 0.35}, {2.2, 8.5, 0.35}, [&](Quality quality) {
        Errors errors;
        for (uint64_t seed = 0; seed < cases(400); ++seed) {
            Random random(seed);
            std::vector<glm::vec3> corners;
            for (int k = 0; k < 3; ++k)
                corners.push_back(random.direction() * random.between(0.5f, 2));
            std::vector<glm::vec3> p, n;
            std::vector<double> exact;
            while (p.size() < 16) { // those that have it wholly above their horizon
                const glm::vec3 position = random.direction() * 0.4f, normal = random.direction();
                bool above = true;
                for (const glm::vec3& c : corners)
                    above = above && glm::dot(c - position, normal) > 0.02f;
                if (!above) {
                    if (random.below(400) == 0) break;
                    continue;
                }
                p.push_back(position);
                n.push_back(normal);
                exact.push_back(1024 * form_factor(position, normal, {corners[0], corners[1], corners[2]}));
            }
            if (p.empty()) continue;
            const Outputs out = run_at_rest(engine.context, {points(p, n), soup(corners)}, quality);
            for (size_t v = 0; v < p.size(); ++v)
                errors.add(hidden(out.meshes[0], v, quality), exact[v]);
        }
        return errors;
    });
}

// A receiver in the origin under one blocker for each seed. `make` gives the blocker, and the part of the
// disk that it hides.
template<class Make>
Errors errors_under(Quality quality, const Make& make) {
    Engine engine;
    Errors errors;
    for (uint64_t seed = 0; seed < cases(4000); ++seed) {
        Random random(seed);
        const glm::mat3 frame = random_frame(random);
        double exact = 0;
        const scenes::Mesh blocker = make(random, frame, exact);
        const Outputs out =
            run_at_rest(engine.context, {points({glm::vec3(0)}, {frame[2]}), blocker}, quality);
        errors.add(hidden(out.meshes[0], 0, quality), 1024 * exact);
    }
    return errors;
}

TEST(ClosedForm, RectangleOverItsCorner) {
    const auto make = [](Random& random, const glm::mat3& frame, double& exact) {
        const float a = std::exp(random.between(-1.5f, 1.5f)), b = std::exp(random.between(-1.5f, 1.5f));
        const double x = a, y = b, rx = std::sqrt(1 + x * x), ry = std::sqrt(1 + y * y);
        exact = (x / rx * std::atan(y / rx) + y / ry * std::atan(x / ry)) / (2 * pi);
        return rectangle(frame[2], frame[0] * a, frame[1] * b);
    };
    expect_within("parallel rectangle", {2.5, 13.5, 0.1}, {1.05, 3.5, 0.2},
                  [&](Quality quality) { return errors_under(quality, make); });
}

TEST(ClosedForm, UprightRectangle) {
    const auto make = [](Random& random, const glm::mat3& frame, double& exact) {
        const float height = std::exp(random.between(-1.5f, 1.5f)),
                    width = std::exp(random.between(-1.5f, 1.5f)), away = std::exp(random.between(-1, 1));
        const double slant = std::sqrt(double(height) * height + double(away) * away);
        exact = (std::atan(width / away) - away / slant * std::atan(width / slant)) / (2 * pi);
        return rectangle(frame[0] * away, frame[1] * width, frame[2] * height); // on the tangent plane
    };
    expect_within("upright rectangle", {1.7, 7.8, 0.1}, {0.85, 4.2, 0.15},
                  [&](Quality quality) { return errors_under(quality, make); });
}

// On the floor of a box without a lid, all is hidden but for the opening.
TEST(ClosedForm, OpenBox) {
    Engine engine;
    expect_within("open box", {3.1, 12.6, 0.25}, {2.2, 9, 0.7}, [&](Quality quality) {
        Errors errors;
        for (uint64_t seed = 0; seed < cases(250); ++seed) {
            Random random(seed);
            const glm::mat3 frame = random_frame(random);
            const float x = std::exp(random.between(-1, 1)), y = std::exp(random.between(-1, 1)),
                        top = std::exp(random.between(-1.5f, 1));
            scenes::Mesh walls;
            std::vector<glm::dvec3> opening;
            for (const float z : {-1.0f, top}) {
                for (const glm::vec3& corner :
                     {glm::vec3(0, 0, z), glm::vec3(x, 0, z), glm::vec3(x, y, z), glm::vec3(0, y, z)})
                    walls.rest_positions.push_back(frame * corner);
            }
            for (uint32_t i = 0; i < 4; ++i) {
                const uint32_t next = (i + 1) % 4;
                opening.push_back(glm::dvec3(walls.rest_positions[4 + i]));
                walls.indices.insert(walls.indices.end(), {i, next, next + 4, i, next + 4, i + 4});
            }
            scenes::compute_normals(walls.rest_positions, walls.indices, walls.rest_normals);
            std::vector<glm::vec3> p, n(16, frame[2]);
            for (int i = 0; i < 16; ++i)
                p.push_back(frame *
                            glm::vec3(x * random.between(0.1f, 0.9f), y * random.between(0.1f, 0.9f), 0));
            const Outputs out = run_at_rest(engine.context, {points(p, n), walls}, quality);
            for (size_t v = 0; v < p.size(); ++v) {
                const double open = form_factor(glm::dvec3(p[v]), glm::dvec3(frame[2]), opening);
                errors.add(hidden(out.meshes[0], v, quality), 1024 * (1 - open));
            }
        }
        return errors;
    });
}

TEST(ClosedForm, Disc) {
    const auto make = [](Random& random, const glm::mat3& frame, double& exact) {
        constexpr uint32_t sides = 14; // a fan of fewer than 16 triangles has one level
        const float radius = std::exp(random.between(-2, 1.5f));
        scenes::Mesh disc;
        std::vector<glm::dvec3> rim;
        for (uint32_t i = 0; i < sides; ++i) {
            const float angle = float(2 * pi * i / sides);
            disc.rest_positions.push_back(frame *
                                          glm::vec3(radius * std::cos(angle), radius * std::sin(angle), 1));
            rim.push_back(glm::dvec3(disc.rest_positions.back()));
            if (i >= 2) disc.indices.insert(disc.indices.end(), {0, i - 1, i});
        }
        scenes::compute_normals(disc.rest_positions, disc.indices, disc.rest_normals);
        exact = form_factor({}, glm::dvec3(frame[2]), rim);
        return disc;
    };
    expect_within("disc", {2.5, 11.6, 0.15}, {1.7, 7.5, 0.75},
                  [&](Quality quality) { return errors_under(quality, make); });
}

// S3. A disc straight above, all 25 terms of what it leaves open: the zonal ones are those of a cap in closed
// form, all others are 0. In parts of the first term of the open hemisphere.
TEST(ClosedForm, CapsInAllBands) {
    struct Bound {
        Quality quality;
        double most[5]; // of a term of each band
    };
    constexpr uint32_t sides = 96;
    for (const Bound& bound : {Bound{Quality::standard, {0.011, 0.017, 0.018, 0.0145, 0.014}},
                               Bound{Quality::fine, {0.0065, 0.0085, 0.0075, 0.0065, 0.0065}}}) {
        Engine engine;
        double most[5] = {};
        for (uint64_t seed = 0; seed < cases(400); ++seed) {
            Random random(seed);
            const float radius = std::exp(random.between(-1.5f, 1.2f)), turn = random.between(0, 1);
            scenes::Mesh disc = points({{0, 0, 1}}, {{0, 0, 1}});
            for (uint32_t i = 0; i < sides; ++i) {
                const float angle = float(2 * pi * i / sides) + turn;
                disc.rest_positions.push_back({radius * std::cos(angle), radius * std::sin(angle), 1});
                disc.rest_normals.push_back({0, 0, 1});
                disc.indices.insert(disc.indices.end(), {0, 1 + i, 1 + (i + 1) % sides});
            }
            const Outputs out =
                run_at_rest(engine.context, {points({{0, 0, 0}}, {{0, 0, 1}}), disc}, bound.quality);
            // A disc of the polygon's area.
            const double area = sides / (2 * pi) * std::sin(2 * pi / sides);
            const double c = 1 / std::sqrt(1 + double(radius) * radius * area), c2 = c * c, c4 = c2 * c2;
            const double capped[5] = {(1 - c2) / 2, (1 - c2 * c) / 3, 3 * (1 - c4) / 8 - (1 - c2) / 4,
                                      (c2 * c - c4 * c) / 2,
                                      35 * (1 - c4 * c2) / 48 - 30 * (1 - c4) / 32 + 3 * (1 - c2) / 16};
            const double open[5] = {1.0 / 2, 1.0 / 3, 1.0 / 8, 0, -1.0 / 48};
            for (int l = 0; l < 5; ++l) {
                const double norm = std::sqrt((2 * l + 1) / (4 * pi)); // times 2 pi, over pi
                for (int m = -l; m <= l; ++m) {
                    const double exact = m == 0 ? 2 * norm * (open[l] - capped[l]) : 0.0;
                    const double error = out.meshes[0].transfer[0][size_t(l * (l + 1) + m)] - exact;
                    most[l] = std::max(most[l], std::fabs(error) / std::sqrt(1 / (4 * pi)));
                }
            }
        }
        std::printf("    caps, %s: most %.4f %.4f %.4f %.4f %.4f of the open first term, by band\n",
                    quality_name(bound.quality), most[0], most[1], most[2], most[3], most[4]);
        for (int l = 0; l < 5; ++l)
            EXPECT_LE(most[l], bound.most[l]) << quality_name(bound.quality) << ", band " << l;
    }
}

// Of 1280 triangles, half a percent smaller than what it stands for.
TEST(ClosedForm, Sphere) {
    Engine engine;
    const scenes::Mesh sphere = scenes::sphere(3);
    expect_within("sphere", {3.85, 15.4, 2.8}, {2.3, 10.5, 1.6}, [&](Quality quality) {
        Errors errors;
        for (uint64_t seed = 0; seed < cases(250); ++seed) {
            Random random(seed);
            std::vector<glm::vec3> p, n;
            std::vector<double> exact;
            while (p.size() < 16) {
                const float distance = random.between(1.5f, 8);
                const glm::vec3 position = random.direction() * distance, normal = random.direction();
                const float cosine = glm::dot(normal, -position) / distance;
                if (std::asin(1 / distance) + std::acos(cosine) > 1.5f) continue; // wholly above the horizon
                p.push_back(position);
                n.push_back(normal);
                exact.push_back(1024 * double(cosine) / double(distance * distance));
            }
            const Outputs out = run_at_rest(engine.context, {points(p, n), sphere}, quality);
            for (size_t v = 0; v < p.size(); ++v)
                errors.add(hidden(out.meshes[0], v, quality), exact[v]);
        }
        return errors;
    });
}

// Receivers inside a mesh whose fronts look inward, which no closed part's do: a sheet, with its levels. All
// is hidden, but for what the table's rounding leaves open at vertices, where three planes of each triangle
// round apart, and for small gaps where levels meet, the more the nearer to the wall. Frames that ask for
// watertight masks have none.
TEST(ClosedForm, EnclosureLeaksLittle) {
    struct Leak {
        Quality quality;
        float reach; // of the radius
        double mean;
        uint32_t most; // bits
    };
    Engine engine;
    for (const Leak& limit : {Leak{Quality::standard, 0.4f, 0.1, 4}, Leak{Quality::standard, 0.9f, 1.25, 22},
                              Leak{Quality::fine, 0.4f, 2.9, 42}, Leak{Quality::fine, 0.9f, 6.3, 90}}) {
        const Quality quality = limit.quality;
        const uint32_t bits = quality_mask_bits(quality);
        for (const uint32_t subdivisions : {2u, 3u, 4u, 5u}) {
            scenes::Mesh sphere = scenes::sphere(subdivisions);
            for (size_t i = 0; i < sphere.indices.size(); i += 3)
                std::swap(sphere.indices[i], sphere.indices[i + 1]);
            uint32_t holes = 0, leaking = 0, most = 0, count = 0;
            for (uint64_t seed = 0; seed < 10; ++seed) {
                Random random(seed);
                std::vector<glm::vec3> p, n;
                for (int i = 0; i < 64; ++i) {
                    p.push_back(random.direction() * random.between(0, limit.reach));
                    n.push_back(random.direction());
                }
                const Outputs out = run_at_rest(engine.context, {points(p, n), sphere}, quality);
                for (size_t v = 0; v < p.size(); ++v) {
                    const uint32_t open = bits - blocked_bits(out.meshes[0], v, quality);
                    holes += open;
                    leaking += open > 0;
                    most = std::max(most, open);
                    ++count;
                }
            }
            std::printf(
                "    enclosing sphere of %zu triangles, receivers within %.1f of the radius: %u of %u leak, "
                "mean %.2f most %u bits of %u\n",
                sphere.indices.size() / 3, limit.reach, leaking, count, double(holes) / count, most, bits);
            EXPECT_LE(double(holes) / count, limit.mean) << subdivisions;
            EXPECT_LE(most, limit.most) << subdivisions;
        }
    }
}

// A receiver at the bottom of a cone of its own triangles sees sin^2 of the half-angle: fans are exact up to
// the table, and leave no cracks between neighbours.
TEST(ClosedForm, FansOfTheReceiversOwnTriangles) {
    Engine engine;
    // Cracks between neighbours would show in the mean.
    expect_within("own fan", {3.4, 13.6, 0.1}, {2.6, 9.2, 0.7}, [&](Quality quality) {
        Errors errors;
        for (uint64_t seed = 0; seed < cases(4000); ++seed) {
            Random random(seed);
            const glm::mat3 frame = random_frame(random);
            constexpr uint32_t sides = 12;
            const float rise = random.between(0.2f, 1.2f), turn = random.between(0, 1);
            scenes::Mesh cone;
            cone.rest_positions.push_back(glm::vec3(0));
            std::vector<glm::dvec3> rim;
            for (uint32_t i = 0; i < sides; ++i) {
                const float angle = float(2 * pi * i / sides) + turn;
                cone.rest_positions.push_back(frame * glm::vec3(std::cos(angle) * std::cos(rise),
                                                                std::sin(angle) * std::cos(rise),
                                                                std::sin(rise)));
                rim.push_back(glm::dvec3(cone.rest_positions.back()));
            }
            for (uint32_t i = 0; i < sides; ++i)
                cone.indices.insert(cone.indices.end(), {0, 1 + i, 1 + (i + 1) % sides});
            cone.rest_normals.assign(sides + 1, frame[2]);
            const Outputs out = run_at_rest(engine.context, {cone}, quality);
            errors.add(hidden(out.meshes[0], 0, quality),
                       1024 * (1 - form_factor({}, glm::dvec3(frame[2]), rim)));
        }
        return errors;
    });
}

} // namespace

} // namespace nusselt::test
