#include "surface.h"

#include <glm/geometric.hpp>

#include <map>
#include <tuple>
#include <utility>

namespace nusselt::scenes {

std::vector<uint32_t> weld_map(const std::vector<glm::vec3>& positions) {
    std::map<std::tuple<float, float, float>, uint32_t> first;
    std::vector<uint32_t> weld(positions.size());
    for (uint32_t v = 0; v < weld.size(); ++v) {
        const glm::vec3& p = positions[v];
        weld[v] = first.try_emplace({p.x, p.y, p.z}, v).first->second;
    }
    return weld;
}

void compute_normals(const std::vector<glm::vec3>& positions, const std::vector<uint32_t>& indices,
                     const std::vector<uint32_t>& weld, std::vector<glm::vec3>& normals) {
    normals.assign(positions.size(), glm::vec3(0));
    const auto welded = [&](uint32_t vertex) { return weld.empty() ? vertex : weld[vertex]; };
    for (size_t i = 0; i + 2 < indices.size(); i += 3) {
        const uint32_t a = welded(indices[i]), b = welded(indices[i + 1]), c = welded(indices[i + 2]);
        const glm::vec3 area = glm::cross(positions[b] - positions[a], positions[c] - positions[a]);
        normals[a] += area;
        normals[b] += area;
        normals[c] += area;
    }
    for (uint32_t v = 0; v < normals.size(); ++v) {
        const uint32_t w = welded(v);
        if (w < v) {
            normals[v] = normals[w];
            continue;
        }
        // Scaled first: the square of a tiny or huge area leaves the range of float.
        const glm::vec3 size = glm::abs(normals[v]);
        const float largest =
            size.x > size.y ? (size.x > size.z ? size.x : size.z) : (size.y > size.z ? size.y : size.z);
        const bool usable = largest > 0 && largest < 3e38f;
        normals[v] = usable ? glm::normalize(normals[v] / largest) : glm::vec3(0, 1, 0);
    }
}

void compute_normals(const std::vector<glm::vec3>& positions, const std::vector<uint32_t>& indices,
                     std::vector<glm::vec3>& normals) {
    compute_normals(positions, indices, {}, normals);
}

void split_charts(std::vector<glm::vec3>& positions, std::vector<uint32_t>& indices,
                  const std::vector<uint32_t>& triangle_chart, std::vector<uint32_t>& chart_of) {
    constexpr uint32_t unused = 0xFFFFFFFFu;
    chart_of.assign(positions.size(), unused);
    std::map<std::pair<uint32_t, uint32_t>, uint32_t> copies;
    for (size_t i = 0; i < indices.size(); ++i) {
        const uint32_t vertex = indices[i], chart = triangle_chart[i / 3];
        if (chart_of[vertex] == unused) chart_of[vertex] = chart;
        if (chart_of[vertex] == chart) continue;
        const auto [copy, fresh] =
            copies.try_emplace({vertex, chart}, static_cast<uint32_t>(positions.size()));
        if (fresh) {
            positions.push_back(glm::vec3(positions[vertex]));
            chart_of.push_back(chart);
        }
        indices[i] = copy->second;
    }
}

} // namespace nusselt::scenes
