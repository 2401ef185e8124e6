// Objects that lie far from a region of receivers: seen once from the region's middle, and multiplied into
// its transfer vectors.
#pragma once

#include "frame_data.h"

namespace nusselt {

// The products of two basis functions, integrated over the part of the sphere that each block of six masks is
// for, as kernels::AddHidden wants them: masks in turn. The masks look along the axes (+x, -x, +y, ...), each
// has the directions nearest to its own.
constexpr uint32_t far_faces = 6;
size_t far_table_size(const kernels::MaskLayout& layout); // floats
void build_far_table(const kernels::MaskLayout& layout, float* table);

// Whether a mesh's own results can do without the other objects in its masks. The frame's outputs are known.
bool may_look_far(const Frame& frame, const MeshSlice& slice);

// What worker.far_meshes hide from the middle of the receivers, as the matrix that takes their transfer
// vectors to those that see less: L . (M V) = (M L) . V, the light that is left (section 4.1 of the paper).
void look_far(Frame& frame, const kernels::ReceiverBounds& receivers, Worker& worker);

// worker.turned, times the matrix.
void multiply_far(const Frame& frame, Worker& worker);

} // namespace nusselt
