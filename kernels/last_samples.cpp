#include "kernels/last_samples.h"

#include "kernels/scalar.h"

#include <cstring>

namespace nusselt::kernels {

namespace {

// Below that a plane's direction has lost digits, and a sample would be decided by what is left of it.
constexpr float least_plane = 1e-30f;

// Whether d lies in all three half-spaces n.d <= 0, or n.d >= 0 where `over`.
bool holds(const Vec normal[3], const bool over[3], const float d[3]) {
    for (uint32_t k = 0; k < 3; ++k) {
        const Vec& n = normal[k];
        const float sum = std::fabs(n.x) + std::fabs(n.y) + std::fabs(n.z);
        if (!(sum > least_plane && sum <= FLT_MAX)) return false;
        const float side = n.x * d[0] + n.y * d[1] + n.z * d[2];
        if (!(over[k] ? side >= 0 : side <= 0)) return false;
    }
    return true;
}

Vec local_point(const Batch& batch, uint32_t lane, const ClusterView& cluster, const float* points,
                uint32_t corner) {
    const float* p = points + 4 * size_t(cluster.vertices[corner]);
    return to_local(batch, lane, {p[0], p[1], p[2]});
}

// As in_band, but that one corner far enough is enough of a sheet, too: of two levels that meet neither may
// be drawn there.
bool reaches(const ClusterView& cluster, uint32_t triangle, const Vec corner[3]) {
    const float farthest = triangle_reach(cluster, triangle);
    bool near = false, far = false;
    for (uint32_t k = 0; k < 3; ++k) {
        const Vec& c = corner[k];
        const float square = c.x * c.x + c.y * c.y + c.z * c.z;
        near = near || square < farthest * farthest;
        far = far || square >= cluster.nearest * cluster.nearest;
    }
    return near && far;
}

} // namespace

uint32_t find_last_samples(const MaskLayout& layout, const uint8_t* mask,
                           uint32_t bits[most_last_samples(fine_layout)]) {
    uint32_t count = 0;
    for (uint32_t w = 0; w < mask_bits(layout) / 64; ++w) {
        uint64_t open;
        std::memcpy(&open, mask + 8 * w, 8);
        for (open = ~open; open; open &= open - 1) {
            if (count == most_last_samples(layout)) return 0;
            bits[count++] = 64 * w + uint32_t(__builtin_ctzll(open));
        }
    }
    return count;
}

Sample sample_of(const MaskLayout& layout, const Batch& batch, uint32_t lane, uint32_t bit) {
    double direction[3] = {};
    sample_direction(layout, bit, direction);
    Sample sample;
    for (uint32_t k = 0; k < 3; ++k)
        sample.local[k] = float(direction[k]);
    for (uint32_t k = 0; k < 3; ++k)
        sample.direction[k] = batch.axis[0][k][lane] * sample.local[0] +
                              batch.axis[1][k][lane] * sample.local[1] +
                              batch.axis[2][k][lane] * sample.local[2];
    return sample;
}

bool hides(const Batch& batch, uint32_t lane, const ClusterView& cluster, const float* points,
           uint32_t triangle, const Sample& sample) {
    const uint32_t slots = triangle_slots(cluster.triangle_count);
    const auto bound = [&](uint32_t array) { return cluster.bounds[array * slots + triangle]; };
    const Vec middle = to_local(batch, lane, {cluster.centre[0], cluster.centre[1], cluster.centre[2]});
    const float distance = std::sqrt(middle.x * middle.x + middle.y * middle.y + middle.z * middle.z);
    // A coarse triangle that ClusterJobs leaves out for its clearance may be all that there is.
    const float margin = (cluster.full ? cluster.clearance : 0.0f) + 1e-6f * (distance + cluster.radius);
    const float height = bound(0) * batch.position[0][lane] + bound(1) * batch.position[1][lane] +
                         bound(2) * batch.position[2][lane] - bound(3);
    const bool front = height > margin, back = cluster.two_sided && height < -margin;
    if (!front && !back) return false;
    const uint8_t* const numbers = cluster.triangles + 8 * triangle;
    Vec corner[3];
    for (uint32_t k = 0; k < 3; ++k)
        corner[k] = local_point(batch, lane, cluster, points, numbers[k]);
    if (!reaches(cluster, triangle, corner)) return false;
    Vec normal[3];
    bool over[3];
    for (uint32_t k = 0; k < 3; ++k) {
        // One direction for the two triangles of an edge, and so one rounding.
        const uint8_t* const edge = cluster.edges + 2 * numbers[3 + k];
        normal[k] = cross(local_point(batch, lane, cluster, points, edge[0]),
                          local_point(batch, lane, cluster, points, edge[1]));
        over[k] = (numbers[6] >> k & 1) != uint32_t(back);
    }
    return holds(normal, over, sample.local);
}

bool hides_below(const Batch& batch, uint32_t lane, const float from[3], const float to[3],
                 const Sample& sample) {
    const Vec a = to_local(batch, lane, {from[0], from[1], from[2]});
    const Vec b = to_local(batch, lane, {to[0], to[1], to[2]});
    if (!(a.z > 0 || b.z > 0)) return false;
    const bool behind = a.x * b.y - a.y * b.x < 0;
    const Vec normal[3] = {cross(a, b), {-b.y, b.x, 0}, {a.y, -a.x, 0}};
    const bool over[3] = {behind, behind, behind};
    return holds(normal, over, sample.local);
}

} // namespace nusselt::kernels
