// The demo's crowd: many objects in one frame, in a picture, with what they cost as they become more.
#pragma once

#include "tools/commands/engine.h"
#include "tools/image/image.h"
#include "tools/report/output.h"

#include <nlohmann/json_fwd.hpp>

namespace nusselt::tools {

struct CrowdScale {
    uint32_t width, height; // of each of three pictures
    uint32_t rays, runs;
};
constexpr uint32_t crowd_objects = 16;

// Figures, three pictures (base64) and the plot; the pictures side by side are added to `out`.
nlohmann::ordered_json show_crowd(const scenes::Scene& scene, const CrowdScale& scale,
                                  const EngineOptions& options, const Image& environment,
                                  OutputDirectory& out);

} // namespace nusselt::tools
