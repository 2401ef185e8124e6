// Images as plain arrays: environments read and made, pictures written.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

namespace nusselt::tools {

// Linear radiance, 3 floats a pixel, rows top to bottom. As an environment: latitude-longitude, laid out as
// nusselt/lighting.h says.
struct Image {
    uint32_t width = 0, height = 0;
    std::vector<float> rgb;
};

// 8-bit sRGB, 3 bytes a pixel, rows top to bottom.
struct Picture {
    uint32_t width = 0, height = 0;
    std::vector<uint8_t> rgb;

    Picture() = default;
    Picture(uint32_t w, uint32_t h) : width(w), height(h), rgb(size_t{w} * h * 3) {}
};

// Limits on images that are read; checked before anything is allocated.
constexpr uint32_t max_image_width = 16384;
constexpr uint32_t max_image_height = 8192;
constexpr uint64_t max_image_pixels = 1u << 26;

// Reads a Radiance (.hdr) or OpenEXR (.exr) environment; the contents decide, not the name. An OpenEXR file
// that says it is a latitude-longitude environment is turned about the vertical axis, so that its +x is our
// +x. Pixels may be negative or not finite: sh_project_latlong counts them. Throws Failure.
Image load_environment(const std::string& path);

// The two readers behind it; `name` is for messages.
Image read_hdr(std::string_view bytes, const std::string& name);
Image read_exr(std::string_view bytes, const std::string& name);

// A clear sky with a soft low sun over a plain ground, +y up. `turn` in turns of the sun about the vertical
// axis.
Image sky(uint32_t width, uint32_t height, double turn);

// Radiance of an environment in unit direction (x, y, z), bilinear; negative and not finite values read as 0.
void sample_latlong(const Image& environment, float x, float y, float z, float out[3]);

// The factor that brings an image to a mean brightness; pixels where `covered` is 0 don't count. Share it
// between pictures that are to be compared.
float exposure_for(const Image& image, const std::vector<uint8_t>& covered);
// A filmic curve on each channel, then sRGB.
Picture tone_map(const Image& image, float exposure);

// All of the same height, from left to right, with `gap` white columns between them.
Picture beside(const std::vector<const Picture*>& pictures, uint32_t gap);

std::string encode_png(const Picture& picture);
// `quality` 1 to 100.
std::string encode_jpeg(const Picture& picture, int quality);

} // namespace nusselt::tools
