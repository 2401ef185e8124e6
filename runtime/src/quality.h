// What each quality means, in one table.
#pragma once

#include "kernels/layout.h"
#include "nusselt/frame.h"

namespace nusselt {

struct QualitySettings {
    const char* name;
    kernels::MaskLayout layout;
    float angle;       // a level of detail is fine enough where its error subtends at most this, radians
    float proxy_angle; // the same where the receiver belongs to another object
    float proxy_least; // meshes of other objects that span a smaller angle from their middle are left out
    float far_gap;     // objects no nearer than this many radii of a region are seen from its middle alone
    float farther_gap; // and no nearer than this many radii of the receivers' mesh, from that one's middle
    bool paper;        // two-level mesh with the receiver's 2-ring, no fans, 4x4 blocks integrated as one
    bool available;
};

constexpr uint32_t quality_count = 4;

// Null for a number that is no quality.
const QualitySettings* quality_settings(Quality quality);

} // namespace nusselt
