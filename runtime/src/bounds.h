// Bounding spheres and normal cones of clusters and groups, bottom up. One code for the rest pose, whose
// radii give the relative errors, and for the scalar reference of the frame's refit.
#pragma once

#include "mesh_data.h"
#include "vec3.h"

#include <algorithm>
#include <limits>

namespace nusselt {

struct Sphere {
    float x = 0, y = 0, z = 0, radius = -1; // negative radius: no finite vertex
};

// All unit normals n of the cluster's triangles satisfy dot(axis, n) >= cosine. cosine -1: no useful cone.
struct Cone {
    float x = 0, y = 0, z = 0, cosine = -1;
};

namespace bounds {

struct Box {
    Vec3f low{std::numeric_limits<float>::max(), std::numeric_limits<float>::max(),
              std::numeric_limits<float>::max()};
    Vec3f high{-std::numeric_limits<float>::max(), -std::numeric_limits<float>::max(),
               -std::numeric_limits<float>::max()};
};

inline void extend(Box& box, Vec3f low, Vec3f high) {
    box.low = {std::min(box.low.x, low.x), std::min(box.low.y, low.y), std::min(box.low.z, low.z)};
    box.high = {std::max(box.high.x, high.x), std::max(box.high.y, high.y), std::max(box.high.z, high.z)};
}

inline Vec3f centre(const Box& box) {
    return {0.5f * box.low.x + 0.5f * box.high.x, 0.5f * box.low.y + 0.5f * box.high.y,
            0.5f * box.low.z + 0.5f * box.high.z};
}

// Rounding of the sums above and below: an enclosing sphere must not be smaller than what it encloses.
constexpr float enlarge = 1.000001f;

} // namespace bounds

// `position(w)` is the position of welded vertex w as Vec3f. Squares must neither overflow nor underflow:
// positions between 1e-15 and 1e15 in size. Vertices that are not finite, and triangles that touch one, are
// ignored.
template<class Position>
void refit_cluster(const Position& position, const Clusters& clusters, uint32_t cluster, Sphere& sphere,
                   Cone& cone) {
    const uint32_t* vertices = clusters.vertices.data() + clusters.vertex_begin[cluster];
    const uint32_t vertex_count = clusters.vertex_begin[cluster + 1] - clusters.vertex_begin[cluster];
    bounds::Box box;
    bool any = false;
    for (uint32_t i = 0; i < vertex_count; ++i) {
        const Vec3f p = position(vertices[i]);
        if (!is_finite(p)) continue;
        bounds::extend(box, p, p);
        any = true;
    }
    sphere = {};
    cone = {};
    if (!any) return;
    const Vec3f c = bounds::centre(box);
    float radius2 = 0;
    for (uint32_t i = 0; i < vertex_count; ++i) {
        const Vec3f p = position(vertices[i]);
        if (!is_finite(p)) continue;
        const Vec3f d = p - c;
        radius2 = std::max(radius2, dot(d, d));
    }
    sphere = {c.x, c.y, c.z, std::sqrt(radius2) * bounds::enlarge};

    Vec3f sum;
    const auto normal = [&](const ClusterTriangle& t, Vec3f& n) {
        const Vec3f a = position(vertices[t.corner[0]]);
        n = cross(position(vertices[t.corner[1]]) - a, position(vertices[t.corner[2]]) - a);
        const float l = length(n);
        if (!(l > 0) || !std::isfinite(l)) return false;
        n = n * (1.0f / l);
        return true;
    };
    const ClusterTriangle* triangles = clusters.triangles.data();
    const uint32_t begin = clusters.triangle_begin[cluster], end = clusters.triangle_begin[cluster + 1];
    Vec3f n;
    for (uint32_t t = begin; t < end; ++t) {
        if (normal(triangles[t], n)) sum = sum + n;
    }
    const float l = length(sum);
    if (!(l > 0)) return;
    const Vec3f axis = sum * (1.0f / l);
    float cosine = 1;
    for (uint32_t t = begin; t < end; ++t) {
        if (normal(triangles[t], n)) cosine = std::min(cosine, dot(axis, n));
    }
    cosine -= 1e-6f;
    cone = {axis.x, axis.y, axis.z, cosine > 0 ? cosine : -1.0f};
}

// Encloses the clusters that the group replaces and everything that those stand for. `error` is the group's
// distance to the full mesh in this pose; never below that of a group beneath it.
// `cluster_spheres` of all members, and `group_spheres` and `group_errors` of all groups before this one, are
// done.
inline void refit_group(const Clusters& clusters, const Groups& groups, const Sphere* cluster_spheres,
                        Sphere* group_spheres, float* group_errors, uint32_t group) {
    const uint32_t begin = groups.cluster_begin[group], end = groups.cluster_begin[group + 1];
    bounds::Box box;
    bool any = false;
    for (uint32_t i = begin; i < end; ++i) {
        const Sphere& s = cluster_spheres[groups.clusters[i]];
        if (s.radius < 0) continue;
        bounds::extend(box, {s.x - s.radius, s.y - s.radius, s.z - s.radius},
                       {s.x + s.radius, s.y + s.radius, s.z + s.radius});
        any = true;
    }
    Sphere out;
    float error = 0;
    if (any) {
        const Vec3f c = bounds::centre(box);
        float radius = 0;
        const auto enclose = [&](const Sphere& s) {
            if (s.radius >= 0) radius = std::max(radius, length(Vec3f{s.x, s.y, s.z} - c) + s.radius);
        };
        for (uint32_t i = begin; i < end; ++i) {
            enclose(cluster_spheres[groups.clusters[i]]);
            const uint32_t own = clusters.own_group[groups.clusters[i]];
            if (own == no_group) continue;
            enclose(group_spheres[own]);
            error = std::max(error, group_errors[own]);
        }
        out = {c.x, c.y, c.z, radius * bounds::enlarge};
        error = std::max(error, groups.relative_error[group] * out.radius);
    }
    group_spheres[group] = out;
    group_errors[group] = error;
}

// All clusters, then all groups, children before parents.
template<class Position>
void refit_bounds(const Position& position, const Clusters& clusters, const Groups& groups,
                  Sphere* cluster_spheres, Cone* cluster_cones, Sphere* group_spheres, float* group_errors) {
    for (uint32_t c = 0; c < clusters.count(); ++c) {
        refit_cluster(position, clusters, c, cluster_spheres[c], cluster_cones[c]);
    }
    for (uint32_t g = 0; g < groups.count(); ++g) {
        refit_group(clusters, groups, cluster_spheres, group_spheres, group_errors, g);
    }
}

} // namespace nusselt
