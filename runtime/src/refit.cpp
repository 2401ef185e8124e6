#include "refit.h"

#include "falloff.h"
#include "kernels/prepare.h"
#include "objects.h"
#include "weld.h"

#include <algorithm>
#include <cmath>
#include <cstring>

namespace nusselt {

namespace {

// In distances of a coarse cluster from the surface that it stands for: a plane that passes a receiver no
// farther off may lie on the wrong side of it, and hide all or nothing. As seen from there its triangles are
// slivers, and where they are near the finer level is drawn. A sheet hides from both sides, and up to twice
// that of a closed part it still darkened receivers in folds.
constexpr float clear_of_closed = 1.5f, clear_of_sheet = 3.0f;
// Of the root mean square distance of a cluster from the level before it. A level serves where twice that of
// the whole level is small enough, and where so many times a cluster's own is: flat parts would else vouch
// for a finger.
constexpr float error_of_own = 1.2f;
// The same for how far one of its triangles lies from that level where it bridges a hollow.
constexpr float error_of_bridge = 1.5f;

// Coordinates are rounded, by 2^-24 of their distance from the frame's origin. So of two surfaces in one
// plane one lies above the other here and there, by a few times that, and would hide the whole hemisphere:
// with 3 times 2^-24 a thousandth of the receivers of such surfaces turned dark, with 4 none.
constexpr float rounding = 4e-7f;

// What a cluster's clearance must be for its coordinates' sake, beside the 1e-6 of its radius that kernels
// add.
float clear_of_rounding(const kernels::ClusterView& view) {
    const float* c = view.centre;
    const float far = std::sqrt(c[0] * c[0] + c[1] * c[1] + c[2] * c[2]) + view.radius;
    return std::max(rounding * far - 1e-6f * view.radius, 0.0f);
}

struct PointRange {
    const MeshSlice& slice;
    uint32_t begin, end; // welded vertices of the mesh
};

PointRange points_of_chunk(const Frame& frame, uint32_t chunk) {
    const MeshSlice& slice = slice_of(bodies(frame), &MeshSlice::first_point_chunk, chunk);
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

// Planes and spheres of a cluster's triangles, as kernels::ClusterView wants them. Returns how many triangles
// have a corner that is not finite.
uint32_t refit_triangles(const float* points, const Clusters& clusters, uint32_t cluster, float* out) {
    const uint32_t* vertices = clusters.vertices.data() + clusters.vertex_begin[cluster];
    const uint32_t first = clusters.triangle_begin[cluster],
                   count = clusters.triangle_begin[cluster + 1] - first;
    const uint32_t slots = kernels::triangle_slots(count);
    uint32_t invalid = 0;
    std::memset(out, 0, 8 * size_t(slots) * sizeof(float));
    std::fill(out + 7 * slots, out + 8 * slots, -FLT_MAX);
    for (uint32_t t = 0; t < count; ++t) {
        const float* p[3];
        if (!corners_of(points, vertices, clusters.triangles[first + t], p)) {
            ++invalid;
            continue;
        }
        const float ux = p[1][0] - p[0][0], uy = p[1][1] - p[0][1], uz = p[1][2] - p[0][2];
        const float vx = p[2][0] - p[0][0], vy = p[2][1] - p[0][1], vz = p[2][2] - p[0][2];
        const float x = uy * vz - uz * vy, y = uz * vx - ux * vz, z = ux * vy - uy * vx;
        // Where its square underflows a normal would not be unit, and kernels' bounds take it to be.
        const float area = x * x + y * y + z * z;
        if (!(area >= FLT_MIN)) continue;
        const float length = std::sqrt(area);
        const float n[3] = {x / length, y / length, z / length};
        float centre[3], square = 0;
        for (uint32_t k = 0; k < 3; ++k) {
            const float low = std::min(std::min(p[0][k], p[1][k]), p[2][k]);
            const float high = std::max(std::max(p[0][k], p[1][k]), p[2][k]);
            centre[k] = 0.5f * low + 0.5f * high;
            out[k * slots + t] = n[k];
            out[(4 + k) * slots + t] = centre[k];
        }
        for (const float* corner : p) {
            const float dx = corner[0] - centre[0], dy = corner[1] - centre[1], dz = corner[2] - centre[2];
            square = std::max(square, dx * dx + dy * dy + dz * dz);
        }
        out[3 * slots + t] = n[0] * p[0][0] + n[1] * p[0][1] + n[2] * p[0][2];
        out[7 * slots + t] = std::sqrt(square);
    }
    return invalid;
}

// A box and a sphere around the finite vertices; false where there is none.
bool refit_sphere(const float* points, const Clusters& clusters, uint32_t cluster, MeshBox& box,
                  float centre[3], float& radius) {
    const uint32_t* vertices = clusters.vertices.data();
    const uint32_t begin = clusters.vertex_begin[cluster], end = clusters.vertex_begin[cluster + 1];
    box = no_box;
    const auto finite = [](const float* p) { return is_finite(p[0]) && is_finite(p[1]) && is_finite(p[2]); };
    for (uint32_t i = begin; i < end; ++i) {
        const float* p = points + 4 * size_t(vertices[i]);
        if (!finite(p)) continue;
        for (uint32_t k = 0; k < 3; ++k) {
            box.low[k] = std::min(box.low[k], p[k]);
            box.high[k] = std::max(box.high[k], p[k]);
        }
    }
    if (box.low[0] > box.high[0]) return false;
    for (uint32_t k = 0; k < 3; ++k)
        centre[k] = 0.5f * box.low[k] + 0.5f * box.high[k];
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

// The cone of the triangles' normals (`bounds` as above); cosine -1 where it would be wider than a right
// angle.
float refit_cone(const float* bounds, uint32_t triangles, float axis[3]) {
    const uint32_t slots = kernels::triangle_slots(triangles);
    const float *x = bounds, *y = bounds + slots, *z = bounds + 2 * size_t(slots);
    float sum[3] = {};
    for (uint32_t t = 0; t < triangles; ++t) {
        sum[0] += x[t];
        sum[1] += y[t];
        sum[2] += z[t];
    }
    const float length = std::sqrt(sum[0] * sum[0] + sum[1] * sum[1] + sum[2] * sum[2]);
    for (uint32_t k = 0; k < 3; ++k)
        axis[k] = length > 0 ? sum[k] / length : 0.0f;
    float least = length > 0 ? 1.0f : -1.0f;
    for (uint32_t t = 0; t < triangles; ++t) {
        const bool degenerate = x[t] == 0 && y[t] == 0 && z[t] == 0; // never rasterised: no part of the cone
        if (!degenerate) least = std::min(least, x[t] * axis[0] + y[t] * axis[1] + z[t] * axis[2]);
    }
    least -= 1e-6f;
    return least > 0 ? least : -1.0f;
}

// The squared distance of a sample's vertex from its point of the level: all of what lies across the
// triangle, and of what lies along it the part that did so in the rest pose.
float sample_distance(const float* points, const LevelSamples& samples, uint32_t i) {
    const float* p = points + 4 * size_t(samples.vertex[i]);
    const float* corner[3];
    for (uint32_t k = 0; k < 3; ++k)
        corner[k] = points + 4 * size_t(samples.corner[3 * size_t(i) + k]);
    const float* weight = samples.weight.data() + 3 * size_t(i);
    float away[3], u[3], v[3];
    for (uint32_t k = 0; k < 3; ++k) {
        away[k] = p[k] - (weight[0] * corner[0][k] + weight[1] * corner[1][k] + weight[2] * corner[2][k]);
        u[k] = corner[1][k] - corner[0][k];
        v[k] = corner[2][k] - corner[0][k];
    }
    const float x = u[1] * v[2] - u[2] * v[1], y = u[2] * v[0] - u[0] * v[2], z = u[0] * v[1] - u[1] * v[0];
    const float square = away[0] * away[0] + away[1] * away[1] + away[2] * away[2];
    const float area = x * x + y * y + z * z, height = away[0] * x + away[1] * y + away[2] * z;
    const float across = area > 0 ? std::min(height * height / area, square) : square;
    return across + samples.tangential[i] * (square - across);
}

float bridge_distance(const float* points, const Bridge& bridge) {
    const float* vertex = points + 4 * size_t(bridge.vertex);
    float square = 0;
    for (uint32_t k = 0; k < 3; ++k) {
        float away = vertex[k];
        for (uint32_t i = 0; i < 3; ++i)
            away -= bridge.weight[i] * points[4 * size_t(bridge.corner[i]) + k];
        square += away * away;
    }
    return std::sqrt(bridge.part * square);
}

// How far a cluster of a coarser level lies from the level before it.
LevelError measure_cluster(const float* points, const LevelSamples& samples, uint32_t cluster) {
    LevelError error{};
    for (uint32_t i = samples.cluster_begin[cluster]; i < samples.cluster_begin[cluster + 1]; ++i) {
        const float square = sample_distance(points, samples, i);
        if (!is_finite(square)) continue;
        error.squares += square;
        error.most = std::max(error.most, square);
    }
    error.most = std::sqrt(error.most);
    const Bridge& bridge = samples.bridges[cluster];
    if (bridge.vertex == none) return error;
    const float far = bridge_distance(points, bridge);
    if (!is_finite(far)) return error;
    error.bridge = far;
    error.most = std::max(error.most, far);
    return error;
}

// Twice the root mean square distance of each level from the one before it, and no less than that one's own.
void level_errors(const Clusters& clusters, const LevelSamples& samples, const LevelError* of_cluster,
                  float error[max_levels]) {
    float squares[max_levels] = {};
    for (uint32_t c = 0; c < clusters.count(); ++c)
        squares[clusters.level[c]] += of_cluster[c].squares;
    error[0] = 0;
    for (uint32_t level = 1; level < level_count(samples); ++level) {
        const uint32_t count = std::max(samples.begin[level + 1] - samples.begin[level], 1u);
        error[level] = std::max(error[level - 1], 2 * std::sqrt(squares[level] / float(count)));
    }
}

template<class Visit>
void each_cover(const Clusters& clusters, uint32_t c, const Visit& visit) {
    for (uint32_t k = clusters.cover_begin[c]; k < clusters.cover_begin[c + 1]; ++k)
        visit(clusters.covers[k]);
}

// The distances at which clusters' levels serve where a level's error may subtend `angle`. `of_cluster`:
// gathered over the levels.
void distance_bands(const MeshSlice& slice, const LevelError* of_cluster, float angle, float* nearest,
                    float* farthest) {
    const Clusters& clusters = *slice.clusters;
    const LevelSamples& samples = slice.mesh->samples;
    float error[max_levels];
    level_errors(clusters, samples, of_cluster, error);
    for (uint32_t c = 0; c < clusters.count(); ++c) {
        const uint32_t count = std::max(samples.cluster_begin[c + 1] - samples.cluster_begin[c], 1u);
        const float own = error_of_own * std::sqrt(of_cluster[c].squares / float(count));
        const float bridge = error_of_bridge * of_cluster[c].bridge;
        nearest[c] = std::max({error[clusters.level[c]], own, bridge}) / angle;
    }
    // Finer levels come first: no cluster serves nearer than what it covers.
    for (uint32_t c = 0; c < clusters.count(); ++c)
        each_cover(clusters, c, [&](uint32_t over) { nearest[over] = std::max(nearest[over], nearest[c]); });
    for (uint32_t c = 0; c < clusters.count(); ++c) {
        farthest[c] = 0;
        bool covered = false;
        each_cover(clusters, c, [&](uint32_t over) {
            farthest[c] = std::max(farthest[c], nearest[over] + of_cluster[over].most);
            covered = true;
        });
        if (!covered) farthest[c] = FLT_MAX;
    }
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
    if (frame.fades) frame.fade = make_fade(frame.falloff, frame.scale);
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
        float* bounds = frame.triangle_bounds.data() + frame.cluster_bounds_begin[c];
        const uint32_t invalid = refit_triangles(points, clusters, own, bounds);
        frame.broken[c] = invalid > 0;
        if (clusters.level[own] == 0) frame.workers[slot].tally.triangles_invalid += invalid;
        float centre[3] = {}, radius = 0, axis[3] = {}, cosine = -1;
        if (refit_sphere(points, clusters, own, frame.cluster_boxes[c], centre, radius) && !view.two_sided)
            cosine = refit_cone(bounds, view.triangle_count, axis);
        for (uint32_t k = 0; k < 3; ++k) {
            frame.centre[k].data()[c] = view.centre[k] = centre[k];
            frame.cone[k].data()[c] = axis[k];
        }
        frame.radius.data()[c] = view.radius = radius;
        if (!frame.quality.paper) {
            frame.level_errors[c] = measure_cluster(points, slice.mesh->samples, own);
        }
        const float* triangle_radius = bounds + 7 * kernels::triangle_slots(view.triangle_count);
        frame.triangle_radius.data()[c] =
            std::max(*std::max_element(triangle_radius, triangle_radius + view.triangle_count), 0.0f);
        frame.cone_cos.data()[c] = cosine;
        frame.cone_sin.data()[c] = std::sqrt(std::max(1 - cosine * cosine, 0.0f));
    }
}

void choose_bands(void* context, uint32_t begin, uint32_t end, uint32_t) {
    Frame& frame = *static_cast<Frame*>(context);
    for (uint32_t m = begin; m < end; ++m) {
        const MeshSlice& slice = frame.meshes[m];
        const Clusters& clusters = *slice.clusters;
        LevelError* const of_cluster = frame.level_errors.data() + slice.first_cluster;
        float* const nearest = frame.nearest.data() + slice.first_cluster;
        float* const farthest = frame.farthest.data() + slice.first_cluster;
        kernels::ClusterView* const views = frame.views.data() + slice.first_cluster;
        if (frame.quality.paper) {
            std::fill_n(nearest, clusters.count(), 0.0f);
            std::fill_n(farthest, clusters.count(), FLT_MAX);
        } else {
            for (uint32_t c = 0; c < clusters.count(); ++c) {
                each_cover(clusters, c, [&](uint32_t over) {
                    of_cluster[over].most = std::max(of_cluster[over].most, of_cluster[c].most);
                });
            }
            distance_bands(slice, of_cluster, frame.quality.angle, nearest, farthest);
        }
        for (uint32_t c = 0; c < clusters.count(); ++c) {
            views[c].nearest = nearest[c];
            views[c].farthest = farthest[c];
            farthest[c] = std::max(farthest[c], 2 * frame.triangle_radius.data()[slice.first_cluster + c]);
            if (frame.fades) farthest[c] = std::min(farthest[c], frame.fade.to);
            const float clear = views[c].two_sided ? clear_of_sheet : clear_of_closed;
            const float own = frame.quality.paper ? 0 : clear * of_cluster[c].most;
            views[c].clearance = std::max(own, clear_of_rounding(views[c]));
        }
        bound_mesh(frame, m);
    }
}

void choose_proxy_bands(const Frame& frame, const MeshSlice& slice, float* nearest, float* farthest) {
    distance_bands(slice, frame.level_errors.data() + slice.first_cluster, frame.quality.proxy_angle, nearest,
                   farthest);
}

} // namespace nusselt
