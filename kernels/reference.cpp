// The scalar reference of every kernel: the oracle of the tests and the fallback where there is no SIMD.
// Obvious, and never improved.
#include "kernels/reference.h"

#include "kernels/prepare.h"
#include "kernels/scalar.h"
#include "kernels/touching.h"

#include <cstring>

namespace nusselt::kernels {

namespace {

#include "kernels/sh_formulas.inl"

struct Constant {
    float operator()(double value) const { return float(value); }
};

void add_jobs(const MaskLayout& layout, const uint32_t entry[3][lanes], const Vec corner[3][lanes],
              uint32_t active, JobList& jobs) {
    const uint32_t bytes = mask_bytes(layout);
    for (uint32_t part = 0; part < mask_parts(layout); ++part) {
        for (uint32_t lane = 0; lane < lanes; ++lane) {
            if (!(active >> lane & 1)) continue;
            if (!reaches_part(layout, part, corner[0][lane], corner[1][lane], corner[2][lane])) continue;
            for (uint32_t k = 0; k < 3; ++k)
                jobs.plane[k][jobs.count] = entry_of_part(layout, entry[k][lane], part);
            jobs.destination[jobs.count] = lane * bytes + part * part_bytes(layout);
            ++jobs.count;
        }
    }
}

uint32_t bit_count(uint32_t value) {
    uint32_t count = 0;
    for (; value; value &= value - 1)
        ++count;
    return count;
}

enum class Reach { out_of_band, culled, reaches };

Reach cluster_reach(const ReceiverBounds& receivers, const ClusterBounds& clusters, uint32_t c,
                    float horizon) {
    const float x = clusters.centre[0][c] - receivers.centre[0],
                y = clusters.centre[1][c] - receivers.centre[1],
                z = clusters.centre[2][c] - receivers.centre[2];
    const float square = x * x + y * y + z * z, distance = std::sqrt(square);
    // A little more than the spheres: the tests' own rounding must not cull.
    const float reach = (clusters.radius[c] + receivers.radius) * 1.00001f + distance * 1e-6f;
    if (!(distance - reach < clusters.farthest[c] && distance + reach >= clusters.nearest[c]))
        return Reach::out_of_band;
    const float along = x * receivers.cone[0] + y * receivers.cone[1] + z * receivers.cone[2];
    const float across = std::sqrt(larger(square - along * along, 0));
    const float height = along * receivers.cone_cos + across * receivers.cone_sin;
    const float side = across * receivers.cone_cos - along * receivers.cone_sin;
    const float steep = reach * std::sqrt(1 + horizon * horizon);
    const bool low = height + reach < 0 || (height - horizon * side + steep < 0 && square > steep * steep);
    const float facing = 0.0f - (x * clusters.cone[0][c] + y * clusters.cone[1][c] + z * clusters.cone[2][c]);
    const float beside = std::sqrt(larger(square - facing * facing, 0));
    const bool back = facing * clusters.cone_cos[c] + beside * clusters.cone_sin[c] + reach < 0;
    const bool culled = (low && receivers.cone_cos > 0) || (back && clusters.cone_cos[c] > 0);
    return culled ? Reach::culled : Reach::reaches;
}

uint32_t select_clusters(const ReceiverBounds& receivers, const ClusterBounds& clusters,
                         const uint32_t* candidates, uint32_t candidate_count, float horizon,
                         uint32_t* selected, uint64_t* tested) {
    uint32_t count = 0;
    for (uint32_t i = 0; i < candidate_count; ++i) {
        const uint32_t c = candidates ? candidates[i] : i;
        const Reach reach = cluster_reach(receivers, clusters, c, horizon);
        *tested += reach != Reach::out_of_band;
        if (reach == Reach::reaches) selected[count++] = c;
    }
    return count;
}

// Whether the rays may meet a sphere.
bool meets(const Rays& rays, float cx, float cy, float cz, float radius) {
    const float x = cx - rays.centre[0], y = cy - rays.centre[1], z = cz - rays.centre[2];
    const float square = x * x + y * y + z * z;
    const float along = x * rays.direction[0] + y * rays.direction[1] + z * rays.direction[2];
    // As in cluster_reach; the root of a difference of squares may be off by more.
    const float reach = (radius + rays.radius) * 1.00001f + 1e-3f * std::sqrt(square);
    return along + reach >= 0 && square - along * along <= reach * reach;
}

uint32_t select_along(const Rays& rays, const ClusterBounds& clusters, const uint32_t* candidates,
                      uint32_t first, uint32_t end, uint32_t* selected) {
    uint32_t count = 0;
    for (uint32_t i = first; i < end; ++i) {
        const uint32_t c = candidates ? candidates[i] : i;
        if (meets(rays, clusters.centre[0][c], clusters.centre[1][c], clusters.centre[2][c],
                  clusters.radius[c]))
            selected[count++] = c;
    }
    return count;
}

uint64_t triangles_along(const Rays& rays, const ClusterView& cluster) {
    const uint32_t slots = triangle_slots(cluster.triangle_count);
    uint64_t met = 0;
    for (uint32_t t = 0; t < cluster.triangle_count; ++t) {
        const auto bound = [&](uint32_t array) { return cluster.bounds[array * slots + t]; };
        met |= uint64_t(meets(rays, bound(4), bound(5), bound(6), bound(7))) << t;
    }
    return met;
}

// Whether one lane's ray may meet a sphere.
bool ray_meets(const Rays& rays, uint32_t lane, float cx, float cy, float cz, float radius) {
    const float x = cx - rays.origin[0][lane], y = cy - rays.origin[1][lane], z = cz - rays.origin[2][lane];
    const auto along = [&](const float unit[3]) { return x * unit[0] + y * unit[1] + z * unit[2]; };
    const float u = along(rays.across[0]), v = along(rays.across[1]);
    const float reach = radius * 1.0001f + 4e-6f;
    return along(rays.direction) + reach >= 0 && u * u + v * v <= reach * reach;
}

void count_crossings(const Rays& rays, const ClusterView& cluster, const float* points,
                     int32_t winding[lanes]) {
    const uint32_t slots = triangle_slots(cluster.triangle_count);
    for (uint32_t lane = 0; lane < lanes; ++lane) {
        if (!(rays.active >> lane & 1)) continue;
        if (!ray_meets(rays, lane, cluster.centre[0], cluster.centre[1], cluster.centre[2], cluster.radius))
            continue;
        const float ox = rays.origin[0][lane], oy = rays.origin[1][lane], oz = rays.origin[2][lane];
        for (uint32_t t = 0; t < cluster.triangle_count; ++t) {
            const auto bound = [&](uint32_t array) { return cluster.bounds[array * slots + t]; };
            if (!ray_meets(rays, lane, bound(4), bound(5), bound(6), bound(7))) continue;
            const float height = bound(0) * ox + bound(1) * oy + bound(2) * oz - bound(3);
            const float* d = rays.direction;
            const float slope = bound(0) * d[0] + bound(1) * d[1] + bound(2) * d[2];
            if (slope == 0 || (height * slope > 0 && std::fabs(slope) > crossing_slope)) continue;
            if (std::fabs(slope) > meeting_slope) {
                const float away = height / slope, reach = bound(7) * 1.0001f + meeting_margin;
                const float x = ox - away * d[0] - bound(4), y = oy - away * d[1] - bound(5),
                            z = oz - away * d[2] - bound(6);
                if (x * x + y * y + z * z > reach * reach) continue;
            }
            winding[lane] += crossing(rays, lane, cluster, points, t, height);
        }
    }
}

// One over the distance of a plane along a direction is the direction times this. `normal` and `height`: of
// the plane, and of the receiver over it.
Vec inverse_distance(const Batch& batch, uint32_t lane, const float normal[3], float height) {
    const float scale = -1 / height;
    float r[3];
    for (uint32_t row = 0; row < 3; ++row)
        r[row] = (batch.axis[row][0][lane] * normal[0] + batch.axis[row][1][lane] * normal[1] +
                  batch.axis[row][2][lane] * normal[2]) *
                 scale;
    return {r[0], r[1], r[2]};
}

void add_fading_jobs(const MaskLayout& layout, const uint32_t entry[3][lanes], const Vec corner[3][lanes],
                     const Vec inverse[lanes], uint32_t active, FadingJobs& jobs) {
    for (uint32_t lane = 0; lane < lanes; ++lane) {
        const uint32_t first = jobs.list.count;
        add_jobs(layout, entry, corner, active & 1u << lane, jobs.list);
        for (uint32_t j = first; j < jobs.list.count; ++j) {
            jobs.inverse[0][j] = inverse[lane].x;
            jobs.inverse[1][j] = inverse[lane].y;
            jobs.inverse[2][j] = inverse[lane].z;
        }
    }
}

// `fade` null: `jobs` alone.
void fade_cluster_jobs(const Batch& batch, const ClusterView& cluster, const float* points,
                       const MaskLayout& layout, float horizon, const Fade* fade, JobList& jobs,
                       FadingJobs* fading, Counters& counters) {
    float margin[lanes];
    Horizon towards[lanes];
    for (uint32_t lane = 0; lane < lanes; ++lane) {
        const Vec local = to_local(batch, lane, {cluster.centre[0], cluster.centre[1], cluster.centre[2]});
        const float distance = std::sqrt(local.x * local.x + local.y * local.y + local.z * local.z);
        margin[lane] = cluster.clearance + 1e-6f * (distance + cluster.radius);
        towards[lane] = horizon_towards(horizon, local);
    }
    for (uint32_t t = 0; t < cluster.triangle_count; ++t) {
        const uint8_t* triangle = cluster.triangles + 8 * t;
        const uint32_t slots = triangle_slots(cluster.triangle_count);
        const float plane[4] = {cluster.bounds[t], cluster.bounds[slots + t], cluster.bounds[2 * slots + t],
                                cluster.bounds[3 * slots + t]};
        uint32_t entry[3][lanes];
        Vec corner[3][lanes];
        Vec inverse[lanes];
        uint32_t active = 0, touching = 0, in_part = 0;
        for (uint32_t lane = 0; lane < lanes; ++lane) {
            if (!(batch.valid >> lane & 1)) continue;
            const float height = plane[0] * batch.position[0][lane] + plane[1] * batch.position[1][lane] +
                                 plane[2] * batch.position[2][lane] - plane[3];
            const bool front = height > margin[lane], back = cluster.two_sided && height < -margin[lane];
            if (cluster.full && std::fabs(height) <= margin[lane]) touching |= 1u << lane;
            if (!front && !back) continue;
            if (fade && is_beyond(*fade, batch, lane, cluster, t, height)) continue;
            for (uint32_t k = 0; k < 3; ++k) {
                const float* p = points + 4 * cluster.vertices[triangle[k]];
                corner[k][lane] = to_local(batch, lane, {p[0], p[1], p[2]});
            }
            if (!above_horizon(towards[lane], corner[0][lane], corner[1][lane], corner[2][lane])) continue;
            const Vec three[3] = {corner[0][lane], corner[1][lane], corner[2][lane]};
            if (!in_band(cluster, t, three)) continue;
            bool valid = true;
            for (uint32_t k = 0; k < 3; ++k) {
                const uint8_t* edge = cluster.edges + 2 * triangle[3 + k];
                const float* from = points + 4 * cluster.vertices[edge[0]];
                const float* to = points + 4 * cluster.vertices[edge[1]];
                const Vec a = to_local(batch, lane, {from[0], from[1], from[2]});
                const Vec b = to_local(batch, lane, {to[0], to[1], to[2]});
                uint32_t e = plane_entry(layout, cross(a, b));
                valid = valid && !(e & entry_invalid);
                if (triangle[6] >> k & 1) e ^= entry_complement(layout);
                if (back) e ^= entry_complement(layout);
                entry[k][lane] = e;
            }
            if (valid) active |= 1u << lane;
            if (!fade) continue;
            inverse[lane] = inverse_distance(batch, lane, plane, height);
            for (const Vec& c : three) {
                const float square = c.x * c.x + c.y * c.y + c.z * c.z;
                in_part |= uint32_t(!(square < fade->from * fade->from)) << lane;
            }
        }
        counters.triangles_considered += bit_count(batch.valid);
        counters.triangles_rasterized += bit_count(active);
        add_jobs(layout, entry, corner, active & ~in_part, jobs);
        if (fade) add_fading_jobs(layout, entry, corner, inverse, active & in_part, *fading);
        touching_jobs(batch, cluster, points, t, touching, layout, horizon, jobs, counters);
    }
}

void cluster_jobs(const Batch& batch, const ClusterView& cluster, const float* points,
                  const MaskLayout& layout, float horizon, ClusterScratch&, JobList& jobs,
                  Counters& counters) {
    fade_cluster_jobs(batch, cluster, points, layout, horizon, nullptr, jobs, nullptr, counters);
}

void fading_cluster_jobs(const Batch& batch, const ClusterView& cluster, const float* points,
                         const MaskLayout& layout, float horizon, const Fade& fade, ClusterScratch&,
                         JobList& jobs, FadingJobs& fading, Counters& counters) {
    fade_cluster_jobs(batch, cluster, points, layout, horizon, &fade, jobs, &fading, counters);
}

void both_sides_jobs(const Batch& batch, const Batch& behind, const ClusterView& cluster, const float* points,
                     const MaskLayout& layout, float horizon, ClusterScratch& scratch, JobList& jobs,
                     Counters& counters) {
    cluster_jobs(batch, cluster, points, layout, horizon, scratch, jobs, counters);
    const uint32_t first = jobs.count;
    cluster_jobs(behind, cluster, points, layout, horizon, scratch, jobs, counters);
    for (uint32_t j = first; j < jobs.count; ++j)
        jobs.destination[j] += lanes * mask_bytes(layout);
}

// The three planes of a free triangle; `inner` tells the lanes in which it is seen from behind.
uint32_t free_entries(const MaskLayout& layout, const Vec& a, const Vec& b, const Vec& c, bool behind,
                      uint32_t lane, uint32_t entry[3][lanes]) {
    const Vec normals[3] = {cross(a, b), cross(b, c), cross(c, a)};
    for (uint32_t k = 0; k < 3; ++k) {
        const uint32_t e = plane_entry(layout, normals[k]);
        if (e & entry_invalid) return 0;
        entry[k][lane] = behind ? e ^ entry_complement(layout) : e;
    }
    return 1u << lane;
}

void triangle_jobs(const Batch& batch, const float corners[3][3][lanes], uint32_t active, uint32_t two_sided,
                   const MaskLayout& layout, float horizon, JobList& jobs, Counters& counters) {
    uint32_t entry[3][lanes], left = 0;
    Vec corner[3][lanes];
    active &= batch.valid;
    for (uint32_t lane = 0; lane < lanes; ++lane) {
        if (!(active >> lane & 1)) continue;
        for (uint32_t k = 0; k < 3; ++k)
            corner[k][lane] =
                to_local(batch, lane, {corners[k][0][lane], corners[k][1][lane], corners[k][2][lane]});
        const Vec a = corner[0][lane], b = corner[1][lane], c = corner[2][lane];
        const Vec ab = cross(a, b);
        const float volume = ab.x * c.x + ab.y * c.y + ab.z * c.z;
        const float edge = std::fabs(ab.x) + std::fabs(ab.y) + std::fabs(ab.z);
        const float reach = std::fabs(c.x) + std::fabs(c.y) + std::fabs(c.z);
        const float margin = 1e-6f * (edge * reach);
        const bool front = volume < -margin, back = (two_sided >> lane & 1) && volume > margin;
        if (!front && !back) continue;
        const Vec sum{a.x + b.x + c.x, a.y + b.y + c.y, a.z + b.z + c.z};
        if (!above_horizon(horizon_towards(horizon, sum), a, b, c)) continue;
        left |= free_entries(layout, a, b, c, back, lane, entry);
    }
    counters.triangles_considered += bit_count(active);
    counters.triangles_rasterized += bit_count(left);
    add_jobs(layout, entry, corner, left, jobs);
}

uint32_t fan_jobs(const Batch& batch, const float corners[2][3][lanes], uint32_t active,
                  const MaskLayout& layout, JobList& jobs, Counters& counters) {
    uint32_t entry[3][lanes], left = 0, folded = 0;
    Vec corner[3][lanes];
    active &= batch.valid;
    for (uint32_t lane = 0; lane < lanes; ++lane) {
        if (!(active >> lane & 1)) continue;
        const Vec a = to_local(batch, lane, {corners[0][0][lane], corners[0][1][lane], corners[0][2][lane]});
        const Vec b = to_local(batch, lane, {corners[1][0][lane], corners[1][1][lane], corners[1][2][lane]});
        corner[0][lane] = a;
        corner[1][lane] = b;
        corner[2][lane] = {0, 0, -1};
        if (!(a.z > 0 || b.z > 0)) continue;
        const float turn = a.x * b.y - a.y * b.x;
        const bool behind = turn < 0; // the arc runs clockwise
        const bool leans = !is_upright(a) && !is_upright(b);
        if (!(turn > 0 && leans)) folded |= 1u << lane;
        // -0: neighbours along the arc look up the same cell for the plane that they share, and leave no
        // crack.
        const Vec normals[3] = {cross(a, b), {-b.y, b.x, 0}, {a.y, -a.x, -0.0f}};
        bool valid = true;
        for (uint32_t k = 0; k < 3; ++k) {
            const uint32_t e = plane_entry(layout, normals[k]);
            valid = valid && !(e & entry_invalid);
            entry[k][lane] = behind ? e ^ entry_complement(layout) : e;
        }
        if (valid && leans) left |= 1u << lane;
    }
    counters.fan_triangles += bit_count(left);
    add_jobs(layout, entry, corner, left, jobs);
    return folded;
}

void run_jobs(const Tables& tables, JobList& jobs, uint8_t* masks) {
    const uint32_t bytes = part_bytes(tables.layout);
    for (uint32_t j = 0; j < jobs.count; ++j) {
        for (uint32_t i = 0; i < bytes; ++i) {
            uint32_t inside = 0xFF;
            for (uint32_t k = 0; k < 3; ++k) {
                const uint32_t entry = jobs.plane[k][j], plane = tables.planes[(entry & ~63u) + i];
                inside &= entry & 1 ? ~plane : plane;
            }
            masks[jobs.destination[j] + i] = uint8_t(masks[jobs.destination[j] + i] | inside);
        }
    }
    jobs.count = 0;
}

void downsample(const uint8_t* mask, uint32_t blocks, uint8_t* counts) {
    for (uint32_t block = 0; block < blocks; ++block)
        counts[block] = uint8_t(bit_count(mask[2 * block]) + bit_count(mask[2 * block + 1]));
}

void integrate_blocks(const Tables& tables, const uint8_t* mask, float sum[sh_columns]) {
    const uint32_t blocks = mask_blocks(tables.layout);
    uint8_t counts[256];
    downsample(mask, blocks, counts);
    const float* all = tables.block_weights + size_t(blocks) * sh_columns;
    std::memcpy(sum, all, sh_columns * sizeof(float));
    for (uint32_t block = 0; block < blocks; ++block) {
        for (uint32_t i = 0; i < sh_columns; ++i)
            sum[i] = sum[i] - float(counts[block]) * tables.block_weights[size_t(block) * sh_columns + i];
    }
}

void integrate_bits(const Tables& tables, const uint8_t* mask, float sum[sh_columns]) {
    uint16_t integer[sh_columns]; // modulo 2^16: intermediate sums may wrap, the result does not
    for (uint32_t i = 0; i < sh_columns; ++i)
        integer[i] = uint16_t(tables.total[i]);
    for (uint32_t block = 0; block < mask_blocks(tables.layout); ++block) {
        const uint32_t bits = uint32_t(mask[2 * block]) | uint32_t(mask[2 * block + 1]) << 8;
        for (uint32_t row = 0; row < 4; ++row) {
            const int16_t* weights =
                tables.nibbles + ((size_t(block) * 4 + row) * 16 + (bits >> (4 * row) & 15)) * sh_columns;
            for (uint32_t i = 0; i < sh_columns; ++i)
                integer[i] = uint16_t(integer[i] - uint16_t(weights[i]));
        }
    }
    for (uint32_t i = 0; i < sh_columns; ++i)
        sum[i] = float(int16_t(integer[i])) * tables.scale[i];
}

void integrate(const Tables& tables, const uint8_t* masks, uint32_t valid, bool per_block, uint32_t order,
               float local[25][lanes], Counters& counters) {
    const uint32_t bytes = mask_bytes(tables.layout);
    for (uint32_t lane = 0; lane < lanes; ++lane) {
        float sum[sh_columns] = {};
        if (valid >> lane & 1) {
            const uint8_t* mask = masks + size_t(lane) * bytes;
            if (per_block) {
                integrate_blocks(tables, mask, sum);
            } else {
                integrate_bits(tables, mask, sum);
            }
            for (uint32_t block = 0; block < mask_blocks(tables.layout); ++block) {
                const uint32_t bits = uint32_t(mask[2 * block]) | uint32_t(mask[2 * block + 1]) << 8;
                ++(bits == 0 || bits == 0xFFFF ? counters.blocks_uniform : counters.blocks_partial);
            }
        }
        for (uint32_t i = 0; i < order * order; ++i)
            local[i][lane] = sum[i];
    }
}

void rotate(const Batch& batch, uint32_t order, const float local[25][lanes], float out[25][lanes]) {
    for (uint32_t lane = 0; lane < lanes; ++lane) {
        float in[25] = {}, turned[25];
        for (uint32_t i = 0; i < order * order; ++i)
            in[i] = local[i][lane];
        sh_rotate_zy(Constant(), batch.axis[2][2][lane], 0.0f - batch.axis[0][2][lane],
                     batch.axis[1][1][lane], 0.0f - batch.axis[1][0][lane], in, turned);
        for (uint32_t i = 0; i < order * order; ++i)
            out[i][lane] = batch.valid >> lane & 1 ? turned[i] : 0.0f;
    }
}

void shade(const float light[75], uint32_t order, const float* transfer, size_t stride, size_t count,
           float* rgb) {
    for (size_t i = 0; i < count; ++i) {
        const float* t = reinterpret_cast<const float*>(reinterpret_cast<const char*>(transfer) + i * stride);
        float sum[3] = {};
        for (uint32_t term = 0; term < order * order; ++term) {
            for (uint32_t c = 0; c < 3; ++c)
                sum[c] = sum[c] + light[term * 3 + c] * t[term];
        }
        std::memcpy(rgb + 3 * i, sum, sizeof(sum));
    }
}

void evaluate_sh(const float* x, const float* y, const float* z, size_t count, float* out) {
    for (size_t i = 0; i < count; ++i) {
        float basis[25];
        sh_basis(Constant(), x[i], y[i], z[i], basis);
        for (uint32_t term = 0; term < 25; ++term)
            out[term * count + i] = basis[term];
    }
}

} // namespace

const Kernels reference_kernels = {
    "scalar",      prepare_batch, select_clusters, cluster_jobs,    both_sides_jobs, fading_cluster_jobs,
    triangle_jobs, fan_jobs,      select_along,    triangles_along, count_crossings, run_jobs,
    integrate,     rotate,        downsample,      shade,           evaluate_sh};

} // namespace nusselt::kernels
