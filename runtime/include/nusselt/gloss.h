// Glossy reflection: transfer vectors with a BRDF and a view (Kautz, Lehtinen, Aila 2004, equation 3), for
// OutputKind::glossy. They hold for one viewpoint: a frame computes them anew.
#pragma once

#include <cstddef>
#include <cstdint>

namespace nusselt {

enum class Brdf : uint32_t {
    // diffuse / pi + specular (e + 2) / (2 pi) max(0, r.s)^e, r the mirrored view: as in the paper,
    // normalised. Diffuse and specular together should not exceed 1.
    phong = 0,
    // Trowbridge and Reitz' distribution, Smith's separable shadowing, Schlick's Fresnel term F with
    // `specular` at normal incidence, and diffuse (1 - (1 - v.h)^5) / pi: with metallic_roughness, the BRDF
    // of glTF 2.0, appendix B.
    ggx = 1,
};

// A material. Colours are linear RGB, each component from 0 to 1.
struct Material {
    Brdf brdf = Brdf::ggx;
    float diffuse[3] = {1, 1, 1};
    float specular[3] = {0, 0, 0};
    // ggx: perceptual, 0 to 1, alpha is its square. Below sharpest_roughness it counts as that: the cells of
    // a mask are no finer.
    float roughness = 1;
    // phong: 0 to 10000. Above what sharpest_roughness stands for, 2 / alpha^2 - 2, it counts as that.
    uint32_t exponent = 1;
};

// As glTF's metallic-roughness model means it: a metal reflects the base colour, anything else 4 %.
Material metallic_roughness(const float base_color[3], float metallic, float roughness);

// The roughness of the sharpest lobe that masks with so many bits carry: 0.25 for 1024, 0.18 for 4096.
float sharpest_roughness(uint32_t mask_bits);

// How much of a material's lobe, seen head-on, lies beyond the given number of SH bands (1 to 5): the
// relative L2 norm of what is left out, 0 to 1. Above 0.3 a highlight under a hard light is visibly wider
// than it should be and rings around; soften the light, window the coefficients (sh_window), or take the
// specular part from elsewhere (a prefiltered environment, times ambient occlusion). The diffuse part is not
// counted.
float lobe_beyond_bands(const Material& material, uint32_t bands = 5);

// How a mesh reflects, and from where it is seen. Arrays are borrowed until `wait` returns.
struct Gloss {
    // The viewer's position, in the frame's space; or, where `distant`, the direction to it (any length).
    // A receiver at the viewer's position is seen along its normal. Views from below the tangent plane count
    // as grazing, as such receivers only matter at silhouettes; from more than 30 degrees below, the receiver
    // counts as not seen and has its diffuse part alone.
    float eye[3] = {};
    uint32_t distant = 0;
    const Material* materials = nullptr;
    uint32_t material_count = 0;
    const uint16_t* material_of = nullptr; // of each vertex, V of them; null: all have the first
};

} // namespace nusselt
