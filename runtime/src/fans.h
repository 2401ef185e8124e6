// What the triangles around a receiver hide from it.
#pragma once

#include "frame_data.h"

namespace nusselt {

// Adds the jobs of what each receiver's incident triangles hide below themselves. Returns the lanes for which
// that may not be all (kernels::FanJobs).
uint32_t shadow_fans(const Frame& frame, const MeshSlice& slice, const uint32_t* receivers,
                     const kernels::Batch& batch, Worker& worker, kernels::JobList& jobs);

// Adds to these lanes' masks the directions into what is solid around them: closed, consistently wound parts
// alone. Fans of more than 256 triangles are left as they are, and so are lanes for which all directions
// would be solid: a bit each in what is returned. Those are receivers deep in a corner where parts touch, or
// a fan that is folded inside out; rays tell (find_inside).
uint32_t fill_fans(const Frame& frame, const MeshSlice& slice, const uint32_t* receivers,
                   const kernels::Batch& batch, uint32_t folded, Worker& worker);

} // namespace nusselt
