// The output kernels for SSE4, AVX2 and AVX-512, or NEON: one source, bit for bit equal to
// outputs_reference.cpp.
#include "kernels/simd.h"

#include <cstring>

#define HWY_WANT_SSE4 1
#if defined(__aarch64__)
#define HWY_COMPILE_ONLY_STATIC // NEON alone: the vectors of SVE have no size
#endif
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "kernels/outputs_simd.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace nusselt::kernels {
namespace HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;

using Float = hn::CappedTag<float, lanes>;
using Word = hn::RebindToUnsigned<Float>;
using Int = hn::RebindToSigned<Float>;
using V = hn::Vec<Float>;
using U = hn::Vec<Word>;

constexpr Float df;
constexpr Word du;
constexpr Int di;
constexpr uint32_t width = hn::MaxLanes(Float()); // lanes of a chunk
constexpr uint32_t first_term[6] = {0, 1, 4, 9, 16, 25};

HWY_INLINE V constant(float value) {
    return hn::Set(df, value);
}
HWY_INLINE V load(const float* row, uint32_t lane) {
    return hn::Load(df, row + lane);
}
HWY_INLINE V clamped(V value, float low, float high) {
    return hn::Min(hn::Max(value, constant(low)), constant(high));
}

// As in outputs_reference.cpp; the low bits of the word.
HWY_INLINE U nearest(V value) {
    return hn::BitCast(du, hn::Add(value, constant(12582912.0f)));
}

// As in half.h.
HWY_INLINE U half_from_float(V value) {
    const U bits = hn::BitCast(du, value);
    const U sign = hn::And(hn::ShiftRight<16>(bits), hn::Set(du, 0x8000));
    const U size = hn::And(bits, hn::Set(du, 0x7FFFFFFF));
    const U small =
        hn::Sub(hn::BitCast(du, hn::Add(hn::BitCast(df, size), constant(0.5f))), hn::Set(du, 0x3F000000));
    const U odd = hn::And(hn::ShiftRight<13>(size), hn::Set(du, 1));
    const U normal = hn::ShiftRight<13>(hn::Add(hn::Sub(size, hn::Set(du, 0x38000000 - 0xFFF)), odd));
    const auto below = hn::RebindMask(
        du, hn::Lt(hn::BitCast(di, size), hn::Set(di, 0x38800000))); // sizes are positive as integers
    const auto beyond = hn::RebindMask(du, hn::Gt(hn::BitCast(di, size), hn::Set(di, 0x477FEFFF)));
    const U number = hn::IfThenElse(below, small, normal);
    return hn::Or(sign, hn::IfThenElse(beyond, hn::Set(du, 0x7C00), number));
}
HWY_INLINE V float_from_half(U half) {
    const U sign = hn::ShiftLeft<16>(hn::And(half, hn::Set(du, 0x8000)));
    const U size = hn::And(half, hn::Set(du, 0x7FFF));
    const V value = hn::Mul(hn::BitCast(df, hn::ShiftLeft<13>(size)), constant(0x1p112f));
    return hn::BitCast(df, hn::Or(hn::BitCast(du, value), sign));
}

// Elements of the chunk's lanes, a component at a time.
struct Elements {
    uint8_t* out; // of the chunk's first lane
    uint32_t stride;

    template<class Part>
    HWY_INLINE void put(U words) {
        alignas(64) uint32_t values[lanes];
        hn::Store(words, du, values);
        for (uint32_t lane = 0; lane < width; ++lane) {
            const Part part = static_cast<Part>(values[lane]);
            std::memcpy(out + size_t(lane) * stride, &part, sizeof(Part));
        }
        out += sizeof(Part);
    }
    // Four floats of each lane: a transpose of 4x4 in every 128 bits.
    HWY_INLINE void put_four(const V* value) {
        const hn::RepartitionToWide<Word> d64;
        const hn::Full128<uint32_t> one;
        const auto pairs = [&](V low, V high, bool upper) HWY_ATTR {
            const V both = upper ? hn::InterleaveUpper(df, low, high) : hn::InterleaveLower(df, low, high);
            return hn::BitCast(d64, both);
        };
        alignas(64) uint32_t rows[4][width]; // [lane of the four][128 bits]
        for (const uint32_t half : {0u, 2u}) {
            const auto low = pairs(value[0], value[1], half > 0), high = pairs(value[2], value[3], half > 0);
            hn::Store(hn::BitCast(du, hn::InterleaveLower(d64, low, high)), du, rows[half]);
            hn::Store(hn::BitCast(du, hn::InterleaveUpper(d64, low, high)), du, rows[half + 1]);
        }
        for (uint32_t lane = 0; lane < width; ++lane)
            hn::StoreU(hn::Load(one, rows[lane % 4] + lane / 4 * 4), one,
                       reinterpret_cast<uint32_t*>(out + size_t(lane) * stride));
        out += 16;
    }
    HWY_INLINE void put_component(Format format, V value) {
        if (format == Format::float32) {
            put<uint32_t>(hn::BitCast(du, value));
        } else {
            put<uint16_t>(half_from_float(value));
        }
    }
};

// Values of lanes that are not valid are zero, and so is what is made of them.
HWY_INLINE void pack_transfer(uint32_t bands, V* values, Elements elements) {
    for (uint32_t i = 0; i < (bands == 1 ? 1u : 4u); ++i)
        elements.put<uint16_t>(half_from_float(values[i]));
    const auto stored = [&](uint32_t i) HWY_ATTR { return float_from_half(half_from_float(values[i])); };
    const V first = stored(0);
    const V zero = hn::Zero(df);
    if (bands > 2) {
        // As expected_band_2.
        const V x = stored(3), y = stored(1), z = stored(2);
        const V share = hn::IfThenElseZero(hn::Gt(first, zero), hn::Div(constant(expected_share), first));
        const V xx = hn::Mul(x, x), yy = hn::Mul(y, y), zz = hn::Mul(z, z);
        const V zonal = hn::Sub(hn::Mul(constant(2.0f), zz), hn::Add(xx, yy));
        const V expected[5] = {hn::Mul(x, y), hn::Mul(y, z), hn::Mul(constant(expected_zonal), zonal),
                               hn::Mul(x, z), hn::Mul(constant(0.5f), hn::Sub(xx, yy))};
        for (uint32_t i = 0; i < 5; ++i)
            values[4 + i] = hn::Sub(values[4 + i], hn::Mul(share, expected[i]));
    }
    Elements terms = elements;
    terms.out += bands > 2 ? bands - 2 : 0;
    for (uint32_t band = 2; band < bands; ++band) {
        const V bound = hn::Mul(first, constant(band_bound[band]));
        V most = zero;
        for (uint32_t i = first_term[band]; i < first_term[band + 1]; ++i)
            most = hn::Max(most, hn::Abs(values[i]));
        const V wanted = hn::Add(hn::Mul(hn::Div(most, bound), constant(255.0f)), constant(0.5f));
        const U scale = hn::And(nearest(hn::IfThenElseZero(hn::Gt(bound, zero), clamped(wanted, 0, 255))),
                                hn::Set(du, 0xFF));
        elements.put<uint8_t>(scale);
        const V level = hn::ConvertTo(df, hn::BitCast(di, scale));
        const V unit = hn::Mul(level, bound);
        for (uint32_t i = first_term[band]; i < first_term[band + 1]; ++i) {
            const V value = hn::Mul(hn::Div(values[i], unit), constant(127.0f * 255.0f));
            terms.put<uint8_t>(nearest(hn::IfThenElseZero(hn::Gt(level, zero), clamped(value, -127, 127))));
        }
    }
}

void encode(const Encoding& encoding, const Batch& batch, const float transfer[][lanes], uint8_t* out,
            uint32_t stride) {
    const V zero = hn::Zero(df);
    for (uint32_t lane = 0; lane < lanes; lane += width) {
        Elements elements{out + size_t(lane) * stride, stride};
        const uint8_t bits[8] = {uint8_t(batch.valid >> lane), uint8_t(batch.valid >> lane >> 8)};
        const auto valid = hn::LoadMaskBits(df, bits);
        if (encoding.quantity == Quantity::transfer || encoding.quantity == Quantity::glossy) {
            V values[25];
            for (uint32_t band = 0; band < encoding.bands; ++band) {
                const V factor = constant(encoding.window[band]);
                for (uint32_t i = first_term[band]; i < first_term[band + 1]; ++i)
                    values[i] = hn::IfThenElseZero(valid, hn::Mul(load(transfer[i], lane), factor));
            }
            if (encoding.format == Format::packed8) {
                pack_transfer(encoding.bands, values, elements);
                continue;
            }
            const uint32_t terms = encoding.bands * encoding.bands;
            uint32_t done = 0;
            for (; encoding.format == Format::float32 && done + 4 <= terms; done += 4)
                elements.put_four(values + done);
            for (; done < terms; ++done)
                elements.put_component(encoding.format, values[done]);
        } else if (encoding.quantity == Quantity::ambient_occlusion) {
            const V seen = hn::IfThenElseZero(
                valid, clamped(hn::Mul(load(transfer[0], lane), constant(over_open_first)), 0, 1));
            if (encoding.format == Format::packed8) {
                elements.put<uint8_t>(nearest(hn::Mul(seen, constant(255.0f))));
            } else {
                elements.put_component(encoding.format, seen);
            }
        } else if (encoding.quantity >= Quantity::radiance) {
            for (uint32_t c = 0; c < 3; ++c)
                elements.put_component(encoding.format, hn::IfThenElseZero(valid, load(transfer[c], lane)));
        } else {
            const V axis[3] = {load(transfer[3], lane), load(transfer[1], lane), load(transfer[2], lane)};
            const V length = hn::Sqrt(hn::Add(hn::Add(hn::Mul(axis[0], axis[0]), hn::Mul(axis[1], axis[1])),
                                              hn::Mul(axis[2], axis[2])));
            for (uint32_t k = 0; k < 3; ++k) {
                const V bent = hn::IfThenElse(hn::Gt(length, zero), hn::Div(axis[k], length),
                                              load(batch.axis[2][k], lane));
                const V value = hn::IfThenElseZero(valid, bent);
                if (encoding.format == Format::packed8) {
                    elements.put<uint8_t>(nearest(hn::Mul(value, constant(127.0f))));
                } else {
                    elements.put_component(encoding.format, value);
                }
            }
        }
    }
}

} // namespace

const OutputKernels table = {encode};

} // namespace HWY_NAMESPACE
} // namespace nusselt::kernels
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace nusselt::kernels {

const OutputKernels* simd_output_kernels(Set set) {
#include "kernels/simd_sets.inl"
}

} // namespace nusselt::kernels
#endif
