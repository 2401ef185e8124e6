// The reference against closed forms: what it gets wrong, every error figure gets wrong.
#include "tools/trace/sh.h"
#include "tools/trace/trace.h"

#include <glm/geometric.hpp>
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <random>

namespace nusselt::tools {
namespace {

constexpr double pi = std::numbers::pi;

struct Builder {
    Assembly all;

    uint32_t vertex(const glm::vec3& position, const glm::vec3& normal = {0, 0, 1}) {
        all.positions.push_back(position);
        all.normals.push_back(normal);
        all.albedo.emplace_back(1);
        return static_cast<uint32_t>(all.positions.size() - 1);
    }
    void triangle(uint32_t a, uint32_t b, uint32_t c) { all.indices.insert(all.indices.end(), {a, b, c}); }
    void quad(const glm::vec3& a, const glm::vec3& b, const glm::vec3& c, const glm::vec3& d) {
        const uint32_t first = vertex(a);
        vertex(b);
        vertex(c);
        vertex(d);
        triangle(first, first + 1, first + 2);
        triangle(first, first + 2, first + 3);
    }
    // Vertex normals point outward.
    void sphere(const glm::vec3& center, float radius, uint32_t rings = 48) {
        const auto first = static_cast<uint32_t>(all.positions.size());
        const uint32_t around = 2 * rings;
        for (uint32_t ring = 0; ring <= rings; ++ring) {
            for (uint32_t k = 0; k < around; ++k) {
                const double t = pi * ring / rings, p = 2 * pi * k / around;
                const glm::vec3 n(std::sin(t) * std::cos(p), std::sin(t) * std::sin(p), std::cos(t));
                vertex(center + radius * n, n);
            }
        }
        for (uint32_t ring = 0; ring < rings; ++ring) {
            for (uint32_t k = 0; k < around; ++k) {
                const uint32_t a = first + ring * around + k, b = first + ring * around + (k + 1) % around;
                triangle(a, a + around, b + around);
                triangle(a, b + around, b);
            }
        }
    }
    TraceResult trace(TraceOptions options = {}) const {
        return trace_transfer(make_trace_scene(all), all, options);
    }
};

double seen(const TraceResult& result, size_t vertex = 0) {
    return seen_part(&result.transfer[vertex * 25]);
}

TEST(Sh, BasisIsOrthonormal) {
    // Midpoint rule: exact in phi for these degrees, second order in theta.
    double gram[25][25] = {};
    constexpr int rows = 400, columns = 32;
    for (int j = 0; j < rows; ++j) {
        for (int k = 0; k < columns; ++k) {
            const double z = -1 + 2 * (j + 0.5) / rows, r = std::sqrt(1 - z * z),
                         p = 2 * pi * (k + 0.5) / columns;
            double y[25];
            sh_basis(r * std::cos(p), r * std::sin(p), z, y);
            for (int a = 0; a < 25; ++a)
                for (int b = 0; b < 25; ++b)
                    gram[a][b] += y[a] * y[b] * 4 * pi / (rows * columns);
        }
    }
    for (int a = 0; a < 25; ++a)
        for (int b = 0; b < 25; ++b)
            EXPECT_NEAR(gram[a][b], a == b, 2e-4) << a << ' ' << b;
}

TEST(Sh, OpenTransferHasItsClosedForm) {
    double open[25];
    open_transfer(0, 0, 1, open);
    EXPECT_NEAR(open[0] * pi, 0.886227, 1e-6);
    EXPECT_NEAR(open[2] * pi, 1.023327, 1e-6);
    EXPECT_NEAR(open[6] * pi, 0.495416, 1e-6);
    EXPECT_NEAR(open[12] * pi, 0, 1e-12);
    EXPECT_NEAR(open[20] * pi, -0.110778, 1e-6);
}

TEST(Trace, NothingThereIsOpen) {
    Builder scene;
    const glm::vec3 normal = glm::normalize(glm::vec3(0.3f, -0.8f, 0.4f));
    scene.vertex({5, 6, 7}, normal);
    const TraceResult result = scene.trace();
    double open[25];
    open_transfer(normal.x, normal.y, normal.z, open);
    for (int i = 0; i < 25; ++i)
        EXPECT_NEAR(result.transfer[i], open[i], 1e-6);
}

// Of a ceiling at height 1 what is nearer than r hides 1 - 1 / r^2; a fade hides the mean of that.
TEST(Trace, FadesWithDistance) {
    Builder scene;
    scene.vertex({0, 0, 0});
    scene.quad({-1e3f, -1e3f, 1}, {-1e3f, 1e3f, 1}, {1e3f, 1e3f, 1}, {1e3f, -1e3f, 1});
    const auto hidden = [](double r) { return r > 1 ? 1 - 1 / (r * r) : 0; };
    for (const auto& [from, to] : {std::pair(0.0, 2.0), std::pair(1.5, 4.0), std::pair(2.0, 2.0)}) {
        double sum = 0;
        for (int i = 0; i < 4000; ++i) {
            const double t = (i + 0.5) / 4000;
            sum += 6 * t * (1 - t) * hidden(from + (to - from) * t) / 4000;
        }
        EXPECT_NEAR(seen(scene.trace({.rays = 16384, .fade_from = from, .fade_to = to})), 1 - sum, 2e-3)
            << from << " " << to;
    }
    EXPECT_EQ(scene.trace({.fade_from = 1e9, .fade_to = 1e9}).transfer, scene.trace().transfer);
}

TEST(Trace, TangentWallHidesHalf) {
    for (const float angle : {0.0f, 0.4f, 2.0f, 5.0f}) {
        Builder scene;
        scene.vertex({0, 0, 0});
        const glm::vec3 out(std::cos(angle), std::sin(angle), 0), along(-out.y, out.x, 0), up(0, 0, 1);
        const glm::vec3 foot = 1e-4f * out;
        scene.quad(foot - 1e3f * along - 1e3f * up, foot + 1e3f * along - 1e3f * up,
                   foot + 1e3f * along + 1e3f * up, foot - 1e3f * along + 1e3f * up);
        EXPECT_NEAR(seen(scene.trace()), 0.5, 0.004) << angle;
    }
}

TEST(Trace, EnclosedSeesNothing) {
    Builder scene;
    scene.vertex({0.1f, 0.2f, -0.1f});
    scene.sphere({0, 0, 0}, 1);
    const TraceResult result = scene.trace({.rays = 4096});
    for (int i = 0; i < 25; ++i)
        EXPECT_EQ(result.transfer[i], 0.0f);
}

TEST(Trace, SphereHidesItsFormFactor) {
    for (const double angle : {0.0, 0.5, 1.0}) {
        Builder scene;
        scene.vertex({0, 0, 0});
        scene.sphere({static_cast<float>(3 * std::sin(angle)), 0, static_cast<float>(3 * std::cos(angle))},
                     1);
        EXPECT_NEAR(seen(scene.trace({.rays = 4096})), 1 - std::cos(angle) / 9, 0.002) << angle;
    }
}

TEST(Trace, FaceOverheadHidesItsZonalHarmonics) {
    // A cap of half-angle a about the normal, here a distant disc: the integral of each zonal function.
    Builder scene;
    scene.vertex({0, 0, 0});
    const uint32_t center = scene.vertex({0, 0, 1});
    constexpr uint32_t around = 256;
    const double radius = std::tan(0.6);
    for (uint32_t k = 0; k < around; ++k) {
        const double p = 2 * pi * k / around;
        scene.vertex(
            {static_cast<float>(radius * std::cos(p)), static_cast<float>(radius * std::sin(p)), 1.0f});
    }
    for (uint32_t k = 0; k < around; ++k)
        scene.triangle(center, center + 1 + k, center + 1 + (k + 1) % around);
    const TraceResult result = scene.trace({.rays = 16384});
    const double c = std::cos(0.6);
    double open[25];
    open_transfer(0, 0, 1, open);
    const double hidden[3] = {(1 - c * c) / 2, (1 - c * c * c) / 3,
                              3 * (1 - c * c * c * c) / 8 - (1 - c * c) / 4};
    const double scale[3] = {0.28209479, 0.48860251, 0.63078313};
    const int term[3] = {0, 2, 6};
    for (int l = 0; l < 3; ++l)
        EXPECT_NEAR(result.transfer[term[l]], open[term[l]] - 2 * hidden[l] * scale[l], 0.0015) << l;
}

TEST(Trace, BackFacesBlockUnlessLeftOut) {
    Builder scene;
    scene.vertex({0, 0, 0});
    // From below a sphere shows its front; a lid whose front looks up shows its back.
    scene.quad({-50, -50, 1}, {50, -50, 1}, {50, 50, 1}, {-50, 50, 1});
    EXPECT_LT(seen(scene.trace()), 0.01);
    EXPECT_GT(seen(scene.trace({.facing = Facing::front})), 0.99);
}

TEST(Fan, PitHidesWhatLiesBelowItsRim) {
    for (const double elevation : {-0.3, 0.0, 0.3, 0.9}) {
        Builder scene;
        const uint32_t bottom = scene.vertex({0, 0, 0});
        constexpr uint32_t around = 96;
        for (uint32_t k = 0; k < around; ++k) {
            const double p = 2 * pi * k / around;
            scene.vertex({static_cast<float>(std::cos(p) * std::cos(elevation)),
                          static_cast<float>(std::sin(p) * std::cos(elevation)),
                          static_cast<float>(std::sin(elevation))});
        }
        for (uint32_t k = 0; k < around; ++k)
            scene.triangle(bottom, 1 + k, 1 + (k + 1) % around);
        const double sky = elevation > 0 ? std::cos(elevation) * std::cos(elevation) : 1;
        EXPECT_NEAR(seen(scene.trace()), sky, 0.004) << elevation;

        // Half a ring leaves the other half alone.
        scene.all.indices.resize(around / 2 * 3);
        EXPECT_NEAR(seen(scene.trace()), (1 + sky) / 2, 0.004) << elevation;
    }
}

TEST(Fan, AgreesWithRaysFromAHairAbove) {
    std::mt19937 random(7);
    std::uniform_real_distribution<double> value(-1, 1);
    const auto direction = [&] {
        for (;;) {
            const glm::dvec3 d(value(random), value(random), value(random));
            if (const double l = glm::length(d); l > 0.1 && l < 1) return d / l;
        }
    };
    int hidden = 0, different = 0;
    constexpr int cases = 20000;
    for (int k = 0; k < cases; ++k) {
        const glm::dvec3 normal = direction(), a = direction(), b = direction();
        glm::dvec3 s = direction();
        if (glm::dot(s, normal) < 0) s = -s;
        Fan fan;
        make_fan(glm::dvec3(0), normal, {a, b}, fan);
        const bool ours = hidden_by(fan, s);
        // Moeller, Trumbore: from 1e-9 along the normal into the triangle (0, a, b).
        const glm::dvec3 origin = 1e-9 * normal, h = glm::cross(s, b);
        const double determinant = glm::dot(a, h);
        const double u = glm::dot(origin, h) / determinant;
        const glm::dvec3 q = glm::cross(origin, a);
        const double v = glm::dot(s, q) / determinant, t = glm::dot(b, q) / determinant;
        const bool hit = u >= 0 && v >= 0 && u + v <= 1 && t > 0;
        hidden += hit;
        different += ours != hit;
    }
    EXPECT_GT(hidden, cases / 50);
    EXPECT_LE(different, 1);
}

// An edge that stands upright but for rounding leans to neither side; one that leans hides a quarter.
TEST(Fan, UprightEdgesHideNothing) {
    const glm::dvec3 normal(0, 0, 1), side(0, 1, 0.01);
    const glm::dvec3 under = glm::normalize(glm::dvec3(0.6, 0.6, 0.3));
    for (const double lean : {1e-3, 1e-6, 0.0, -1e-6}) {
        Fan fan;
        make_fan(glm::dvec3(0), normal, {glm::dvec3(lean, 0, 1), side}, fan);
        EXPECT_EQ(hidden_by(fan, under), lean == 1e-3) << lean;
    }
}

TEST(Trace, ConvexSurfaceIsOpenEverywhere) {
    Builder scene;
    scene.sphere({100, -20, 3}, 0.01f, 24);
    const TraceResult result = scene.trace({.rays = 256});
    for (size_t v = 0; v < scene.all.positions.size(); ++v)
        EXPECT_NEAR(seen(result, v), 1, 1e-6) << v;
}

TEST(Trace, SeedDecidesAndHalvesDiffer) {
    Builder scene;
    scene.vertex({0, 0, 0});
    scene.vertex({0, 0, 0});
    scene.sphere({0.5f, 0, 2}, 1);
    const TraceResult a = scene.trace({.rays = 2048, .seed = 5, .halves = true});
    const TraceResult b = scene.trace({.rays = 2048, .seed = 5, .halves = true});
    EXPECT_EQ(a.transfer, b.transfer);
    EXPECT_NE(a.half[0], a.half[1]);
    for (int i = 0; i < 25; ++i) {
        EXPECT_NEAR(a.transfer[i], (a.half[0][i] + a.half[1][i]) / 2, 1e-6);
        EXPECT_EQ(a.transfer[i], a.transfer[25 + i]); // the second vertex at the same place
    }
    EXPECT_NE(a.transfer, scene.trace({.rays = 2048, .seed = 6}).transfer);
}

TEST(Trace, NoiseOfHalvesIsThatOfTheReference) {
    // 1,024 jittered rays are within a percent or so.
    Builder scene;
    scene.sphere({0, 0, 0}, 1, 12);
    scene.sphere({0, 0, 2.5f}, 1, 12);
    const TraceResult few = scene.trace({.rays = 2048, .halves = true});
    const TransferError error = transfer_error(few.half[0], few.half[1]);
    EXPECT_GT(error.receivers, 400u);
    EXPECT_LT(error.mean, 0.015);
}

TEST(Trace, SpoiledVerticesAffectThemselves) {
    Builder scene;
    scene.vertex({0, 0, 0});
    scene.vertex({NAN, 0, 0});
    scene.vertex({0, 0, 0}, {0, 0, 0});
    scene.vertex({0, 0, 0}, {0, INFINITY, 0});
    const uint32_t a = scene.vertex({1, 0, 1}), b = scene.vertex({0, 1, 1}), c = scene.vertex({NAN, 1, 1});
    scene.triangle(a, b, c);
    const TraceResult result = scene.trace({.rays = 256});
    EXPECT_NEAR(seen(result, 0), 1, 1e-6);
    for (size_t v = 1; v < 4; ++v)
        EXPECT_EQ(seen(result, v), 0) << v;
}

TEST(Trace, CancelStops) {
    Builder scene;
    scene.sphere({0, 0, 0}, 1, 8);
    const std::atomic<bool> cancel{true};
    EXPECT_TRUE(scene.trace({.cancel = &cancel}).cancelled);
}

TEST(Trace, ClearLeavesOutWhatTouches) {
    Builder scene;
    scene.vertex({0, 0, 0}); // free
    scene.vertex({3, 0, 0}); // under a lid that touches it
    scene.quad({2, -1, 1e-5f}, {4, -1, 1e-5f}, {4, 1, 1e-5f}, {2, 1, 1e-5f});
    scene.vertex({3, 0.5f, 1e-5f - 1e-6f}, {0, 0, 1}); // just below the lid: wholly dark, open when lifted
    const Assembly& all = scene.all;
    const TraceScene traced = make_trace_scene(all);
    const auto clear = clear_receivers(trace_transfer(traced, all, {}).transfer,
                                       trace_transfer(traced, all, {.lift = clear_lift}).transfer);
    EXPECT_EQ(clear[0], 1);
    EXPECT_EQ(clear[1], 0);
    EXPECT_EQ(clear[6], 0);
}

TEST(TransferError, IsRelativePerReceiver) {
    std::vector<float> reference(75, 0.0f), ours(75, 0.0f);
    reference[0] = 0.28f;
    ours[0] = 0.28f * 1.1f;
    reference[25] = 0.14f;
    ours[25] = 0.14f;
    ours[26] = 0.14f * 0.3f;
    reference[50] = 0.001f; // sees less than 1 %: not counted
    ours[50] = 1;
    const TransferError error = transfer_error(ours, reference);
    EXPECT_EQ(error.receivers, 2u);
    EXPECT_NEAR(error.mean, 0.2, 1e-5);
    EXPECT_NEAR(error.max, 0.3, 1e-5);
    EXPECT_NEAR(error.pooled, std::sqrt((0.028 * 0.028 + 0.042 * 0.042) / (0.28 * 0.28 + 0.14 * 0.14)), 1e-5);
    EXPECT_EQ(transfer_error(ours, reference, {1, 0, 1}).receivers, 1u);
}

} // namespace
} // namespace nusselt::tools
