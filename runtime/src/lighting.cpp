#include "nusselt/lighting.h"

#include "context_data.h"
#include "jobs/float_environment.h"

#include <algorithm>
#include <cmath>
#include <cstring>

namespace nusselt {

namespace {

#include "kernels/sh_formulas.inl"

struct Single {
    float operator()(double value) const { return static_cast<float>(value); }
};
struct Double {
    double operator()(double value) const { return value; }
};

constexpr double pi = 3.14159265358979323846;

// The light's bands up to the last that is not zero; at least one.
uint32_t bands_of(const float light[75], uint32_t most) {
    uint32_t terms = most * most;
    while (terms > 1 && light[3 * terms - 3] == 0 && light[3 * terms - 2] == 0 && light[3 * terms - 1] == 0)
        --terms;
    uint32_t order = 1;
    while (order * order < terms)
        ++order;
    return order;
}

} // namespace

void sh_evaluate(float x, float y, float z, float out[25]) {
    const jobs::FloatEnvironment environment;
    sh_basis(Single(), x, y, z, out);
}

Status sh_project_latlong(const float* rgb, uint32_t width, uint32_t height, float out[75], uint64_t* bad) {
    if (!rgb || !out || width == 0 || height == 0)
        return {StatusCode::invalid_argument,
                "not projected: the image or out is null, or the image empty; give width * height pixels"};
    const jobs::FloatEnvironment environment;
    double sum[75] = {};
    uint64_t refused = 0;
    for (uint32_t row = 0; row < height; ++row) {
        const double top = std::cos(pi * row / height), bottom = std::cos(pi * (row + 1) / height);
        const double area = (top - bottom) * 2 * pi / width; // the pixel's exact solid angle
        const double polar = pi * (row + 0.5) / height, y = std::cos(polar), across = std::sin(polar);
        for (uint32_t column = 0; column < width; ++column) {
            const float* pixel = rgb + 3 * (size_t(row) * width + column);
            bool good = true, bright = false;
            for (uint32_t c = 0; c < 3; ++c) {
                good = good && std::isfinite(pixel[c]) && pixel[c] >= 0;
                bright = bright || pixel[c] > brightest;
            }
            refused += !good || bright;
            if (!good) continue;
            const double azimuth = 2 * pi * ((column + 0.5) / width - 0.5);
            double basis[25];
            sh_basis(Double(), across * std::cos(azimuth), y, across * std::sin(azimuth), basis);
            for (uint32_t i = 0; i < 25; ++i) {
                for (uint32_t c = 0; c < 3; ++c)
                    sum[i * 3 + c] += basis[i] * area * double(std::min(pixel[c], brightest));
            }
        }
    }
    for (uint32_t i = 0; i < 75; ++i)
        out[i] = static_cast<float>(sum[i]);
    if (bad) *bad = refused;
    return {};
}

void sh_rotate(const float rotation[9], const float coefficients[25], float out[25]) {
    // R = Rz(a) Ry(b) Rz(c).
    const jobs::FloatEnvironment environment;
    const double r02 = rotation[2], r12 = rotation[5], r22 = rotation[8];
    const double sin_b = std::sqrt(r02 * r02 + r12 * r12);
    // Close to a turn about z alone, a means nothing and a + c everything: c comes from what Rz(-a) leaves,
    // so that any a will do.
    const double cos_a = sin_b > 0 ? r02 / sin_b : 1, sin_a = sin_b > 0 ? r12 / sin_b : 0;
    const double x = cos_a * rotation[4] - sin_a * rotation[1], y = cos_a * rotation[3] - sin_a * rotation[0];
    const double length = std::sqrt(x * x + y * y);
    const double cos_c = length > 0 ? x / length : 1, sin_c = length > 0 ? y / length : 0;
    double c[25], turned[25];
    for (uint32_t i = 0; i < 25; ++i)
        c[i] = coefficients[i];
    sh_rotate_z(Double(), cos_c, sin_c, c);
    sh_rotate_zy(Double(), r22, sin_b, cos_a, sin_a, c, turned);
    for (uint32_t i = 0; i < 25; ++i)
        out[i] = static_cast<float>(turned[i]);
}

void turn_light(const float object_to_world[9], const float light[75], float out[75]) {
    float world_to_object[9], channel[25], turned[25];
    for (uint32_t row = 0; row < 3; ++row) {
        for (uint32_t column = 0; column < 3; ++column)
            world_to_object[3 * row + column] = object_to_world[3 * column + row];
    }
    for (uint32_t c = 0; c < 3; ++c) {
        for (uint32_t i = 0; i < 25; ++i)
            channel[i] = light[3 * i + c];
        sh_rotate(world_to_object, channel, turned);
        for (uint32_t i = 0; i < 25; ++i)
            out[3 * i + c] = turned[i];
    }
}

Status shade(const Context* context, const float light[75], TransferView transfer, Vec3View albedo,
             float* rgb, uint32_t order) {
    if (!context || !light || !rgb || (!transfer.data && transfer.count > 0))
        return {StatusCode::invalid_argument,
                "not shaded: context, light, transfer or rgb is null; all four are needed"};
    if (order < 1 || order > sh_order)
        return {StatusCode::invalid_argument,
                "not shaded: the order is not one of 1 to 5; give that of the frame"};
    if (transfer.stride < 4 * order * order || transfer.stride % 4 != 0 ||
        (albedo.data && (albedo.count != transfer.count || albedo.stride < 12 || albedo.stride % 4 != 0)))
        return {StatusCode::invalid_argument,
                "not shaded: a stride is too small or no multiple of 4, or albedo and transfer "
                "differ in count; strides are in bytes"};
    const jobs::FloatEnvironment environment;
    context->kernels->shade(light, bands_of(light, order), transfer.data, transfer.stride, transfer.count,
                            rgb);
    for (size_t i = 0; albedo.data && i < transfer.count; ++i) {
        const float* a =
            reinterpret_cast<const float*>(reinterpret_cast<const char*>(albedo.data) + i * albedo.stride);
        for (uint32_t c = 0; c < 3; ++c)
            rgb[3 * i + c] *= a[c];
    }
    return {};
}

} // namespace nusselt
