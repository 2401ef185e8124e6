// The kernels behind a frame's outputs: from transfer vectors to the streams that an engine asked for.
// One table of them an instruction set, all with the same bits, as in kernels.h.
#pragma once

#include "kernels/kernels.h"

namespace nusselt::kernels {

enum class Quantity : uint32_t { transfer, ambient_occlusion, bent_normal, glossy, radiance, direct };
enum class Format : uint32_t { float32, float16, packed8 };

// One stream. nusselt/output.h says what each quantity and format means.
struct Encoding {
    Quantity quantity;
    Format format;
    uint32_t bands;  // of a transfer vector, 1 to 5
    float window[5]; // factor of each band, 0 to 1, the first 1
};

// Of one transfer vector where the quantity is glossy: an element holds three.
constexpr uint32_t encoded_bytes(const Encoding& e) {
    const bool vector = e.quantity == Quantity::transfer || e.quantity == Quantity::glossy;
    const uint32_t components = vector                                      ? e.bands * e.bands
                                : e.quantity == Quantity::ambient_occlusion ? 1
                                                                            : 3;
    if (e.format == Format::float32) return 4 * components;
    if (e.format == Format::float16) return 2 * components;
    if (!vector) return components;
    // Bands 0 and 1 as half floats, then a scale for each further band, then a byte a term; band 2 is stored
    // as what lies beside expected_band_2.
    return e.bands == 1 ? 2 : 8 + (e.bands - 2) + (components - 4);
}
constexpr uint32_t most_encoded_bytes = 100;

// sqrt(2 l + 1): no coefficient of band l exceeds this many times the first one (addition theorem, and
// visibility is not negative).
constexpr float band_bound[5] = {1, 1.7320508075688772f, 2.23606797749979f, 2.6457513110645906f, 3};
// What band 2 of a packed transfer vector is stored beside: three quarters of the products of band 1's
// direction, which take most of a lobe's band 2 away (an open hemisphere has 0.665 of them, light from one
// direction 1.18). `low`: bands 0 and 1 as they are stored. Zeros where the first is not positive.
constexpr float expected_share = 0.81941133f, expected_zonal = 0.28867513f; // of xy; 1 / (2 sqrt 3)
inline void expected_band_2(const float low[4], float out[5]) {
    const float x = low[3], y = low[1], z = low[2];
    const float share = low[0] > 0 ? expected_share / low[0] : 0.0f;
    out[0] = share * (x * y);
    out[1] = share * (y * z);
    out[2] = share * (expected_zonal * (2.0f * (z * z) - (x * x + y * y)));
    out[3] = share * (x * z);
    out[4] = share * (0.5f * (x * x - y * y));
}
// The first coefficient of an open receiver, and 1 over it.
constexpr float open_first = 0.28209479177387814f;
constexpr float over_open_first = 3.5449077018110318f;

// transfer[term][lane] of the batch's receivers, in the caller's space, to 16 elements of encoded_bytes,
// `stride` bytes apart; all zero where a lane is not valid. Of radiance and direct light there are three
// rows, the channels.
using Encode = void (*)(const Encoding& encoding, const Batch& batch, const float transfer[][lanes],
                        uint8_t* out, uint32_t stride);

struct OutputKernels {
    Encode encode;
};

// Null where kernels_for is.
const OutputKernels* output_kernels_for(Set set);

} // namespace nusselt::kernels
