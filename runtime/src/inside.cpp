#include "inside.h"

#include <algorithm>
#include <cmath>
#include <cstring>

namespace nusselt {

namespace {

using namespace kernels;

constexpr uint32_t few_clusters = 2 * group_clusters; // of a part, that are looked at one by one

// The lanes whose own ray may meet a sphere.
uint32_t meeting(const Rays& rays, const float centre[3], float radius) {
    uint32_t met = 0;
    for (uint32_t lane = 0; lane < lanes; ++lane) {
        float square = 0, along = 0;
        for (uint32_t i = 0; i < 3; ++i) {
            const float d = centre[i] - rays.origin[i][lane];
            square += d * d;
            along += d * rays.direction[i];
        }
        const float reach = radius * 1.00001f + 1e-3f * std::sqrt(square);
        met |= uint32_t(along + reach >= 0 && square - along * along <= reach * reach) << lane;
    }
    return met & rays.active;
}

// The lanes whose own origin lies in the box: a receiver's answer must not depend on its batch.
uint32_t within(const MeshBox& box, const Rays& rays) {
    for (uint32_t i = 0; i < 3; ++i) {
        const float reach = 1.00001f * rays.radius + 1e-5f;
        if (rays.centre[i] + reach < box.low[i] || rays.centre[i] - reach > box.high[i]) return 0;
    }
    uint32_t held = rays.active;
    for (uint32_t lane = 0; lane < lanes; ++lane) {
        bool in = true;
        for (uint32_t i = 0; i < 3; ++i)
            in = in && rays.origin[i][lane] >= box.low[i] - 1e-6f &&
                 rays.origin[i][lane] <= box.high[i] + 1e-6f;
        held &= ~(uint32_t(!in) << lane);
    }
    return held;
}

// Of a closed part's clusters, from number `begin` of the mesh to `end`, those that the rays may meet: to
// worker.selected.
uint32_t clusters_along(const Frame& frame, const MeshSlice& slice, uint32_t begin, uint32_t end,
                        Worker& worker) {
    const Kernels& k = *frame.kernels;
    const uint32_t first = slice.first_cluster, first_group = slice.first_group;
    if (end - begin <= few_clusters)
        return k.select_along(worker.rays, frame.cluster_bounds, nullptr, first + begin, first + end,
                              worker.selected.data());
    const uint32_t groups =
        k.select_along(worker.rays, frame.group_bounds.view(0), nullptr, first_group + begin / group_clusters,
                       first_group + groups_of(end), worker.groups.data());
    uint32_t count = 0;
    for (uint32_t g = 0; g < groups; ++g) {
        const uint32_t at = (worker.groups[g] - first_group) * group_clusters;
        count += k.select_along(worker.rays, frame.cluster_bounds, nullptr, first + std::max(at, begin),
                                first + std::min(at + group_clusters, end), worker.selected.data() + count);
    }
    return count;
}

// What all closed parts wind around the rays' origins. Returns the lanes for which that is not known: their
// ray may meet a broken triangle.
uint32_t count_winding(const Frame& frame, Worker& worker, int32_t winding[lanes]) {
    const Kernels& k = *frame.kernels;
    Rays& rays = worker.rays;
    const uint32_t active = rays.active;
    uint32_t unknown = 0;
    for (uint32_t m = 0; m < frame.mesh_count; ++m) {
        const MeshSlice& slice = frame.meshes[m];
        // Closed parts wind 0 times around what lies outside of them.
        rays.active = active;
        const uint32_t held = within(frame.closed_boxes[m], rays);
        if (!held) continue;
        const float* points = frame.points.data() + 4 * size_t(slice.first_point);
        for (uint32_t part = 0; part < part_count(slice); ++part) {
            rays.active = held;
            rays.active = within(frame.part_boxes[slice.first_part + part], rays);
            if (!rays.active) continue;
            const uint32_t count = clusters_along(frame, slice, slice.mesh->closed_parts[part],
                                                  slice.mesh->closed_parts[part + 1], worker);
            for (uint32_t i = 0; i < count; ++i) {
                const uint32_t c = worker.selected[i];
                const ClusterView& view = frame.views[c];
                if (frame.broken[c]) unknown |= meeting(rays, view.centre, view.radius);
                k.count_crossings(rays, view, points, winding);
            }
        }
    }
    rays.active = active;
    return unknown;
}

void set_direction(const float direction[3], Rays& rays) {
    uint32_t least = 0;
    for (uint32_t i = 1; i < 3; ++i)
        least = std::fabs(direction[i]) < std::fabs(direction[least]) ? i : least;
    const uint32_t i = (least + 1) % 3, j = (least + 2) % 3;
    const float length = std::sqrt(direction[i] * direction[i] + direction[j] * direction[j]);
    float first[3] = {};
    first[i] = direction[j] / length;
    first[j] = -direction[i] / length;
    for (uint32_t k = 0; k < 3; ++k) {
        const uint32_t m = (k + 1) % 3, n = (k + 2) % 3;
        rays.direction[k] = direction[k];
        rays.across[0][k] = first[k];
        rays.across[1][k] = direction[m] * first[n] - direction[n] * first[m];
    }
}

bool is_set(const uint8_t* mask, uint32_t bit) {
    return mask[bit / 8] >> (bit % 8) & 1;
}

// Whether closed parts wind around the lane's receiver along a sample's direction; not where that is unknown.
bool leaves(const Frame& frame, const Batch& batch, uint32_t lane, const ObliqueSample& sample,
            Worker& worker) {
    Rays& rays = worker.rays;
    rays.active = 1u << lane;
    rays.radius = 0;
    float direction[3];
    for (uint32_t i = 0; i < 3; ++i) {
        rays.centre[i] = batch.position[i][lane];
        direction[i] = 0;
        for (uint32_t row = 0; row < 3; ++row)
            direction[i] += sample.direction[row] * batch.axis[row][i][lane];
    }
    set_direction(direction, rays);
    int32_t winding[lanes] = {};
    return count_winding(frame, worker, winding) == 0 && winding[lane] > 0;
}

bool oblique_agree(const Frame& frame, const Batch& batch, uint32_t lane, Worker& worker) {
    const MaskLayout& layout = frame.tables->layout;
    const uint8_t* mask = worker.masks.data() + size_t(lane) * mask_bytes(layout);
    uint32_t asked = 0;
    for (const ObliqueSample& sample : frame.oblique) {
        if (is_set(mask, sample.bit)) continue;
        if (asked == oblique_asked) break;
        if (!leaves(frame, batch, lane, sample, worker)) return false;
        ++asked;
    }
    return asked > 0;
}

// Whether more than one sample direction leads into what is solid. Where parts touch, single rays run along
// walls and say anything; of fans that fill by mistake at most one ray in nine leaves.
bool is_solid(const Frame& frame, const Batch& batch, uint32_t lane, Worker& worker) {
    uint32_t left = 0;
    for (const ObliqueSample& sample : frame.oblique) {
        left += leaves(frame, batch, lane, sample, worker);
        if (left > 1) return true;
    }
    return false;
}

} // namespace

void choose_oblique(const MaskLayout& layout, ObliqueSample out[oblique_samples]) {
    // Three tenths of the side from the middle, a third of a turn apart, about: elevations of 50 to 60
    // degrees.
    // The rest stand in for those that the fan hides.
    constexpr float place[oblique_samples][2] = {{0.82f, 0.53f}, {0.29f, 0.74f}, {0.37f, 0.21f},
                                                 {0.5f, 0.5f},   {0.7f, 0.8f},   {0.17f, 0.45f},
                                                 {0.68f, 0.2f},  {0.5f, 0.9f},   {0.9f, 0.75f}};
    for (uint32_t i = 0; i < oblique_samples; ++i) {
        const uint32_t x = static_cast<uint32_t>(place[i][0] * float(layout.side)),
                       y = static_cast<uint32_t>(place[i][1] * float(layout.side));
        out[i].bit = bit_of_cell(layout, x, y);
        double direction[3];
        sample_direction(layout, out[i].bit, direction);
        for (uint32_t k = 0; k < 3; ++k)
            out[i].direction[k] = static_cast<float>(direction[k]);
    }
}

uint32_t find_inside(const Frame& frame, const Batch& batch, uint32_t full, Worker& worker) {
    if (!frame.any_closed || !batch.valid) return 0;
    uint32_t members[6] = {}; // lanes whose normals lie nearest to each axis and its opposite
    for (uint32_t lane = 0; lane < lanes; ++lane) {
        if (!((batch.valid & ~full) >> lane & 1)) continue;
        const auto size = [&](uint32_t i) { return std::fabs(batch.axis[2][i][lane]); };
        const uint32_t axis = size(0) >= size(1) && size(0) >= size(2) ? 0 : size(1) >= size(2) ? 1 : 2;
        members[2 * axis + (batch.axis[2][axis][lane] < 0)] |= 1u << lane;
    }
    Rays& rays = worker.rays;
    std::memcpy(rays.origin, batch.position, sizeof(rays.origin));
    int32_t winding[lanes] = {};
    uint32_t unknown = 0;
    for (uint32_t side = 0; side < 6; ++side) {
        if (!members[side]) continue;
        float direction[3] = {};
        direction[side / 2] = side % 2 ? -1.0f : 1.0f;
        set_direction(direction, rays);
        std::memcpy(rays.centre, batch.bounds.centre, sizeof(rays.centre));
        rays.radius = batch.bounds.radius;
        rays.active = members[side];
        unknown |= count_winding(frame, worker, winding);
    }
    uint32_t inside = 0;
    for (uint32_t lane = 0; lane < lanes; ++lane) {
        if (!((batch.valid & ~unknown) >> lane & 1)) continue;
        const bool is_inside = full >> lane & 1
                                   ? is_solid(frame, batch, lane, worker)
                                   : winding[lane] > 0 && oblique_agree(frame, batch, lane, worker);
        inside |= uint32_t(is_inside) << lane;
    }
    return inside;
}

} // namespace nusselt
