#include "shapes.h"

#include "portable_math.h"

#include <glm/geometric.hpp>

#include <map>
#include <utility>

namespace nusselt::scenes {

namespace {

void finish(Mesh& mesh, const char* name) {
    mesh.name = name;
    mesh.albedo.assign(mesh.rest_positions.size(), glm::vec3(0.8f));
}

} // namespace

Mesh sphere(uint32_t subdivisions, float radius) {
    Mesh mesh;
    const float g = 0.5f * (1 + std::sqrt(5.0f));
    std::vector<glm::vec3> unit = {{-1, g, 0},  {1, g, 0},  {-1, -g, 0}, {1, -g, 0}, {0, -1, g},  {0, 1, g},
                                   {0, -1, -g}, {0, 1, -g}, {g, 0, -1},  {g, 0, 1},  {-g, 0, -1}, {-g, 0, 1}};
    for (glm::vec3& point : unit)
        point = glm::normalize(point);
    std::vector<uint32_t> indices = {0, 11, 5,  0, 5,  1, 0, 1, 7, 0, 7,  10, 0, 10, 11, 1, 5, 9, 5, 11,
                                     4, 11, 10, 2, 10, 7, 6, 7, 1, 8, 3,  9,  4, 3,  4,  2, 3, 2, 6, 3,
                                     6, 8,  3,  8, 9,  4, 9, 5, 2, 4, 11, 6,  2, 10, 8,  6, 7, 9, 8, 1};
    for (uint32_t level = 0; level < subdivisions; ++level) {
        std::map<std::pair<uint32_t, uint32_t>, uint32_t> middles;
        const auto middle = [&](uint32_t a, uint32_t b) {
            const auto [entry, fresh] =
                middles.try_emplace(std::minmax(a, b), static_cast<uint32_t>(unit.size()));
            if (fresh) unit.push_back(glm::normalize(unit[a] + unit[b]));
            return entry->second;
        };
        std::vector<uint32_t> finer;
        finer.reserve(indices.size() * 4);
        for (size_t i = 0; i < indices.size(); i += 3) {
            const uint32_t a = indices[i], b = indices[i + 1], c = indices[i + 2];
            const uint32_t ab = middle(a, b), bc = middle(b, c), ca = middle(c, a);
            finer.insert(finer.end(), {a, ab, ca, b, bc, ab, c, ca, bc, ab, bc, ca});
        }
        indices = std::move(finer);
    }
    mesh.rest_positions = unit;
    for (glm::vec3& point : mesh.rest_positions)
        point *= radius;
    mesh.rest_normals = std::move(unit);
    mesh.indices = std::move(indices);
    finish(mesh, "sphere");
    return mesh;
}

Mesh torus(float major_radius, float minor_radius, uint32_t around, uint32_t across) {
    Mesh mesh;
    for (uint32_t i = 0; i < around; ++i) {
        const double u = 2 * pi * i / around;
        const glm::vec3 out(static_cast<float>(cosine(u)), 0, static_cast<float>(sine(u)));
        for (uint32_t j = 0; j < across; ++j) {
            const double v = 2 * pi * j / across;
            const float cos_v = static_cast<float>(cosine(v)), sin_v = static_cast<float>(sine(v));
            const glm::vec3 normal = out * cos_v + glm::vec3(0, sin_v, 0);
            mesh.rest_positions.push_back(out * major_radius + normal * minor_radius);
            mesh.rest_normals.push_back(glm::normalize(normal));
            const uint32_t next_i = (i + 1) % around, next_j = (j + 1) % across;
            const uint32_t a = i * across + j, b = next_i * across + j;
            const uint32_t c = next_i * across + next_j, d = i * across + next_j;
            mesh.indices.insert(mesh.indices.end(), {a, d, c, a, c, b});
        }
    }
    finish(mesh, "torus");
    return mesh;
}

Mesh plane(float size, uint32_t cells) {
    Mesh mesh;
    for (uint32_t row = 0; row <= cells; ++row) {
        for (uint32_t column = 0; column <= cells; ++column) {
            const float x = static_cast<float>(column) / static_cast<float>(cells) - 0.5f;
            const float z = static_cast<float>(row) / static_cast<float>(cells) - 0.5f;
            mesh.rest_positions.push_back({x * size, 0, z * size});
            if (row == cells || column == cells) continue;
            const uint32_t a = row * (cells + 1) + column, b = a + 1, c = a + cells + 1, d = c + 1;
            mesh.indices.insert(mesh.indices.end(), {a, c, b, b, c, d});
        }
    }
    mesh.rest_normals.assign(mesh.rest_positions.size(), glm::vec3(0, 1, 0));
    finish(mesh, "plane");
    return mesh;
}

Mesh box(const glm::vec3& low, const glm::vec3& high) {
    Mesh mesh;
    for (int axis = 0; axis < 3; ++axis) {
        const int u = (axis + 1) % 3, v = (axis + 2) % 3;
        for (int side = 0; side < 2; ++side) {
            const uint32_t first = static_cast<uint32_t>(mesh.rest_positions.size());
            glm::vec3 normal(0);
            normal[axis] = side ? 1.0f : -1.0f;
            for (int corner = 0; corner < 4; ++corner) {
                glm::vec3 point;
                point[axis] = side ? high[axis] : low[axis];
                point[u] = (corner == 1 || corner == 2) ? high[u] : low[u];
                point[v] = corner >= 2 ? high[v] : low[v];
                mesh.rest_positions.push_back(point);
                mesh.rest_normals.push_back(normal);
            }
            const uint32_t b = side ? first + 1 : first + 3, d = side ? first + 3 : first + 1;
            mesh.indices.insert(mesh.indices.end(), {first, b, first + 2, first, first + 2, d});
        }
    }
    finish(mesh, "box");
    return mesh;
}

} // namespace nusselt::scenes
