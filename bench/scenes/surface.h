// Triangle surfaces with seams: vertices at equal positions that belong to one smooth surface.
#pragma once

#include "scene.h"

namespace nusselt::scenes {

// For each vertex the first vertex at exactly the same position.
std::vector<uint32_t> weld_map(const std::vector<glm::vec3>& positions);

// As compute_normals, with one normal for all vertices of a weld_map entry.
void compute_normals(const std::vector<glm::vec3>& positions, const std::vector<uint32_t>& indices,
                     const std::vector<uint32_t>& weld, std::vector<glm::vec3>& normals);

// Gives each chart (a number a triangle) its own copies of the vertices along its border, as texture seams
// do. `chart_of[v]` becomes the chart of vertex v.
void split_charts(std::vector<glm::vec3>& positions, std::vector<uint32_t>& indices,
                  const std::vector<uint32_t>& triangle_chart, std::vector<uint32_t>& chart_of);

} // namespace nusselt::scenes
