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
constexpr float field_of_view = 32;

// Where a point lies on the picture, in pixels.
std::array<double, 2> project(const Camera& camera, const glm::vec3& point, double across, double upright) {
    const glm::dvec3 d = glm::dvec3(point) - glm::dvec3(camera.eye);
    const glm::dvec3 right(camera.right), up(camera.up);
    const double depth = glm::dot(d, glm::dvec3(camera.forward));
    return {(0.5 + 0.5 * glm::dot(d, right) / glm::dot(right, right) / depth) * across,
            (0.5 - 0.5 * glm::dot(d, up) / glm::dot(up, up) / depth) * upright};
}

// Whether a triangle of the vertex, or of one at its place, is what the pixels around it show.
bool in_view(const View& view, const Assembly& all, uint32_t vertex) {
    const auto at = project(view.camera, all.positions[vertex], view.width, view.height);
    const size_t samples = view.triangle.size() / view.covered.size();
    for (int dy = -1; dy <= 1; ++dy) {
        for (int dx = -1; dx <= 1; ++dx) {
            const double x = std::floor(at[0]) + dx, y = std::floor(at[1]) + dy;
            if (!(x >= 0 && y >= 0 && x < view.width && y < view.height)) continue;
            const size_t pixel = static_cast<size_t>(y) * view.width + static_cast<size_t>(x);
            for (size_t k = pixel * samples; k < (pixel + 1) * samples; ++k) {
                if (view.triangle[k] == no_triangle) continue;
                for (size_t corner = 0; corner < 3; ++corner)
                    if (all.positions[all.indices[size_t{3} * view.triangle[k] + corner]] ==
                        all.positions[vertex])
                        return true;
            }
        }
    }
    return false;
}

// The usual direction, unless from another side or end more of the worst vertices are seen; the first counts
// most.
glm::vec3 best_direction(const TraceScene& scene, const Assembly& all, const glm::vec3& usual,
                         const std::vector<Worst>& worst) {
    const glm::vec3 across = glm::cross(usual, glm::vec3(0, 1, 0));
    std::vector<glm::vec3> directions{usual, {-usual.x, usual.y, -usual.z}, {usual.x, -usual.y, usual.z}};
    if (glm::length(across) > 1e-3f * glm::length(usual)) {
        directions.push_back(across + glm::vec3(0, usual.y, 0));
        directions.push_back(-across + glm::vec3(0, usual.y, 0));
    }
    glm::vec3 best = usual;
    int most = -1;
    for (const glm::vec3& direction : directions) {
        Framing framing = make_framing(direction, field_of_view, width / 2, height / 2);
        include(framing, all.positions);
        const View view = cast_view(scene, frame_camera(framing), width / 2, height / 2);
        int seen = 0;
        for (size_t k = 0; k < worst.size(); ++k)
            if (in_view(view, all, worst[k].vertex)) seen += k == 0 ? 3 : 1;
        if (seen > most) {
            most = seen;
            best = direction;
        }
    }
    return best;
}

// Black within white, so that it shows on any colour.
void draw_ring(Picture& picture, const std::array<double, 2>& at, double radius) {
    const auto reach = static_cast<int>(radius) + 2;
    for (int y = static_cast<int>(at[1]) - reach; y <= static_cast<int>(at[1]) + reach; ++y) {
        for (int x = static_cast<int>(at[0]) - reach; x <= static_cast<int>(at[0]) + reach; ++x) {
            if (x < 0 || y < 0 || x >= static_cast<int>(width) || y >= static_cast<int>(height)) continue;
            const double off = std::abs(std::hypot(x + 0.5 - at[0], y + 0.5 - at[1]) - radius);
            if (off >= 1.5) continue;
            const uint8_t value = off < 0.75 ? 0 : 255;
            for (size_t c = 0; c < 3; ++c)
                picture.rgb[(static_cast<size_t>(y) * width + static_cast<size_t>(x)) * 3 + c] = value;
        }
    }
}

// For each vertex the one with a reference that it repeats, or itself.
std::vector<uint32_t> sources(const Moment& moment) {
    const Assembly& all = moment.all;
    const auto key_of = [&](uint32_t vertex) {
        std::array<uint32_t, 6> key;
        std::memcpy(key.data(), &all.positions[vertex], 12);
        std::memcpy(key.data() + 3, &all.normals[vertex], 12);
        return key;
    };
    std::map<std::array<uint32_t, 6>, uint32_t> place;
    for (const uint32_t vertex : moment.traced)
        place[key_of(vertex)] = vertex;
    std::vector<uint32_t> source(all.positions.size());
    for (uint32_t v = 0; v < source.size(); ++v) {
        const auto found = place.find(key_of(v));
        source[v] = found == place.end() ? v : found->second;
    }
    return source;
}

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

Picture error_picture(const Moment& moment, const glm::vec3& view_direction, const std::vector<float>& ours,
                      const std::vector<Worst>& worst) {
    const Assembly& all = moment.all;
    const std::vector<float>& reference = moment.reference;
    const glm::vec3 unknown(0.35f), dark(0.12f);
    std::vector<glm::vec3> color(all.positions.size(), unknown);
    for (const uint32_t vertex : moment.traced) {
        const size_t first = size_t{25} * vertex;
        double difference = 0, size = 0;
        for (size_t i = first; i < first + 25; ++i) {
            const double d = double{ours[i]} - reference[i];
            difference += d * d;
            size += double{reference[i]} * reference[i];
        }
        color[vertex] = dark;
        if (!(seen_part(&reference[first]) >= 0.01)) continue;
        const glm::vec3 own = error_color(std::sqrt(difference / size));
        color[vertex] = moment.clear[vertex] ? own : glm::mix(own, unknown, 0.6f);
    }
    const std::vector<uint32_t> source = sources(moment);
    for (uint32_t v = 0; v < all.positions.size(); ++v)
        color[v] = color[source[v]];

    // A little shading by the view's direction shows the shape.
    const TraceScene scene = make_trace_scene(all);
    const glm::vec3 direction = best_direction(scene, all, view_direction, worst);
    const glm::vec3 towards = -glm::normalize(direction);
    std::vector<float> radiance;
    for (size_t v = 0; v < color.size(); ++v) {
        const float shade = 0.7f + 0.3f * std::abs(glm::dot(all.normals[v], towards));
        for (int c = 0; c < 3; ++c)
            radiance.push_back(color[v][c] * shade);
    }
    Framing framing = make_framing(direction, field_of_view, width, height);
    include(framing, all.positions);
    const View view = cast_view(scene, frame_camera(framing), width, height);
    const Image image = color_view(view, all, radiance);
    Picture picture(width, height);
    for (size_t k = 0; k < picture.rgb.size(); ++k) {
        const unsigned hits = view.covered[k / 3];
        picture.rgb[k] = static_cast<uint8_t>((hits * srgb(image.rgb[k]) + (9 - hits) * 250u + 4) / 9);
    }
    for (size_t k = 0; k < worst.size(); ++k) {
        if (!in_view(view, all, worst[k].vertex)) continue;
        const auto at = project(view.camera, all.positions[worst[k].vertex], width, height);
        draw_ring(picture, at, 7);
        if (k == 0) draw_ring(picture, at, 11);
    }
    return picture;
}

std::array<Picture, 2> lit_pictures(const Moment& moment, const glm::vec3& view_direction,
                                    const std::vector<float>& ours, const Light& light) {
    const Assembly& all = moment.all;
    Framing framing = make_framing(view_direction, field_of_view, width, height);
    include(framing, all.positions);
    const View view = cast_view(make_trace_scene(all), frame_camera(framing), width, height);
    const std::vector<uint32_t> source = sources(moment);
    const auto colored = [&](const std::vector<float>& transfer, bool repeats, bool white) {
        std::vector<float> radiance(all.positions.size() * 3);
        for (size_t v = 0; v < all.positions.size(); ++v) {
            const float* each = &transfer[size_t{25} * (repeats ? source[v] : v)];
            for (size_t c = 0; c < 3; ++c) {
                double sum = 0;
                for (size_t i = 0; i < 25; ++i)
                    sum += double{light.terms[i * 3 + c]} * each[i];
                radiance[3 * v + c] =
                    static_cast<float>(std::max(sum, 0.0)) * (white ? 1 : all.albedo[v][static_cast<int>(c)]);
            }
        }
        return color_view(view, all, radiance);
    };
    // One exposure, of the unshadowed surface in white.
    const float exposure = exposure_for(colored(open_transfers(all.normals), false, true), view.covered);
    return {finish_view(view, colored(ours, false, false), exposure, nullptr),
            finish_view(view, colored(moment.reference, true, false), exposure, nullptr)};
}

} // namespace nusselt::tools
