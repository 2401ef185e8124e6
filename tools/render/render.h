// Pictures by ray casting: what is seen from the camera, coloured by radiance per vertex. Nothing is lit
// here.
#pragma once

#include "tools/image/image.h"
#include "tools/trace/trace.h"

#include <glm/vec3.hpp>

#include <cstdint>
#include <vector>

namespace nusselt::tools {

struct Camera {
    glm::vec3 eye{0};
    // Unit vectors; `right` and `up` are scaled so that forward + x right + y up with x, y in [-1, 1] spans
    // the picture.
    glm::vec3 right{1, 0, 0}, up{0, 1, 0}, forward{0, 0, -1};
};

// Gathers what a camera that looks along `direction` has to show; +y is up unless the direction is vertical.
// `fov` is vertical, in degrees.
struct Framing {
    glm::dvec3 right, up, forward;
    double tan_x = 0, tan_y = 0;
    double reach[4] =
        {}; // how far the picture's four border planes have to lie out: left, right, bottom, top
    bool empty = true;
};
Framing make_framing(const glm::vec3& direction, float fov, uint32_t width, uint32_t height);
// Not finite positions don't count. Several poses of a clip share a camera.
void include(Framing& framing, const std::vector<glm::vec3>& positions);
// The nearest place from which all of it is seen, with a margin.
Camera frame_camera(const Framing& framing);

// What the camera sees: 3 x 3 samples a pixel.
struct View {
    uint32_t width = 0, height = 0;
    Camera camera;
    std::vector<uint32_t> triangle; // no_triangle: background
    std::vector<float> uv; // 2 barycentric coordinates a sample, of the triangle's second and third corner
    std::vector<uint8_t> behind;  // one a sample: 1 where the triangle's back is seen
    std::vector<uint8_t> covered; // samples of each pixel that hit, 0 to 9
    std::vector<float> opacity;   // of each pixel's hits (fade_view); empty: 1
};
constexpr uint32_t no_triangle = 0xFFFFFFFFu;

View cast_view(const TraceScene& scene, const Camera& camera, uint32_t width, uint32_t height);

// Lets what is behind shine through: `opacity` of each vertex, 0 to 1.
void fade_view(View& view, const Assembly& all, const std::vector<float>& opacity);

// The mean over each pixel's hits of the vertices' radiance (3 floats each); 0 where nothing was hit. Of
// triangles seen from behind that of `backs`, where there is one; otherwise they look as from the front.
struct BackRadiance {
    std::vector<float> radiance;   // 3 floats a vertex; empty: no backs
    std::vector<uint8_t> has_back; // one a vertex; a triangle has a back where all corners have
};
Image color_view(const View& view, const Assembly& all, const std::vector<float>& radiance,
                 const BackRadiance& backs = {});

// Tone-mapped, over the environment, or over a neutral gradient where `environment` is null.
Picture finish_view(const View& view, const Image& colored, float exposure, const Image* environment);

// Numbers in [0, 1] as they are, linear to 8 bits, over white.
Picture show_view(const View& view, const Image& colored);

} // namespace nusselt::tools
