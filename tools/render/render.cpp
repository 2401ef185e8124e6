#include "tools/render/render.h"

#include "tools/trace/parallel.h"

#include <embree3/rtcore.h>
#include <glm/geometric.hpp>
#include <glm/vec2.hpp>
#include <pmmintrin.h>
#include <xmmintrin.h>

#include <algorithm>
#include <cmath>
#include <numbers>

namespace nusselt::tools {

namespace {

constexpr double margin = 1.08;
constexpr uint32_t samples_across = 3;
constexpr uint32_t samples_per_pixel = samples_across * samples_across;

glm::vec3 through(const Camera& camera, float x, float y) {
    return glm::normalize(camera.forward + x * camera.right + y * camera.up);
}

// Picture coordinates in [-1, 1], y up.
glm::vec2 on_picture(const View& view, double x, double y) {
    return {static_cast<float>(2 * x / view.width - 1), static_cast<float>(1 - 2 * y / view.height)};
}

} // namespace

Framing make_framing(const glm::vec3& direction, float fov, uint32_t width, uint32_t height) {
    Framing framing;
    const double length = glm::length(glm::dvec3(direction));
    framing.forward = length > 0 ? glm::dvec3(direction) / length : glm::dvec3(0, 0, -1);
    const glm::dvec3 world_up =
        std::abs(framing.forward.y) > 0.999 ? glm::dvec3(0, 0, -1) : glm::dvec3(0, 1, 0);
    framing.right = glm::normalize(glm::cross(framing.forward, world_up));
    framing.up = glm::cross(framing.right, framing.forward);
    framing.tan_y = std::tan(double{fov} * 0.5 * std::numbers::pi / 180);
    framing.tan_x = framing.tan_y * width / height;
    return framing;
}

void include(Framing& framing, const std::vector<glm::vec3>& positions) {
    // The margin is part of the angle that is fitted.
    const double tan_x = framing.tan_x / margin, tan_y = framing.tan_y / margin;
    for (const glm::vec3& position : positions) {
        if (!std::isfinite(position.x) || !std::isfinite(position.y) || !std::isfinite(position.z)) continue;
        const glm::dvec3 p(position);
        const double x = glm::dot(p, framing.right), y = glm::dot(p, framing.up),
                     z = glm::dot(p, framing.forward);
        const double reach[4] = {-x - tan_x * z, x - tan_x * z, -y - tan_y * z, y - tan_y * z};
        for (int k = 0; k < 4; ++k)
            framing.reach[k] = framing.empty ? reach[k] : std::max(framing.reach[k], reach[k]);
        framing.empty = false;
    }
}

Camera frame_camera(const Framing& framing) {
    // From eye (x, y, -d) a point is seen where |p.x - x| <= tan_x (p.z + d): two planes each way, which meet
    // in the middle and need d at least their half distance over the tangent.
    const double tan_x = framing.tan_x / margin, tan_y = framing.tan_y / margin;
    const double* reach = framing.reach;
    const double x = (reach[1] - reach[0]) / 2, y = (reach[3] - reach[2]) / 2;
    const double across = (reach[0] + reach[1]) / (2 * tan_x), upright = (reach[2] + reach[3]) / (2 * tan_y);
    double d = std::max(across, upright);
    // A single point, or a line along the view: any distance does.
    const double size = std::max({std::abs(d), std::abs(x), std::abs(y), 1e-30});
    d += 1e-3 * size;
    Camera camera;
    camera.forward = framing.forward;
    camera.right = framing.right * framing.tan_x;
    camera.up = framing.up * framing.tan_y;
    camera.eye = framing.right * x + framing.up * y - framing.forward * d;
    return camera;
}

View cast_view(const TraceScene& scene, const Camera& camera, uint32_t width, uint32_t height) {
    View view;
    view.width = width;
    view.height = height;
    view.camera = camera;
    const size_t pixels = size_t{width} * height;
    view.triangle.assign(pixels * samples_per_pixel, no_triangle);
    view.uv.assign(pixels * samples_per_pixel * 2, 0.0f);
    view.behind.assign(pixels * samples_per_pixel, 0);
    view.covered.assign(pixels, 0);
    parallel_blocks(height, 4, [&](size_t begin, size_t end) {
        const unsigned saved = _mm_getcsr();
        _MM_SET_FLUSH_ZERO_MODE(_MM_FLUSH_ZERO_ON);
        _MM_SET_DENORMALS_ZERO_MODE(_MM_DENORMALS_ZERO_ON);
        RTCIntersectContext context;
        rtcInitIntersectContext(&context);
        context.flags = RTC_INTERSECT_CONTEXT_FLAG_COHERENT;
        for (size_t pixel = begin * width; pixel < end * width; ++pixel) {
            for (uint32_t sample = 0; sample < samples_per_pixel; ++sample) {
                const double sx = (sample % samples_across + 0.5) / samples_across;
                const double sy = (sample / samples_across + 0.5) / samples_across;
                const glm::vec2 at = on_picture(view, static_cast<double>(pixel % width) + sx,
                                                static_cast<double>(pixel / width) + sy);
                const glm::vec3 direction = through(camera, at.x, at.y);
                RTCRayHit hit;
                hit.ray.org_x = camera.eye.x;
                hit.ray.org_y = camera.eye.y;
                hit.ray.org_z = camera.eye.z;
                hit.ray.dir_x = direction.x;
                hit.ray.dir_y = direction.y;
                hit.ray.dir_z = direction.z;
                hit.ray.tnear = 0;
                hit.ray.tfar = INFINITY;
                hit.ray.time = 0;
                hit.ray.mask = ~0u;
                hit.ray.id = 0;
                hit.ray.flags = 0;
                hit.hit.geomID = RTC_INVALID_GEOMETRY_ID;
                hit.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
                rtcIntersect1(scene.scene.get(), &context, &hit);
                if (hit.hit.geomID == RTC_INVALID_GEOMETRY_ID) continue;
                const size_t k = pixel * samples_per_pixel + sample;
                view.triangle[k] = hit.hit.primID;
                view.uv[2 * k] = hit.hit.u;
                view.uv[2 * k + 1] = hit.hit.v;
                view.behind[k] = glm::dot(direction, glm::vec3(hit.hit.Ng_x, hit.hit.Ng_y, hit.hit.Ng_z)) > 0;
                ++view.covered[pixel];
            }
        }
        _mm_setcsr(saved);
    });
    return view;
}

void fade_view(View& view, const Assembly& all, const std::vector<float>& opacity) {
    view.opacity.assign(view.covered.size(), 1.0f);
    for (size_t pixel = 0; pixel < view.covered.size(); ++pixel) {
        if (!view.covered[pixel]) continue;
        float sum = 0;
        for (size_t k = pixel * samples_per_pixel; k < (pixel + 1) * samples_per_pixel; ++k) {
            if (view.triangle[k] == no_triangle) continue;
            const uint32_t* corner = &all.indices[size_t{3} * view.triangle[k]];
            const float u = view.uv[2 * k], v = view.uv[2 * k + 1];
            sum += (1 - u - v) * opacity[corner[0]] + u * opacity[corner[1]] + v * opacity[corner[2]];
        }
        view.opacity[pixel] = sum / static_cast<float>(view.covered[pixel]);
    }
}

Image color_view(const View& view, const Assembly& all, const std::vector<float>& radiance,
                 const BackRadiance& backs) {
    const auto has_back = [&](const uint32_t* corner) {
        return !backs.radiance.empty() && backs.has_back[corner[0]] && backs.has_back[corner[1]] &&
               backs.has_back[corner[2]];
    };
    Image image{view.width, view.height, {}};
    image.rgb.assign(view.covered.size() * 3, 0.0f);
    for (size_t pixel = 0; pixel < view.covered.size(); ++pixel) {
        if (!view.covered[pixel]) continue;
        float sum[3] = {};
        for (size_t k = pixel * samples_per_pixel; k < (pixel + 1) * samples_per_pixel; ++k) {
            if (view.triangle[k] == no_triangle) continue;
            const uint32_t* corner = &all.indices[size_t{3} * view.triangle[k]];
            const float u = view.uv[2 * k], v = view.uv[2 * k + 1];
            const float weight[3] = {1 - u - v, u, v};
            const std::vector<float>& seen = view.behind[k] && has_back(corner) ? backs.radiance : radiance;
            for (int c = 0; c < 3; ++c)
                for (size_t channel = 0; channel < 3; ++channel)
                    sum[channel] += weight[c] * seen[size_t{3} * corner[c] + channel];
        }
        for (size_t channel = 0; channel < 3; ++channel)
            image.rgb[pixel * 3 + channel] = sum[channel] / static_cast<float>(view.covered[pixel]);
    }
    return image;
}

namespace {

float part_covered(const View& view, size_t pixel) {
    const float hits = static_cast<float>(view.covered[pixel]) / samples_per_pixel;
    return view.opacity.empty() ? hits : hits * view.opacity[pixel];
}

} // namespace

Picture finish_view(const View& view, const Image& colored, float exposure, const Image* environment) {
    Picture picture = tone_map(colored, exposure);
    Picture background(view.width, view.height);
    if (environment) {
        Image seen{view.width, view.height, {}};
        seen.rgb.resize(colored.rgb.size());
        for (size_t pixel = 0; pixel < view.covered.size(); ++pixel) {
            const glm::vec2 at = on_picture(view, static_cast<double>(pixel % view.width) + 0.5,
                                            static_cast<double>(pixel / view.width) + 0.5);
            const glm::vec3 direction = through(view.camera, at.x, at.y);
            sample_latlong(*environment, direction.x, direction.y, direction.z, &seen.rgb[pixel * 3]);
        }
        background = tone_map(seen, exposure);
    } else {
        constexpr float top[3] = {214, 220, 228}, bottom[3] = {244, 244, 242};
        for (size_t pixel = 0; pixel < view.covered.size(); ++pixel) {
            const float t = static_cast<float>(pixel / view.width) / static_cast<float>(view.height);
            for (size_t channel = 0; channel < 3; ++channel) {
                background.rgb[pixel * 3 + channel] =
                    static_cast<uint8_t>(top[channel] + t * (bottom[channel] - top[channel]));
            }
        }
    }
    // Edges are blended after the film curve: a bright sky doesn't eat into the outline.
    for (size_t k = 0; k < picture.rgb.size(); ++k) {
        const float part = part_covered(view, k / 3);
        picture.rgb[k] = static_cast<uint8_t>(static_cast<float>(picture.rgb[k]) * part +
                                              static_cast<float>(background.rgb[k]) * (1 - part) + 0.5f);
    }
    return picture;
}

Picture show_view(const View& view, const Image& colored) {
    Picture picture(view.width, view.height);
    for (size_t k = 0; k < picture.rgb.size(); ++k) {
        const float part = part_covered(view, k / 3);
        const float value = std::clamp(colored.rgb[k], 0.0f, 1.0f);
        picture.rgb[k] = static_cast<uint8_t>(255 * (value * part + 1 - part) + 0.5f);
    }
    return picture;
}

} // namespace nusselt::tools
