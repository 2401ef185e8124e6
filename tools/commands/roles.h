// What the meshes of a picture do: block and receive, only one of the two, or a ground for them to stand on.
#pragma once

#include "bench/scenes/scene.h"

#include <string>
#include <vector>

namespace nusselt::tools {

// Meshes by name or number, of whose hides and receives one is left.
struct Roles {
    std::vector<std::string> receive_only, block_only;
    bool ground = false;
};

// Throws Failure (usage) with the list of meshes where there is none of a name, or nothing would be drawn.
void assign_roles(scenes::Scene& scene, const Roles& roles);

// A plane below all that the scene has at these times, which takes shadows and hides nothing: a mesh more.
// Returns the opacity of its vertices, which fades towards its edge.
std::vector<float> add_ground(scenes::Scene& scene, const std::vector<double>& times);

} // namespace nusselt::tools
