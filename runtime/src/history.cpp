#include "history.h"

#include "batches.h"
#include "kernels/prepare.h"
#include "refit.h"
#include "regions.h"
#include "weld.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>

namespace nusselt {

namespace {

using namespace kernels;

Frame& frame_of(void* context) {
    return *static_cast<Frame*>(context);
}

// Some vertex of the mesh; also where nothing is known of the last pose.
bool has_moved(const Frame& frame, const MeshSlice& slice) {
    if (frame.history.same_pose) return false;
    const uint32_t points = static_cast<uint32_t>(slice.mesh->weld_source.size());
    const uint8_t* chunks = frame.history.chunk_moved.data() + slice.first_point_chunk;
    return std::any_of(chunks, chunks + (points + point_chunk - 1) / point_chunk,
                       [](uint8_t moved) { return moved != 0; });
}

// Some vertex that the cluster's bounds, or its distance from the surface that it stands for, are made from.
bool is_touched(const Frame& frame, const MeshSlice& slice, uint32_t cluster) {
    const Clusters& clusters = *slice.clusters;
    const float* moved = frame.history.moved.data() + slice.first_point;
    const auto any = [&](const Vector<uint32_t>& vertices, size_t begin, size_t end) {
        return std::any_of(vertices.data() + begin, vertices.data() + end,
                           [&](uint32_t v) { return moved[v] > 0; });
    };
    if (any(clusters.vertices, clusters.vertex_begin[cluster], clusters.vertex_begin[cluster + 1]))
        return true;
    if (frame.quality.paper) return false;
    const LevelSamples& samples = slice.mesh->samples;
    const size_t begin = samples.cluster_begin[cluster], end = samples.cluster_begin[cluster + 1];
    if (any(samples.vertex, begin, end) || any(samples.corner, 3 * begin, 3 * end)) return true;
    const uint32_t beside = samples.bridges[cluster].vertex; // the bridge's corners are the cluster's
    return beside != none && moved[beside] > 0;
}

void copy_bounds(const Frame& frame, uint32_t c, ClusterBoundsArrays& to, uint32_t at) {
    for (uint32_t k = 0; k < 3; ++k) {
        to.centre[k].data()[at] = frame.centre[k].data()[c];
        to.cone[k].data()[at] = frame.cone[k].data()[c];
    }
    to.radius.data()[at] = frame.radius.data()[c];
    to.cone_cos.data()[at] = frame.cone_cos.data()[c];
    to.cone_sin.data()[at] = frame.cone_sin.data()[c];
    to.nearest.data()[at] = frame.nearest.data()[c];
    to.farthest.data()[at] = frame.farthest.data()[c];
}

void copy_bounds(const ClusterBoundsArrays& from, uint32_t c, ClusterBoundsArrays& to, uint32_t at) {
    for (uint32_t k = 0; k < 3; ++k) {
        to.centre[k].data()[at] = from.centre[k].data()[c];
        to.cone[k].data()[at] = from.cone[k].data()[c];
    }
    to.radius.data()[at] = from.radius.data()[c];
    to.cone_cos.data()[at] = from.cone_cos.data()[c];
    to.cone_sin.data()[at] = from.cone_sin.data()[c];
    to.nearest.data()[at] = from.nearest.data()[c];
    to.farthest.data()[at] = from.farthest.data()[c];
}

// How far the centre of a cluster moved.
float motion_of(const Frame& frame, uint32_t c) {
    float square = 0;
    for (uint32_t k = 0; k < 3; ++k) {
        const float d = frame.centre[k].data()[c] - frame.history.before.centre[k].data()[c];
        square += d * d;
    }
    return std::sqrt(square);
}

// A cluster that stayed where it was, but now stands for its surface from another distance on: it matters to
// those in whose sight it is in the shell between the two distances.
void add_shell(const Frame& frame, uint32_t c, float one, float other, History& history) {
    if (one == other) return;
    const uint32_t at = history.disturbed_count++;
    copy_bounds(frame, c, history.disturbed, at);
    history.disturbed.nearest.data()[at] = std::min(one, other);
    history.disturbed.farthest.data()[at] = std::max(one, other);
    history.disturbed_by[at] = 0;
}

// Cluster c of a mesh that moved, as it is `drawn`: for its own object, or as a proxy.
void disturb(Frame& frame, const MeshSlice& slice, uint32_t c, uint32_t drawn) {
    History& h = frame.history;
    if (!h.touched[c] && h.clearance_before[c] == frame.views[c].clearance) {
        add_shell(frame, drawn, h.before.nearest.data()[drawn], frame.nearest.data()[drawn], h);
        add_shell(frame, drawn, h.before.farthest.data()[drawn], frame.farthest.data()[drawn], h);
        return;
    }
    const float motion = motion_of(frame, c);
    for (uint32_t i = 0; i < 2; ++i)
        h.disturbed_by[h.disturbed_count + i] = motion <= FLT_MAX ? motion : FLT_MAX;
    copy_bounds(h.before, drawn, h.disturbed, h.disturbed_count++);
    copy_bounds(frame, drawn, h.disturbed, h.disturbed_count++);
    // Rays that look for receivers inside closed parts leave through back faces, at any distance. They stay
    // well above the receiver's horizon.
    const bool closed = c - slice.first_cluster < slice.mesh->closed_clusters;
    for (uint32_t i = 1; closed && frame.any_closed && i <= 2; ++i) {
        const uint32_t last = h.disturbed_count - i;
        h.disturbed.cone_cos.data()[last] = -1;
        h.disturbed.nearest.data()[last] = 0;
        h.disturbed.farthest.data()[last] = FLT_MAX;
    }
}

} // namespace

void ClusterBoundsArrays::resize(size_t count) {
    for (FloatArray* array : {&centre[0], &centre[1], &centre[2], &radius, &cone[0], &cone[1], &cone[2],
                              &cone_cos, &cone_sin, &nearest, &farthest})
        array->resize(count);
}

kernels::ClusterBounds ClusterBoundsArrays::view(uint32_t count) const {
    return {{centre[0].data(), centre[1].data(), centre[2].data()},
            radius.data(),
            {cone[0].data(), cone[1].data(), cone[2].data()},
            cone_cos.data(),
            cone_sin.data(),
            nearest.data(),
            farthest.data(),
            count};
}

bool is_same_group(const Frame& frame, const FrameDesc& desc) {
    const History& h = frame.history;
    if (h.quality != desc.quality || h.order != desc.order || h.watertight != desc.watertight ||
        h.members.size() != desc.mesh_count)
        return false;
    for (uint32_t i = 0; i < desc.mesh_count; ++i) {
        const FrameMesh& m = desc.meshes[i];
        const GroupMember& known = h.members[i];
        if (known.mesh.slot != m.mesh.slot || known.mesh.generation != m.mesh.generation ||
            known.receives != receives(m) || known.masks != (m.masks.data != nullptr) ||
            known.back_receives != receives(m.back) || known.back_masks != (m.back.masks.data != nullptr) ||
            known.object != m.object)
            return false;
    }
    return true;
}

void compare_group(Frame& frame, const FrameDesc& desc) {
    History& h = frame.history;
    h.same_group = is_same_group(frame, desc);
    if (h.same_group) return;
    h.members.clear();
    h.pose_whole = false;
}

void meet_history(Frame& frame, const FrameDesc& desc) {
    History& h = frame.history;
    h.same_pose = desc.same_pose;
    if (h.same_group) return;
    uint32_t vertices = 0;
    bool masks = false;
    for (const MeshSlice& s : frame.meshes) {
        if (!receives(s.in)) continue;
        vertices = s.first_vertex + s.mesh->vertex_count;
        masks = masks || s.in.masks.data;
    }
    const size_t batches = size_t(frame.region_count) * region_batches;
    h.moved.resize(frame.point_count);
    h.chunk_moved.resize(frame.point_chunks);
    h.touched.resize(frame.cluster_count);
    h.normals.resize(3 * size_t(vertices));
    h.transfer.resize(size_t(desc.order) * desc.order * vertices);
    h.masks.resize(masks ? size_t(vertices) * mask_bytes(frame.quality.layout) : 0);
    h.wanted.assign(batches, 0);
    h.current.assign(batches, 0);
    h.known.assign(batches, 0);
    h.fresh.assign(batches, 0);
    h.stale_frames.assign(batches, 0);
    h.change.assign(batches, 0);
    h.turns.resize(batches);
    h.invalid_triangles.resize(frame.cluster_count);
    h.level_errors.resize(frame.cluster_count);
    h.clearance_before.resize(frame.cluster_count);
    h.before.resize(frame.views.size());
    h.disturbed.resize(2 * frame.views.size());
    h.disturbed_by.resize(2 * frame.views.size());
    h.members.reserve(desc.mesh_count);
    for (uint32_t i = 0; i < desc.mesh_count; ++i) {
        const FrameMesh& m = desc.meshes[i];
        h.members.push_back({m.mesh, receives(m), m.masks.data != nullptr, receives(m.back),
                             m.back.masks.data != nullptr, m.object});
    }
    h.quality = desc.quality;
    h.order = desc.order;
    h.watertight = desc.watertight;
}

void start_clock(void* context, uint32_t, uint32_t, uint32_t) {
    Frame& frame = frame_of(context);
    frame.deadline_ns = clock_nanoseconds(frame) + frame.budget_ns;
    frame.is_spent.store(false, std::memory_order_relaxed);
}

void place_and_compare(void* context, uint32_t begin, uint32_t end, uint32_t slot) {
    Frame& frame = frame_of(context);
    History& h = frame.history;
    float* const before = frame.workers[slot].points_before.data();
    for (uint32_t chunk = begin; chunk < end; ++chunk) {
        const MeshSlice& slice = slice_of(bodies(frame), &MeshSlice::first_point_chunk, chunk);
        const uint32_t first = slice.first_point + (chunk - slice.first_point_chunk) * point_chunk;
        const uint32_t last = std::min(
            first + point_chunk, slice.first_point + static_cast<uint32_t>(slice.mesh->weld_source.size()));
        const float* const points = frame.points.data() + 4 * size_t(first);
        std::copy_n(points, 4 * size_t(last - first), before);
        place_points(context, chunk, chunk + 1, slot);
        bool any = !h.pose_whole;
        for (uint32_t i = 0; i < last - first; ++i) {
            const float *p = points + 4 * size_t(i), *q = before + 4 * size_t(i);
            const float x = p[0] - q[0], y = p[1] - q[1], z = p[2] - q[2];
            const float distance = std::sqrt(x * x + y * y + z * z);
            const bool moved = !h.pose_whole || std::memcmp(p, q, 12) != 0;
            h.moved[first + i] = moved ? (distance <= FLT_MAX ? std::max(distance, FLT_MIN) : FLT_MAX) : 0;
            any = any || moved;
        }
        h.chunk_moved[chunk] = any;
    }
}

void refit_moved_clusters(void* context, uint32_t begin, uint32_t end, uint32_t slot) {
    Frame& frame = frame_of(context);
    History& h = frame.history;
    Tally& tally = frame.workers[slot].tally;
    for (uint32_t c = begin; c < end; ++c) {
        const MeshSlice& slice = frame.meshes[frame.cluster_mesh[c]];
        copy_bounds(frame, c, h.before, c);
        if (frame.proxies) copy_bounds(frame, frame.cluster_count + c, h.before, frame.cluster_count + c);
        h.clearance_before[c] = frame.views[c].clearance;
        h.touched[c] = !h.pose_whole || is_touched(frame, slice, c - slice.first_cluster);
        if (!h.touched[c]) {
            tally.triangles_invalid += h.invalid_triangles[c];
            ++tally.clusters_kept;
            continue;
        }
        const uint32_t invalid = tally.triangles_invalid;
        refit_clusters(context, c, c + 1, slot);
        h.invalid_triangles[c] = tally.triangles_invalid - invalid;
        h.level_errors[c] = frame.level_errors[c];
    }
}

void choose_moved_bands(void* context, uint32_t begin, uint32_t end, uint32_t slot) {
    Frame& frame = frame_of(context);
    History& h = frame.history;
    for (uint32_t m = begin; m < end; ++m) {
        const MeshSlice& slice = frame.meshes[m];
        if (!has_moved(frame, slice)) continue;
        const uint32_t first = slice.first_cluster, count = slice.clusters->count();
        // As measured: the bands gather them over the levels in place.
        std::copy_n(h.level_errors.data() + first, count, frame.level_errors.data() + first);
        choose_bands(context, m, m + 1, slot);
    }
}

void gather_disturbed(void* context, uint32_t, uint32_t, uint32_t) {
    Frame& frame = frame_of(context);
    History& h = frame.history;
    h.disturbed_count = 0;
    if (!h.pose_whole) return; // everything is computed
    for (const MeshSlice& slice : bodies(frame)) {
        if (!has_moved(frame, slice)) continue;
        for (uint32_t c = slice.first_cluster; c < slice.first_cluster + slice.clusters->count(); ++c) {
            disturb(frame, slice, c, c);
            if (frame.proxies) disturb(frame, slice, c, frame.cluster_count + c);
        }
    }
}

namespace {

// How far, in frame space, the nearest thing moved that a receiver's fan is made of, or the receiver itself.
float motion_around(const History& h, const MeshSlice& slice, uint32_t vertex) {
    const MeshData& mesh = *slice.mesh;
    const float* moved = h.moved.data() + slice.first_point;
    const uint32_t w = mesh.weld[vertex];
    float most = moved[w];
    for (uint32_t k = 2 * mesh.fan_begin[w]; k < 2 * mesh.fan_begin[w + 1]; ++k)
        most = std::max(most, moved[mesh.fan[k]]);
    return most;
}

// Takes over a normal; returns how far it turned, radians for small turns.
float take_normal(History& h, const MeshSlice& slice, uint32_t vertex) {
    const float* now = element(slice.in.normals, vertex);
    float* before = h.normals.data() + 3 * (size_t(slice.first_vertex) + vertex);
    if (std::memcmp(now, before, 12) == 0) return 0;
    const float x = now[0] - before[0], y = now[1] - before[1], z = now[2] - before[2];
    std::copy_n(now, 3, before);
    const float turn = std::sqrt(x * x + y * y + z * z);
    return turn <= FLT_MAX ? std::max(turn, FLT_MIN) : FLT_MAX;
}

// Clears the current bits of what moved itself; returns by how much the batch changed.
float notice_motion(History& h, const Region& region, uint32_t first, uint32_t batch, bool mesh_moved) {
    const uint32_t end = std::min(first + lanes, region.count);
    uint32_t changed = 0;
    float most = 0;
    for (uint32_t i = first; i < end; ++i) {
        const float turn = take_normal(h, region.slice, region.vertices[i]);
        const float motion = mesh_moved ? motion_around(h, region.slice, region.vertices[i]) : 0;
        if (turn == 0 && motion == 0) continue;
        changed |= 1u << (i - first);
        most = std::max(most, std::max(turn, motion));
    }
    h.current[batch] &= static_cast<uint16_t>(~changed);
    return most;
}

// Batches of a region that did not move themselves, and what of the disturbed clusters they can see.
void notice_disturbed(Frame& frame, const Region& region, uint32_t first_batch, Worker& worker) {
    History& h = frame.history;
    const Kernels& k = *frame.kernels;
    const kernels::ClusterBounds disturbed = h.disturbed.view(h.disturbed_count);
    ReceiverBounds bounds[region_batches];
    uint32_t open[region_batches], count = 0;
    for (uint32_t b = 0; b * lanes < region.count; ++b) {
        // What isn't wanted now isn't looked at, and so not known to be current either.
        h.current[first_batch + b] &= h.wanted[first_batch + b];
        uint32_t receivers[lanes], kept = 0;
        for (uint32_t bits = h.current[first_batch + b]; bits; bits &= bits - 1)
            receivers[kept++] = region.vertices[b * lanes + static_cast<uint32_t>(std::countr_zero(bits))];
        if (kept == 0) continue;
        load_batch(frame, region.slice, receivers, kept, worker.batches[b], worker);
        if (!worker.batches[b].valid) continue; // nothing blocks a receiver that is none
        bounds[count] = worker.batches[b].bounds;
        open[count++] = b;
    }
    if (count == 0) return;
    uint64_t tested = 0;
    const uint32_t candidates = k.select_clusters(unite(bounds, count), disturbed, nullptr, h.disturbed_count,
                                                  frame.tables->horizon, worker.candidates.data(), &tested);
    for (uint32_t i = 0; candidates > 0 && i < count; ++i) {
        const uint32_t seen = k.select_clusters(bounds[i], disturbed, worker.candidates.data(), candidates,
                                                frame.tables->horizon, worker.selected.data(), &tested);
        if (seen == 0) continue;
        h.current[first_batch + open[i]] = 0;
        float most = 0; // as an angle
        for (uint32_t j = 0; j < seen; ++j) {
            const uint32_t c = worker.selected[j];
            float square = 0;
            for (uint32_t axis = 0; axis < 3; ++axis) {
                const float d = disturbed.centre[axis][c] - bounds[i].centre[axis];
                square += d * d;
            }
            const float away = std::max(std::sqrt(square), disturbed.radius[c]);
            most = std::max(most, away > 0 ? h.disturbed_by[c] / away : 0.0f);
        }
        h.change[first_batch + open[i]] += std::min(most, 4.0f);
    }
    worker.tally.clusters_tested += tested;
}

} // namespace

void find_changes(void* context, uint32_t begin, uint32_t end, uint32_t slot) {
    Frame& frame = frame_of(context);
    History& h = frame.history;
    Worker& worker = frame.workers[slot];
    StageClock clock(worker.tally);
    const bool any_moved =
        !h.pose_whole || std::any_of(frame.meshes.begin(), frame.meshes.end(),
                                     [&](const MeshSlice& s) { return has_moved(frame, s); });
    for (uint32_t number = begin; number < end; ++number) {
        const Region region = region_of(frame, number);
        const bool mesh_moved = has_moved(frame, region.slice);
        const uint32_t first_batch = number * region_batches;
        for (uint32_t b = 0; b * lanes < region.count; ++b) {
            const uint32_t batch = first_batch + b, first = b * lanes;
            uint32_t wanted = 0;
            for (uint32_t i = first; i < std::min(first + lanes, region.count); ++i)
                wanted |= uint32_t(is_wanted(region, i)) << (i - first);
            h.wanted[batch] = static_cast<uint16_t>(wanted);
            h.fresh[batch] = 0;
            if (!h.same_group) h.known[batch] = 0;
            if (!h.same_pose) h.change[batch] += notice_motion(h, region, first, batch, mesh_moved);
            // The quality `paper` looks at triangles beyond the clusters.
            if (!h.pose_whole || (frame.quality.paper && any_moved)) h.current[batch] = 0;
        }
        if (h.disturbed_count > 0) notice_disturbed(frame, region, first_batch, worker);
    }
    clock.lap(cull_stage);
}

void order_turns(void* context, uint32_t, uint32_t, uint32_t) {
    Frame& frame = frame_of(context);
    History& h = frame.history;
    h.turn_count = 0;
    for (uint32_t region = 0; region < frame.region_count; ++region) {
        const uint32_t first = h.turn_count;
        for (uint32_t b = 0; b < region_batches; ++b) {
            const uint32_t batch = region * region_batches + b;
            const uint32_t todo = h.wanted[batch] & ~uint32_t(h.current[batch]);
            if (!todo) continue;
            // Those that never had a result wait longest.
            const uint32_t stale = todo & ~uint32_t(h.known[batch]) ? UINT32_MAX : h.stale_frames[batch];
            const auto equal = std::find_if(&h.turns[first], h.turns.data() + h.turn_count,
                                            [&](const History::Turn& t) { return t.stale_frames == stale; });
            if (equal == h.turns.data() + h.turn_count) h.turns[h.turn_count++] = {region, 0, stale, 0};
            equal->batches |= 1u << b;
            equal->change = std::max(equal->change, h.change[batch]);
        }
    }
    std::sort(h.turns.data(), h.turns.data() + h.turn_count,
              [](const History::Turn& a, const History::Turn& b) {
                  if (a.stale_frames != b.stale_frames) return a.stale_frames > b.stale_frames;
                  if (a.change != b.change) return a.change > b.change;
                  return a.region < b.region;
              });
}

namespace {

// A receiver's kept result, to all its vertices.
void write_result(const Frame& frame, const MeshSlice& slice, uint32_t receiver, Tally& tally) {
    const size_t bytes = mask_bytes(frame.tables->layout), at = size_t(slice.first_vertex) + receiver;
    const size_t terms = frame.order * frame.order;
    const uint32_t written = each_vertex(slice, receiver, [&](uint32_t vertex) {
        if (slice.in.transfer.data)
            std::memcpy(transfer_of(slice.in, vertex), frame.history.transfer.data() + terms * at,
                        terms * sizeof(float));
        if (slice.in.masks.data)
            std::memcpy(mask_of(slice.in, vertex), frame.history.masks.data() + bytes * at, bytes);
    });
    tally.receivers_written += written;
    tally.receivers_copied += written - 1;
}

// The streams of up to 16 receivers with kept results.
void write_streams(Frame& frame, const MeshSlice& slice, const uint32_t* receivers, uint32_t count,
                   Worker& worker) {
    if (slice.in.output_count == 0 || count == 0) return;
    load_batch(frame, slice, receivers, count, worker.batches[0], worker);
    for (uint32_t lane = 0; lane < lanes; ++lane) {
        const size_t at = size_t(slice.first_vertex) + receivers[lane < count ? lane : 0];
        for (uint32_t i = 0; i < 25; ++i)
            worker.turned[i][lane] = frame.history.transfer[25 * at + i];
    }
    store_outputs(frame, slice, receivers, count, worker.batches[0], worker);
}

void count_stale(History& h, uint32_t batch, Tally& tally) {
    const uint32_t stale = h.wanted[batch] & ~uint32_t(h.current[batch]);
    h.stale_frames[batch] = stale ? h.stale_frames[batch] + 1 : 0;
    if (!stale) {
        h.change[batch] = 0;
        return;
    }
    const uint32_t count = static_cast<uint32_t>(std::popcount(stale));
    tally.receivers_stale += count;
    tally.stale_frames_sum += uint64_t(count) * h.stale_frames[batch];
    tally.stale_frames_max = std::max(tally.stale_frames_max, h.stale_frames[batch]);
}

} // namespace

void write_kept(void* context, uint32_t begin, uint32_t end, uint32_t slot) {
    Frame& frame = frame_of(context);
    History& h = frame.history;
    Worker& worker = frame.workers[slot];
    Tally& tally = worker.tally;
    StageClock clock(tally);
    for (uint32_t number = begin; number < end; ++number) {
        const Region region = region_of(frame, number);
        for (uint32_t b = 0; b * lanes < region.count; ++b) {
            const uint32_t batch = number * region_batches + b;
            const uint32_t rest = h.wanted[batch] & ~uint32_t(h.fresh[batch]);
            uint32_t unknown[lanes], unknown_count = 0, kept[lanes], kept_count = 0;
            for (uint32_t bits = rest; bits; bits &= bits - 1) {
                const uint32_t lane = static_cast<uint32_t>(std::countr_zero(bits));
                const uint32_t vertex = region.vertices[b * lanes + lane];
                if (h.known[batch] >> lane & 1) {
                    write_result(frame, region.slice, vertex, tally);
                    kept[kept_count++] = vertex;
                } else {
                    unknown[unknown_count++] = vertex;
                }
            }
            write_streams(frame, region.slice, kept, kept_count, worker);
            tally.receivers_reused += static_cast<uint32_t>(std::popcount(rest & h.current[batch]));
            tally.receivers_unshadowed += unknown_count;
            count_stale(h, batch, tally);
            if (unknown_count == 0) continue;
            clock.lap(rotate_stage);
            load_batch(frame, region.slice, unknown, unknown_count, worker.batches[0], worker);
            open_batch(frame, region.slice, unknown, unknown_count, worker.batches[0], worker, clock);
        }
    }
    clock.lap(rotate_stage);
}

} // namespace nusselt
