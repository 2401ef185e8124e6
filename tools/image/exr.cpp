// OpenEXR. The header is walked here first, so that no size from a damaged file reaches the library
// unchecked.
#include "tools/image/image.h"
#include "tools/report/failure.h"

#include <OpenEXR/ImfChannelList.h>
#include <OpenEXR/ImfFrameBuffer.h>
#include <OpenEXR/ImfHeader.h>
#include <OpenEXR/ImfIO.h>
#include <OpenEXR/ImfInputFile.h>
#include <OpenEXR/ImfStandardAttributes.h>

#include <algorithm>
#include <cstring>
#include <exception>

namespace nusselt::tools {

namespace {

struct Window {
    int32_t x0 = 0, y0 = 0, x1 = -1, y1 = -1;

    uint64_t width() const { return static_cast<uint64_t>(int64_t{x1} - x0 + 1); }
    uint64_t height() const { return static_cast<uint64_t>(int64_t{y1} - y0 + 1); }
};

struct Preview {
    std::string_view rest;
    const std::string& name;

    [[noreturn]] void fail(const std::string& what) const { throw Failure(name, what); }

    template<class T>
    T take() {
        T value;
        if (rest.size() < sizeof(T)) fail("the .exr header ends early; the file is truncated, get it again");
        std::memcpy(&value, rest.data(), sizeof(T));
        rest.remove_prefix(sizeof(T));
        return value;
    }
    std::string_view text() {
        const size_t end = rest.substr(0, 256).find('\0');
        if (end == std::string_view::npos) fail("the .exr header is damaged; get the file again");
        const std::string_view result = rest.substr(0, end);
        rest.remove_prefix(end + 1);
        return result;
    }
};

// The library reads these by their type, whatever size the header states: one of another size would have it
// take pixels for sizes of attributes.
struct FixedSize {
    std::string_view type;
    uint32_t size;
};
constexpr FixedSize fixed_sizes[] = {{"box2i", 16},      {"box2f", 16},   {"chromaticities", 32},
                                     {"compression", 1}, {"double", 8},   {"envmap", 1},
                                     {"float", 4},       {"int", 4},      {"keycode", 28},
                                     {"lineOrder", 1},   {"m33f", 36},    {"m44f", 64},
                                     {"m33d", 72},       {"m44d", 128},   {"rational", 8},
                                     {"tiledesc", 9},    {"timecode", 8}, {"v2i", 8},
                                     {"v2f", 8},         {"v2d", 16},     {"v3i", 12},
                                     {"v3f", 12},        {"v3d", 24},     {"deepImageState", 1}};

void check_size(const Preview& in, std::string_view type, const Preview& value) {
    const auto damaged = [&] { in.fail("an attribute has another size than its type; get the file again"); };
    for (const FixedSize& fixed : fixed_sizes) {
        if (type == fixed.type && value.rest.size() != fixed.size) damaged();
    }
    if (type == "preview") {
        Preview preview = value;
        const uint64_t width = preview.take<uint32_t>(), height = preview.take<uint32_t>();
        if (width > 4096 || height > 4096 || width * height * 4 != preview.rest.size()) damaged();
    } else if (type == "stringvector") {
        for (Preview strings = value; !strings.rest.empty();) {
            const auto length = strings.take<uint32_t>();
            if (length > strings.rest.size()) damaged();
            strings.rest.remove_prefix(length);
        }
    } else if (type == "floatvector" && value.rest.size() % 4 != 0) {
        damaged();
    }
}

void check_window(const Preview& in, const Window& window, const char* which) {
    if (window.x1 < window.x0 || window.y1 < window.y0)
        in.fail(std::string("the ") + which + " is empty; get the file again");
    if (window.width() > max_image_width || window.height() > max_image_height ||
        window.width() * window.height() > max_image_pixels) {
        in.fail("is " + std::to_string(window.width()) + " x " + std::to_string(window.height()) +
                " pixels; at most 16384 x 8192 and 2^26 are read, scale it down");
    }
    // Corners far from the origin overflow inside the library.
    constexpr int32_t far = 1 << 24;
    if (std::min({window.x0, window.y0}) < -far || std::max({window.x1, window.y1}) > far) {
        in.fail(std::string("the ") + which + " lies too far from the origin; crop the image again");
    }
}

// Checks every size that the header states. Returns the display window.
Window check_header(std::string_view bytes, const std::string& name) {
    Preview in{bytes, name};
    in.take<uint32_t>();
    const auto version = in.take<uint32_t>();
    constexpr uint32_t deep = 0x800, multipart = 0x1000;
    if ((version & 0xFF) != 2) in.fail("is of an unknown OpenEXR version; save it as version 2");
    if (version & (deep | multipart)) in.fail("is a deep or multi-part image; save it as a single flat part");

    Window data, display;
    bool has_data = false, has_display = false;
    uint64_t channels = 0;
    for (std::string_view attribute = in.text(); !attribute.empty(); attribute = in.text()) {
        const std::string_view type = in.text();
        const auto size = in.take<uint32_t>();
        if (size > in.rest.size()) in.fail("the .exr header ends early; the file is truncated, get it again");
        Preview value{in.rest.substr(0, size), name};
        in.rest.remove_prefix(size);
        check_size(in, type, value);
        if (type == "box2i" && (attribute == "dataWindow" || attribute == "displayWindow")) {
            Window& window = attribute == "dataWindow" ? data : display;
            (attribute == "dataWindow" ? has_data : has_display) = true;
            window = value.take<Window>();
            check_window(in, window, attribute == "dataWindow" ? "data window" : "display window");
        } else if (type == "chlist") {
            while (!value.text().empty()) {
                if (value.rest.size() < 16) in.fail("the channel list is damaged; get the file again");
                value.rest.remove_prefix(16);
                ++channels;
            }
            if (!value.rest.empty()) in.fail("the channel list is damaged; get the file again");
        } else if (attribute == "tiles") {
            const auto x = value.take<uint32_t>(), y = value.take<uint32_t>();
            if (x == 0 || y == 0 || x > 4096 || y > 4096)
                in.fail("has tiles over 4096 pixels; save it with smaller");
        }
    }
    if (!has_data || !has_display)
        in.fail("the .exr header lacks a window; the file is damaged, get it again");
    if (channels > 64 || channels * data.width() > (1u << 18))
        in.fail("has too many channels; keep R, G and B");
    // No compression of OpenEXR gets below a byte for some hundreds of pixels, so this is a file cut short or
    // a bomb.
    if (data.width() * data.height() > 512 * uint64_t{in.rest.size()} + 4096) {
        in.fail("has too few bytes for its pixels; the file is truncated, get it again");
    }
    return display;
}

class Bytes : public Imf::IStream {
public:
    Bytes(std::string_view bytes, const std::string& name) : IStream(name.c_str()), bytes_(bytes) {}

    bool read(char out[], int count) override {
        if (count < 0 || static_cast<uint64_t>(count) > bytes_.size() - at_) {
            throw std::runtime_error("unexpected end of file");
        }
        std::memcpy(out, bytes_.data() + at_, static_cast<size_t>(count));
        at_ += static_cast<size_t>(count);
        return at_ < bytes_.size();
    }
    uint64_t tellg() override { return at_; }
    void seekg(uint64_t position) override { at_ = std::min<uint64_t>(position, bytes_.size()); }

private:
    std::string_view bytes_;
    uint64_t at_ = 0;
};

Image read_pixels(std::string_view bytes, const std::string& name, const Window& display) {
    Bytes stream(bytes, name);
    Imf::InputFile file(stream, 0);
    const Imf::Header& header = file.header();
    bool turned = false;
    if (Imf::hasEnvmap(header)) {
        if (Imf::envmap(header) != Imf::ENVMAP_LATLONG) {
            throw Failure(name, "is a cube map; convert it to latitude-longitude");
        }
        turned = true;
    }
    const Imf::ChannelList& channels = header.channels();
    const bool gray = !channels.findChannel("R") && channels.findChannel("Y") && !channels.findChannel("RY");
    const char* names[3] = {gray ? "Y" : "R", gray ? "Y" : "G", gray ? "Y" : "B"};
    for (const char* channel : names) {
        const Imf::Channel* found = channels.findChannel(channel);
        if (!found || found->xSampling != 1 || found->ySampling != 1) {
            throw Failure(name, "has no full-size channels R, G and B; save it as RGB");
        }
    }

    Image image{static_cast<uint32_t>(display.width()), static_cast<uint32_t>(display.height()), {}};
    image.rgb.assign(display.width() * display.height() * 3, 0.0f);
    const Imath::Box2i data = header.dataWindow();
    const int width = data.max.x - data.min.x + 1;
    constexpr int rows = 64;
    std::vector<float> chunk(static_cast<size_t>(width) * rows * 3);
    for (int y0 = data.min.y; y0 <= data.max.y; y0 += rows) {
        const int y1 = std::min(y0 + rows - 1, data.max.y);
        Imf::FrameBuffer frame;
        const Imath::Box2i window(Imath::V2i(data.min.x, y0), Imath::V2i(data.max.x, y1));
        for (int channel = 0; channel < (gray ? 1 : 3); ++channel) {
            frame.insert(names[channel],
                         Imf::Slice::Make(Imf::FLOAT, chunk.data() + channel, window, 3 * sizeof(float),
                                          3 * sizeof(float) * static_cast<size_t>(width)));
        }
        file.setFrameBuffer(frame);
        file.readPixels(y0, y1);
        for (int y = std::max(y0, display.y0); y <= std::min(y1, display.y1); ++y) {
            for (int x = std::max(data.min.x, display.x0); x <= std::min(data.max.x, display.x1); ++x) {
                const float* from = &chunk[(static_cast<size_t>(y - y0) * static_cast<size_t>(width) +
                                            static_cast<size_t>(x - data.min.x)) *
                                           3];
                float* to = &image.rgb[(static_cast<size_t>(y - display.y0) * image.width +
                                        static_cast<size_t>(x - display.x0)) *
                                       3];
                for (int channel = 0; channel < 3; ++channel)
                    to[channel] = from[gray ? 0 : channel];
            }
        }
    }
    // OpenEXR's latitude-longitude images have +z in the middle and +x a quarter to the left of it, ours have
    // +x in the middle.
    if (turned) {
        for (uint32_t y = 0; y < image.height; ++y) {
            float* row = &image.rgb[size_t{y} * image.width * 3];
            std::rotate(row, row + size_t{image.width - image.width / 4} * 3, row + size_t{image.width} * 3);
        }
    }
    return image;
}

} // namespace

Image read_exr(std::string_view bytes, const std::string& name) {
    const Window display = check_header(bytes, name);
    try {
        return read_pixels(bytes, name, display);
    } catch (const Failure&) {
        throw;
    } catch (const std::exception& error) {
        throw Failure(name, std::string("is a damaged OpenEXR file (") + error.what() + "); get it again");
    }
}

} // namespace nusselt::tools
