// Half floats by integer arithmetic, the same on every instruction set.
#pragma once

#include <bit>
#include <cstdint>

namespace nusselt::kernels {

// The nearest half float, ties to even, of a finite number; beyond 65504 infinity.
inline uint16_t half_from_float(float value) {
    const uint32_t bits = std::bit_cast<uint32_t>(value);
    const uint32_t sign = bits >> 16 & 0x8000, size = bits & 0x7FFFFFFF;
    if (size >= 0x477FF000) return static_cast<uint16_t>(sign | 0x7C00);
    // Below the smallest normal half: adding 0.5 leaves the rounded subnormal in the last bits.
    const uint32_t small = std::bit_cast<uint32_t>(std::bit_cast<float>(size) + 0.5f) - 0x3F000000;
    const uint32_t normal = (size - 0x38000000 + 0xFFF + (size >> 13 & 1)) >> 13;
    return static_cast<uint16_t>(sign | (size < 0x38800000 ? small : normal));
}

inline float float_from_half(uint16_t half) {
    const uint32_t sign = uint32_t(half & 0x8000) << 16, size = half & 0x7FFFu;
    // As a float 2^112 times too small, subnormals included; infinity stays a large number.
    const float value = std::bit_cast<float>(size << 13) * 0x1p112f;
    return std::bit_cast<float>(std::bit_cast<uint32_t>(value) | sign);
}

} // namespace nusselt::kernels
