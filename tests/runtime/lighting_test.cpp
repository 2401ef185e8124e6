// Environments, rotation and shading through the public functions.
#include "tests/runtime/fixture.h"

#include <cmath>

#include <glm/geometric.hpp>
#include <glm/mat3x3.hpp>

namespace nusselt::test {

namespace {

using Coefficients = std::array<float, 25>;

double value(const Coefficients& c, const glm::dvec3& d) {
    float basis[25];
    sh_evaluate(float(d.x), float(d.y), float(d.z), basis);
    double sum = 0;
    for (int i = 0; i < 25; ++i)
        sum += double(c[size_t(i)]) * double(basis[i]);
    return sum;
}

// Columns are the axes' images.
glm::dmat3 about(const glm::dvec3& axis, double angle) {
    const glm::dvec3 a = glm::normalize(axis);
    const double c = std::cos(angle), s = std::sin(angle);
    glm::dmat3 m;
    for (int i = 0; i < 3; ++i) {
        glm::dvec3 e(0);
        e[i] = 1;
        m[i] = c * e + s * glm::cross(a, e) + (1 - c) * glm::dot(a, e) * a;
    }
    return m;
}

double worst_of_rotation(const glm::dmat3& m, Random& random) {
    float rows[9];
    for (int row = 0; row < 3; ++row) {
        for (int column = 0; column < 3; ++column)
            rows[3 * row + column] = float(m[column][row]);
    }
    Coefficients c, out;
    double before = 0, after = 0, worst = 0;
    for (float& v : c) {
        v = random.between(-1, 1);
        before += double(v) * double(v);
    }
    sh_rotate(rows, c.data(), out.data());
    for (const float v : out)
        after += double(v) * double(v);
    worst = std::fabs(after - before);
    for (int i = 0; i < 20; ++i) {
        const glm::dvec3 s(random.direction());
        worst = std::max(worst, std::fabs(value(out, m * s) - value(c, s)));
    }
    return worst;
}

TEST(ShRotate, RandomRotations) {
    Random random(1);
    for (int i = 0; i < 300; ++i)
        EXPECT_LT(worst_of_rotation(about(glm::dvec3(random.direction()), random.between(0, 6.3f)), random),
                  2e-5)
            << i;
}

TEST(ShRotate, PolesAndTheirNeighbourhood) {
    Random random(2);
    for (const double base : {0.0, 3.14159265358979323846}) {
        for (int i = 0; i < 200; ++i) {
            // z stays, or turns over, or nearly so.
            const double off = i % 4 == 0 ? 0 : std::pow(10, -(i % 16)), turn = random.between(0, 6.3f);
            const glm::dmat3 m = about({0, 0, 1}, turn) * about({std::cos(i), std::sin(i), 0}, base + off) *
                                 about({0, 0, 1}, double(i));
            EXPECT_LT(worst_of_rotation(m, random), 2e-5) << base << " " << off << " " << turn;
        }
    }
    const glm::dmat3 axes[] = {{{1, 0, 0}, {0, -1, 0}, {0, 0, -1}}, {{-1, 0, 0}, {0, 1, 0}, {0, 0, -1}},
                               {{0, 1, 0}, {1, 0, 0}, {0, 0, -1}},  {{0, 1, 0}, {0, 0, 1}, {1, 0, 0}},
                               {{-1, 0, 0}, {0, -1, 0}, {0, 0, 1}}, {{0, 1, 0}, {-1, 0, 0}, {0, 0, 1}}};
    for (const glm::dmat3& m : axes)
        EXPECT_LT(worst_of_rotation(m, random), 1e-5);
}

TEST(ShRotate, IdentityIsExact) {
    Random random(3);
    const float identity[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1};
    Coefficients c, out;
    for (float& v : c)
        v = random.between(-1, 1);
    sh_rotate(identity, c.data(), out.data());
    for (size_t i = 0; i < 25; ++i)
        EXPECT_EQ(out[i], c[i]) << i;
    sh_rotate(identity, c.data(), c.data()); // in place
    EXPECT_EQ(out, c);
}

TEST(ShRotate, ComposesAndKeepsEachBandsEnergy) {
    Random random(4);
    const auto rows_of = [](const glm::dmat3& m) {
        std::array<float, 9> rows;
        for (int i = 0; i < 9; ++i)
            rows[size_t(i)] = float(m[i % 3][i / 3]);
        return rows;
    };
    for (int i = 0; i < 50; ++i) {
        const glm::dmat3 a = about(glm::dvec3(random.direction()), random.between(0, 3)),
                         b = about(glm::dvec3(random.direction()), random.between(0, 3));
        Coefficients c, once, twice, both;
        for (float& v : c)
            v = random.between(-1, 1);
        sh_rotate(rows_of(a).data(), c.data(), once.data());
        sh_rotate(rows_of(b).data(), once.data(), twice.data());
        sh_rotate(rows_of(b * a).data(), c.data(), both.data());
        for (size_t k = 0; k < 25; ++k)
            EXPECT_NEAR(twice[k], both[k], 5e-6);
        for (size_t l = 0; l <= 4; ++l) {
            double before = 0, after = 0;
            for (size_t k = l * l; k < (l + 1) * (l + 1); ++k) {
                before += double(c[k]) * double(c[k]);
                after += double(once[k]) * double(once[k]);
            }
            EXPECT_NEAR(before, after, 1e-6 * (before + 1));
        }
    }
}

TEST(ShProject, ConstantEnvironment) {
    std::vector<float> rgb(3 * 64 * 32);
    for (size_t i = 0; i < rgb.size(); ++i)
        rgb[i] = float(i % 3) + 0.5f;
    float out[75];
    uint64_t bad = 9;
    ASSERT_TRUE(sh_project_latlong(rgb.data(), 64, 32, out, &bad).ok());
    EXPECT_EQ(bad, 0u);
    for (uint32_t c = 0; c < 3; ++c) {
        EXPECT_NEAR(out[c], 3.5449077f * (float(c) + 0.5f), 1e-5f * (float(c) + 1)); // sqrt(4 pi)
        for (uint32_t i = 1; i < 25; ++i)
            EXPECT_NEAR(out[3 * i + c], 0, 0.02f) << i; // pixels' centres stand for their areas
    }
}

TEST(ShProject, OnePixel) {
    constexpr uint32_t width = 64, height = 32;
    Random random(5);
    for (int n = 0; n < 30; ++n) {
        const uint32_t x = random.below(width), y = random.below(height);
        std::vector<float> rgb(3 * width * height);
        rgb[3 * (y * width + x) + 1] = 7;
        float out[75], basis[25];
        ASSERT_TRUE(sh_project_latlong(rgb.data(), width, height, out, nullptr).ok());
        const double p = 2 * M_PI * ((x + 0.5) / width - 0.5), t = M_PI * (y + 0.5) / height;
        sh_evaluate(float(std::sin(t) * std::cos(p)), float(std::cos(t)), float(std::sin(t) * std::sin(p)),
                    basis);
        const double area =
            2 * M_PI / width * (std::cos(M_PI * y / height) - std::cos(M_PI * (y + 1) / height));
        for (uint32_t i = 0; i < 25; ++i) {
            EXPECT_EQ(out[3 * i], 0);
            EXPECT_NEAR(out[3 * i + 1], 7 * area * double(basis[i]), 1e-6);
            EXPECT_EQ(out[3 * i + 2], 0);
        }
    }
}

TEST(ShProject, BadPixelsCountAsZero) {
    std::vector<float> rgb(3 * 8 * 4, 1.0f), clean = rgb;
    const float bad_values[] = {-1, std::nanf(""), INFINITY, -INFINITY};
    for (size_t i = 0; i < 4; ++i) {
        rgb[3 * (5 * i) + i % 3] = bad_values[i];
        for (size_t c = 0; c < 3; ++c)
            clean[3 * (5 * i) + c] = 0;
    }
    float out[75], expected[75];
    uint64_t bad = 0;
    ASSERT_TRUE(sh_project_latlong(rgb.data(), 8, 4, out, &bad).ok());
    ASSERT_TRUE(sh_project_latlong(clean.data(), 8, 4, expected, nullptr).ok());
    EXPECT_EQ(bad, 4u);
    for (int i = 0; i < 75; ++i)
        EXPECT_EQ(out[i], expected[i]);
}

// S8. Pixels as bright as floats go, and worse: finite light, and told.
TEST(ShProject, RadianceOutOfRangeIsClampedAndTold) {
    Engine engine;
    const Outputs open = run_at_rest(engine.context, {points({{0, 0, 0}}, {{0, 0.6f, 0.8f}})});
    auto transfer = open.meshes[0].transfer;
    for (const float value : {1e35f, 1e36f, 1e38f, 3.4e38f, INFINITY, -INFINITY, std::nanf(""), -1e38f}) {
        std::vector<float> rgb(3 * 8 * 4, value);
        float out[75], shaded[3];
        uint64_t bad = 0;
        ASSERT_TRUE(sh_project_latlong(rgb.data(), 8, 4, out, &bad).ok());
        EXPECT_EQ(bad, value == 1e35f ? 0u : 32u) << value;
        for (const float c : out)
            EXPECT_TRUE(std::isfinite(c)) << value;
        ASSERT_TRUE(shade(engine.context, out, {transfer[0].data(), 1, 100}, {}, shaded).ok());
        for (const float c : shaded) {
            EXPECT_TRUE(std::isfinite(c)) << value;
            EXPECT_NEAR(c, value >= 1e35f && std::isfinite(value) ? 1e35f : 0, 2e33f) << value;
        }
    }
}

// S5. A hundred thousand turns, one after the other, against one turn by their product.
TEST(ShRotate, ManyTurnsDriftLittle) {
    Random random(6);
    Coefficients c, start;
    for (float& v : c)
        v = random.between(-1, 1);
    start = c;
    glm::dmat3 product(1);
    const auto rows_of = [](const glm::dmat3& m) {
        std::array<float, 9> rows;
        for (int i = 0; i < 9; ++i)
            rows[size_t(i)] = float(m[i % 3][i / 3]);
        return rows;
    };
    const int turns = 100000;
    for (int i = 0; i < turns; ++i) {
        const auto rows = rows_of(about(glm::dvec3(random.direction()), random.between(0, 3)));
        sh_rotate(rows.data(), c.data(), c.data());
        // The matrix that was used, made orthonormal again: floats are not quite.
        glm::dmat3 m;
        for (int k = 0; k < 9; ++k)
            m[k % 3][k / 3] = double(rows[size_t(k)]);
        product = m * product;
        product[0] = glm::normalize(product[0]);
        product[1] = glm::normalize(product[1] - glm::dot(product[1], product[0]) * product[0]);
        product[2] = glm::cross(product[0], product[1]);
    }
    Coefficients once;
    sh_rotate(rows_of(product).data(), start.data(), once.data());
    double before = 0, after = 0, apart = 0;
    for (size_t i = 0; i < 25; ++i) {
        before += double(start[i]) * double(start[i]);
        after += double(c[i]) * double(c[i]);
        apart = std::max(apart, std::fabs(double(c[i]) - double(once[i])));
    }
    std::printf("[  FIGURE  ] S5 after %d turns: energy off by %.2g, terms by %.2g\n", turns,
                std::fabs(after / before - 1), apart);
    EXPECT_NEAR(after / before, 1, 1e-4);
    EXPECT_LT(apart, 1e-4);
}

TEST(Shade, ConstantLightOnAnOpenReceiverIsItsRadiance) {
    Engine engine;
    const Outputs out =
        run_at_rest(engine.context, {points({{0, 0, 0}, {1, 0, 0}}, {{0, 1, 0}, {0.6f, 0, 0.8f}})});
    float light[75] = {};
    for (uint32_t c = 0; c < 3; ++c)
        light[c] = 3.5449077f * float(c + 1);
    auto transfer = out.meshes[0].transfer;
    const float albedo[6] = {1, 0.5f, 0.25f, 0, 1, 2};
    float rgb[6];
    ASSERT_TRUE(shade(engine.context, light, {transfer[0].data(), 2, 100}, {albedo, 2, 12}, rgb).ok());
    for (uint32_t i = 0; i < 6; ++i)
        EXPECT_NEAR(rgb[i], albedo[i] * float(i % 3 + 1), 3e-3f);
    // The same for every instruction set, and beside one another at any stride.
    for (const Isa isa : available_isas()) {
        Engine other(with_isa(isa));
        std::vector<float> wide(2 * 40, 9.0f);
        for (size_t v = 0; v < 2; ++v)
            std::copy(transfer[v].begin(), transfer[v].end(), wide.begin() + long(40 * v));
        float again[6];
        ASSERT_TRUE(shade(other.context, light, {wide.data(), 2, 160}, {albedo, 2, 12}, again).ok());
        for (uint32_t i = 0; i < 6; ++i)
            EXPECT_EQ(again[i], rgb[i]) << isa_name(isa);
    }
}

} // namespace

} // namespace nusselt::test
