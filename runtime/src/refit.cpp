#include "refit.h"

#include "kernels/prepare.h"

#include <algorithm>
#include <cmath>
#include <cstring>

namespace nusselt {

namespace {

const float* element(const Vec3View& view, size_t index) {
    return reinterpret_cast<const float*>(reinterpret_cast<const char*>(view.data) + index * view.stride);
}

// The mesh whose chunk of points this is.
const MeshSlice& slice_of_chunk(const Frame& frame, uint32_t chunk) {
    size_t low = 0, high = frame.meshes.size();
    while (high - low > 1) {
        const size_t middle = (low + high) / 2;
        (frame.meshes[middle].first_point_chunk <= chunk ? low : high) = middle;
    }
    return frame.meshes[low];
}

struct PointRange {
    const MeshSlice& slice;
    uint32_t begin, end; // welded vertices of the mesh
};

PointRange points_of_chunk(const Frame& frame, uint32_t chunk) {
    const MeshSlice& slice = slice_of_chunk(frame, chunk);
    const uint32_t begin = (chunk - slice.first_point_chunk) * point_chunk;
    const uint32_t count = static_cast<uint32_t>(slice.mesh->weld_source.size());
    return {slice, begin, std::min(begin + point_chunk, count)};
}

using kernels::is_finite;

// Corner positions of a triangle; false where one is not finite.
bool corners_of(const float* points, const uint32_t* vertices, const ClusterTriangle& triangle,
                const float* corner[3]) {
    for (uint32_t k = 0; k < 3; ++k)
        corner[k] = points + 4 * size_t(vertices[triangle.corner[k]]);
    const auto finite = [](const float* p) { return is_finite(p[0]) && is_finite(p[1]) && is_finite(p[2]); };
    return finite(corner[0]) && finite(corner[1]) && finite(corner[2]);
}

// The unit normal and distance of each triangle; all zero, so that it faces nobody, where there is no normal.
// Returns how many have a corner that is not finite.
uint32_t refit_planes(const float* points, const Clusters& clusters, uint32_t cluster, float* planes) {
    const uint32_t* vertices = clusters.vertices.data() + clusters.vertex_begin[cluster];
    uint32_t invalid = 0;
    for (uint32_t t = clusters.triangle_begin[cluster]; t < clusters.triangle_begin[cluster + 1];
         ++t, planes += 4) {
        const float* p[3];
        std::memset(planes, 0, 4 * sizeof(float));
        if (!corners_of(points, vertices, clusters.triangles[t], p)) {
            ++invalid;
            continue;
        }
        const float ux = p[1][0] - p[0][0], uy = p[1][1] - p[0][1], uz = p[1][2] - p[0][2];
        const float vx = p[2][0] - p[0][0], vy = p[2][1] - p[0][1], vz = p[2][2] - p[0][2];
        const float x = uy * vz - uz * vy, y = uz * vx - ux * vz, z = ux * vy - uy * vx;
        const float length = std::sqrt(x * x + y * y + z * z);
        if (!(length > 0)) continue;
        planes[0] = x / length;
        planes[1] = y / length;
        planes[2] = z / length;
        planes[3] = planes[0] * p[0][0] + planes[1] * p[0][1] + planes[2] * p[0][2];
    }
    return invalid;
}

// A sphere around the finite vertices; false where there is none.
bool refit_sphere(const float* points, const Clusters& clusters, uint32_t cluster, float centre[3],
                  float& radius) {
    const uint32_t* vertices = clusters.vertices.data();
    const uint32_t begin = clusters.vertex_begin[cluster], end = clusters.vertex_begin[cluster + 1];
    float low[3] = {FLT_MAX, FLT_MAX, FLT_MAX}, high[3] = {-FLT_MAX, -FLT_MAX, -FLT_MAX};
    const auto finite = [](const float* p) { return is_finite(p[0]) && is_finite(p[1]) && is_finite(p[2]); };
    for (uint32_t i = begin; i < end; ++i) {
        const float* p = points + 4 * size_t(vertices[i]);
        if (!finite(p)) continue;
        for (uint32_t k = 0; k < 3; ++k) {
            low[k] = std::min(low[k], p[k]);
            high[k] = std::max(high[k], p[k]);
        }
    }
    if (low[0] > high[0]) return false;
    for (uint32_t k = 0; k < 3; ++k)
        centre[k] = 0.5f * low[k] + 0.5f * high[k];
    float far = 0;
    for (uint32_t i = begin; i < end; ++i) {
        const float* p = points + 4 * size_t(vertices[i]);
        if (!finite(p)) continue;
        const float x = p[0] - centre[0], y = p[1] - centre[1], z = p[2] - centre[2];
        far = std::max(far, x * x + y * y + z * z);
    }
    radius = std::sqrt(far);
    return true;
}

// The cone of the triangles' normals; cosine -1 where it would be wider than a right angle.
float refit_cone(const float* planes, uint32_t triangles, float axis[3]) {
    float sum[3] = {};
    for (uint32_t t = 0; t < triangles; ++t) {
        for (uint32_t k = 0; k < 3; ++k)
            sum[k] += planes[4 * t + k];
    }
    const float length = std::sqrt(sum[0] * sum[0] + sum[1] * sum[1] + sum[2] * sum[2]);
    for (uint32_t k = 0; k < 3; ++k)
        axis[k] = length > 0 ? sum[k] / length : 0.0f;
    float least = length > 0 ? 1.0f : -1.0f;
    for (uint32_t t = 0; t < triangles; ++t) {
        const float* n = planes + 4 * t;
        const bool degenerate = n[0] == 0 && n[1] == 0 && n[2] == 0; // never rasterised: no part of the cone
        if (!degenerate) least = std::min(least, n[0] * axis[0] + n[1] * axis[1] + n[2] * axis[2]);
    }
    least -= 1e-6f;
    return least > 0 ? least : -1.0f;
}

} // namespace

void measure_extents(void* context, uint32_t begin, uint32_t end, uint32_t) {
    Frame& frame = *static_cast<Frame*>(context);
    for (uint32_t chunk = begin; chunk < end; ++chunk) {
        const PointRange range = points_of_chunk(frame, chunk);
        float largest = 0;
        for (uint32_t w = range.begin; w < range.end; ++w) {
            const float* p = element(range.slice.in.positions, range.slice.mesh->weld_source[w]);
            for (uint32_t k = 0; k < 3; ++k) {
                const float size = std::fabs(p[k] - frame.origin[k]);
                largest = is_finite(size) && size > largest ? size : largest;
            }
        }
        frame.extents[chunk] = largest;
    }
}

void choose_scale(void* context, uint32_t, uint32_t, uint32_t) {
    Frame& frame = *static_cast<Frame*>(context);
    float largest = 0;
    for (uint32_t chunk = 0; chunk < frame.point_chunks; ++chunk)
        largest = std::max(largest, frame.extents[chunk]);
    int exponent = 0;
    std::frexp(largest, &exponent);
    frame.scale = largest > 0 ? std::ldexp(1.0f, std::clamp(-exponent, -126, 126)) : 1.0f;
}

void place_points(void* context, uint32_t begin, uint32_t end, uint32_t) {
    Frame& frame = *static_cast<Frame*>(context);
    for (uint32_t chunk = begin; chunk < end; ++chunk) {
        const PointRange range = points_of_chunk(frame, chunk);
        for (uint32_t w = range.begin; w < range.end; ++w) {
            const float* p = element(range.slice.in.positions, range.slice.mesh->weld_source[w]);
            float* out = frame.points.data() + 4 * (size_t(range.slice.first_point) + w);
            for (uint32_t k = 0; k < 3; ++k)
                out[k] = (p[k] - frame.origin[k]) * frame.scale;
            out[3] = 0;
        }
    }
}

void refit_clusters(void* context, uint32_t begin, uint32_t end, uint32_t slot) {
    Frame& frame = *static_cast<Frame*>(context);
    for (uint32_t c = begin; c < end; ++c) {
        const MeshSlice& slice = frame.meshes[frame.cluster_mesh[c]];
        const Clusters& clusters = *slice.clusters;
        const uint32_t own = c - slice.first_cluster;
        const float* points = frame.points.data() + 4 * size_t(slice.first_point);
        kernels::ClusterView& view = frame.views[c];
        float* planes = frame.planes.data() + 4 * size_t(frame.cluster_planes[c]);
        const uint32_t invalid = refit_planes(points, clusters, own, planes);
        if (clusters.own_group[own] == no_group) frame.workers[slot].tally.triangles_invalid += invalid;
        float centre[3] = {}, radius = 0, axis[3] = {}, cosine = -1;
        if (refit_sphere(points, clusters, own, centre, radius) && !view.two_sided)
            cosine = refit_cone(planes, view.triangle_count, axis);
        for (uint32_t k = 0; k < 3; ++k) {
            frame.centre[k].data()[c] = view.centre[k] = centre[k];
            frame.cone[k].data()[c] = axis[k];
        }
        frame.radius.data()[c] = view.radius = radius;
        frame.cone_cos.data()[c] = cosine;
        frame.cone_sin.data()[c] = std::sqrt(std::max(1 - cosine * cosine, 0.0f));
    }
}

void refit_groups(void* context, uint32_t begin, uint32_t end, uint32_t) {
    Frame& frame = *static_cast<Frame*>(context);
    for (uint32_t m = begin; m < end; ++m) {
        const MeshSlice& slice = frame.meshes[m];
        if (frame.quality.paper) continue;
        const Groups& groups = slice.mesh->groups;
        for (uint32_t g = 0; g < groups.count(); ++g) {
            const uint32_t first = groups.cluster_begin[g], last = groups.cluster_begin[g + 1];
            float low[3] = {FLT_MAX, FLT_MAX, FLT_MAX}, high[3] = {-FLT_MAX, -FLT_MAX, -FLT_MAX};
            for (uint32_t i = first; i < last; ++i) {
                const uint32_t c = slice.first_cluster + groups.clusters[i];
                for (uint32_t k = 0; k < 3; ++k) {
                    low[k] = std::min(low[k], frame.centre[k].data()[c] - frame.radius.data()[c]);
                    high[k] = std::max(high[k], frame.centre[k].data()[c] + frame.radius.data()[c]);
                }
            }
            float centre[3];
            for (uint32_t k = 0; k < 3; ++k)
                centre[k] = 0.5f * low[k] + 0.5f * high[k];
            // Around the clusters it replaces and around all that those stand for, so that the distance to a
            // parent is never more than to its children: the cut is then the same from both sides of every
            // border.
            float radius = 0, error = 0;
            const auto enclose = [&](float x, float y, float z, float r) {
                x -= centre[0];
                y -= centre[1];
                z -= centre[2];
                radius = std::max(radius, std::sqrt(x * x + y * y + z * z) + r);
            };
            for (uint32_t i = first; i < last; ++i) {
                const uint32_t c = slice.first_cluster + groups.clusters[i];
                enclose(frame.centre[0].data()[c], frame.centre[1].data()[c], frame.centre[2].data()[c],
                        frame.radius.data()[c]);
                const uint32_t child = slice.clusters->own_group[groups.clusters[i]];
                if (child == no_group) continue;
                const uint32_t o = slice.first_group + child;
                enclose(frame.group_centre[0].data()[o], frame.group_centre[1].data()[o],
                        frame.group_centre[2].data()[o], frame.group_radius.data()[o]);
                error = std::max(error, frame.group_error.data()[o]);
            }
            radius *= 1.000001f;
            const uint32_t out = slice.first_group + g;
            for (uint32_t k = 0; k < 3; ++k)
                frame.group_centre[k].data()[out] = centre[k];
            frame.group_radius.data()[out] = radius;
            frame.group_error.data()[out] = std::max(error, groups.relative_error[g] * radius);
        }
    }
}

} // namespace nusselt
