// The mesh-wide stages of a frame: positions to frame space, planes, bounds of clusters, bands of levels.
#pragma once

#include "frame_data.h"

namespace nusselt {

// Tasks of the frame's graph; `context` is the Frame, items as named.
void measure_extents(void* context, uint32_t begin, uint32_t end, uint32_t slot); // chunks of points
void choose_scale(void* context, uint32_t begin, uint32_t end, uint32_t slot);    // one item
void place_points(void* context, uint32_t begin, uint32_t end, uint32_t slot);    // chunks of points
void refit_clusters(void* context, uint32_t begin, uint32_t end, uint32_t slot);  // clusters
void choose_bands(void* context, uint32_t begin, uint32_t end, uint32_t slot);    // meshes

// The bands of a mesh's clusters as proxies, for receivers of other objects; after its own were chosen.
void choose_proxy_bands(const Frame& frame, const MeshSlice& slice, float* nearest, float* farthest);

} // namespace nusselt
