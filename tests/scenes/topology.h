// Facts about a mesh after welding equal positions.
#pragma once

#include "bench/scenes/scene.h"
#include "bench/scenes/surface.h"

#include <glm/geometric.hpp>

#include <algorithm>
#include <cmath>
#include <map>
#include <utility>

namespace nusselt::scenes {

struct Topology {
    size_t boundary_edges = 0;
    size_t repeated_edges = 0; // run along twice in one direction: not a manifold, or turned round
    double volume = 0;         // signed
};

inline Topology topology(const Mesh& mesh) {
    const std::vector<uint32_t> weld = weld_map(mesh.rest_positions);
    std::map<std::pair<uint32_t, uint32_t>, int> edges;
    Topology result;
    for (size_t i = 0; i < mesh.indices.size(); i += 3) {
        for (size_t k = 0; k < 3; ++k) {
            const uint32_t from = weld[mesh.indices[i + k]], to = weld[mesh.indices[i + (k + 1) % 3]];
            if (++edges[{from, to}] > 1) ++result.repeated_edges;
        }
        const auto& p = mesh.rest_positions;
        const glm::vec3 a = p[mesh.indices[i]], b = p[mesh.indices[i + 1]], c = p[mesh.indices[i + 2]];
        result.volume += static_cast<double>(glm::dot(a, glm::cross(b, c))) / 6;
    }
    for (const auto& [edge, count] : edges)
        if (!edges.count({edge.second, edge.first})) ++result.boundary_edges;
    return result;
}

// Least angle of a triangle in degrees.
inline double least_angle(const glm::vec3& a, const glm::vec3& b, const glm::vec3& c) {
    const glm::vec3 corners[3] = {a, b, c};
    double least = 180;
    for (int k = 0; k < 3; ++k) {
        const glm::dvec3 u = corners[(k + 1) % 3] - corners[k], v = corners[(k + 2) % 3] - corners[k];
        least = std::min(least,
                         std::atan2(glm::length(glm::cross(u, v)), glm::dot(u, v)) * 180 / 3.14159265358979);
    }
    return least;
}

} // namespace nusselt::scenes
