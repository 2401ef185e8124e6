// Further models of a picture: each an object of its own, beside the first one or where it is put.
#pragma once

#include "bench/scenes/scene.h"

#include <cstdint>
#include <string>
#include <vector>

namespace nusselt::tools {

struct FurtherModels {
    std::vector<std::string> paths;
    std::vector<std::string> places; // X:Y:Z that each is moved by; none: in a row along x
};

// Throws Failure (usage) where there are places, but not one for each path, or one that is none.
void check_places(const FurtherModels& further);

// Adds their meshes to the scene, `moving` with their first clips, at most to its end, else as they stand.
// In a row each stands on the first one's floor, a tenth of the widest apart at `time`. Returns the object of
// each mesh, the first scene's 0.
std::vector<uint32_t> add_models(scenes::Scene& scene, const FurtherModels& further, bool moving,
                                 double time);

} // namespace nusselt::tools
