// What a triangle hides of a receiver's hemisphere, by definition: one test a sample point, with no table.
// Four levels stand above one another, each with an error of its own: whole numbers (none), double, float,
// and the library's table.
#pragma once

#include "kernels/kernels.h"

#include <array>
#include <cstdint>
#include <vector>

namespace nusselt::test {

// How the receiver sees a triangle. Edge-on: so close to its plane that the library leaves it out
// (ClusterJobs).
enum class Side { front, back, edge_on };

using Corners = std::array<std::array<float, 3>, 3>;

// The sample points of a layout, rounded to multiples of 2^-24 so that all levels mean the same directions.
struct Samples {
    explicit Samples(const kernels::MaskLayout& layout);
    uint32_t bits;
    std::vector<int32_t> whole[3];    // in 2^-24
    std::vector<double> direction[3]; // the same numbers
    std::vector<uint8_t> used;
};

// The closed cone over the triangle, whichever way it is wound, ORed into the mask: a sample on an edge
// belongs to it. `local` are corners in the receiver's tangent frame. Real is float or double.
template<class Real>
void cover(const Samples& samples, const std::array<std::array<Real, 3>, 3>& local, uint8_t* mask);

// The same in whole numbers: corners below 2^29 in size, nothing is rounded.
void cover_exactly(const Samples& samples, const std::array<std::array<int32_t, 3>, 3>& local, uint8_t* mask);

// A corner as a lane of the batch sees it, in double from the batch's own floats.
std::array<double, 3> local_corner(const kernels::Batch& batch, uint32_t lane,
                                   const std::array<float, 3>& corner);
std::array<std::array<double, 3>, 3> local_corners(const kernels::Batch& batch, uint32_t lane,
                                                   const Corners& corners);

// In double; `margin` is the height over the plane below which a receiver counts as in it, in parts of the
// distance to the farthest corner.
Side side_of(const std::array<std::array<double, 3>, 3>& local, double margin);

uint32_t count_bits(const uint8_t* mask, uint32_t bytes);

} // namespace nusselt::test
