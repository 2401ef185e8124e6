#include "tests/fuzz/fuzz.h"
#include "tools/image/image.h"
#include "tools/report/failure.h"

#include <cmath>
#include <cstdio>

namespace nusselt::fuzz {

namespace {

void check(const tools::Image& image) {
    expect(image.width >= 1 && image.height >= 1, "an image has pixels");
    expect(image.width <= tools::max_image_width && image.height <= tools::max_image_height,
           "an image keeps its limits");
    expect(image.rgb.size() == size_t(image.width) * image.height * 3,
           "an image has as many numbers as pixels say");
}

} // namespace

int hdr(const uint8_t* data, size_t size) {
    const std::string_view bytes(reinterpret_cast<const char*>(data), size);
#if defined(NUSSELT_PLANT)
    // A reader that takes a flat image's size from its header.
    const std::string text(bytes);
    unsigned width = 0, height = 0;
    const size_t at = text.find("-Y ");
    if (at != std::string::npos && std::sscanf(text.c_str() + at, "-Y %5u +X %5u\n", &height, &width) == 2 &&
        width > 64) {
        volatile uint8_t last = data[at + 11 + size_t(width) * height * 4];
        (void)last;
    }
#endif
    try {
        const tools::Image image = tools::read_hdr(bytes, "image.hdr");
        check(image);
        for (const float value : image.rgb)
            expect(value >= 0 && std::isfinite(value), "radiance of an .hdr is finite and not negative");
        // Run lengths pack at most 127 pixels into 8 bytes.
        expect(uint64_t(image.width) * image.height <= 16 * uint64_t(size) + 4096,
               "pixels are paid for in bytes");
    } catch (const tools::Failure&) {
        return 0;
    }
    return 0;
}

int exr(const uint8_t* data, size_t size) {
    const std::string_view bytes(reinterpret_cast<const char*>(data), size);
#if defined(NUSSELT_PLANT)
    // A reader that trusts the length of the first attribute.
    if (size > 24 && data[0] == 0x76 && data[1] == 0x2f) {
        const auto* name_end = static_cast<const uint8_t*>(std::memchr(data + 8, 0, size - 8));
        const auto* type_end = name_end ? static_cast<const uint8_t*>(std::memchr(
                                              name_end + 1, 0, size_t(data + size - name_end - 1)))
                                        : nullptr;
        if (type_end && type_end + 5 < data + size) {
            uint32_t length = 0;
            std::memcpy(&length, type_end + 1, 4);
            if (length < 1u << 20) {
                volatile uint8_t last = type_end[4 + length];
                (void)last;
            }
        }
    }
#endif
    try {
        check(tools::read_exr(bytes, "image.exr"));
    } catch (const tools::Failure&) {
        return 0;
    }
    return 0;
}

} // namespace nusselt::fuzz
