// All meshes of a pose as one: what is traced, drawn and written out.
#pragma once

#include "bench/scenes/scene.h"

#include <glm/vec2.hpp>
#include <glm/vec3.hpp>

#include <cstdint>
#include <vector>

namespace nusselt::tools {

struct Assembly {
    std::vector<glm::vec3> positions, normals, albedo;
    std::vector<glm::vec2> metallic_roughness; // (0, 1) where a mesh has none
    std::vector<uint8_t> two_sided;            // 0 where a mesh doesn't say
    std::vector<uint32_t> indices;
    std::vector<uint32_t> mesh_begin; // first vertex of each mesh, and the end
};

Assembly assemble(const scenes::Scene& scene, const scenes::Pose& pose);

// The same vertices with the triangles of some of the scene's meshes, one flag each.
Assembly triangles_of(const Assembly& all, const scenes::Scene& scene, const std::vector<uint8_t>& meshes);

struct Bounds {
    glm::vec3 low{0}, high{0};
    bool empty = true;
};

// Of the finite positions. `grow` extends, so that a clip's frames can share a camera.
void grow(Bounds& bounds, const std::vector<glm::vec3>& positions);
float diagonal(const Bounds& bounds);

} // namespace nusselt::tools
