// The scalar reference of the fading kernels. Obvious, and never improved.
#include "kernels/reference.h"
#include "kernels/scalar.h"

#include <algorithm>
#include <bit>

namespace nusselt::kernels {

void build_fade_directions(const MaskLayout& layout, float* directions) {
    for (uint32_t bit = 0; bit < mask_bits(layout); ++bit) {
        double d[3] = {0, 0, 1};
        sample_direction(layout, bit, d);
        for (uint32_t k = 0; k < 3; ++k)
            directions[bit / 16 * 48 + k * 16 + bit % 16] = static_cast<float>(d[k]);
    }
}

namespace {

// `inverse`: one over the distance. Where rounding lets a sample pass beside the plane, it meets nothing.
uint32_t part_at(const Fade& fade, float inverse) {
    const float away = fade.steepness / larger(inverse, least_inverse);
    const float t = larger(fade.to * fade.steepness - away, 0), in = t < 1 ? t : 1;
    constexpr float whole = float(whole_part);
    return std::bit_cast<uint32_t>(in * in * (3 * whole - 2 * whole * in) + rounding) & 0xFF;
}

void run_jobs(const Tables& tables, const float* directions, const Fade& fade, FadingJobs& jobs,
              const uint8_t* masks, FadingParts& parts) {
    const MaskLayout& layout = tables.layout;
    const uint32_t bytes = mask_bytes(layout), bits = mask_bits(layout), words = mask_blocks(layout) / 64;
    for (uint32_t j = 0; j < jobs.list.count; ++j) {
        const uint32_t destination = jobs.list.destination[j], lane = destination / bytes;
        for (uint32_t i = 0; i < part_bytes(layout); ++i) {
            uint32_t inside = ~uint32_t(masks[destination + i]) & 0xFF;
            for (uint32_t k = 0; k < 3; ++k) {
                const uint32_t entry = jobs.list.plane[k][j];
                const uint32_t plane = tables.planes[(entry & ~63u) + i];
                inside &= entry & 1 ? ~plane : plane;
            }
            for (uint32_t bit = 0; bit < 8; ++bit) {
                if (!(inside >> bit & 1)) continue;
                const uint32_t sample = (destination % bytes + i) * 8 + bit, block = sample / 16;
                const float* d = directions + block * 48 + sample % 16;
                const float inverse =
                    d[0] * jobs.inverse[0][j] + d[16] * jobs.inverse[1][j] + d[32] * jobs.inverse[2][j];
                uint8_t& part = parts.parts[lane * bits + sample];
                part = std::max(part, static_cast<uint8_t>(part_at(fade, inverse)));
                parts.touched[lane * words + block / 64] |= 1ull << block % 64;
            }
        }
    }
    jobs.list.count = 0;
}

uint32_t split(const MaskLayout& layout, FadingParts& parts, uint8_t* masks,
               uint8_t* const digits[fade_digits]) {
    const uint32_t bytes = mask_bytes(layout), bits = mask_bits(layout), words = mask_blocks(layout) / 64;
    uint32_t any = 0;
    for (uint32_t lane = 0; lane < lanes; ++lane) {
        for (uint32_t sample = 0; sample < bits; ++sample) {
            uint8_t& part = parts.parts[lane * bits + sample];
            const uint32_t at = lane * bytes + sample / 8, bit = sample % 8;
            if (part == whole_part) masks[at] = uint8_t(masks[at] | 1u << bit);
            for (uint32_t digit = 0; digit < fade_digits && !(masks[at] >> bit & 1); ++digit) {
                const uint32_t set = part >> (fade_digits - 1 - digit) & 1;
                digits[digit][at] = uint8_t(digits[digit][at] | set << bit);
                any |= set << lane;
            }
            part = 0;
        }
        std::fill_n(parts.touched + lane * words, words, uint64_t(0));
    }
    return any;
}

} // namespace

const FadingKernels reference_fading_kernels = {run_jobs, split};

} // namespace nusselt::kernels
