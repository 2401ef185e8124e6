// What each quality means, in one table.
#pragma once

#include "kernels/layout.h"
#include "nusselt/frame.h"

namespace nusselt {

struct QualitySettings {
    const char* name;
    kernels::MaskLayout layout;
    float angle; // a level of detail is fine enough where its error subtends at most this, radians
    bool paper;  // two-level mesh with the receiver's 2-ring, no fans, 4x4 blocks integrated as one
    bool available;
};

constexpr uint32_t quality_count = 4;

// Null for a number that is no quality.
const QualitySettings* quality_settings(Quality quality);

} // namespace nusselt
