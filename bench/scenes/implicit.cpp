#include "implicit.h"

#include <glm/common.hpp>
#include <glm/geometric.hpp>

#include <algorithm>
#include <array>
#include <cmath>

namespace nusselt::scenes {

float distance(const Limb& limb, const glm::vec3& point) {
    const glm::vec3 axis = limb.b - limb.a;
    const float along = glm::clamp(glm::dot(point - limb.a, axis) / glm::dot(axis, axis), 0.0f, 1.0f);
    glm::vec3 offset = point - limb.a - axis * along;
    offset.z /= limb.flat;
    const float inside = glm::length(offset) - glm::mix(limb.ra, limb.rb, along);
    return inside * std::min(1.0f, limb.flat);
}

float ellipsoid_distance(const glm::vec3& center, const glm::vec3& radii, const glm::vec3& point) {
    const glm::vec3 scaled = (point - center) / radii;
    const float k0 = glm::length(scaled);
    const float k1 = glm::length(scaled / radii);
    return k1 > 0 ? k0 * (k0 - 1) / k1 : -std::min({radii.x, radii.y, radii.z});
}

float smooth_min(float a, float b, float radius) {
    const float h = std::max(radius - std::abs(a - b), 0.0f) / radius;
    return std::min(a, b) - h * h * radius * 0.25f;
}

namespace {

// A surface net is a manifold only if no cell holds two sheets: fills the narrower gap (the smallest positive
// value) wherever the signs of a face's corners alternate, or two opposite corners of a cell stand alone.
void close_narrow_gaps(std::vector<float>& values, const std::array<uint32_t, 3>& samples,
                       const std::array<size_t, 3>& stride, float cell) {
    const auto fill = [&](size_t a, size_t b) {
        size_t narrow = values[a] < values[b] ? a : b;
        values[narrow] = -1e-3f * cell;
    };
    bool changed = true;
    while (changed) {
        changed = false;
        for (uint32_t z = 0; z + 1 < samples[2]; ++z) {
            for (uint32_t y = 0; y + 1 < samples[1]; ++y) {
                for (uint32_t x = 0; x + 1 < samples[0]; ++x) {
                    const size_t here = x + y * stride[1] + z * stride[2];
                    for (size_t axis = 0; axis < 3; ++axis) {
                        const size_t u = stride[(axis + 1) % 3], v = stride[(axis + 2) % 3];
                        const bool inside = values[here] < 0;
                        if ((values[here + u + v] < 0) != inside || (values[here + u] < 0) == inside ||
                            (values[here + v] < 0) == inside)
                            continue;
                        if (inside) {
                            fill(here + u, here + v);
                        } else {
                            fill(here, here + u + v);
                        }
                        changed = true;
                    }
                    std::array<size_t, 8> corners;
                    uint32_t inside_count = 0;
                    for (size_t corner = 0; corner < 8; ++corner) {
                        corners[corner] =
                            here + (corner & 1) + (corner >> 1 & 1) * stride[1] + (corner >> 2) * stride[2];
                        inside_count += values[corners[corner]] < 0;
                    }
                    if (inside_count != 2 && inside_count != 6) continue;
                    for (size_t corner = 0; corner < 4; ++corner) {
                        const size_t a = corners[corner], b = corners[7 - corner];
                        const bool lone_inside = inside_count == 2;
                        if ((values[a] < 0) != lone_inside || (values[b] < 0) != lone_inside) continue;
                        if (lone_inside) {
                            // A step from one to the other becomes inside; the next round closes the rest.
                            values[corners[corner ^ 1]] = -1e-3f * cell;
                        } else {
                            fill(a, b);
                        }
                        changed = true;
                    }
                }
            }
        }
    }
}

// Newton steps along the gradient, which is taken from four samples at the corners of a tetrahedron.
glm::vec3 project(const std::function<float(const glm::vec3&)>& field, glm::vec3 point, float cell) {
    static const std::array<glm::vec3, 4> corners{{{1, -1, -1}, {-1, -1, 1}, {-1, 1, -1}, {1, 1, 1}}};
    const float step = 0.05f * cell;
    for (int iteration = 0; iteration < 2; ++iteration) {
        glm::vec3 gradient(0);
        float mean = 0;
        for (const glm::vec3& corner : corners) {
            const float value = field(point + corner * step);
            gradient += corner * value;
            mean += 0.25f * value;
        }
        gradient /= 4 * step;
        const float square = std::max(glm::dot(gradient, gradient), 0.05f);
        glm::vec3 move = gradient * (-mean / square);
        const float length = glm::length(move);
        if (length > 0.5f * cell) move *= 0.5f * cell / length;
        point += move;
    }
    return point;
}

} // namespace

Surface mesh_field(const std::function<float(const glm::vec3&)>& field, const glm::vec3& low,
                   const glm::vec3& high, float cell) {
    std::array<uint32_t, 3> samples;
    for (int axis = 0; axis < 3; ++axis)
        samples[static_cast<size_t>(axis)] = static_cast<uint32_t>((high[axis] - low[axis]) / cell) + 3;
    const std::array<size_t, 3> stride{1, samples[0], static_cast<size_t>(samples[0]) * samples[1]};
    const size_t count = stride[2] * samples[2];
    const auto at = [&](uint32_t x, uint32_t y, uint32_t z) { return x + y * stride[1] + z * stride[2]; };
    const auto place = [&](uint32_t x, uint32_t y, uint32_t z) {
        return low + cell * (glm::vec3(x, y, z) - 0.5f);
    };

    std::vector<float> values(count);
    for (uint32_t z = 0; z < samples[2]; ++z)
        for (uint32_t y = 0; y < samples[1]; ++y)
            for (uint32_t x = 0; x < samples[0]; ++x)
                values[at(x, y, z)] = field(place(x, y, z));

    close_narrow_gaps(values, samples, stride, cell);

    Surface surface;
    constexpr uint32_t none = 0xFFFFFFFFu;
    std::vector<uint32_t> vertex_of(count, none);
    for (uint32_t z = 0; z + 1 < samples[2]; ++z) {
        for (uint32_t y = 0; y + 1 < samples[1]; ++y) {
            for (uint32_t x = 0; x + 1 < samples[0]; ++x) {
                glm::vec3 sum(0);
                int crossings = 0;
                for (uint32_t corner = 0; corner < 8; ++corner) {
                    const glm::uvec3 from(x + (corner & 1), y + (corner >> 1 & 1), z + (corner >> 2));
                    const float value = values[at(from.x, from.y, from.z)];
                    for (int axis = 0; axis < 3; ++axis) {
                        if (corner >> axis & 1) continue;
                        glm::uvec3 to = from;
                        ++to[axis];
                        const float other = values[at(to.x, to.y, to.z)];
                        if ((value < 0) == (other < 0)) continue;
                        sum += glm::mix(place(from.x, from.y, from.z), place(to.x, to.y, to.z),
                                        value / (value - other));
                        ++crossings;
                    }
                }
                if (crossings == 0) continue;
                vertex_of[at(x, y, z)] = static_cast<uint32_t>(surface.positions.size());
                surface.positions.push_back(sum / static_cast<float>(crossings));
            }
        }
    }

    std::vector<std::array<uint32_t, 4>> quads;
    for (uint32_t z = 1; z + 1 < samples[2]; ++z) {
        for (uint32_t y = 1; y + 1 < samples[1]; ++y) {
            for (uint32_t x = 1; x + 1 < samples[0]; ++x) {
                const size_t here = at(x, y, z);
                for (size_t axis = 0; axis < 3; ++axis) {
                    const bool inside = values[here] < 0;
                    if (inside == (values[here + stride[axis]] < 0)) continue;
                    const size_t u = stride[(axis + 1) % 3], v = stride[(axis + 2) % 3];
                    std::array<uint32_t, 4> quad{vertex_of[here - u - v], vertex_of[here - v],
                                                 vertex_of[here], vertex_of[here - u]};
                    if (!inside) std::swap(quad[1], quad[3]);
                    quads.push_back(quad);
                }
            }
        }
    }

    std::vector<glm::vec3> sums(surface.positions.size());
    std::vector<float> weights(surface.positions.size());
    for (int iteration = 0; iteration < 8; ++iteration) {
        std::fill(sums.begin(), sums.end(), glm::vec3(0));
        std::fill(weights.begin(), weights.end(), 0.0f);
        for (const std::array<uint32_t, 4>& quad : quads) {
            for (size_t k = 0; k < 4; ++k) {
                sums[quad[k]] += surface.positions[quad[(k + 1) % 4]] + surface.positions[quad[(k + 3) % 4]];
                weights[quad[k]] += 2;
            }
        }
        for (size_t v = 0; v < sums.size(); ++v)
            surface.positions[v] =
                project(field, glm::mix(surface.positions[v], sums[v] / weights[v], 0.5f), cell);
    }

    for (const std::array<uint32_t, 4>& q : quads) {
        const auto& p = surface.positions;
        if (glm::distance(p[q[0]], p[q[2]]) <= glm::distance(p[q[1]], p[q[3]])) {
            surface.indices.insert(surface.indices.end(), {q[0], q[1], q[2], q[0], q[2], q[3]});
        } else {
            surface.indices.insert(surface.indices.end(), {q[0], q[1], q[3], q[1], q[2], q[3]});
        }
    }
    return surface;
}

} // namespace nusselt::scenes
