// What is decided mesh by mesh before any cluster is looked at: which meshes a set of receivers can see,
// which of their levels lie in reach, and how the meshes of other objects are drawn.
#pragma once

#include "frame_data.h"

namespace nusselt {

// Whether meshes of several objects may hide one another; they are then proxies to one another.
bool needs_proxies(const Frame& frame);

// The sphere around mesh m and the bands of its levels; with proxies its clusters once more, in the bands of
// proxies. After its bands were chosen (refit.h).
void bound_mesh(Frame& frame, uint32_t m);

// The clusters of mesh m as a proxy that may matter to the receivers; returns how many.
uint32_t select_proxies(const Frame& frame, uint32_t m, const kernels::ReceiverBounds& receivers,
                        uint32_t* selected, Worker& worker);

// The sphere around mesh m, as bounds of receivers that look every way.
kernels::ReceiverBounds middle_of(const Frame& frame, uint32_t m);
// The meshes of other objects that are so far from mesh m that all of its receivers see them where its middle
// does; returns how many.
uint32_t list_farther(const Frame& frame, uint32_t m, uint32_t* meshes);

// The clusters that may matter to receivers of that mesh, to worker.candidates: those of its own object, and
// proxies of the others. `home` bounds all receivers of their region. Returns how many. Where the mesh looks
// far, the far ones of these are left to worker.far_meshes, and those of list_farther are left out.
uint32_t select_candidates(const Frame& frame, const MeshSlice& slice,
                           const kernels::ReceiverBounds& receivers, const kernels::ReceiverBounds& home,
                           Worker& worker);

} // namespace nusselt
