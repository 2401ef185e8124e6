// Several of a scene beside one another, as objects of one frame: what the study and the demo show.
#pragma once

#include "tools/commands/engine.h"

#include <cstdint>
#include <string>
#include <vector>

namespace nusselt::tools {

// Copies of a scene on a grid over x and z, each at its own moment.
struct Crowd {
    scenes::Scene scene; // all meshes; has no clip
    scenes::Pose pose;
    std::vector<uint32_t> object_of; // of each mesh
    std::vector<scenes::Pose> alone; // of each object, where it stands
};

// As far apart as 1.1 times the width of `pose`, over the ground.
float crowd_spacing(const scenes::Pose& pose);
Crowd make_crowd(const scenes::Scene& scene, uint32_t objects, float spacing);

// From above, so that all are seen.
constexpr float crowd_direction[3] = {-0.5f, -0.75f, -1};

// Processor milliseconds, medians of rounds in which the three take turns; the transfer vectors of each; and
// what the frame of objects says of itself.
struct CrowdFrames {
    double grouped_ms = 0, together_ms = 0, alone_ms = 0; // alone: the sum
    std::vector<float> grouped, together, alone;          // as objects, as one object, each alone
    FrameStats stats;
};
CrowdFrames run_crowd(const Crowd& crowd, Engine& all, Engine& one, Quality quality, uint32_t rounds);

// What a crowd costs against the number of its objects, as a picture to be put into a page or a file.
struct CrowdCost {
    uint32_t objects;
    double grouped, together, alone; // microseconds a receiver
};
std::string plot_crowd(const std::vector<CrowdCost>& costs);

} // namespace nusselt::tools
