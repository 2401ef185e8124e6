// Spherical harmonics: the formulas that all instruction sets share, against what defines them.
#include "tests/kernels/fixture.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <cstring>

namespace nusselt::test {

namespace {

#include "kernels/sh_formulas.inl"

struct Double {
    double operator()(double value) const { return value; }
};
struct Single {
    float operator()(double value) const { return float(value); }
};

constexpr double pi = 3.14159265358979323846;

using Coefficients = std::array<double, 25>;
using Direction = std::array<double, 3>;
using Matrix = std::array<double, 9>; // row-major

Coefficients basis(const Direction& d) {
    Coefficients b;
    sh_basis(Double(), d[0], d[1], d[2], b.data());
    return b;
}

// A rule that is exact for polynomials of degree 8 and more: Gauss-Legendre in z, equal steps in azimuth.
template<class Visit>
void quadrature(const Visit& visit) {
    constexpr int n = 12, around = 24;
    for (int i = 0; i < n; ++i) {
        double z = std::cos(pi * (i + 0.75) / (n + 0.5)), slope = 1;
        for (int step = 0; step < 50; ++step) { // Newton on the Legendre polynomial
            double p0 = 1, p1 = z;
            for (int k = 2; k <= n; ++k) {
                const double p2 = ((2 * k - 1) * z * p1 - (k - 1) * p0) / k;
                p0 = p1;
                p1 = p2;
            }
            slope = n * (z * p1 - p0) / (z * z - 1);
            z -= p1 / slope;
        }
        const double weight = 2 / ((1 - z * z) * slope * slope) * 2 * pi / around;
        for (int j = 0; j < around; ++j) {
            const double a = 2 * pi * (j + 0.5) / around, r = std::sqrt(1 - z * z);
            visit(Direction{r * std::cos(a), r * std::sin(a), z}, weight);
        }
    }
}

double value(const Coefficients& c, const Direction& d) {
    const Coefficients b = basis(d);
    double sum = 0;
    for (int i = 0; i < 25; ++i)
        sum += c[i] * b[i];
    return sum;
}

Direction times(const Matrix& m, const Direction& d) {
    Direction out;
    for (int row = 0; row < 3; ++row)
        out[row] = m[3 * row] * d[0] + m[3 * row + 1] * d[1] + m[3 * row + 2] * d[2];
    return out;
}

Matrix transposed(const Matrix& m) {
    return {m[0], m[3], m[6], m[1], m[4], m[7], m[2], m[5], m[8]};
}

// r(R s) = c(s) by projection: r_i = integral of b_i(s) c(R^-1 s).
Coefficients rotated_by_projection(const Matrix& m, const Coefficients& c) {
    Coefficients out{};
    quadrature([&](const Direction& s, double weight) {
        const Coefficients b = basis(s);
        const double v = value(c, times(transposed(m), s));
        for (int i = 0; i < 25; ++i)
            out[i] += weight * b[i] * v;
    });
    return out;
}

Matrix rz_ry(double azimuth, double polar) {
    const double ca = std::cos(azimuth), sa = std::sin(azimuth), cp = std::cos(polar), sp = std::sin(polar);
    return {ca * cp, -sa, ca * sp, sa * cp, ca, sa * sp, -sp, 0, cp};
}

Coefficients random_coefficients(Random& random) {
    Coefficients c;
    for (double& v : c)
        v = random.unit() * 2 - 1;
    return c;
}

Coefficients rotate_zy(double azimuth, double polar, const Coefficients& c) {
    Coefficients out;
    sh_rotate_zy(Double(), std::cos(polar), std::sin(polar), std::cos(azimuth), std::sin(azimuth), c.data(),
                 out.data());
    return out;
}

TEST(Sh, IsOrthonormal) {
    double gram[25][25] = {};
    quadrature([&](const Direction& s, double weight) {
        const Coefficients b = basis(s);
        for (int i = 0; i < 25; ++i) {
            for (int j = 0; j < 25; ++j)
                gram[i][j] += weight * b[i] * b[j];
        }
    });
    for (int i = 0; i < 25; ++i) {
        for (int j = 0; j < 25; ++j)
            EXPECT_NEAR(gram[i][j], i == j, 1e-12) << i << " " << j;
    }
}

// Signs and order of the convention: no Condon-Shortley phase, Y_1,-1 ~ y, Y_1,0 ~ z, Y_1,1 ~ x.
TEST(Sh, ConventionOfTheHeader) {
    const double k = std::sqrt(3 / (4 * pi));
    const Direction d{0.48, 0.6, 0.64};
    const Coefficients b = basis(d);
    EXPECT_NEAR(b[0], std::sqrt(1 / (4 * pi)), 1e-15);
    EXPECT_NEAR(b[1], k * d[1], 1e-15);
    EXPECT_NEAR(b[2], k * d[2], 1e-15);
    EXPECT_NEAR(b[3], k * d[0], 1e-15);
    // Sectoral: sqrt(2) |N_ll| sin^l times cos or sin of l p, all positive for small positive azimuth.
    const Coefficients e = basis({std::cos(0.1), std::sin(0.1), 0});
    const double n4 = std::sqrt(9 / (4 * pi) / 40320) * 105 * std::sqrt(2.0);
    EXPECT_NEAR(e[24], n4 * std::cos(0.4), 1e-14);
    EXPECT_NEAR(e[16], n4 * std::sin(0.4), 1e-14);
    EXPECT_NEAR(basis({0, 0, 1})[20], std::sqrt(9 / (4 * pi)), 1e-14);
}

TEST(Sh, AdditionTheorem) {
    Random random(5);
    for (int n = 0; n < 1000; ++n) {
        float a[3], b[3];
        random.direction(a);
        random.direction(b);
        const auto unit = [](const float* d) {
            const double l = std::sqrt(double(d[0]) * d[0] + double(d[1]) * d[1] + double(d[2]) * d[2]);
            return Direction{d[0] / l, d[1] / l, d[2] / l};
        };
        const Direction s = unit(a), t = unit(b);
        const double x = s[0] * t[0] + s[1] * t[1] + s[2] * t[2];
        const double legendre[5] = {1, x, (3 * x * x - 1) / 2, (5 * x * x * x - 3 * x) / 2,
                                    (35 * x * x * x * x - 30 * x * x + 3) / 8};
        const Coefficients bs = basis(s), bt = basis(t);
        for (int l = 0; l <= 4; ++l) {
            double sum = 0;
            for (int i = l * l; i < (l + 1) * (l + 1); ++i)
                sum += bs[i] * bt[i];
            EXPECT_NEAR(sum, (2 * l + 1) / (4 * pi) * legendre[l], 1e-12);
        }
    }
}

struct LongDouble {
    long double operator()(double value) const { return value; }
};

// The same with one direction, of a hundred thousand and the axes, to 8 units in double's last place: the
// formulas in long double, whose directions are of unit length to as many digits (in double a length that is
// off by a unit has that eight times in its eighth power, which is the input's fault).
TEST(Sh, SquaresOfABandAddUp) {
    Random random(8);
    double worst = 0;
    for (int n = 0; n < 100000; ++n) {
        float d[3] = {};
        if (n < 6) {
            d[n / 2] = n % 2 ? 1.0f : -1.0f;
        } else {
            random.direction(d);
        }
        using Long = long double;
        const Long length = std::sqrt(Long(d[0]) * d[0] + Long(d[1]) * d[1] + Long(d[2]) * d[2]);
        Long b[25];
        sh_basis(LongDouble(), d[0] / length, d[1] / length, d[2] / length, b);
        for (int l = 0; l <= 4; ++l) {
            Long sum = 0;
            for (int i = l * l; i < (l + 1) * (l + 1); ++i)
                sum += b[i] * b[i];
            const double exact = (2 * l + 1) / (4 * pi);
            worst = std::max(worst, std::fabs(double(sum - exact)) / (std::nextafter(exact, 1e9) - exact));
        }
    }
    std::printf("[  FIGURE  ] S4 squares of a band: %.1f units in the last place at most\n", worst);
    EXPECT_LE(worst, 8);
}

// Within 6 units in the last place of its band's largest value, in float and in double: 35 z^4 - 30 z^2 + 3
// takes a value of at most 8 out of terms of 35, which alone costs four of them.
TEST(Sh, RoundingIsThatOfTheFormulas) {
    Random random(6);
    double worst[2] = {};
    for (int n = 0; n < 100000; ++n) {
        float d[3], single[25];
        random.direction(d);
        sh_basis(Single(), d[0], d[1], d[2], single);
        const Coefficients twice = basis({d[0], d[1], d[2]});
        long double exact[25];
        sh_basis(LongDouble(), static_cast<long double>(d[0]), static_cast<long double>(d[1]),
                 static_cast<long double>(d[2]), exact);
        for (int l = 0; l <= 4; ++l) {
            const double most = std::sqrt((2 * l + 1) / (4 * pi));
            const double unit = std::nextafter(most, 1e9) - most;
            const float most_single = float(most),
                        unit_single = std::nextafter(most_single, 1e9f) - most_single;
            for (int i = l * l; i < (l + 1) * (l + 1); ++i) {
                worst[0] = std::max(worst[0], std::fabs(double(single[i] - exact[i])) / double(unit_single));
                worst[1] = std::max(worst[1], std::fabs(double(twice[i] - exact[i])) / unit);
            }
        }
    }
    std::printf("[  FIGURE  ] S6 single precision: %.1f units in the last place at most, double %.1f\n",
                worst[0], worst[1]);
    EXPECT_LE(worst[0], 6);
    EXPECT_LE(worst[1], 6);
}

TEST(ShRotation, NoneChangesNothingExactlyInTheFirstBands) {
    Random random(1);
    const Coefficients c = random_coefficients(random);
    const Coefficients out = rotate_zy(0, 0, c);
    for (int i = 0; i < 25; ++i)
        EXPECT_NEAR(out[i], c[i], 1e-15) << i;
    for (int i = 0; i < 4; ++i)
        EXPECT_EQ(out[i], c[i]) << i;
}

TEST(ShRotation, SwapIsItsOwnInverse) {
    Random random(2);
    const Coefficients c = random_coefficients(random);
    Coefficients once, twice;
    sh_swap_yz(Double(), c.data(), once.data());
    sh_swap_yz(Double(), once.data(), twice.data());
    for (int i = 0; i < 25; ++i)
        EXPECT_NEAR(twice[i], c[i], 1e-15) << i;
    for (int n = 0; n < 50; ++n) {
        float d[3];
        random.direction(d);
        EXPECT_NEAR(value(once, {d[0], d[1], d[2]}), value(c, {d[0], d[2], d[1]}), 1e-6);
    }
}

TEST(ShRotation, EqualsProjection) {
    Random random(3);
    for (int n = 0; n < 40; ++n) {
        const double azimuth = random.unit() * 2 * pi, polar = n == 0 ? 0 : n == 1 ? pi : random.unit() * pi;
        const Coefficients c = random_coefficients(random);
        const Coefficients ours = rotate_zy(azimuth, polar, c),
                           exact = rotated_by_projection(rz_ry(azimuth, polar), c);
        for (int i = 0; i < 25; ++i)
            EXPECT_NEAR(ours[i], exact[i], 1e-12) << i;
    }
}

TEST(ShRotation, IsOrthogonalWithinEachBand) {
    Random random(4);
    for (int n = 0; n < 20; ++n) {
        const double azimuth = random.unit() * 2 * pi, polar = random.unit() * pi;
        double matrix[25][25];
        for (int column = 0; column < 25; ++column) {
            Coefficients unit{};
            unit[column] = 1;
            const Coefficients out = rotate_zy(azimuth, polar, unit);
            for (int row = 0; row < 25; ++row)
                matrix[row][column] = out[row];
        }
        for (int i = 0; i < 25; ++i) {
            for (int j = 0; j < 25; ++j) {
                double sum = 0;
                for (int k = 0; k < 25; ++k)
                    sum += matrix[k][i] * matrix[k][j];
                EXPECT_NEAR(sum, i == j, 1e-13);
                if (int(std::sqrt(i)) != int(std::sqrt(j))) {
                    EXPECT_EQ(matrix[i][j], 0) << i << " " << j; // bands don't mix
                }
            }
        }
    }
}

TEST(ShRotation, TurnsComposeAboutOneAxis) {
    Random random(8);
    for (int n = 0; n < 20; ++n) {
        const double a = random.unit() * pi / 2, b = random.unit() * pi / 2;
        const Coefficients c = random_coefficients(random);
        const Coefficients about_y = rotate_zy(0, b, rotate_zy(0, a, c)), y_once = rotate_zy(0, a + b, c);
        const Coefficients about_z = rotate_zy(b, 0, rotate_zy(a, 0, c)), z_once = rotate_zy(a + b, 0, c);
        for (int i = 0; i < 25; ++i) {
            EXPECT_NEAR(about_y[i], y_once[i], 1e-13);
            EXPECT_NEAR(about_z[i], z_once[i], 1e-13);
        }
    }
}

TEST(ShRotation, KernelTurnsFromTheTangentFrameToSpace) {
    const kernels::Kernels& k = *kernels::kernels_for(kernels::Set::scalar);
    for (uint64_t seed = 0; seed < 60; ++seed) {
        Random random(seed);
        BatchInput input;
        random_batch(random, false, 2, input);
        for (uint32_t lane = 0; lane < 6 && seed == 0; ++lane) { // the poles and axes
            for (uint32_t i = 0; i < 3; ++i)
                input.normal[i][lane] = lane / 2 == i ? (lane % 2 ? -1.0f : 1.0f) : 0.0f;
        }
        k.prepare_batch(input.batch, input.normal);
        ASSERT_EQ(input.batch.valid, 0xFFFFu);
        alignas(64) float local[25][kernels::lanes], out[25][kernels::lanes];
        Coefficients c[kernels::lanes];
        for (uint32_t lane = 0; lane < kernels::lanes; ++lane) {
            c[lane] = random_coefficients(random);
            for (uint32_t i = 0; i < 25; ++i)
                local[i][lane] = float(c[lane][i]);
        }
        k.rotate(input.batch, 5, local, out);
        for (uint32_t set = 0; set < kernels::set_count; ++set) {
            const kernels::Kernels* const kernels = kernels::kernels_for(kernels::Set(set));
            if (!kernels) continue;
            alignas(64) float in_place[25][kernels::lanes];
            std::memcpy(in_place, local, sizeof(local));
            kernels->rotate(input.batch, 5, in_place, in_place);
            ASSERT_EQ(std::memcmp(in_place, out, sizeof(out)), 0) << seed;
        }
        for (uint32_t lane = 0; lane < kernels::lanes; ++lane) {
            Coefficients turned;
            double before = 0, after = 0;
            for (uint32_t i = 0; i < 25; ++i) {
                turned[i] = out[i][lane];
                before += double(local[i][lane]) * local[i][lane];
                after += turned[i] * turned[i];
            }
            EXPECT_NEAR(after, before, 1e-5 * before);
            // local = axis * direction, so the turned function in `direction` is the old one in `local`.
            for (uint32_t n = 0; n < 4; ++n) {
                float d[3];
                random.direction(d);
                Matrix axis;
                for (uint32_t row = 0; row < 3; ++row) {
                    for (uint32_t i = 0; i < 3; ++i)
                        axis[3 * row + i] = input.batch.axis[row][i][lane];
                }
                const Direction s{d[0], d[1], d[2]};
                EXPECT_NEAR(value(turned, s), value(c[lane], times(axis, s)), 2e-5) << "seed " << seed;
            }
        }
    }
}

// Right-handed and orthonormal, poles and their neighbourhood included.
TEST(TangentFrame, IsOrthonormalAndRightHanded) {
    const kernels::Kernels& k = *kernels::kernels_for(kernels::Set::scalar);
    for (uint64_t seed = 0; seed < 500; ++seed) {
        Random random(seed);
        BatchInput input;
        random_batch(random, true, 2, input);
        k.prepare_batch(input.batch, input.normal);
        for (uint32_t lane = 0; lane < kernels::lanes; ++lane) {
            if (!(input.batch.valid >> lane & 1)) continue;
            double r[3][3];
            for (uint32_t row = 0; row < 3; ++row) {
                for (uint32_t i = 0; i < 3; ++i)
                    r[row][i] = input.batch.axis[row][i][lane];
            }
            for (uint32_t i = 0; i < 3; ++i) {
                for (uint32_t j = 0; j < 3; ++j) {
                    EXPECT_NEAR(r[i][0] * r[j][0] + r[i][1] * r[j][1] + r[i][2] * r[j][2], i == j, 5e-7)
                        << "seed " << seed << " lane " << lane;
                }
            }
            EXPECT_NEAR(r[0][1] * r[1][2] - r[0][2] * r[1][1], r[2][0], 5e-7);
            EXPECT_NEAR(r[0][2] * r[1][0] - r[0][0] * r[1][2], r[2][1], 5e-7);
            EXPECT_NEAR(r[0][0] * r[1][1] - r[0][1] * r[1][0], r[2][2], 5e-7);
        }
    }
}

TEST(Shade, EqualsTheSumInDouble) {
    for (uint64_t seed = 0; seed < 50; ++seed) {
        Random random(seed);
        float light[75], rgb[3 * 20];
        std::vector<float> transfer(20 * 25);
        for (float& v : light)
            v = random.between(-4, 4);
        for (float& v : transfer)
            v = random.between(-1, 1);
        kernels::kernels_for(kernels::Set::scalar)->shade(light, 5, transfer.data(), 100, 20, rgb);
        for (uint32_t i = 0; i < 20; ++i) {
            for (uint32_t c = 0; c < 3; ++c) {
                double sum = 0, size = 0;
                for (uint32_t t = 0; t < 25; ++t) {
                    sum += double(light[3 * t + c]) * double(transfer[25 * i + t]);
                    size += std::fabs(double(light[3 * t + c]) * double(transfer[25 * i + t]));
                }
                EXPECT_NEAR(rgb[3 * i + c], sum, size * 25 * 6e-8);
            }
        }
    }
}

} // namespace

} // namespace nusselt::test
