#include "regions.h"

#include "batches.h"
#include "far.h"
#include "objects.h"
#include "visible_set.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>

namespace nusselt {

using namespace kernels;

Region region_of(const Frame& frame, uint32_t region) {
    const MeshSlice& slice = slice_of(frame.meshes, &MeshSlice::first_region, region);
    const MeshData& mesh = *slice.mesh;
    const bool duplicates = region >= slice.first_own_region;
    const Vector<uint32_t>& list = duplicates ? mesh.duplicates : mesh.receivers;
    const uint32_t first =
        (region - (duplicates ? slice.first_own_region : slice.first_region)) * frame.region_size;
    const uint32_t count = std::min(static_cast<uint32_t>(list.size()) - first, frame.region_size);
    return {slice, list.data() + first, duplicates ? mesh.duplicate_of.data() + first : nullptr, count};
}

bool is_wanted(const Region& region, uint32_t i) {
    const FrameMesh& mesh = region.slice.in;
    return is_needed(mesh, region.vertices[i]) &&
           !(region.originals && repeats(mesh, region.vertices[i], region.originals[i]));
}

ReceiverBounds unite(const ReceiverBounds* batches, uint32_t count) {
    ReceiverBounds all{};
    float low[3] = {INFINITY, INFINITY, INFINITY}, high[3] = {-INFINITY, -INFINITY, -INFINITY}, sum[3] = {};
    for (uint32_t b = 0; b < count; ++b) {
        for (uint32_t k = 0; k < 3; ++k) {
            low[k] = std::min(low[k], batches[b].centre[k] - batches[b].radius);
            high[k] = std::max(high[k], batches[b].centre[k] + batches[b].radius);
            sum[k] += batches[b].cone[k];
        }
    }
    const float length = std::sqrt(sum[0] * sum[0] + sum[1] * sum[1] + sum[2] * sum[2]);
    for (uint32_t k = 0; k < 3; ++k) {
        all.centre[k] = 0.5f * low[k] + 0.5f * high[k];
        all.cone[k] = length > 0 ? sum[k] / length : 0.0f;
    }
    float widest = 0; // angle from the axis
    for (uint32_t b = 0; b < count; ++b) {
        float square = 0, along = 0;
        for (uint32_t k = 0; k < 3; ++k) {
            const float d = batches[b].centre[k] - all.centre[k];
            square += d * d;
            along += batches[b].cone[k] * all.cone[k];
        }
        all.radius = std::max(all.radius, std::sqrt(square) + batches[b].radius);
        // cos(a + b) of the batch's tilt and its own cone.
        const float tilt = std::sqrt(std::max(1 - along * along, 0.0f));
        const float cosine = along * batches[b].cone_cos - tilt * batches[b].cone_sin;
        widest = std::max(widest, batches[b].cone_cos > 0 && along > 0 ? 1 - cosine : 2.0f);
    }
    all.radius *= 1.00001f;
    all.cone_cos = length > 0 && widest < 1 ? 1 - widest - 1e-5f : -1.0f;
    all.cone_cos = all.cone_cos > 0 ? all.cone_cos : -1.0f;
    all.cone_sin = std::sqrt(std::max(1 - all.cone_cos * all.cone_cos, 0.0f));
    return all;
}

namespace {

// The vertices of a region that are computed, packed: so batches are full.
struct Packed {
    uint32_t vertex[region_receivers];
    uint8_t place[region_receivers]; // in the region
    uint32_t count = 0;
};

void pack(const Region& region, uint32_t first, uint32_t lanes_wanted, Packed& out) {
    for (uint32_t bits = lanes_wanted; bits; bits &= bits - 1) {
        const uint32_t place = first + static_cast<uint32_t>(std::countr_zero(bits));
        out.vertex[out.count] = region.vertices[place];
        out.place[out.count++] = static_cast<uint8_t>(place);
    }
}

// The lanes of a batch of the region that are to be computed in this frame.
uint32_t to_compute(const Frame& frame, const Region& region, uint32_t number, uint32_t batch) {
    const History& h = frame.history;
    const uint32_t at = number * region_batches + batch;
    if (frame.has_history) return h.wanted[at] & ~uint32_t(h.current[at]);
    uint32_t wanted = 0;
    for (uint32_t lane = 0; lane < std::min(region.count - batch * lanes, lanes); ++lane)
        wanted |= uint32_t(is_wanted(region, batch * lanes + lane)) << lane;
    return wanted;
}

// The rows of a visible set that tell what matters to some of a region's vertices.
void find_rows(const Frame& frame, const Region& region, uint32_t number, const uint8_t* places,
               uint32_t count, const VisibleSet& set, uint32_t rows[lanes]) {
    const MeshSlice& slice = region.slice;
    const VisibleRows& own = set.meshes[slice.body];
    const uint32_t region_row = region.originals ? own.first_own_row : own.first_row;
    const uint32_t first = number - (region.originals ? slice.first_own_region : slice.first_region);
    for (uint32_t i = 0; i < count; ++i)
        rows[i] = region_row + (first * frame.region_size + places[i]) / lanes;
}

void note_computed(History& h, uint32_t number, const uint8_t* places, uint32_t count) {
    for (uint32_t i = 0; i < count; ++i) {
        const uint32_t batch = number * region_batches + places[i] / lanes;
        const uint16_t bit = static_cast<uint16_t>(1u << places[i] % lanes);
        h.current[batch] |= bit;
        h.known[batch] |= bit;
        h.fresh[batch] |= bit;
    }
}

// False where none is valid; else the bounds of those that are.
bool load_batches(const Frame& frame, const MeshSlice& slice, const uint32_t* receivers, uint32_t count,
                  Worker& worker, Batch* out, ReceiverBounds& all) {
    ReceiverBounds bounds[region_batches];
    uint32_t batches = 0;
    for (uint32_t i = 0; i < count; i += lanes) {
        Batch& batch = out[i / lanes];
        load_batch(frame, slice, receivers + i, std::min(count - i, lanes), batch, worker);
        if (batch.valid) bounds[batches++] = batch.bounds;
    }
    if (batches > 0) all = unite(bounds, batches);
    return batches > 0;
}

// Whether a region's receivers are computed together with their backs. Not where parts are closed: their
// backs are dark.
bool is_for_both(const Frame& frame, const MeshSlice& front, uint32_t number) {
    const MeshSlice& back = frame.meshes[front.back];
    if (!frame.both_at_once || front.back == 0 || !receives(front.in)) return false;
    if (front.mesh->closed_clusters > 0) return false;
    if (front.in.needed == back.in.needed) return true;
    const uint32_t behind = number - front.first_region + back.first_region;
    const Region a = region_of(frame, number), b = region_of(frame, behind);
    for (uint32_t i = 0; i < a.count; i += lanes) {
        if (to_compute(frame, a, number, i / lanes) != to_compute(frame, b, behind, i / lanes)) return false;
    }
    return true;
}

// Both sides of a region's receivers.
void shadow_sides(Frame& frame, const MeshSlice& front, const uint32_t* receivers, uint32_t count,
                  Worker& worker, StageClock& clock) {
    const MeshSlice& back = frame.meshes[front.back];
    const MeshSlice* const slices[2] = {&front, &back};
    ReceiverBounds all, ignored;
    uint32_t candidates = 0;
    load_batches(frame, back, receivers, count, worker, worker.behind, ignored);
    if (load_batches(frame, front, receivers, count, worker, worker.batches, all)) {
        all.cone_cos = -1; // of both sides: next to nothing lies below all of their horizons
        candidates = select_candidates(frame, front, all, all, worker);
    }
    clock.lap(cull_stage);
    for (uint32_t i = 0; i < count; i += lanes) {
        Batch* const batches[2] = {&worker.batches[i / lanes], &worker.behind[i / lanes]};
        const uint32_t in_batch = std::min(count - i, lanes);
        if (is_mirrored(*batches[0], *batches[1])) {
            shadow_both(frame, slices, receivers + i, in_batch, batches, worker.candidates.data(), candidates,
                        worker, clock);
            continue;
        }
        for (uint32_t side = 0; side < 2; ++side)
            shadow_batch(frame, *slices[side], receivers + i, in_batch, *batches[side],
                         worker.candidates.data(), candidates, worker, clock);
    }
}

// `batches`: one bit a batch of the region. `first`: computes something whatever the time.
void shadow_region(Frame& frame, uint32_t number, uint32_t batches_wanted, bool first, Worker& worker) {
    if (!first && is_out_of_time(frame)) return;
    const Region region = region_of(frame, number);
    const MeshSlice& slice = region.slice;
    const MeshSlice& front = frame.meshes[slice.body];
    const bool both = is_for_both(frame, front, number - slice.first_region + front.first_region);
    if (both && slice.is_back) return; // with its front
    StageClock clock(worker.tally);
    Packed packed;
    for (uint32_t b = 0; b * lanes < region.count; ++b) {
        if (batches_wanted >> b & 1) pack(region, b * lanes, to_compute(frame, region, number, b), packed);
    }
    const uint32_t count = packed.count;
    if (count == 0) return;

    const uint32_t* const receivers = packed.vertex;
    worker.far_count = 0;
    worker.far_matrix = nullptr;
    if (both) return shadow_sides(frame, slice, receivers, count, worker, clock);
    const auto in_batch = [&](uint32_t i) { return std::min(count - i, lanes); };
    // Of all of the region's receivers: how objects are seen must not depend on who is computed in this
    // frame.
    ReceiverBounds home, all;
    const bool part = frame.proxies && count < region.count;
    if (part) load_batches(frame, slice, region.vertices, region.count, worker, worker.batches, home);
    uint32_t candidates = 0;
    if (load_batches(frame, slice, receivers, count, worker, worker.batches, all)) {
        candidates = select_candidates(frame, slice, all, part ? home : all, worker);
        if (slice.looks_far) look_far(frame, slice, part ? home : all, worker);
    }
    clock.lap(cull_stage);
    for (uint32_t i = 0; i < count; i += lanes) {
        if (!(first && i == 0) && is_out_of_time(frame)) return;
        const uint32_t* blockers = worker.candidates.data();
        uint32_t blocker_count = candidates;
        if (frame.visible || frame.record)
            find_rows(frame, region, number, packed.place + i, in_batch(i),
                      frame.visible ? *frame.visible : *frame.record, worker.rows);
        if (frame.visible) {
            blocker_count = keep_visible(frame, worker.rows, in_batch(i), candidates, worker);
            blockers = worker.visible.data();
        }
        shadow_batch(frame, slice, receivers + i, in_batch(i), worker.batches[i / lanes], blockers,
                     blocker_count, worker, clock);
        if (frame.has_history) note_computed(frame.history, number, packed.place + i, in_batch(i));
    }
}

} // namespace

void shadow_regions(void* context, uint32_t begin, uint32_t end, uint32_t slot) {
    Frame& frame = *static_cast<Frame*>(context);
    for (uint32_t region = begin; region < end; ++region)
        shadow_region(frame, region, 0xFF, false, frame.workers[slot]);
}

void shadow_turns(void* context, uint32_t begin, uint32_t end, uint32_t slot) {
    Frame& frame = *static_cast<Frame*>(context);
    for (uint32_t i = begin; i < std::min(end, frame.history.turn_count); ++i) {
        const History::Turn& turn = frame.history.turns[i];
        shadow_region(frame, turn.region, turn.batches, i == 0, frame.workers[slot]);
    }
}

} // namespace nusselt
