#include "layout.h"

#include "objects.h"

#include <algorithm>
#include <cfloat>

namespace nusselt {

namespace {

// Small frames are cut finer, so that threads end together: of 128 pieces the last one makes two threads wait
// for less than a hundredth. Not below two batches: what nobody needs is packed away within a region.
uint32_t region_size(const Frame& frame) {
    size_t receivers = 0;
    for (const MeshSlice& s : frame.meshes)
        receivers += receives(s.in) ? s.mesh->receivers.size() : 0;
    const size_t batches = receivers / (128 * kernels::lanes);
    return static_cast<uint32_t>(std::clamp<size_t>(batches, 2, region_batches)) * kernels::lanes;
}

} // namespace

void lay_out(Frame& frame) {
    frame.point_count = frame.point_chunks = frame.cluster_count = 0;
    frame.group_count = frame.part_count = frame.triangle_bounds_count = 0;
    frame.any_closed = false;
    frame.region_count = 0;
    frame.region_size = region_size(frame);
    frame.proxies = needs_proxies(frame);
    frame.both_at_once = frame.meshes.size() > frame.mesh_count && !frame.quality.paper && !frame.proxies &&
                         !frame.has_history && !frame.fades && !frame.visible && !frame.record;
    const auto regions = [&](uint32_t receivers) {
        return (receivers + frame.region_size - 1) / frame.region_size;
    };
    uint32_t vertices = 0;
    for (MeshSlice& s : frame.meshes) {
        s.first_region = frame.region_count;
        s.first_vertex = vertices;
        const uint32_t receivers = receives(s.in) ? static_cast<uint32_t>(s.mesh->receivers.size()) : 0;
        const uint32_t duplicates = receives(s.in) ? static_cast<uint32_t>(s.mesh->duplicates.size()) : 0;
        s.first_own_region = s.first_region + regions(receivers);
        frame.region_count = s.first_own_region + regions(duplicates);
        vertices += receives(s.in) ? s.mesh->vertex_count : 0;
        if (s.is_back) continue;
        s.body = static_cast<uint32_t>(&s - frame.meshes.data());
        const uint32_t points = static_cast<uint32_t>(s.mesh->weld_source.size());
        s.clusters = s.in.receive_only     ? &frame.no_clusters
                     : frame.quality.paper ? &s.mesh->coarse_clusters
                                           : &s.mesh->clusters;
        s.first_point = frame.point_count;
        s.first_point_chunk = frame.point_chunks;
        s.first_cluster = frame.cluster_count;
        s.first_group = frame.group_count;
        s.first_part = frame.part_count;
        frame.point_count += points;
        frame.point_chunks += (points + point_chunk - 1) / point_chunk;
        frame.cluster_count += s.clusters->count();
        frame.group_count += groups_of(s.clusters->count()) + max_levels; // each level begins one
        frame.part_count += part_count(s);
        frame.any_closed |= !frame.quality.paper && !s.in.receive_only && s.mesh->closed_clusters > 0;
        for (uint32_t c = 0; c < s.clusters->count(); ++c) {
            const uint32_t triangles = s.clusters->triangle_begin[c + 1] - s.clusters->triangle_begin[c];
            frame.triangle_bounds_count += 8 * kernels::triangle_slots(triangles);
        }
    }
    uint32_t back = frame.mesh_count;
    for (uint32_t m = 0; m < frame.mesh_count; ++m) {
        MeshSlice& front = frame.meshes[m];
        front.back = receives(front.in.back) ? back : 0;
        if (front.back == 0) continue;
        MeshSlice& s = frame.meshes[back++];
        s.body = front.body;
        s.clusters = &frame.no_clusters;
        s.first_point = front.first_point;
        s.first_point_chunk = front.first_point_chunk;
        s.first_cluster = frame.cluster_count;
    }
}

void grow(Frame& frame) {
    frame.extents.resize(frame.point_chunks);
    frame.points.resize(4 * size_t(frame.point_count));
    const uint32_t drawn = frame.proxies ? 2 * frame.cluster_count : frame.cluster_count;
    for (uint32_t k = 0; k < 3; ++k) {
        frame.centre[k].resize(drawn);
        frame.cone[k].resize(drawn);
    }
    frame.radius.resize(drawn);
    frame.cone_cos.resize(drawn);
    frame.cone_sin.resize(drawn);
    frame.triangle_radius.resize(drawn);
    frame.nearest.resize(drawn);
    frame.farthest.resize(drawn);
    frame.views.resize(drawn);
    frame.cluster_mesh.resize(drawn);
    frame.level_errors.resize(frame.cluster_count);
    frame.broken.resize(frame.cluster_count);
    frame.cluster_boxes.resize(frame.cluster_count);
    frame.cluster_bounds_begin.resize(frame.cluster_count);
    frame.group_bounds.resize(frame.proxies ? 2 * frame.group_count : frame.group_count);
    frame.mesh_bounds.resize(frame.meshes.size());
    frame.closed_boxes.resize(frame.meshes.size());
    frame.part_boxes.resize(frame.part_count);
    if (frame.far_table) frame.far_views.resize(frame.mesh_count);
    for (FarView& view : frame.far_views)
        view.wanted = false;
    for (const MeshSlice& s : frame.meshes) {
        // A mesh without triangles has no middle.
        if (s.looks_far && frame.meshes[s.body].clusters->count() > 0) frame.far_views[s.body].wanted = true;
    }
    frame.level_bands.resize((frame.proxies ? 2 : 1) * frame.meshes.size());
    frame.triangle_bounds.resize(frame.triangle_bounds_count);
    const uint32_t sides = frame.both_at_once ? 2 : 1;
    const size_t job_capacity = job_flush + sides * kernels::jobs_per_cluster(frame.quality.layout) + 64;
    // What a history looks at: clusters as they were and as they are.
    const uint32_t clusters = frame.has_history ? 2 * drawn : frame.cluster_count;
    for (Worker& w : frame.crew->workers) {
        w.scratch.resize(1);
        w.masks.resize(size_t(kernels::lanes) * kernels::mask_bytes(frame.quality.layout) *
                       (frame.fades ? 1 + kernels::fade_digits : sides));
        w.jobs.resize(4 * job_capacity);
        if (frame.fades) {
            const size_t samples = size_t(kernels::lanes) * kernels::mask_bits(frame.quality.layout);
            w.parts.resize(samples, 0);
            w.touched.resize(samples / (16 * 64), 0);
            w.fading_jobs.resize(4 * job_capacity);
            w.inverse.resize(3 * job_capacity);
        }
        if (frame.quality.paper) w.near.resize(frame.point_count, 0);
        w.candidates.resize(clusters + 16);
        w.selected.resize(clusters + 16);
        w.along.resize(clusters + 16);
        w.groups.resize(frame.group_count + 16);
        w.meshes.resize(frame.meshes.size() + 16);
        w.far_meshes.resize(frame.meshes.size());
        if (frame.visible) w.visible.resize(clusters + 16);
        if (frame.record) w.masks_before.resize(w.masks.size());
        if (frame.has_history) w.points_before.resize(4 * size_t(point_chunk));
    }
}

void connect(Frame& frame) {
    uint32_t bounds = 0;
    for (uint32_t m = 0; m < frame.meshes.size(); ++m) {
        const MeshSlice& s = frame.meshes[m];
        const Clusters& k = *s.clusters;
        for (uint32_t i = 0; i < k.count(); ++i) {
            const uint32_t c = s.first_cluster + i;
            const uint32_t triangle = k.triangle_begin[i];
            frame.cluster_mesh[c] = m;
            if (frame.proxies) frame.cluster_mesh[frame.cluster_count + c] = m;
            frame.cluster_bounds_begin[c] = bounds;
            kernels::ClusterView& view = frame.views[c];
            view.vertices = k.vertices.data() + k.vertex_begin[i];
            view.edges = reinterpret_cast<const uint8_t*>(k.edges.data() + k.edge_begin[i]);
            view.triangles = reinterpret_cast<const uint8_t*>(k.triangles.data() + triangle);
            view.vertex_count = k.vertex_begin[i + 1] - k.vertex_begin[i];
            view.edge_count = k.edge_begin[i + 1] - k.edge_begin[i];
            view.triangle_count = k.triangle_begin[i + 1] - triangle;
            view.two_sided = k.two_sided[i];
            view.full = k.level[i] == 0 && !frame.quality.paper;
            view.bounds = frame.triangle_bounds.data() + bounds;
            bounds += 8 * kernels::triangle_slots(view.triangle_count);
        }
    }
    frame.cluster_bounds = {{frame.centre[0].data(), frame.centre[1].data(), frame.centre[2].data()},
                            frame.radius.data(),
                            {frame.cone[0].data(), frame.cone[1].data(), frame.cone[2].data()},
                            frame.cone_cos.data(),
                            frame.cone_sin.data(),
                            frame.nearest.data(),
                            frame.farthest.data(),
                            frame.proxies ? 2 * frame.cluster_count : frame.cluster_count};
}

} // namespace nusselt
