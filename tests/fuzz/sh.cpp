#include "nusselt/lighting.h"
#include "tests/fuzz/fuzz.h"

#include <algorithm>
#include <cmath>
#include <vector>

namespace nusselt::fuzz {

namespace {

// A rotation about an axis by an angle, in double.
void rotation(const double axis[3], double angle, float out[9]) {
    const double c = std::cos(angle), s = std::sin(angle);
    for (int i = 0; i < 3; ++i) {
        for (int j = 0; j < 3; ++j) {
            const int k = 3 - i - j;
            const double skew = i == j ? 0 : (j == (i + 1) % 3 ? -axis[k] : axis[k]) * s;
            out[3 * i + j] = float((i == j ? c : 0) + axis[i] * axis[j] * (1 - c) + skew);
        }
    }
}

double value(const float coefficients[25], const double d[3]) {
    float basis[25];
    sh_evaluate(float(d[0]), float(d[1]), float(d[2]), basis);
    double sum = 0;
    for (int i = 0; i < 25; ++i)
        sum += double(basis[i]) * double(coefficients[i]);
    return sum;
}

} // namespace

// Rotation moves the function and keeps each band's energy; projection survives any pixels.
int sh(const uint8_t* data, size_t size) {
    Bytes in{data, size};
    double axis[3], direction[3], length = 0, along = 0;
    for (double& a : axis) {
        a = in.small_float();
        length += a * a;
    }
    for (double& d : direction) {
        d = in.small_float();
        along += d * d;
    }
    const double angle = in.small_float() * 3.2;
    float coefficients[25], turned[25], matrix[9];
    double most = 0;
    for (float& c : coefficients) {
        c = in.small_float();
        most = std::max(most, std::fabs(double(c)));
    }
    if (length > 0.01 && along > 0.01) {
        for (int k = 0; k < 3; ++k) {
            axis[k] /= std::sqrt(length);
            direction[k] /= std::sqrt(along);
        }
        rotation(axis, angle, matrix);
        sh_rotate(matrix, coefficients, turned);
#if defined(NUSSELT_PLANT)
        // A wrong sign in one entry of one band, for turns about nearly the vertical axis.
        if (axis[2] > 0.9) turned[7] = -turned[7];
#endif
        double moved[3];
        for (int i = 0; i < 3; ++i) {
            moved[i] = 0;
            for (int j = 0; j < 3; ++j)
                moved[i] += double(matrix[3 * i + j]) * direction[j];
        }
        expect(std::fabs(value(turned, moved) - value(coefficients, direction)) <= 1e-4 * (1 + most),
               "rotated coefficients are the rotated function's");
        for (int band = 0, first = 0; band < 5; first += 2 * band + 1, ++band) {
            double before = 0, after = 0;
            for (int i = first; i <= first + 2 * band; ++i) {
                before += double(coefficients[i]) * double(coefficients[i]);
                after += double(turned[i]) * double(turned[i]);
            }
            expect(std::fabs(before - after) <= 1e-4 * (before + 1e-6), "rotation keeps a band's energy");
        }
    }
    const uint32_t width = 1 + in.below(8), height = 1 + in.below(8);
    std::vector<float> pixels(size_t(width) * height * 3);
    uint64_t wrong = 0, counted = 0;
    for (size_t i = 0; i < pixels.size(); i += 3) {
        bool good = true;
        for (size_t k = 0; k < 3; ++k) {
            pixels[i + k] = in.raw_float();
            good = good && std::isfinite(pixels[i + k]) && pixels[i + k] >= 0 && pixels[i + k] <= 1e35f;
        }
        wrong += !good;
    }
    float out[75];
    expect(sh_project_latlong(pixels.data(), width, height, out, &counted).ok(), "any pixels are projected");
    expect(counted == wrong, "bad pixels are counted");
    for (const float c : out)
        expect(std::isfinite(c), "a projection is finite");
    return 0;
}

} // namespace nusselt::fuzz
