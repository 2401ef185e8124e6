// Where everything lies in a frame's arrays.
#pragma once

#include "frame_data.h"

namespace nusselt {

// Where each mesh's part of the frame's arrays begins, and the arrays' sizes.
void lay_out(Frame& frame);

// Grows what is too small; a frame no larger than the largest so far allocates nothing. Throws
// std::bad_alloc.
void grow(Frame& frame);

// What does not change with the positions: every cluster's view of its mesh.
void connect(Frame& frame);

} // namespace nusselt
