#include "tools/image/image.h"

#include "tools/report/failure.h"

// Debian's package brings the implementation as a library too, but not everyone's stb does.
#define STB_IMAGE_WRITE_STATIC
#define STB_IMAGE_WRITE_IMPLEMENTATION
#include <stb_image_write.h>

#include <algorithm>
#include <cmath>
#include <cstring>

namespace nusselt::tools {

namespace {

void append(void* user, void* data, int size) {
    static_cast<std::string*>(user)->append(static_cast<const char*>(data), static_cast<size_t>(size));
}

// Narkowicz's fit of the ACES film curve:
// https://knarkowicz.wordpress.com/2016/01/06/aces-filmic-tone-mapping-curve/
float film(float x) {
    return std::clamp(x * (2.51f * x + 0.03f) / (x * (2.43f * x + 0.59f) + 0.14f), 0.0f, 1.0f);
}

float srgb(float x) {
    return x <= 0.0031308f ? 12.92f * x : 1.055f * std::pow(x, 1 / 2.4f) - 0.055f;
}

} // namespace

float exposure_for(const Image& image, const std::vector<uint8_t>& covered) {
    double sum = 0;
    size_t count = 0;
    for (size_t k = 0; k < covered.size(); ++k) {
        if (!covered[k]) continue;
        const float* c = &image.rgb[k * 3];
        const double luminance = 0.2126 * c[0] + 0.7152 * c[1] + 0.0722 * c[2];
        if (!(luminance >= 0 && luminance < 1e30)) continue;
        sum += luminance;
        ++count;
    }
    // The film curve maps 0.45 to four fifths of white after sRGB: white looks white, and a lit side has room
    // above.
    return count == 0 || sum <= 0 ? 1.0f : static_cast<float>(0.45 * static_cast<double>(count) / sum);
}

Picture tone_map(const Image& image, float exposure) {
    Picture picture(image.width, image.height);
    for (size_t k = 0; k < picture.rgb.size(); ++k) {
        const float value = image.rgb[k] * exposure;
        // White long before the curve's squares overflow; no number is black.
        picture.rgb[k] =
            static_cast<uint8_t>(255 * srgb(film(value > 0 ? std::min(value, 1e6f) : 0.0f)) + 0.5f);
    }
    return picture;
}

Picture beside(const std::vector<const Picture*>& pictures, uint32_t gap) {
    uint32_t width = 0, height = 0;
    for (const Picture* picture : pictures) {
        width += picture->width + (width > 0 ? gap : 0);
        height = std::max(height, picture->height);
    }
    Picture result(width, height);
    std::fill(result.rgb.begin(), result.rgb.end(), uint8_t{255});
    uint32_t x = 0;
    for (const Picture* picture : pictures) {
        for (uint32_t y = 0; y < picture->height; ++y) {
            std::memcpy(&result.rgb[(size_t{y} * width + x) * 3],
                        &picture->rgb[size_t{y} * picture->width * 3], size_t{picture->width} * 3);
        }
        x += picture->width + gap;
    }
    return result;
}

std::string encode_png(const Picture& picture) {
    std::string bytes;
    const int width = static_cast<int>(picture.width), height = static_cast<int>(picture.height);
    if (!stbi_write_png_to_func(append, &bytes, width, height, 3, picture.rgb.data(), width * 3)) {
        throw Failure("picture", "there is no memory to encode it; choose a smaller --size");
    }
    return bytes;
}

std::string encode_jpeg(const Picture& picture, int quality) {
    std::string bytes;
    if (!stbi_write_jpg_to_func(append, &bytes, static_cast<int>(picture.width),
                                static_cast<int>(picture.height), 3, picture.rgb.data(), quality)) {
        throw Failure("picture", "there is no memory to encode it; choose a smaller --size");
    }
    return bytes;
}

} // namespace nusselt::tools
