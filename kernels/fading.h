// Occlusion that fades with distance: blockers hide all of the light up to one distance, none beyond another,
// and less and less in between. A triangle that lies in between hides a part of each sample under it, by the
// distance at which the sample's direction meets the triangle; the parts are added to the mask as binary
// digits, a mask each. One table an instruction set, all with the same bits, as in kernels.h.
#pragma once

#include "kernels/kernels.h"

namespace nusselt::kernels {

// The bits' sample directions: [block][x, y, z][bit of the block], aligned to 64 bytes.
constexpr size_t fade_directions_size(const MaskLayout& l) {
    return size_t(mask_bits(l)) * 3;
}
void build_fade_directions(const MaskLayout& layout, float* directions);

// Parts are sixteenths, in a byte a sample.
constexpr uint32_t fade_digits = 4, whole_part = 1u << fade_digits;

// What is hidden in part, of a batch: parts[lane][bit], and one bit a block where any of them may not be 0.
// All zero before the first job of a batch.
struct FadingParts {
    uint8_t* parts;    // lanes * mask_bits, aligned to 64 bytes
    uint64_t* touched; // lanes * mask_blocks / 64
};

// Carries out the jobs and empties the list: each sample that a job covers and its mask lacks is hidden for
// the job's part at least.
using RunFadingJobs = void (*)(const Tables& tables, const float* directions, const Fade& fade,
                               FadingJobs& jobs, const uint8_t* masks, FadingParts& parts);

// Adds samples that are hidden as a whole to `masks`, writes the digits of the others to digits[digit]
// (a batch's masks each, all zero before; a half, a quarter and so on of a sample), and makes all parts zero
// again. Returns the lanes that have a digit.
using SplitParts = uint32_t (*)(const MaskLayout& layout, FadingParts& parts, uint8_t* masks,
                                uint8_t* const digits[fade_digits]);

struct FadingKernels {
    RunFadingJobs run_jobs;
    SplitParts split;
};

// Null where kernels_for is.
const FadingKernels* fading_kernels_for(Set set);

} // namespace nusselt::kernels
