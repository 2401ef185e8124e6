// Closed skins from distance fields: smooth unions of limbs, meshed once in the rest pose.
#pragma once

#include <glm/vec3.hpp>

#include <cstdint>
#include <functional>
#include <vector>

namespace nusselt::scenes {

// A limb: spheres of radius ra at a to rb at b, swept; squeezed along z by `flat` about its axis (1: round).
struct Limb {
    glm::vec3 a, b;
    float ra, rb;
    float flat = 1;
};

// Approximate signed distances, negative inside.
float distance(const Limb& limb, const glm::vec3& point);
float ellipsoid_distance(const glm::vec3& center, const glm::vec3& radii, const glm::vec3& point);
// The lesser of both, rounded where they differ by less than `radius`; at most radius / 4 below it.
float smooth_min(float a, float b, float radius);

struct Surface {
    std::vector<glm::vec3> positions;
    std::vector<uint32_t> indices;
};

// The zero set of `field` (negative inside) in a box that holds all of it, as a surface net: one vertex a
// cell that the surface crosses, one quad (two triangles) a crossed grid edge, then relaxed within the
// surface. Closed; an edge-manifold wherever the surface is smooth at the size of a cell.
Surface mesh_field(const std::function<float(const glm::vec3&)>& field, const glm::vec3& low,
                   const glm::vec3& high, float cell);

} // namespace nusselt::scenes
