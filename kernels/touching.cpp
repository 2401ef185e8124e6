#include "kernels/touching.h"

#include "kernels/scalar.h"

namespace nusselt::kernels {

namespace {

// Of a triangle's radius: how far off its plane a receiver stands that lies in it. Its own rounding is far
// less, and what lies beyond the triangle's edges stays a sliver below what the mask can tell.
constexpr float stand_off = 1e-5f;

Vec point_at(const ClusterView& cluster, const float* points, uint32_t corner) {
    const float* p = points + 4 * cluster.vertices[corner];
    return {p[0], p[1], p[2]};
}

bool is_at(const Vec& p, const Vec& q) {
    return p.x == q.x && p.y == q.y && p.z == q.z;
}

void add_lane(const Batch& batch, const ClusterView& cluster, const float* points, uint32_t t, uint32_t lane,
              const MaskLayout& layout, float horizon, JobList& jobs, Counters& counters) {
    const uint32_t slots = triangle_slots(cluster.triangle_count);
    const auto bound = [&](uint32_t array) { return cluster.bounds[array * slots + t]; };
    const Vec p{batch.position[0][lane], batch.position[1][lane], batch.position[2][lane]};
    const Vec n{bound(0), bound(1), bound(2)};
    const float x = bound(4) - p.x, y = bound(5) - p.y, z = bound(6) - p.z, radius = bound(7);
    if (!(radius > 0 && x * x + y * y + z * z < radius * radius)) return; // a degenerate one has no radius
    Vec corner[3];
    for (uint32_t k = 0; k < 3; ++k) {
        corner[k] = point_at(cluster, points, cluster.triangles[8 * t + k]);
        if (is_at(corner[k], p)) return; // the fan's, or a corner that meets a corner
    }
    const float height = n.x * p.x + n.y * p.y + n.z * p.z - bound(3);
    const float along =
        n.x * batch.axis[2][0][lane] + n.y * batch.axis[2][1][lane] + n.z * batch.axis[2][2][lane];
    const bool behind = cluster.two_sided && (std::fabs(along) > 0.25f ? along < 0 : height < 0);
    const float off = (behind ? -stand_off : stand_off) * radius - height;
    for (Vec& c : corner)
        c = to_local(batch, lane, {c.x - off * n.x, c.y - off * n.y, c.z - off * n.z});
    const Vec sum{corner[0].x + corner[1].x + corner[2].x, corner[0].y + corner[1].y + corner[2].y,
                  corner[0].z + corner[1].z + corner[2].z};
    if (!above_horizon(horizon_towards(horizon, sum), corner[0], corner[1], corner[2])) return;
    if (!in_band(cluster, t, corner)) return;
    uint32_t entry[3];
    for (uint32_t k = 0; k < 3; ++k) {
        entry[k] = plane_entry(layout, cross(corner[k], corner[(k + 1) % 3]));
        if (entry[k] & entry_invalid) return;
        if (behind) entry[k] ^= entry_complement(layout);
    }
    ++counters.triangles_rasterized;
    const uint32_t bytes = mask_bytes(layout);
    for (uint32_t part = 0; part < mask_parts(layout); ++part) {
        if (!reaches_part(layout, part, corner[0], corner[1], corner[2])) continue;
        for (uint32_t k = 0; k < 3; ++k)
            jobs.plane[k][jobs.count] = entry_of_part(layout, entry[k], part);
        jobs.destination[jobs.count] = lane * bytes + part * part_bytes(layout);
        ++jobs.count;
    }
}

} // namespace

void touching_jobs(const Batch& batch, const ClusterView& cluster, const float* points, uint32_t triangle,
                   uint32_t touching, const MaskLayout& layout, float horizon, JobList& jobs,
                   Counters& counters) {
    for (uint32_t left = touching; left; left &= left - 1)
        add_lane(batch, cluster, points, triangle, static_cast<uint32_t>(__builtin_ctz(left)), layout,
                 horizon, jobs, counters);
}

} // namespace nusselt::kernels
