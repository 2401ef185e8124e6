// Objects that lie far from a region of receivers: seen once from the region's middle, or, farther still,
// from its mesh's, and multiplied into its transfer vectors.
#pragma once

#include "frame_data.h"

namespace nusselt {

// The products of two basis functions, integrated over the part of the sphere that each block of six masks is
// for, as kernels::AddHidden wants them: masks in turn. The masks look along the axes (+x, -x, +y, ...), each
// has the directions nearest to its own.
size_t far_table_size(const kernels::MaskLayout& layout); // floats
void build_far_table(const kernels::MaskLayout& layout, float* table);

// Whether a mesh's own results can do without the other objects in its masks. The frame's outputs are known.
bool may_look_far(const Frame& frame, const MeshSlice& slice);

// A task of the frame's graph: what is so far from a mesh that all of its receivers see it where the mesh's
// middle does, drawn once.
void look_farther(void* context, uint32_t begin, uint32_t end, uint32_t slot);

// What worker.far_meshes hide from the middle of the receivers, and what is farther still from the middle of
// their mesh, as the matrix that takes their transfer vectors to those that see less: L . (M V) = (M L) . V,
// the light that is left (section 4.1 of the paper). Sets worker.far_matrix.
void look_far(const Frame& frame, const MeshSlice& slice, const kernels::ReceiverBounds& receivers,
              Worker& worker);

// worker.turned, times that matrix.
void multiply_far(const Frame& frame, Worker& worker);

} // namespace nusselt
