// Receivers inside closed parts: all is blocked there, by back faces that are never drawn.
#pragma once

#include "frame_data.h"

namespace nusselt {

// Fills frame.oblique: sample directions that stand well above the horizon and well apart.
void choose_oblique(const kernels::MaskLayout& layout, ObliqueSample out[oblique_samples]);

// The receivers of the batch that closed parts wind around, one bit a lane. Rays against the full mesh, whose
// crossings with all closed parts together are counted. From inside, every ray leaves once more than it
// enters; so one along the axis nearest to the normal rules most receivers out. It proves nothing: it may
// start below the receiver's own surface, or run along a wall. Where it leaves, three sample directions of
// the receiver's own decide, and all must agree; those that its own fan hides (`masks` as the fans leave
// them) have no say, and others take their place. Which rays are asked depends on the receiver alone, not on
// the batch. A receiver is not called inside where one of its own rays may meet a triangle with a corner that
// is not finite. Lanes of `full` (fill_fans) are asked for nine directions: two that lead out decide.
uint32_t find_inside(const Frame& frame, const kernels::Batch& batch, uint32_t full, Worker& worker);

} // namespace nusselt
