#include "environment.h"

#include "context_data.h"
#include "jobs/float_environment.h"

#include <algorithm>
#include <cmath>

namespace nusselt {

namespace {

constexpr double pi = 3.14159265358979323846;
constexpr uint64_t most_pixels = 1u << 28;

// The filter is Gaussian; its standard deviation in sides of a cell. The irradiance of a small light on an
// open receiver wavers as the light passes from cell to cell: by 2.1 % of its greatest in the mean and 16 %
// at worst with 0.5, 1.8 and 10 % with 0.6, 2.0 and 8 % with 0.75, where shadows have softer edges. Texels
// make that 16 % at worst.
constexpr double deviation = 0.6;
constexpr double reach = 3; // deviations
constexpr double texels_a_deviation = 2;

// Radiance times solid angle, and solid angle, of the pixels of a latitude-longitude image.
struct Panorama {
    explicit Panorama(const Allocator& a) : pixels(HostAllocator<double>(a)) {}
    Vector<double> pixels; // red, green, blue, solid angle
    uint32_t width = 0, height = 0;
};

uint64_t read_panorama(const EnvironmentDesc& desc, Panorama& out) {
    out.width = desc.width;
    out.height = desc.height;
    out.pixels.assign(size_t(desc.width) * desc.height * 4, 0);
    uint64_t bad = 0;
    for (uint32_t row = 0; row < desc.height; ++row) {
        const double top = std::cos(pi * row / desc.height), bottom = std::cos(pi * (row + 1) / desc.height);
        const double area = (top - bottom) * 2 * pi / desc.width;
        for (uint32_t column = 0; column < desc.width; ++column) {
            const size_t at = size_t(row) * desc.width + column;
            const float* rgb = desc.rgb + 3 * at;
            double* pixel = out.pixels.data() + 4 * at;
            pixel[3] = area;
            bool good = true, bright = false;
            for (uint32_t c = 0; c < 3; ++c) {
                good = good && std::isfinite(rgb[c]) && rgb[c] >= 0;
                bright = bright || rgb[c] > brightest;
            }
            bad += !good || bright;
            for (uint32_t c = 0; good && c < 3; ++c)
                pixel[c] = double(std::min(rgb[c], brightest)) * area;
        }
    }
    return bad;
}

// Halves both sides while pixels are finer than needed; odd sides stay.
void coarsen(Panorama& image, double side) {
    while (image.width % 2 == 0 && image.height % 2 == 0 && pi / image.height * 2 <= side) {
        const uint32_t width = image.width / 2, height = image.height / 2;
        for (uint32_t row = 0; row < height; ++row) {
            for (uint32_t column = 0; column < width; ++column) {
                double sum[4] = {};
                for (uint32_t k = 0; k < 4; ++k) {
                    const size_t from = size_t(2 * row + k / 2) * image.width + 2 * column + k % 2;
                    for (uint32_t c = 0; c < 4; ++c)
                        sum[c] += image.pixels[4 * from + c];
                }
                // Behind all that is still to be read.
                std::copy(sum, sum + 4, image.pixels.data() + 4 * (size_t(row) * width + column));
            }
        }
        image.width = width;
        image.height = height;
    }
}

// The direction of a texel's centre.
void texel_direction(uint32_t size, uint32_t column, uint32_t row, double d[3]) {
    const double u = (column + 0.5) * 2 / size - 1, v = (row + 0.5) * 2 / size - 1;
    d[0] = u;
    d[1] = v;
    d[2] = 1 - std::fabs(u) - std::fabs(v);
    if (d[2] < 0) {
        d[0] = std::copysign(1 - std::fabs(v), u);
        d[1] = std::copysign(1 - std::fabs(u), v);
    }
    const double length = std::sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]);
    for (uint32_t k = 0; k < 3; ++k)
        d[k] /= length;
}

// The mean radiance around a direction.
void filter(const Panorama& image, const double d[3], double sigma, float out[4]) {
    const double polar = std::acos(std::clamp(d[1], -1.0, 1.0)), azimuth = std::atan2(d[2], d[0]);
    const double far = reach * sigma, step = pi / image.height;
    const auto row_at = [&](double angle) {
        return std::clamp(static_cast<int64_t>(std::floor(angle / step)), int64_t(0),
                          int64_t(image.height) - 1);
    };
    const int64_t first_row = row_at(polar - far), last_row = row_at(polar + far);
    // A cap of radius `far` spans that much azimuth, all of it where it holds a pole.
    const double flat = std::sin(polar), span = polar - far <= 0 || polar + far >= pi || std::sin(far) >= flat
                                                    ? pi
                                                    : std::asin(std::sin(far) / flat);
    const double column_step = 2 * pi / image.width;
    const auto centre = static_cast<int64_t>(std::floor((azimuth / (2 * pi) + 0.5) * image.width));
    const int64_t aside = std::min(static_cast<int64_t>(std::ceil(span / column_step)) + 1,
                                   static_cast<int64_t>(image.width - 1) / 2);
    const bool all = span >= pi || 2 * aside + 1 >= int64_t(image.width);
    double sum[4] = {};
    for (int64_t row = first_row; row <= last_row; ++row) {
        const double p = (double(row) + 0.5) * step, y = std::cos(p), across = std::sin(p);
        const int64_t begin = all ? 0 : centre - aside, end = all ? image.width : centre + aside + 1;
        for (int64_t k = begin; k < end; ++k) {
            const int64_t column = (k % int64_t(image.width) + image.width) % image.width;
            const double a = column_step * (double(column) + 0.5) - pi;
            const double cosine = across * std::cos(a) * d[0] + y * d[1] + across * std::sin(a) * d[2];
            const double weight = std::exp((cosine - 1) / (sigma * sigma));
            const double* pixel = image.pixels.data() + 4 * (size_t(row) * image.width + size_t(column));
            for (uint32_t c = 0; c < 4; ++c)
                sum[c] += pixel[c] * weight;
        }
    }
    if (!(sum[3] > 0)) { // pixels so large that their centres lie beyond the filter: the one around it
        const int64_t column = (centre % int64_t(image.width) + image.width) % image.width;
        const double* pixel =
            image.pixels.data() + 4 * (size_t(row_at(polar)) * image.width + size_t(column));
        std::copy(pixel, pixel + 4, sum);
    }
    for (uint32_t c = 0; c < 4; ++c)
        out[c] = c < 3 ? static_cast<float>(sum[c] / sum[3]) : 0.0f;
}

} // namespace

Status create_environment(Context* context, const EnvironmentDesc& desc, Environment** out, uint64_t* bad) {
    if (!out)
        return {StatusCode::invalid_argument, "no environment made: out is null; pass where to write it"};
    *out = nullptr;
    if (!context)
        return {StatusCode::invalid_argument,
                "no environment made: the context is null; make one with create_context"};
    if (!desc.rgb || desc.width == 0 || desc.height == 0 || uint64_t(desc.width) * desc.height > most_pixels)
        return {StatusCode::invalid_argument, "no environment made: the image is null, empty or too large; "
                                              "give width * height pixels, at most 2^28"};
    if (desc.mask_bits != 1024 && desc.mask_bits != 4096)
        return {StatusCode::invalid_argument,
                "no environment made: masks have 1024 or 4096 bits; pass quality_mask_bits of the frames"};
    const jobs::FloatEnvironment environment;
    Environment* made = nullptr;
    try {
        made = make<Environment>(context->allocator, context->allocator);
        made->mask_bits = desc.mask_bits;
        Panorama image(context->allocator);
        const uint64_t refused = read_panorama(desc, image);
        uint32_t texels = 0;
        for (uint32_t level = 0; level < kernels::sky_levels; ++level) {
            const double sigma = deviation * std::sqrt(kernels::sky_solid_angle(desc.mask_bits, level));
            // A texel's side is that of its share of the sphere.
            const auto size =
                static_cast<uint32_t>(std::ceil(std::sqrt(4 * pi) / sigma * texels_a_deviation));
            made->map.size[level] = size;
            made->map.begin[level] = texels;
            texels += size * size;
        }
        made->texels.resize(size_t(texels) * 4);
        made->map.texels = made->texels.data();
        for (uint32_t level = 0; level < kernels::sky_levels; ++level) {
            const double sigma = deviation * std::sqrt(kernels::sky_solid_angle(desc.mask_bits, level));
            coarsen(image, sigma / 2);
            const uint32_t size = made->map.size[level];
            for (uint32_t i = 0; i < size * size; ++i) {
                double d[3];
                texel_direction(size, i % size, i / size, d);
                filter(image, d, sigma, made->texels.data() + 4 * size_t(made->map.begin[level] + i));
            }
        }
        if (bad) *bad = refused;
        *out = made;
    } catch (const std::bad_alloc&) {
        unmake(context->allocator, made);
        return {StatusCode::out_of_memory,
                "no environment made: the allocator gave no memory; free some and try again"};
    }
    return {};
}

void destroy_environment(Context* context, Environment* environment) {
    if (context) unmake(context->allocator, environment);
}

} // namespace nusselt
