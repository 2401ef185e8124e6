// The last open samples of a mask that is nearly closed, decided by the triangles' own planes: around a
// vertex the table's planes round apart and may leave a sample to none of the triangles there, which inside a
// closed surface is light from nowhere. Shared by all sets: rare, and the same bits.
#pragma once

#include "kernels/kernels.h"

namespace nusselt::kernels {

// A mask is nearly closed where at most this many samples are open: 64 of 1024, 256 of 4096. Where levels of
// a sheet meet right beside the receiver, 55 of 1024 were seen.
constexpr uint32_t most_last_samples(const MaskLayout& l) {
    return mask_bits(l) / 16;
}

struct Sample {
    float local[3];     // unit direction in the lane's tangent frame
    float direction[3]; // and in the frame's space
};

// The bits of the open samples of one mask, in order; returns how many, 0 where none is open, or too many.
uint32_t find_last_samples(const MaskLayout& layout, const uint8_t* mask,
                           uint32_t bits[most_last_samples(fine_layout)]);

Sample sample_of(const MaskLayout& layout, const Batch& batch, uint32_t lane, uint32_t bit);

// Whether a triangle hides the sample, its planes unrounded: one that ClusterJobs draws, or a coarse one that
// it leaves out where levels meet. A sample in the plane of an edge belongs to both sides.
bool hides(const Batch& batch, uint32_t lane, const ClusterView& cluster, const float* points,
           uint32_t triangle, const Sample& sample);

// The same of what an incident triangle (receiver, from, to) hides below itself (FanJobs).
bool hides_below(const Batch& batch, uint32_t lane, const float from[3], const float to[3],
                 const Sample& sample);

} // namespace nusselt::kernels
