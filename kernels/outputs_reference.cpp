// The scalar reference of the output kernels.
#include "kernels/half.h"
#include "kernels/reference.h"

#include <cmath>
#include <cstring>

namespace nusselt::kernels {

namespace {

constexpr uint32_t first_term[6] = {0, 1, 4, 9, 16, 25};

// The nearest integer, ties to even, of a number below 2^22 in size.
int32_t nearest(float value) {
    return int32_t(std::bit_cast<uint32_t>(value + 12582912.0f) << 10) >> 10;
}

float clamped(float value, float low, float high) {
    const float above = value > low ? value : low;
    return above < high ? above : high;
}

void put_float(float value, uint8_t*& out) {
    std::memcpy(out, &value, 4);
    out += 4;
}

void put_half(float value, uint8_t*& out) {
    const uint16_t half = half_from_float(value);
    std::memcpy(out, &half, 2);
    out += 2;
}

void put_components(Format format, const float* values, uint32_t count, uint8_t* out) {
    for (uint32_t i = 0; i < count; ++i) {
        if (format == Format::float32) {
            put_float(values[i], out);
        } else {
            put_half(values[i], out);
        }
    }
}

void pack_transfer(uint32_t bands, const float* values, uint8_t* out) {
    for (uint32_t i = 0; i < (bands == 1 ? 1u : 4u); ++i)
        put_half(values[i], out);
    const float first = float_from_half(half_from_float(values[0]));
    float rest[25];
    std::memcpy(rest, values, size_t(bands) * bands * sizeof(float));
    if (bands > 2) {
        float low[4], expected[5];
        for (uint32_t i = 0; i < 4; ++i)
            low[i] = float_from_half(half_from_float(values[i]));
        expected_band_2(low, expected);
        for (uint32_t i = 0; i < 5; ++i)
            rest[4 + i] = values[4 + i] - expected[i];
    }
    uint8_t* const scales = out;
    uint8_t* terms = out + (bands > 2 ? bands - 2 : 0);
    for (uint32_t band = 2; band < bands; ++band) {
        const float bound = first * band_bound[band];
        float most = 0;
        for (uint32_t i = first_term[band]; i < first_term[band + 1]; ++i)
            most = std::fabs(rest[i]) > most ? std::fabs(rest[i]) : most;
        // Rounded up, so that no term exceeds the scale.
        const int32_t scale = bound > 0 ? nearest(clamped(most / bound * 255.0f + 0.5f, 0, 255)) : 0;
        scales[band - 2] = uint8_t(scale);
        const float unit = float(scale) * bound;
        for (uint32_t i = first_term[band]; i < first_term[band + 1]; ++i) {
            const float value = scale > 0 ? rest[i] / unit * (127.0f * 255.0f) : 0.0f;
            *terms++ = uint8_t(nearest(clamped(value, -127, 127)));
        }
    }
}

void encode_transfer(const Encoding& e, const float transfer[25], uint8_t* out) {
    float values[25];
    for (uint32_t band = 0; band < e.bands; ++band) {
        for (uint32_t i = first_term[band]; i < first_term[band + 1]; ++i)
            values[i] = transfer[i] * e.window[band];
    }
    if (e.format == Format::packed8) {
        pack_transfer(e.bands, values, out);
    } else {
        put_components(e.format, values, e.bands * e.bands, out);
    }
}

void encode_occlusion(const Encoding& e, const float transfer[25], uint8_t* out) {
    const float seen = clamped(transfer[0] * over_open_first, 0, 1);
    if (e.format == Format::packed8) {
        *out = uint8_t(nearest(seen * 255.0f));
    } else {
        put_components(e.format, &seen, 1, out);
    }
}

void encode_bent_normal(const Encoding& e, const float normal[3], const float transfer[25], uint8_t* out) {
    const float x = transfer[3], y = transfer[1], z = transfer[2];
    const float length = std::sqrt(x * x + y * y + z * z);
    const float bent[3] = {length > 0 ? x / length : normal[0], length > 0 ? y / length : normal[1],
                           length > 0 ? z / length : normal[2]};
    if (e.format == Format::packed8) {
        for (uint32_t k = 0; k < 3; ++k)
            out[k] = uint8_t(nearest(bent[k] * 127.0f));
    } else {
        put_components(e.format, bent, 3, out);
    }
}

void encode(const Encoding& encoding, const Batch& batch, const float transfer[][lanes], uint8_t* out,
            uint32_t stride) {
    for (uint32_t lane = 0; lane < lanes; ++lane, out += stride) {
        std::memset(out, 0, encoded_bytes(encoding));
        if (!(batch.valid >> lane & 1)) continue;
        float own[25];
        for (uint32_t i = 0; i < (encoding.quantity >= Quantity::radiance ? 3u : 25u); ++i)
            own[i] = transfer[i][lane];
        const float normal[3] = {batch.axis[2][0][lane], batch.axis[2][1][lane], batch.axis[2][2][lane]};
        switch (encoding.quantity) {
        case Quantity::transfer:
        case Quantity::glossy:
            encode_transfer(encoding, own, out);
            break;
        case Quantity::ambient_occlusion:
            encode_occlusion(encoding, own, out);
            break;
        case Quantity::bent_normal:
            encode_bent_normal(encoding, normal, own, out);
            break;
        case Quantity::radiance:
        case Quantity::direct:
            put_components(encoding.format, own, 3, out);
            break;
        }
    }
}

} // namespace

const OutputKernels reference_output_kernels = {encode};

} // namespace nusselt::kernels
