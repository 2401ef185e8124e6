// Environments for direct integration: radiance straight from masks and light, without spherical harmonics.
#pragma once

#include "nusselt/context.h"

#include <cstddef>
#include <cstdint>

namespace nusselt {

// A distant environment as all frames with masks of so many bits may use it, for OutputKind::direct. It shows
// light of all frequencies as finely as the cells of a mask are, 5 degrees of 1024: a sun casts a shadow with
// an edge about two cells wide, where 25 terms of SH blur it over 45 degrees. Read-only once made.
struct Environment;

struct EnvironmentDesc {
    // Radiance, in latitude-longitude layout as sh_project_latlong takes it; not kept.
    const float* rgb = nullptr;
    uint32_t width = 0, height = 0;
    uint32_t mask_bits = 1024; // quality_mask_bits of the frames: 1024 or 4096
};

// Filters the environment to the cells (about 0.1 s for 1024 bits, 0.4 s for 4096; 0.5 and 2.1 MB held).
// Pixels that are not finite or negative count as 0, those above 1e35 as 1e35 (so that radiance stays
// finite), and both are counted in *bad (may be null), as sh_project_latlong has it. `invalid_argument`:
// null, empty or more than 2^28 pixels, or other mask bits.
Status create_environment(Context* context, const EnvironmentDesc& desc, Environment** out,
                          uint64_t* bad = nullptr);

// Frees it; no frame in flight may use it. Null is ignored. Before the context is destroyed.
void destroy_environment(Context* context, Environment* environment);

} // namespace nusselt
