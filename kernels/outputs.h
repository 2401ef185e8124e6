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
    // Bands 0 and 1 as half floats, then a scale for each further band, then a byte a term.
    return e.bands == 1 ? 2 : 8 + (e.bands - 2) + (components - 4);
}
constexpr uint32_t most_encoded_bytes = 100;

// sqrt(2 l + 1): no coefficient of band l exceeds this many times the first one (addition theorem, and
// visibility is not negative).
constexpr float band_bound[5] = {1, 1.7320508075688772f, 2.23606797749979f, 2.6457513110645906f, 3};
// The first coefficient of an open receiver, and 1 over it.
constexpr float open_first = 0.28209479177387814f;
constexpr float over_open_first = 3.5449077018110318f;

// transfer[term][lane] of the batch's receivers, in the caller's space, to 16 elements of encoded_bytes, one
// after the other; all zero where a lane is not valid. Of radiance and direct light,
// rows 0 to 2 are the channels.
using Encode = void (*)(const Encoding& encoding, const Batch& batch, const float transfer[25][lanes],
                        uint8_t* out);

struct OutputKernels {
    Encode encode;
};

// Null where kernels_for is.
const OutputKernels* output_kernels_for(Set set);

} // namespace nusselt::kernels
