#include "tools/image/image.h"

#include "tools/report/failure.h"

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <fcntl.h>
#include <numbers>
#include <sys/stat.h>
#include <unistd.h>

namespace nusselt::tools {

namespace {

// Regular files only: a pipe would wait for ever, a device never ends.
std::string read_file(const std::string& path) {
    constexpr int64_t largest = int64_t{1} << 30;
    const int file = ::open(path.c_str(), O_RDONLY | O_NONBLOCK | O_CLOEXEC);
    if (file < 0)
        throw Failure(path, std::string("cannot be read (") + std::strerror(errno) + "); check the name");
    struct Closer {
        int file;
        ~Closer() { ::close(file); }
    } closer{file};
    struct stat status;
    if (::fstat(file, &status) != 0 || !S_ISREG(status.st_mode)) {
        throw Failure(path, "is not a regular file; give a .hdr or .exr environment");
    }
    if (status.st_size > largest) throw Failure(path, "is over 1 GiB; scale the environment down");
    std::string bytes(static_cast<size_t>(status.st_size), '\0');
    size_t done = 0;
    while (done < bytes.size()) {
        const ssize_t count = ::read(file, bytes.data() + done, bytes.size() - done);
        if (count < 0 && errno == EINTR) continue;
        if (count < 0)
            throw Failure(path, std::string("cannot be read (") + std::strerror(errno) + "); try again");
        if (count == 0) break;
        done += static_cast<size_t>(count);
    }
    bytes.resize(done);
    return bytes;
}

struct Color {
    double r, g, b;
};

Color operator*(double a, Color c) {
    return {a * c.r, a * c.g, a * c.b};
}
Color operator+(Color a, Color b) {
    return {a.r + b.r, a.g + b.g, a.b + b.b};
}
Color mix(Color a, Color b, double t) {
    return (1 - t) * a + t * b;
}

double smooth(double edge0, double edge1, double x) {
    const double t = std::clamp((x - edge0) / (edge1 - edge0), 0.0, 1.0);
    return t * t * (3 - 2 * t);
}

} // namespace

Image load_environment(const std::string& path) {
    const std::string bytes = read_file(path);
    if (bytes.starts_with("\x76\x2f\x31\x01")) return read_exr(bytes, path);
    if (bytes.starts_with("#?")) return read_hdr(bytes, path);
    throw Failure(path, bytes.empty()
                            ? "is empty; give a .hdr or .exr environment"
                            : "is neither a Radiance .hdr nor an OpenEXR image; convert it to one of them");
}

Image sky(uint32_t width, uint32_t height, double turn) {
    // Chosen by eye: the sun's lobe is wide enough for degree 4, and gives about as much light as the rest of
    // the sky, so that a shadow has a direction and the shade keeps its blue.
    constexpr double pi = std::numbers::pi;
    constexpr double elevation = 0.75;
    const double azimuth = 2 * pi * turn + 0.6;
    const double sun[3] = {std::cos(elevation) * std::cos(azimuth), std::sin(elevation),
                           std::cos(elevation) * std::sin(azimuth)};
    constexpr Color zenith{0.16, 0.30, 0.68}, horizon{0.72, 0.80, 0.92}, ground{0.20, 0.18, 0.16};
    constexpr Color glow{1.0, 0.82, 0.55}, disc{1.0, 0.90, 0.74};

    Image image{width, height, {}};
    image.rgb.resize(size_t{width} * height * 3);
    for (uint32_t row = 0; row < height; ++row) {
        const double theta = pi * (row + 0.5) / height;
        const double y = std::cos(theta), ring = std::sin(theta);
        for (uint32_t column = 0; column < width; ++column) {
            const double phi = 2 * pi * ((column + 0.5) / width - 0.5);
            const double cosine = ring * std::cos(phi) * sun[0] + y * sun[1] + ring * std::sin(phi) * sun[2];
            const double up = std::clamp(y, 0.0, 1.0);
            const Color air = mix(horizon, zenith, 1 - std::pow(1 - up, 2.2)) +
                              (0.9 * std::pow(std::max(0.0, cosine), 12.0)) * glow +
                              (40 * smooth(0.975, 0.995, cosine)) * disc;
            // The ground's light fades a little towards the nadir, where the viewer's own shade would be.
            const Color earth = (0.7 + 0.5 * (1 + std::max(-1.0, y))) * ground;
            const Color c = mix(earth, air, smooth(-0.03, 0.03, y));
            float* out = &image.rgb[(size_t{row} * width + column) * 3];
            out[0] = static_cast<float>(c.r);
            out[1] = static_cast<float>(c.g);
            out[2] = static_cast<float>(c.b);
        }
    }
    return image;
}

void sample_latlong(const Image& environment, float x, float y, float z, float out[3]) {
    constexpr float pi = std::numbers::pi_v<float>;
    const auto width = static_cast<float>(environment.width), height = static_cast<float>(environment.height);
    const float u = (std::atan2(z, x) / (2 * pi) + 0.5f) * width - 0.5f;
    const float v = std::acos(std::clamp(y, -1.0f, 1.0f)) / pi * height - 0.5f;
    const float fu = std::floor(u), fv = std::floor(v);
    const auto column = [&](float at) {
        const auto w = static_cast<int64_t>(environment.width);
        return static_cast<size_t>(((static_cast<int64_t>(at) % w) + w) % w);
    };
    const auto line = [&](float at) {
        return static_cast<size_t>(std::clamp<int64_t>(static_cast<int64_t>(at), 0, environment.height - 1));
    };
    for (int channel = 0; channel < 3; ++channel) {
        const auto at = [&](float cx, float cy) {
            const float value =
                environment
                    .rgb[(line(cy) * environment.width + column(cx)) * 3 + static_cast<size_t>(channel)];
            return value > 0 && value < 1e30f ? value : 0.0f;
        };
        const float a = u - fu, b = v - fv;
        out[channel] = (1 - b) * ((1 - a) * at(fu, fv) + a * at(fu + 1, fv)) +
                       b * ((1 - a) * at(fu, fv + 1) + a * at(fu + 1, fv + 1));
    }
}

} // namespace nusselt::tools
