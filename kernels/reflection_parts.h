// A reflection as a sum of fields over the hemisphere that don't depend on the channel: what is integrated
// over a mask is then seldom three channels. pi f_r of channel c is the sum over fields of factor[field][c]
// times the field, but for the diffuse part that the view does not change.
#pragma once

#include "kernels/light.h"

#include <bit>

namespace nusselt::kernels {

enum class Parts : uint32_t {
    power,   // phong: cos^e, normalised
    whole,   // ggx, one channel: all of it
    metal,   // no diffuse part: the lobe, and the lobe at grazing angles
    plastic, // grey specular: the lobe with its Fresnel term, and what it takes from the diffuse part
    mixed    // both of metal, and what they take from the diffuse part
};

constexpr uint32_t fields_of(Parts kind) {
    return kind == Parts::mixed ? 3 : kind == Parts::metal || kind == Parts::plastic ? 2 : 1;
}

struct ReflectionParts {
    Parts kind;
    uint32_t fields;    // 0: no lobe
    float factor[3][3]; // [field][channel]
};

inline ReflectionParts parts_of(const Reflection& r, uint32_t channels) {
    const float* s = r.specular;
    const float* d = r.diffuse;
    if (r.lobe == Lobe::none) return {};
    if (r.lobe == Lobe::phong) return {Parts::power, 1, {{s[0], s[1], s[2]}}};
    if (channels == 1) return {Parts::whole, 1, {{1, 1, 1}}};
    if (d[0] == 0 && d[1] == 0 && d[2] == 0) return {Parts::metal, 2, {{s[0], s[1], s[2]}, {1, 1, 1}}};
    if (s[0] == s[1] && s[0] == s[2]) return {Parts::plastic, 2, {{1, 1, 1}, {-d[0], -d[1], -d[2]}}};
    return {Parts::mixed, 3, {{s[0], s[1], s[2]}, {1, 1, 1}, {-d[0], -d[1], -d[2]}}};
}

// Fields are multiplied as integers with a sign, in units of a power of two: outside the lobe's core by
// blocks, up to 15 bits (a sum over all blocks stays within 32: columns of tables add up to 32000 at most,
// either way); in it by bits, up to 12.
constexpr int block_levels = 15, bit_levels = 12;
constexpr uint32_t core_group = 16; // blocks with open bits that share a unit, in their order

// The inverse of the unit for values up to `largest`, and the unit.
struct LevelUnit {
    float inverse, unit;
};
inline LevelUnit level_unit(float largest, int bits) {
    // The levels' power of two over the next one above `largest`; what is less than 2^-100 is nothing.
    const int exponent = int(std::bit_cast<uint32_t>(largest) >> 23) - 126;
    if (exponent < -100) return {0.0f, 0.0f};
    return {std::bit_cast<float>(uint32_t(127 + bits - exponent) << 23),
            std::bit_cast<float>(uint32_t(127 + exponent - bits) << 23)};
}

} // namespace nusselt::kernels
