#include "tools/compare/pictures.h"

#include "tools/render/render.h"
#include "tools/trace/trace.h"

#include <glm/common.hpp>
#include <glm/geometric.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <map>

namespace nusselt::tools {

namespace {

constexpr uint32_t width = 560, height = 480;

uint8_t srgb(float linear) {
    const double x = std::clamp(static_cast<double>(linear), 0.0, 1.0);
    const double y = x <= 0.0031308 ? 12.92 * x : 1.055 * std::pow(x, 1 / 2.4) - 0.055;
    return static_cast<uint8_t>(std::lround(255 * y));
}

} // namespace

glm::vec3 error_color(double error) {
    // Dark blue, cyan, yellow, red, with steps of one decade.
    static constexpr std::array<glm::vec3, 4> stops{
        glm::vec3(0.02f, 0.08f, 0.35f), glm::vec3(0.05f, 0.55f, 0.55f), glm::vec3(0.95f, 0.75f, 0.05f),
        glm::vec3(0.85f, 0.02f, 0.02f)};
    const double place = std::clamp(std::log10(std::max(error, 1e-9)) + 3, 0.0, 2.999);
    const auto stop = static_cast<size_t>(place);
    return glm::mix(stops[stop], stops[stop + 1], static_cast<float>(place - static_cast<double>(stop)));
}

Picture error_picture(const Assembly& all, const glm::vec3& view_direction, const std::vector<float>& ours,
                      const std::vector<float>& reference, const std::vector<uint32_t>& receivers,
                      const std::vector<uint8_t>& clear) {
    const glm::vec3 unknown(0.35f), dark(0.12f);
    std::vector<glm::vec3> color(all.positions.size(), unknown);
    std::vector<uint8_t> known(all.positions.size());
    for (const uint32_t vertex : receivers) {
        const size_t first = size_t{25} * vertex;
        double difference = 0, size = 0;
        for (size_t i = first; i < first + 25; ++i) {
            const double d = double{ours[i]} - reference[i];
            difference += d * d;
            size += double{reference[i]} * reference[i];
        }
        known[vertex] = 1;
        color[vertex] = dark;
        if (!(seen_part(&reference[first]) >= 0.01)) continue;
        const glm::vec3 own = error_color(std::sqrt(difference / size));
        color[vertex] = clear[vertex] ? own : glm::mix(own, unknown, 0.6f);
    }
    // Vertices that repeat a receiver take its colour.
    const auto key_of = [&](uint32_t vertex) {
        std::array<uint32_t, 6> key;
        std::memcpy(key.data(), &all.positions[vertex], 12);
        std::memcpy(key.data() + 3, &all.normals[vertex], 12);
        return key;
    };
    std::map<std::array<uint32_t, 6>, uint32_t> place;
    for (const uint32_t vertex : receivers)
        place[key_of(vertex)] = vertex;
    for (uint32_t v = 0; v < all.positions.size(); ++v) {
        if (known[v]) continue;
        const auto found = place.find(key_of(v));
        if (found != place.end()) color[v] = color[found->second];
    }

    // A little shading by the view's direction shows the shape.
    const glm::vec3 towards = -glm::normalize(view_direction);
    std::vector<float> radiance;
    for (size_t v = 0; v < color.size(); ++v) {
        const float shade = 0.7f + 0.3f * std::abs(glm::dot(all.normals[v], towards));
        for (int c = 0; c < 3; ++c)
            radiance.push_back(color[v][c] * shade);
    }
    Framing framing = make_framing(view_direction, 32, width, height);
    include(framing, all.positions);
    const View view = cast_view(make_trace_scene(all), frame_camera(framing), width, height);
    const Image image = color_view(view, all, radiance);
    Picture picture(width, height);
    for (size_t k = 0; k < picture.rgb.size(); ++k) {
        const unsigned hits = view.covered[k / 3];
        picture.rgb[k] = static_cast<uint8_t>((hits * srgb(image.rgb[k]) + (9 - hits) * 250u + 4) / 9);
    }
    return picture;
}

} // namespace nusselt::tools
