#include "objects.h"

#include "refit.h"

#include <algorithm>
#include <cfloat>
#include <cmath>

namespace nusselt {

namespace {

using namespace kernels;

constexpr uint32_t few_parts = 64;
constexpr uint32_t few_clusters = 4 * group_clusters; // of a level, that are looked at one by one

void add_box(const MeshBox& box, MeshBox& all) {
    for (uint32_t k = 0; k < 3; ++k) {
        all.low[k] = std::min(all.low[k], box.low[k]);
        all.high[k] = std::max(all.high[k], box.high[k]);
    }
}

// A box around spheres.
MeshBox box_spheres(const Frame& frame, uint32_t begin, uint32_t end) {
    MeshBox box = no_box;
    for (uint32_t c = begin; c < end; ++c) {
        for (uint32_t k = 0; k < 3; ++k) {
            box.low[k] = std::min(box.low[k], frame.centre[k].data()[c] - frame.radius.data()[c]);
            box.high[k] = std::max(box.high[k], frame.centre[k].data()[c] + frame.radius.data()[c]);
        }
    }
    return box;
}

// What of the mesh can hold a receiver: its closed parts. Where a triangle of a part is broken a ray that
// meets it tells nothing, wherever it starts.
void box_closed(Frame& frame, uint32_t m) {
    const MeshSlice& slice = frame.meshes[m];
    MeshBox& all = frame.closed_boxes[m] = no_box;
    if (slice.in.receive_only || frame.quality.paper) return;
    const uint8_t* const broken = frame.broken.data() + slice.first_cluster;
    for (uint32_t i = 0; i < part_count(slice); ++i) {
        const uint32_t begin = slice.mesh->closed_parts[i], end = slice.mesh->closed_parts[i + 1];
        MeshBox& box = frame.part_boxes[slice.first_part + i] = no_box;
        for (uint32_t c = begin; c < end; ++c)
            add_box(broken[c] ? every_box : frame.cluster_boxes[slice.first_cluster + c], box);
        add_box(box, all);
    }
}

// A sphere around spheres, from the middle of their box: entry `to` of `out`.
void bound_sphere(const Frame& frame, uint32_t begin, uint32_t end, ClusterBoundsArrays& out, uint32_t to) {
    const MeshBox box = box_spheres(frame, begin, end);
    float centre[3], radius = 0;
    for (uint32_t k = 0; k < 3; ++k) {
        centre[k] = begin < end ? 0.5f * box.low[k] + 0.5f * box.high[k] : 0.0f;
        out.centre[k].data()[to] = centre[k];
    }
    for (uint32_t c = begin; c < end; ++c) {
        float square = 0;
        for (uint32_t k = 0; k < 3; ++k) {
            const float d = frame.centre[k].data()[c] - centre[k];
            square += d * d;
        }
        radius = std::max(radius, std::sqrt(square) + frame.radius.data()[c]);
    }
    out.radius.data()[to] = radius * 1.00001f;
}

// The levels from cluster `first` and group `first_group` on, with what their clusters' bands have in common.
void band_levels(const Frame& frame, const Clusters& clusters, uint32_t first, uint32_t first_group,
                 LevelBands& out) {
    out.count = 0;
    for (uint32_t c = 0; c < clusters.count(); ++c) {
        if (c == 0 || clusters.level[c] != clusters.level[c - 1]) {
            if (out.count > 0) {
                const LevelBands::Level& before = out.levels[out.count - 1];
                first_group = before.first_group + groups_of(before.end - before.begin);
            }
            out.levels[out.count++] = {first + c, first + c, FLT_MAX, 0, first_group};
        }
        LevelBands::Level& level = out.levels[out.count - 1];
        ++level.end;
        level.nearest = std::min(level.nearest, frame.nearest.data()[first + c]);
        level.farthest = std::max(level.farthest, frame.farthest.data()[first + c]);
    }
}

// Spheres around the groups of each level, in the level's band.
void bound_groups(Frame& frame, const LevelBands& bands) {
    ClusterBoundsArrays& groups = frame.group_bounds;
    for (uint32_t l = 0; l < bands.count; ++l) {
        const LevelBands::Level& level = bands.levels[l];
        for (uint32_t begin = level.begin, g = level.first_group; begin < level.end;
             begin += group_clusters, ++g) {
            bound_sphere(frame, begin, std::min(begin + group_clusters, level.end), groups, g);
            groups.cone_cos.data()[g] = -1;
            groups.nearest.data()[g] = level.nearest;
            groups.farthest.data()[g] = level.farthest;
        }
    }
}

// The clusters of mesh m once more, for receivers of other objects.
void copy_proxies(Frame& frame, uint32_t m) {
    const MeshSlice& slice = frame.meshes[m];
    const uint32_t count = slice.clusters->count(), from = slice.first_cluster,
                   to = frame.cluster_count + slice.first_cluster;
    for (FloatArray* array :
         {&frame.centre[0], &frame.centre[1], &frame.centre[2], &frame.radius, &frame.cone[0], &frame.cone[1],
          &frame.cone[2], &frame.cone_cos, &frame.cone_sin, &frame.triangle_radius})
        std::copy_n(array->data() + from, count, array->data() + to);
    choose_proxy_bands(frame, slice, frame.nearest.data() + to, frame.farthest.data() + to);
    for (uint32_t c = 0; c < count; ++c) {
        frame.views[to + c] = frame.views[from + c];
        frame.views[to + c].nearest = frame.nearest.data()[to + c];
        float& farthest = frame.farthest.data()[to + c];
        frame.views[to + c].farthest = farthest;
        farthest = std::max(farthest, 2 * frame.triangle_radius.data()[to + c]);
        if (frame.fades) farthest = std::min(farthest, frame.fade.to);
    }
}

// The bounds of the clusters from `first` on.
ClusterBounds from_cluster(const ClusterBounds& all, uint32_t first, uint32_t count) {
    return {{all.centre[0] + first, all.centre[1] + first, all.centre[2] + first},
            all.radius + first,
            {all.cone[0] + first, all.cone[1] + first, all.cone[2] + first},
            all.cone_cos + first,
            all.cone_sin + first,
            all.nearest + first,
            all.farthest + first,
            count};
}

// How far the middles of two spheres lie apart, and how near they may come to one another beside.
struct Apart {
    float distance, reach;
};
Apart apart(const float* const centre[3], const float* radius, uint32_t at, const ReceiverBounds& receivers) {
    float square = 0;
    for (uint32_t axis = 0; axis < 3; ++axis) {
        const float d = centre[axis][at] - receivers.centre[axis];
        square += d * d;
    }
    // As select_clusters bounds a cluster, and a little more.
    const float distance = std::sqrt(square);
    return {distance, 1.0001f * (radius[at] + receivers.radius) + 1e-5f * distance};
}

Apart apart_from_mesh(const Frame& frame, uint32_t m, const ReceiverBounds& receivers) {
    const ClusterBounds bounds = frame.mesh_bounds.view(0);
    return apart(bounds.centre, bounds.radius, m, receivers);
}

// Of clusters begin to end those that can reach the receivers.
uint32_t select_run(const Frame& frame, uint32_t begin, uint32_t end, const ReceiverBounds& receivers,
                    uint32_t* selected, uint64_t& tested) {
    const ClusterBounds bounds = from_cluster(frame.cluster_bounds, begin, end - begin);
    const uint32_t count = frame.kernels->select_clusters(receivers, bounds, nullptr, bounds.count,
                                                          frame.tables->horizon, selected, &tested);
    for (uint32_t i = 0; i < count; ++i)
        selected[i] += begin;
    return count;
}

// The clusters of a mesh's levels, in their bands, that can reach the receivers.
uint32_t select_levels(const Frame& frame, uint32_t m, const LevelBands& bands,
                       const ReceiverBounds& receivers, uint32_t* selected, Worker& worker) {
    const Apart mesh = apart_from_mesh(frame, m, receivers);
    const ClusterBounds all_groups = frame.group_bounds.view(0);
    uint32_t count = 0;
    for (uint32_t l = 0; l < bands.count; ++l) {
        const LevelBands::Level& level = bands.levels[l];
        if (mesh.distance - mesh.reach >= level.farthest || mesh.distance + mesh.reach < level.nearest)
            continue;
        if (level.end - level.begin <= few_clusters) {
            count += select_run(frame, level.begin, level.end, receivers, selected + count,
                                worker.tally.clusters_tested);
            continue;
        }
        uint64_t looked_at = 0;
        const ClusterBounds own =
            from_cluster(all_groups, level.first_group, groups_of(level.end - level.begin));
        const uint32_t found = frame.kernels->select_clusters(
            receivers, own, nullptr, own.count, frame.tables->horizon, worker.groups.data(), &looked_at);
        for (uint32_t i = 0; i < found; ++i) {
            const uint32_t begin = level.begin + worker.groups[i] * group_clusters;
            count += select_run(frame, begin, std::min(begin + group_clusters, level.end), receivers,
                                selected + count, worker.tally.clusters_tested);
        }
    }
    return count;
}

// Too small, from there, to matter.
bool is_small(const Frame& frame, uint32_t m, const ReceiverBounds& receivers) {
    const Apart mesh = apart_from_mesh(frame, m, receivers);
    return frame.mesh_bounds.radius.data()[m] < frame.quality.proxy_least * (mesh.distance - mesh.reach);
}

// So far that all receivers of a mesh see it where the mesh's middle does.
bool is_farther(const Frame& frame, uint32_t m, const ReceiverBounds& receivers) {
    const Apart mesh = apart_from_mesh(frame, m, receivers);
    return mesh.distance - mesh.reach >= frame.quality.farther_gap * receivers.radius;
}

// The same of a region's receivers: no part is nearer to one of them than quality.far_gap times the radius of
// all.
bool is_far(const Frame& frame, uint32_t m, const ReceiverBounds& receivers) {
    const float gap = frame.quality.far_gap * receivers.radius;
    const Apart mesh = apart_from_mesh(frame, m, receivers);
    if (mesh.distance - mesh.reach >= gap) return true;
    // The sphere around a body is mostly empty: its parts, at the first level that has few.
    const LevelBands& bands = frame.level_bands[m];
    uint32_t l = 0;
    while (l + 1 < bands.count && bands.levels[l].end - bands.levels[l].begin > few_parts)
        ++l;
    const ClusterBounds& all = frame.cluster_bounds;
    for (uint32_t c = bands.levels[l].begin; c < bands.levels[l].end; ++c) {
        const Apart part = apart(all.centre, all.radius, c, receivers);
        if (part.distance - part.reach < gap) return false;
    }
    return true;
}

} // namespace

bool needs_proxies(const Frame& frame) {
    if (frame.quality.paper) return false;
    const auto other = [&](const MeshSlice& s) { return s.in.object != frame.meshes[0].in.object; };
    return std::any_of(frame.meshes.begin(), frame.meshes.end(), other);
}

void bound_mesh(Frame& frame, uint32_t m) {
    const MeshSlice& slice = frame.meshes[m];
    const uint32_t first = slice.first_cluster, count = slice.clusters->count();
    bound_sphere(frame, first, first + count, frame.mesh_bounds, m);
    box_closed(frame, m);
    frame.mesh_bounds.cone_cos.data()[m] = -1;
    frame.mesh_bounds.farthest.data()[m] = frame.fades ? frame.fade.to : FLT_MAX;
    LevelBands& own = frame.level_bands[m];
    band_levels(frame, *slice.clusters, first, slice.first_group, own);
    bound_groups(frame, own);
    if (!frame.proxies) return;
    copy_proxies(frame, m);
    LevelBands& proxy = frame.level_bands[frame.mesh_count + m];
    band_levels(frame, *slice.clusters, frame.cluster_count + first, frame.group_count + slice.first_group,
                proxy);
    bound_groups(frame, proxy);
}

kernels::ReceiverBounds middle_of(const Frame& frame, uint32_t m) {
    const ClusterBounds bounds = frame.mesh_bounds.view(0);
    return {{bounds.centre[0][m], bounds.centre[1][m], bounds.centre[2][m]}, bounds.radius[m], {}, -1, 0};
}

uint32_t list_farther(const Frame& frame, uint32_t m, uint32_t* meshes) {
    const ReceiverBounds receivers = middle_of(frame, m);
    uint32_t count = 0;
    for (uint32_t other = 0; other < frame.mesh_count; ++other) {
        if (frame.meshes[other].in.object == frame.meshes[m].in.object) continue;
        if (is_farther(frame, other, receivers) && !is_small(frame, other, receivers))
            meshes[count++] = other;
    }
    return count;
}

uint32_t select_proxies(const Frame& frame, uint32_t m, const ReceiverBounds& receivers, uint32_t* selected,
                        Worker& worker) {
    return select_levels(frame, m, frame.level_bands[frame.mesh_count + m], receivers, selected, worker);
}

uint32_t select_candidates(const Frame& frame, const MeshSlice& slice, const ReceiverBounds& receivers,
                           const ReceiverBounds& home, Worker& worker) {
    const Kernels& k = *frame.kernels;
    const uint32_t meshes = frame.mesh_count;
    uint64_t tested = 0;
    const uint32_t seen = k.select_clusters(home, frame.mesh_bounds.view(meshes), nullptr, meshes,
                                            frame.tables->horizon, worker.meshes.data(), &tested);
    const ReceiverBounds own = middle_of(frame, slice.body);
    // A receiver that is no corner of a triangle may be anywhere, and must not see from the mesh's middle.
    const bool is_at_mesh =
        apart_from_mesh(frame, slice.body, home).distance <= own.radius && home.radius <= 1.25f * own.radius;
    worker.has_far_view = slice.looks_far && frame.far_views[slice.body].wanted && is_at_mesh;
    uint32_t count = 0;
    for (uint32_t i = 0; i < seen; ++i) {
        const uint32_t m = worker.meshes[i];
        uint32_t* const out = worker.candidates.data() + count;
        if (!frame.proxies || frame.meshes[m].in.object == slice.in.object) {
            count += select_levels(frame, m, frame.level_bands[m], receivers, out, worker);
        } else if (worker.has_far_view && is_farther(frame, m, own)) {
            continue; // look_farther
        } else if (!frame.has_history && is_small(frame, m, home)) {
            // With a history it would come and go as receivers move that others are kept beside.
            continue;
        } else if (slice.looks_far && is_far(frame, m, home)) {
            worker.far_meshes[worker.far_count++] = m;
        } else {
            count += select_proxies(frame, m, receivers, out, worker);
        }
    }
    return count;
}

} // namespace nusselt
