// A reflection as a sum of fields over the hemisphere that don't depend on the channel: what is integrated
// over a mask is then seldom three channels. pi f_r of channel c is the sum over fields of factor[field][c]
// times the field, but for the diffuse part that the view does not change.
#pragma once

#include "kernels/light.h"

namespace nusselt::kernels {

enum class Parts : uint32_t {
    power,   // phong: cos^e, normalised
    whole,   // ggx, one channel: all of it
    metal,   // no diffuse part: the lobe, and the lobe at grazing angles
    plastic, // grey specular: the lobe with its Fresnel term, and what it takes from the diffuse part
    mixed    // both of metal, and what they take from the diffuse part
};

struct ReflectionParts {
    Parts kind;
    uint32_t fields;
    float factor[3][3]; // [field][channel]
};

inline ReflectionParts parts_of(const Reflection& r, uint32_t channels) {
    const float* s = r.specular;
    const float* d = r.diffuse;
    if (r.lobe == Lobe::phong) return {Parts::power, 1, {{s[0], s[1], s[2]}}};
    if (channels == 1) return {Parts::whole, 1, {{1, 1, 1}}};
    if (d[0] == 0 && d[1] == 0 && d[2] == 0) return {Parts::metal, 2, {{s[0], s[1], s[2]}, {1, 1, 1}}};
    if (s[0] == s[1] && s[0] == s[2]) return {Parts::plastic, 2, {{1, 1, 1}, {-d[0], -d[1], -d[2]}}};
    return {Parts::mixed, 3, {{s[0], s[1], s[2]}, {1, 1, 1}, {-d[0], -d[1], -d[2]}}};
}

} // namespace nusselt::kernels
