#include "tools/trace/assembly.h"

#include <glm/common.hpp>
#include <glm/geometric.hpp>

#include <cmath>

namespace nusselt::tools {

Assembly assemble(const scenes::Scene& scene, const scenes::Pose& pose) {
    Assembly all;
    all.mesh_begin.push_back(0);
    for (size_t m = 0; m < scene.meshes.size(); ++m) {
        const scenes::Mesh& mesh = scene.meshes[m];
        const auto begin = static_cast<uint32_t>(all.positions.size());
        all.positions.insert(all.positions.end(), pose.positions[m].begin(), pose.positions[m].end());
        all.normals.insert(all.normals.end(), pose.normals[m].begin(), pose.normals[m].end());
        all.albedo.insert(all.albedo.end(), mesh.albedo.begin(), mesh.albedo.end());
        all.albedo.resize(all.positions.size(), glm::vec3(1));
        all.metallic_roughness.insert(all.metallic_roughness.end(), mesh.metallic_roughness.begin(),
                                      mesh.metallic_roughness.end());
        all.metallic_roughness.resize(all.positions.size(), glm::vec2(0, 1));
        all.two_sided.insert(all.two_sided.end(), mesh.two_sided.begin(), mesh.two_sided.end());
        all.two_sided.resize(all.positions.size(), 0);
        for (const uint32_t index : mesh.indices)
            all.indices.push_back(begin + index);
        all.mesh_begin.push_back(static_cast<uint32_t>(all.positions.size()));
    }
    return all;
}

Assembly triangles_of(const Assembly& all, const scenes::Scene& scene, const std::vector<uint8_t>& meshes) {
    Assembly part = all;
    part.indices.clear();
    for (size_t m = 0; m < scene.meshes.size(); ++m) {
        for (size_t k = 0; meshes[m] && k < scene.meshes[m].indices.size(); ++k)
            part.indices.push_back(all.mesh_begin[m] + scene.meshes[m].indices[k]);
    }
    return part;
}

void grow(Bounds& bounds, const std::vector<glm::vec3>& positions) {
    for (const glm::vec3& p : positions) {
        if (!std::isfinite(p.x) || !std::isfinite(p.y) || !std::isfinite(p.z)) continue;
        bounds.low = bounds.empty ? p : glm::min(bounds.low, p);
        bounds.high = bounds.empty ? p : glm::max(bounds.high, p);
        bounds.empty = false;
    }
}

float diagonal(const Bounds& bounds) {
    return bounds.empty ? 0 : glm::length(bounds.high - bounds.low);
}

} // namespace nusselt::tools
