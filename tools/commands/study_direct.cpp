// Direct integration against 25 terms of SH: time, and error of the radiance of a white Lambert surface
// against rays into the environment itself.
#include "tools/commands/study.h"
#include "tools/image/image.h"
#include "tools/render/render.h"
#include "tools/report/stop.h"
#include "tools/trace/parallel.h"
#include "tools/trace/trace.h"

#include <glm/geometric.hpp>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <numbers>
#include <numeric>

namespace nusselt::tools {

namespace {

constexpr double pi = std::numbers::pi;
constexpr uint32_t width = 1024, height = 512;

struct Light {
    const char* name;
    Image image;
    std::vector<uint32_t> bright; // pixels that are sampled one by one
};

glm::dvec3 direction_of(double column, double row) {
    const double a = 2 * pi * (column / width - 0.5), p = pi * row / height;
    return {std::sin(p) * std::cos(a), std::cos(p), std::sin(p) * std::sin(a)};
}

// A disc of so many degrees across, that gives as much irradiance as a white sky.
Light with_sun(const char* name, const Image& around, double degrees) {
    Light light{name, around, {}};
    const glm::dvec3 sun = glm::normalize(glm::dvec3(0.5, 0.7, 0.5));
    double area = 0;
    for (uint32_t k = 0; k < width * height; ++k) {
        const glm::dvec3 d = direction_of(k % width + 0.5, k / width + 0.5);
        if (glm::dot(d, sun) < std::cos(degrees / 2 * pi / 180)) continue;
        light.bright.push_back(k);
        area +=
            (std::cos(pi * (k / width) / height) - std::cos(pi * (k / width + 1) / height)) * 2 * pi / width;
    }
    for (const uint32_t k : light.bright)
        for (size_t c = 0; c < 3; ++c)
            light.image.rgb[size_t{3} * k + c] += static_cast<float>(pi / area);
    return light;
}

// Radiance of the receivers (red): bright pixels by rays through each, the rest by a cosine-weighted grid.
std::vector<double> trace_radiance(const TraceScene& scene, const Assembly& all, const Light& light,
                                   const std::vector<uint32_t>& receivers, uint32_t side) {
    std::vector<double> radiance(receivers.size());
    std::vector<uint8_t> is_bright(size_t{width} * height);
    for (const uint32_t k : light.bright)
        is_bright[k] = 1;
    parallel_blocks(receivers.size(), 16, [&](size_t begin, size_t end) {
        for (size_t k = begin; k < end; ++k) {
            if (interrupted()) return;
            const uint32_t vertex = receivers[k];
            const glm::dvec3 n = glm::normalize(glm::dvec3(all.normals[vertex]));
            const glm::dvec3 other = std::abs(n.x) < 0.6 ? glm::dvec3(1, 0, 0) : glm::dvec3(0, 1, 0);
            const glm::dvec3 t = glm::normalize(glm::cross(other, n)), b = glm::cross(n, t);
            std::vector<glm::dvec3> directions;
            std::vector<double> weights;
            for (uint32_t i = 0; i < side * side; ++i) {
                // Malley's method on a square grid.
                const double r = std::sqrt((i / side + 0.5) / side), a = 2 * pi * (i % side + 0.5) / side;
                const glm::dvec3 d = r * std::cos(a) * t + r * std::sin(a) * b + std::sqrt(1 - r * r) * n;
                const double p = std::acos(std::clamp(d.y, -1.0, 1.0)), azimuth = std::atan2(d.z, d.x);
                const auto row = std::min(static_cast<uint32_t>(p / pi * height), height - 1);
                const auto column =
                    std::min(static_cast<uint32_t>((azimuth / (2 * pi) + 0.5) * width), width - 1);
                const size_t pixel = size_t{row} * width + column;
                if (is_bright[pixel]) continue;
                directions.push_back(d);
                weights.push_back(double{light.image.rgb[3 * pixel]} / (static_cast<double>(side) * side));
            }
            constexpr uint32_t across = 4;
            for (const uint32_t pixel : light.bright) {
                const uint32_t row = pixel / width;
                const double area =
                    (std::cos(pi * row / height) - std::cos(pi * (row + 1) / height)) * 2 * pi / width;
                for (uint32_t i = 0; i < across * across; ++i) {
                    const glm::dvec3 d = direction_of(pixel % width + (i % across + 0.5) / across,
                                                      row + (i / across + 0.5) / across);
                    if (glm::dot(d, n) <= 0) continue;
                    directions.push_back(d);
                    weights.push_back(double{light.image.rgb[size_t{3} * pixel]} * area * glm::dot(d, n) /
                                      pi / (across * across));
                }
            }
            std::vector<uint8_t> blocked;
            if (!trace_blocked(scene, all, vertex, directions, blocked)) continue;
            for (size_t i = 0; i < directions.size(); ++i)
                radiance[k] += blocked[i] ? 0 : weights[i];
        }
    });
    throw_if_interrupted();
    return radiance;
}

struct RadianceError {
    double mean = 0, p99 = 0; // of |ours - reference|, over the mean of the reference
};
RadianceError error_of(const StreamArray& stream, const std::vector<double>& reference,
                       const std::vector<uint32_t>& receivers) {
    std::vector<double> errors;
    double bright = 0;
    for (size_t k = 0; k < receivers.size(); ++k) {
        float red;
        std::memcpy(&red, stream.bytes.data() + size_t{12} * receivers[k], sizeof red);
        errors.push_back(std::abs(double{red} - reference[k]));
        bright += reference[k];
    }
    std::sort(errors.begin(), errors.end());
    RadianceError error;
    for (const double e : errors)
        error.mean += e / bright;
    error.p99 = errors[errors.size() * 99 / 100] / (bright / static_cast<double>(errors.size()));
    return error;
}

// Under a hard sun alone, beside one another: 25 terms, direct light, rays.
std::string beside_rays(const Subject& subject, const Assembly& all, const TraceScene& traced,
                        const Light& light, const StreamArray& sh, const StreamArray& direct, bool quick) {
    const uint32_t side = quick ? 120 : 420;
    Framing framing = make_framing(subject.scene.view_direction, 32, side, side);
    include(framing, all.positions);
    const View view = cast_view(traced, frame_camera(framing), side, side);
    std::vector<uint32_t> every(all.positions.size());
    std::iota(every.begin(), every.end(), 0u);
    const std::vector<double> red = trace_radiance(traced, all, light, every, 1);
    std::vector<float> rays;
    for (const double value : red)
        rays.insert(rays.end(), 3, static_cast<float>(value));
    const auto colours = [&](const StreamArray& stream) {
        std::vector<float> radiance(stream.bytes.size() / sizeof(float));
        std::memcpy(radiance.data(), stream.bytes.data(), stream.bytes.size());
        return color_view(view, all, radiance);
    };
    const Image truth = color_view(view, all, rays);
    const float exposure = exposure_for(truth, view.covered);
    const auto finished = [&](const Image& image) { return finish_view(view, image, exposure, nullptr); };
    const Picture left = finished(colours(sh)), middle = finished(colours(direct)), right = finished(truth);
    return encode_png(beside({&left, &middle, &right}, 4));
}

} // namespace

Study study_direct(const Subject& subject, const StudyOptions& options) {
    Study study;
    Table& table = study.table;
    table.columns = {"light", "how", "over transfer", "error", "p99"};
    const Assembly all = assemble(subject.scene, subject.pose);
    const TraceScene traced = make_trace_scene(all);
    const std::vector<uint32_t> receivers =
        choose_receivers(all.positions.size(), options.quick ? 300 : 4000);
    Engine engine(subject.scene, options.engine, subject.name);
    const Image around = sky(width, height, 0);
    Image black{width, height, std::vector<float>(size_t{3} * width * height)};
    const Light lights[] = {{"soft sky", around, {}},
                            with_sun("sky and a sun of 6 degrees", around, 6),
                            with_sun("sky and a sun of 1 degree", around, 1),
                            with_sun("a sun of 1 degree alone", black, 1)};
    double done = 0;
    for (const Light& light : lights) {
        const std::vector<double> reference =
            trace_radiance(traced, all, light, receivers, options.quick ? 32 : 96);
        const std::vector<float> terms = project_environment(light.image, light.name);
        std::vector<float> windowed = terms;
        float window[5];
        sh_window(ShWindow::hann, 6, window);
        sh_apply_window(window, 3, windowed.data());
        engine.surround(light.image, options.quality);
        std::vector<float> transfer;
        std::vector<StreamArray> none, sh(1), damped(1), direct(1);
        sh[0].kind = damped[0].kind = OutputKind::radiance;
        direct[0].kind = OutputKind::direct;
        const auto cpu = [&](const std::vector<float>& l, std::vector<StreamArray>& streams) {
            engine.light(l); // no palette: white Lambert
            return engine.frame(subject.pose, options.quality, transfer, nullptr, &streams).cpu_ms;
        };
        const std::vector<double> times =
            measure_in_turns(options.quick ? 3 : 15,
                             {[&] { return cpu(terms, none); }, [&] { return cpu(terms, sh); },
                              [&] { return cpu(windowed, damped); }, [&] { return cpu(terms, direct); }});
        const auto row = [&](const char* how, double time, const StreamArray& stream) {
            const RadianceError error = error_of(stream, reference, receivers);
            char ratio[32];
            std::snprintf(ratio, sizeof ratio, "%.2f x", time / times[0]);
            table.rows.push_back({light.name, how, ratio, percent(error.mean), percent(error.p99)});
        };
        row("25 terms", times[1], sh[0]);
        row("25 terms, Hann 6", times[2], damped[0]);
        row("direct", times[3], direct[0]);
        if (options.pictures && &light == std::end(lights) - 1)
            study.pictures.emplace_back(
                "direct.png", beside_rays(subject, all, traced, light, sh[0], direct[0], options.quick));
        options.progress(++done / std::size(lights));
    }
    return study;
}

} // namespace nusselt::tools
