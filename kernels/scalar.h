// One receiver's arithmetic: what reference.cpp does for each lane, and what is too rare to be done for
// sixteen at once.
#pragma once

#include "kernels/kernels.h"

#include <cfloat>
#include <cmath>

namespace nusselt::kernels {

struct Vec {
    float x, y, z;
};

inline Vec cross(const Vec& a, const Vec& b) {
    return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}

// The first cell for what is not a number, too: zero times the infinite reciprocal of a denormal sum.
inline uint32_t clamp_cell(float value, uint32_t cells) {
    const float top = float(cells - 1);
    return uint32_t(!(value > 0) ? 0 : value > top ? top : value);
}

// The table's entry for the half-space n.d <= 0, n the plane's normal: inside, for a front-facing triangle's
// edges.
inline uint32_t plane_entry(const MaskLayout& layout, const Vec& n) {
    const uint32_t cells = layout.plane_cells;
    const float half = float(cells / 2);
    const float ax = std::fabs(n.x), ay = std::fabs(n.y), az = std::fabs(n.z);
    if (layout.planes == PlaneMap::octahedral) {
        const float sum = ax + ay + az;
        if (!(sum > 0 && sum <= FLT_MAX)) return entry_invalid;
        const bool below = std::signbit(n.z);
        const float x = below ? -n.x : n.x, y = below ? -n.y : n.y;
        const float scale = (half - 0.5f) / sum;
        const uint32_t u = clamp_cell((x + y) * scale + half, cells),
                       v = clamp_cell((x - y) * scale + half, cells);
        return (((v << row_shift(layout)) + u) << cell_shift(layout)) | (below ? 0u : 1u);
    }
    // The paper's cube map. The half-space n.d <= 0 is that of -n, the opposite cell of the opposite face.
    const uint32_t axis = ax >= ay && ax >= az ? 0 : ay >= az ? 1 : 2;
    const float major = axis == 0 ? n.x : axis == 1 ? n.y : n.z, size = std::fabs(major);
    if (!(size > 0 && size <= FLT_MAX)) return entry_invalid;
    const float scale = half / size;
    const uint32_t u = clamp_cell((axis == 0 ? n.y : n.x) * scale + half, cells);
    const uint32_t v = clamp_cell((axis == 2 ? n.y : n.z) * scale + half, cells);
    const uint32_t face = axis * 2 + (std::signbit(major) ? 1u : 0u);
    return (((face * cells + v) * cells + u) << cell_shift(layout)) ^ entry_complement(layout);
}

// Whether a triangle with these corners reaches a part of the mask. Conservative.
inline bool reaches_part(const MaskLayout& layout, uint32_t part, const Vec& a, const Vec& b, const Vec& c) {
    const auto any = [](bool positive, float x, float y, float z) {
        return positive ? x > 0 || y > 0 || z > 0 : x < 0 || y < 0 || z < 0;
    };
    const bool quarters = mask_parts(layout) == 4;
    return any(quarters ? part >= 2 : part == 1, a.y, b.y, c.y) &&
           (!quarters || any(part == 1 || part == 2, a.x, b.x, c.x));
}

inline Vec to_local(const Batch& batch, uint32_t lane, const Vec& point) {
    const float x = point.x - batch.position[0][lane], y = point.y - batch.position[1][lane],
                z = point.z - batch.position[2][lane];
    float r[3];
    for (uint32_t row = 0; row < 3; ++row)
        r[row] = batch.axis[row][0][lane] * x + batch.axis[row][1][lane] * y + batch.axis[row][2][lane] * z;
    return {r[0], r[1], r[2]};
}

// Per lane: what the horizon test measures heights against.
struct Horizon {
    float x, y; // tangent of the elevation times the horizontal direction to the blockers
};

inline Horizon horizon_towards(float tangent, const Vec& local) {
    const float across = std::sqrt(local.x * local.x + local.y * local.y);
    if (!(across > 0)) return {0, 0};
    return {tangent * (local.x / across), tangent * (local.y / across)};
}

inline float larger(float a, float b) {
    return a > b ? a : b;
}

// Below the tangent plane, or below a plane through the receiver that rises to the horizon's elevation:
// either way no sample point is covered.
inline bool above_horizon(const Horizon& h, const Vec& a, const Vec& b, const Vec& c) {
    const float height = larger(larger(a.z, b.z), c.z);
    const float over = larger(larger(a.z - (h.x * a.x + h.y * a.y), b.z - (h.x * b.x + h.y * b.y)),
                              c.z - (h.x * c.x + h.y * c.y));
    return height > 0 && over > 0;
}

// How far off a triangle of the cluster is drawn.
inline float triangle_reach(const ClusterView& cluster, uint32_t triangle) {
    return larger(cluster.farthest,
                  2 * cluster.bounds[7 * triangle_slots(cluster.triangle_count) + triangle]);
}

inline bool in_band(const ClusterView& cluster, uint32_t triangle, const Vec corner[3]) {
    const float farthest = triangle_reach(cluster, triangle);
    uint32_t near = 0, far = 0; // corners
    for (uint32_t k = 0; k < 3; ++k) {
        const float square =
            corner[k].x * corner[k].x + corner[k].y * corner[k].y + corner[k].z * corner[k].z;
        near += square < farthest * farthest;
        far += square >= cluster.nearest * cluster.nearest;
    }
    return near >= 1 && far >= (cluster.two_sided ? 2u : 1u);
}

// Whether no point of the triangle, whose plane passes the receiver at that height, is nearer than the fade's
// end.
inline bool is_beyond(const Fade& fade, const Batch& batch, uint32_t lane, const ClusterView& cluster,
                      uint32_t triangle, float height) {
    const uint32_t slots = triangle_slots(cluster.triangle_count);
    const float* sphere = cluster.bounds + 4 * slots + triangle;
    const float x = sphere[0] - batch.position[0][lane], y = sphere[slots] - batch.position[1][lane],
                z = sphere[2 * slots] - batch.position[2][lane];
    const float reach = sphere[3 * slots] * 1.00001f + fade.to;
    return std::fabs(height) >= fade.to || x * x + y * y + z * z >= reach * reach;
}

// One over the greatest distance at which a sample meets a plane.
constexpr float least_inverse = 1e-30f;
// What is added to a number from 0 to 255 has its nearest integer in the lowest byte.
constexpr float rounding = 8388608;

// So near the zenith, in squared tangents, that rounding decides on which side of it an arc passes: whether
// the arc hides what is under it in a quarter of the hemisphere or in none. It hides nothing: the triangle's
// plane stands upright.
constexpr float upright = 1e-8f;

inline bool is_upright(const Vec& p) {
    return p.z > 0 && p.x * p.x + p.y * p.y < upright * (p.z * p.z);
}

// A triangle whose plane passes a ray's origin no farther off than this is not crossed by it.
constexpr float crossing_margin = 4e-6f;
// A plane lies behind a ray's origin where its height and the cosine of ray and normal say so, unless the ray
// runs so nearly along it that rounding may decide.
constexpr float crossing_slope = 1e-4f;
// From this cosine on it is asked how far from the triangle's middle the ray meets the plane; with room for
// what rounding does to the normals of triangles a hundred times as long as wide, over the cosine.
constexpr float meeting_slope = 0.1f, meeting_margin = 2e-4f;

// 1 where the lane's ray leaves through the triangle, -1 where it enters, else 0. `height`: of the origin
// over the triangle's plane.
inline int32_t crossing(const Rays& rays, uint32_t lane, const ClusterView& cluster, const float* points,
                        uint32_t triangle, float height) {
    const auto along = [&](uint32_t axis, float x, float y, float z) {
        return x * rays.across[axis][0] + y * rays.across[axis][1] + z * rays.across[axis][2];
    };
    const float ox = rays.origin[0][lane], oy = rays.origin[1][lane], oz = rays.origin[2][lane];
    float u[3], v[3];
    for (uint32_t k = 0; k < 3; ++k) {
        const float* p = points + 4 * size_t(cluster.vertices[cluster.triangles[8 * triangle + k]]);
        u[k] = along(0, p[0], p[1], p[2]) - along(0, ox, oy, oz);
        v[k] = along(1, p[0], p[1], p[2]) - along(1, ox, oy, oz);
    }
    uint32_t left = 0; // edges that have the ray on their left
    for (uint32_t k = 0; k < 3; ++k) {
        const uint32_t n = (k + 1) % 3;
        const float side = u[k] * v[n] - v[k] * u[n];
        left += side > 0 || (side == 0 && (u[k] < u[n] || (u[k] == u[n] && v[k] < v[n])));
    }
    if (left == 3 && height < -crossing_margin) return 1;
    return left == 0 && height > crossing_margin ? -1 : 0;
}

} // namespace nusselt::kernels
