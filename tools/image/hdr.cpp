// Radiance RGBE. Flat scanlines and run-length-encoded ones as Radiance has written them since 1991; the run
// markers of older files, which can repeat a pixel without bound, are refused.
#include "tools/image/image.h"
#include "tools/report/failure.h"

#include <charconv>
#include <cmath>
#include <cstring>

namespace nusselt::tools {

namespace {

struct Reader {
    std::string_view rest;
    const std::string& name;

    [[noreturn]] void fail(const std::string& what) const { throw Failure(name, what); }

    std::string_view line() {
        constexpr size_t longest = 2048;
        const size_t end = rest.substr(0, longest).find('\n');
        if (end == std::string_view::npos) {
            fail(rest.size() < longest
                     ? "the .hdr header ends early; the file is truncated, get it again"
                     : "the .hdr header has a line of over 2048 bytes; this is no Radiance file");
        }
        std::string_view result = rest.substr(0, end);
        rest.remove_prefix(end + 1);
        if (!result.empty() && result.back() == '\r') result.remove_suffix(1);
        return result;
    }
};

std::string_view after(std::string_view line, std::string_view key) {
    std::string_view value = line.substr(key.size());
    while (!value.empty() && value.front() == ' ')
        value.remove_prefix(1);
    while (!value.empty() && value.back() == ' ')
        value.remove_suffix(1);
    return value;
}

template<class T>
bool parse(std::string_view text, T& value) {
    const auto result = std::from_chars(text.data(), text.data() + text.size(), value);
    return result.ec == std::errc() && result.ptr == text.data() + text.size();
}

// "-Y height +X width"
bool parse_resolution(std::string_view line, uint32_t& width, uint32_t& height) {
    if (!line.starts_with("-Y ")) return false;
    const size_t x = line.find(" +X ");
    return x != std::string_view::npos && x >= 3 && parse(after(line.substr(0, x), "-Y "), height) &&
           parse(after(line.substr(x), " +X "), width);
}

// Fills `row` (4 planes of `width` bytes) with a run-length-encoded scanline.
void read_runs(Reader& in, uint32_t width, std::vector<uint8_t>& row) {
    for (size_t at = 0; at < size_t{width} * 4;) {
        const size_t left = width - at % width;
        if (in.rest.empty()) in.fail("the pixels end early; the file is truncated, get it again");
        size_t count = static_cast<uint8_t>(in.rest[0]);
        const bool run = count > 128;
        if (run) count -= 128;
        const size_t bytes = run ? 2 : count + 1;
        if (count == 0 || count > left)
            in.fail("a scanline's runs don't add up to its width; the file is damaged");
        if (in.rest.size() < bytes) in.fail("the pixels end early; the file is truncated, get it again");
        if (run) {
            std::memset(row.data() + at, static_cast<uint8_t>(in.rest[1]), count);
        } else {
            std::memcpy(row.data() + at, in.rest.data() + 1, count);
        }
        in.rest.remove_prefix(bytes);
        at += count;
    }
}

} // namespace

Image read_hdr(std::string_view bytes, const std::string& name) {
    Reader in{bytes, name};
    if (!in.line().starts_with("#?")) in.fail("is no Radiance file; give a .hdr or .exr environment");

    double exposure = 1;
    for (std::string_view line = in.line(); !line.empty(); line = in.line()) {
        if (line.starts_with("FORMAT=")) {
            if (after(line, "FORMAT=") != "32-bit_rle_rgbe") {
                in.fail("has another pixel format than 32-bit_rle_rgbe; save it as RGBE");
            }
        } else if (line.starts_with("EXPOSURE=")) {
            // Several multiply (Radiance's own rule); pixels are divided by the product.
            double value = 0;
            if (!parse(after(line, "EXPOSURE="), value) || !(value > 0) || !std::isfinite(value)) {
                in.fail("EXPOSURE is not a positive number; correct the header");
            }
            exposure *= value;
        } else if (line.starts_with("GAMMA=")) {
            double value = 0;
            if (!parse(after(line, "GAMMA="), value) || std::abs(value - 1) > 0.01) {
                in.fail("has a gamma other than 1; save it with linear values");
            }
        }
    }
    if (!(exposure >= 1e-9 && exposure <= 1e9)) in.fail("EXPOSURE is out of range; correct the header");

    uint32_t width = 0, height = 0;
    if (!parse_resolution(in.line(), width, height)) {
        in.fail("has a size or an orientation other than '-Y height +X width'; save it upright");
    }
    if (width == 0 || height == 0) in.fail("has no pixels; get it again");
    const uint64_t pixels = uint64_t{width} * height;
    if (width > max_image_width || height > max_image_height || pixels > max_image_pixels) {
        in.fail("is " + std::to_string(width) + " x " + std::to_string(height) +
                " pixels; at most 16384 x 8192 and 2^26 are read, scale it down");
    }
    // 127 equal bytes of each of 4 planes take 8 bytes.
    if (pixels > 16 * uint64_t{in.rest.size()} + 4096) {
        in.fail("has too few bytes for its " + std::to_string(width) + " x " + std::to_string(height) +
                " pixels; the file is truncated, get it again");
    }

    Image image{width, height, {}};
    image.rgb.resize(pixels * 3);
    std::vector<uint8_t> row(size_t{width} * 4);
    for (uint32_t y = 0; y < height; ++y) {
        const auto byte = [&](size_t k) { return static_cast<uint8_t>(in.rest[k]); };
        if (in.rest.size() < 4) in.fail("the pixels end early; the file is truncated, get it again");
        const bool runs = width >= 8 && width < 32768 && byte(0) == 2 && byte(1) == 2 && byte(2) < 128;
        if (runs) {
            if (byte(2) * 256u + byte(3) != width)
                in.fail("a scanline has another width; the file is damaged");
            in.rest.remove_prefix(4);
            read_runs(in, width, row);
        } else {
            if (in.rest.size() < row.size())
                in.fail("the pixels end early; the file is truncated, get it again");
            for (uint32_t x = 0; x < width; ++x) {
                const size_t k = size_t{x} * 4;
                if (byte(k) == 1 && byte(k + 1) == 1 && byte(k + 2) == 1) {
                    in.fail("has run markers of a pre-1991 file; save it again with a current program");
                }
                for (uint32_t plane = 0; plane < 4; ++plane)
                    row[size_t{plane} * width + x] = byte(k + plane);
            }
            in.rest.remove_prefix(row.size());
        }
        for (uint32_t x = 0; x < width; ++x) {
            const int exponent = row[size_t{3} * width + x];
            const double scale = exponent == 0 ? 0 : std::ldexp(1.0, exponent - 136) / exposure;
            for (uint32_t plane = 0; plane < 3; ++plane) {
                image.rgb[(size_t{y} * width + x) * 3 + plane] =
                    static_cast<float>(scale * row[size_t{plane} * width + x]);
            }
        }
    }
    return image;
}

} // namespace nusselt::tools
