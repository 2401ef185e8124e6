// Lighting: environments and radiance in real spherical harmonics of degree 4 (conventions:
// nusselt/nusselt.h).
#pragma once

#include "nusselt/context.h"
#include "nusselt/views.h"

namespace nusselt {

constexpr int sh_order = 5; // bands
constexpr int sh_terms = 25;

// Values of the 25 basis functions in unit direction (x, y, z).
void sh_evaluate(float x, float y, float z, float out[25]);

// Projects an environment in latitude-longitude layout onto SH: out[term * 3 + channel], radiance. `rgb`
// holds width * height pixels, rows top to bottom; row 0 is up = +y, and column u in [0, 1) is the direction
// (sin t cos p, cos t, sin t sin p) with p = 2 pi (u - 0.5) (so the middle of the image is +x, as glTF
// viewers show it), t = pi (v). Pixels are weighted with their exact solid angle; sums are in double. Pixels
// that are not finite or negative count as 0, those above 1e35 as 1e35 (so that shading stays finite), and
// both are counted in *bad (may be null).
Status sh_project_latlong(const float* rgb, uint32_t width, uint32_t height, float out[75], uint64_t* bad);

// Rotates SH coefficients: the result r satisfies r(R s) = c(s). `rotation` is row-major, orthonormal,
// proper.
void sh_rotate(const float rotation[9], const float coefficients[25], float out[25]);

// A light of the world as an object that stands turned by `object_to_world` (row-major, orthonormal, proper)
// sees it. Under it, transfer vectors in the object's space give what vectors in the world's space give under
// `light`: an object in rigid motion needs nothing but this. Both lights as sh_project_latlong writes them.
void turn_light(const float object_to_world[9], const float light[75], float out[75]);

// Radiance leaving each receiver: rgb[i] = albedo[i] * sum over terms of light[term] * transfer[i][term]
// (paper, equation 2). `light` as sh_project_latlong writes it. `albedo` may have no data (white). `rgb` has
// transfer.count * 3 floats. `order`: bands of the transfer vectors, 1 to 5, as in the frame that made them;
// bands that the light doesn't have are left out, which changes no bit. Plain function on the calling thread:
// a change of the light needs nothing else.
Status shade(const Context* context, const float light[75], TransferView transfer, Vec3View albedo,
             float* rgb, uint32_t order = sh_order);

} // namespace nusselt
