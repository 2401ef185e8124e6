// The fading kernels for SSE4, AVX2 and AVX-512, or NEON: one source, bit for bit equal to
// fading_reference.cpp.
#include "kernels/scalar.h"
#include "kernels/simd.h"

#include <cstring>

#define HWY_WANT_SSE4 1
#if defined(__aarch64__)
#define HWY_COMPILE_ONLY_STATIC // NEON alone: the vectors of SVE have no size
#endif
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "kernels/fading_simd.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace nusselt::kernels {
namespace HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;

using Float = hn::CappedTag<float, lanes>;
using Word = hn::RebindToUnsigned<Float>;
using V = hn::Vec<Float>;

constexpr Float df;
constexpr Word du;
constexpr uint32_t width = hn::MaxLanes(Float()); // samples of a chunk

HWY_INLINE V constant(float value) {
    return hn::Set(df, value);
}
HWY_INLINE hn::Mask<Word> mask_of(uint32_t bits) {
    const uint8_t bytes[8] = {uint8_t(bits), uint8_t(bits >> 8)};
    return hn::LoadMaskBits(du, bytes);
}

// What a job knows of its triangle's plane, for all samples.
struct Plane {
    V x, y, z;
    V to, steepness; // the fade's end over its length, and one over its length
};

// Raises the parts of those of a block's samples that are covered.
HWY_INLINE void raise_parts(const Plane& plane, const float* direction, uint32_t covered, uint8_t* parts) {
    const hn::Rebind<uint8_t, Float> bytes;
    for (uint32_t i = 0; i < 16; i += width) {
        const uint32_t bits = covered >> i & ((1u << width) - 1);
        if (width < 16 && !bits) continue;
        const V inverse = hn::Add(hn::Add(hn::Mul(hn::Load(df, direction + i), plane.x),
                                          hn::Mul(hn::Load(df, direction + 16 + i), plane.y)),
                                  hn::Mul(hn::Load(df, direction + 32 + i), plane.z));
        const V away = hn::Div(plane.steepness, hn::Max(inverse, constant(least_inverse)));
        const V in = hn::Min(hn::Max(hn::Sub(plane.to, away), hn::Zero(df)), constant(1));
        const V smooth = hn::Mul(hn::Mul(in, in), hn::Sub(constant(3 * float(whole_part)),
                                                          hn::Mul(constant(2 * float(whole_part)), in)));
        const auto part = hn::BitCast(du, hn::Add(smooth, constant(rounding)));
        const auto raised = hn::TruncateTo(bytes, hn::IfThenElseZero(mask_of(bits), part));
        hn::StoreU(hn::Max(raised, hn::LoadU(bytes, parts + i)), bytes, parts + i);
    }
}

template<uint32_t part_bytes, uint32_t bytes>
void run_jobs_of(const Tables& tables, const float* directions, const Fade& fade, FadingJobs& jobs,
                 const uint8_t* masks, FadingParts& out) {
    const hn::CappedTag<uint32_t, 16> d;
    constexpr uint32_t step = hn::MaxLanes(hn::CappedTag<uint32_t, 16>()) * 4;
    constexpr uint32_t ahead = 12, words = bytes / 128;
    const uint8_t* planes = tables.planes;
    const JobList& list = jobs.list;
    for (uint32_t j = 0; j < list.count; ++j) {
        const uint32_t next = j + ahead < list.count ? j + ahead : j;
        for (uint32_t k = 0; k < 3; ++k) {
            for (uint32_t line = 0; line < part_bytes; line += 64)
                __builtin_prefetch(planes + (list.plane[k][next] & ~63u) + line);
        }
        const uint32_t e0 = list.plane[0][j], e1 = list.plane[1][j], e2 = list.plane[2][j];
        const auto s0 = hn::Set(d, 0u - (e0 & 1)), s1 = hn::Set(d, 0u - (e1 & 1)),
                   s2 = hn::Set(d, 0u - (e2 & 1));
        const uint8_t* p0 = planes + (e0 & ~63u);
        const uint8_t* p1 = planes + (e1 & ~63u);
        const uint8_t* p2 = planes + (e2 & ~63u);
        const uint32_t destination = list.destination[j];
        alignas(64) uint64_t covered[part_bytes / 8];
        for (uint32_t i = 0; i < part_bytes; i += step) {
            const auto load = [&](const uint8_t* p)
                                  HWY_ATTR { return hn::Load(d, reinterpret_cast<const uint32_t*>(p + i)); };
            const auto inside =
                hn::And(hn::And(hn::Xor(load(p0), s0), hn::Xor(load(p1), s1)), hn::Xor(load(p2), s2));
            hn::Store(hn::AndNot(load(masks + destination), inside), d,
                      reinterpret_cast<uint32_t*>(covered) + i / 4);
        }
        const uint32_t lane = destination / bytes, first = destination % bytes / 2;
        const Plane plane{constant(jobs.inverse[0][j]), constant(jobs.inverse[1][j]),
                          constant(jobs.inverse[2][j]), constant(fade.to * fade.steepness),
                          constant(fade.steepness)};
        uint8_t* const parts = out.parts + size_t(lane) * bytes * 8;
        uint64_t* const touched = out.touched + lane * words;
        for (uint32_t w = 0; w < part_bytes / 8; ++w) {
            for (uint64_t left = covered[w]; left;) {
                const uint32_t in_word = static_cast<uint32_t>(__builtin_ctzll(left)) / 16;
                const uint32_t block = first + 4 * w + in_word;
                raise_parts(plane, directions + size_t(block) * 48,
                            static_cast<uint32_t>(left >> (16 * in_word) & 0xFFFF),
                            parts + size_t(block) * 16);
                touched[block / 64] |= 1ull << block % 64;
                left &= ~(0xFFFFull << (16 * in_word));
            }
        }
    }
    jobs.list.count = 0;
}

void run_jobs(const Tables& tables, const float* directions, const Fade& fade, FadingJobs& jobs,
              const uint8_t* masks, FadingParts& parts) {
    if (mask_bytes(tables.layout) == 128) {
        run_jobs_of<64, 128>(tables, directions, fade, jobs, masks, parts);
    } else {
        run_jobs_of<128, 512>(tables, directions, fade, jobs, masks, parts);
    }
}

uint32_t split(const MaskLayout& layout, FadingParts& parts, uint8_t* masks,
               uint8_t* const digits[fade_digits]) {
    const hn::CappedTag<uint8_t, 16> d;
    const uint32_t bytes = mask_bytes(layout), words = mask_blocks(layout) / 64;
    const auto bits_where = [&](hn::Mask<decltype(d)> mask) HWY_ATTR {
        uint16_t bits;
        hn::StoreMaskBits(d, mask, reinterpret_cast<uint8_t*>(&bits));
        return uint32_t(bits);
    };
    uint32_t any = 0;
    for (uint32_t lane = 0; lane < lanes; ++lane) {
        for (uint32_t w = 0; w < words; ++w) {
            uint64_t& touched = parts.touched[lane * words + w];
            for (uint64_t left = touched; left; left &= left - 1) {
                const uint32_t block = w * 64 + static_cast<uint32_t>(__builtin_ctzll(left));
                uint8_t* const part = parts.parts + (size_t(lane) * bytes * 8 + size_t(block) * 16);
                const auto values = hn::Load(d, part);
                hn::Store(hn::Zero(d), d, part);
                const size_t at = size_t(lane) * bytes + size_t(block) * 2;
                uint16_t mask;
                std::memcpy(&mask, masks + at, 2);
                mask = uint16_t(mask | bits_where(hn::Eq(values, hn::Set(d, uint8_t(whole_part)))));
                std::memcpy(masks + at, &mask, 2);
                for (uint32_t digit = 0; digit < fade_digits; ++digit) {
                    const auto one = hn::Set(d, uint8_t(whole_part >> (digit + 1)));
                    const auto set = uint16_t(bits_where(hn::TestBit(values, one)) & ~uint32_t(mask));
                    std::memcpy(digits[digit] + at, &set, 2);
                    any |= uint32_t(set != 0) << lane;
                }
            }
            touched = 0;
        }
    }
    return any;
}

} // namespace

const FadingKernels table = {run_jobs, split};

} // namespace HWY_NAMESPACE
} // namespace nusselt::kernels
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace nusselt::kernels {

const FadingKernels* simd_fading_kernels(Set set) {
#include "kernels/simd_sets.inl"
}

} // namespace nusselt::kernels
#endif
