// Receivers that lie in a blocker's surface: feet on a floor, a part that stands on another.
#pragma once

#include "kernels/kernels.h"

namespace nusselt::kernels {

// Adds the jobs of a triangle of the full mesh for receivers (`touching`, a bit a lane) so near its plane
// that rounding decides on which side they are. Seen from within it hides half of all directions; left out, a
// foot would be lit through the floor. The receiver is taken to stand a hundred-thousandth of the triangle's
// size off the plane: in front of a closed part's surface; before an open part's on the side to which its own
// normal points, or, where that lies in the plane too, on the side where it is by its coordinates. Nothing
// for receivers beside the triangle or at one of its corners. Shared by all sets: rare, and the same bits.
void touching_jobs(const Batch& batch, const ClusterView& cluster, const float* points, uint32_t triangle,
                   uint32_t touching, const MaskLayout& layout, float horizon, JobList& jobs,
                   Counters& counters);

} // namespace nusselt::kernels
