// Plain static meshes for tests and benchmarks: unit normals, counter-clockwise outside, albedo 0.8.
#pragma once

#include "scene.h"

namespace nusselt::scenes {

// A subdivided icosahedron, closed: 20 * 4^subdivisions triangles, 10 * 4^subdivisions + 2 vertices.
Mesh sphere(uint32_t subdivisions, float radius = 1);
// Closed, around the y axis: 2 * around * across triangles, around * across vertices, each count at least 3.
Mesh torus(float major_radius, float minor_radius, uint32_t around, uint32_t across);
// A square sheet of `cells` by `cells` quads at y = 0, seen from +y; open. `size` is the edge's length.
Mesh plane(float size, uint32_t cells);
// Closed after welding: 24 vertices (hard edges), 12 triangles.
Mesh box(const glm::vec3& low, const glm::vec3& high);

} // namespace nusselt::scenes
