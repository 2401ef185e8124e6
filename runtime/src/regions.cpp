#include "regions.h"

#include "batches.h"

#include <algorithm>
#include <cmath>
#include <cstring>

namespace nusselt {

namespace {

using namespace kernels;

// A run of a mesh's receivers, or of its duplicates.
struct Region {
    const MeshSlice& slice;
    const uint32_t* vertices;
    const uint32_t* originals; // of duplicates; null for receivers
    uint32_t count;
};

Region region_of(const Frame& frame, uint32_t region) {
    const MeshSlice& slice = slice_of(frame, &MeshSlice::first_region, region);
    const MeshData& mesh = *slice.mesh;
    const bool duplicates = region >= slice.first_own_region;
    const Vector<uint32_t>& list = duplicates ? mesh.duplicates : mesh.receivers;
    const uint32_t first =
        (region - (duplicates ? slice.first_own_region : slice.first_region)) * frame.region_size;
    const uint32_t count = std::min(static_cast<uint32_t>(list.size()) - first, frame.region_size);
    return {slice, list.data() + first, duplicates ? mesh.duplicate_of.data() + first : nullptr, count};
}

// A duplicate had the position and normal of another vertex when the mesh was added. It gets that one's
// result, unless their normals differ in this frame or nobody needs the other.
bool repeats(const FrameMesh& mesh, uint32_t duplicate, uint32_t original) {
    return is_needed(mesh, original) &&
           std::memcmp(element(mesh.normals, duplicate), element(mesh.normals, original), 12) == 0;
}

// The region's vertices that want a result of their own, packed: so batches are full.
uint32_t pack_wanted(const Region& region, uint32_t* out) {
    const FrameMesh& mesh = region.slice.in;
    uint32_t count = 0;
    for (uint32_t i = 0; i < region.count; ++i) {
        const uint32_t vertex = region.vertices[i];
        const bool wanted =
            is_needed(mesh, vertex) && !(region.originals && repeats(mesh, vertex, region.originals[i]));
        if (wanted) out[count++] = vertex;
    }
    return count;
}

// A sphere and a cone around all receivers of a region, from its batches' bounds.
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

void shadow_region(Frame& frame, uint32_t number, Worker& worker) {
    const Region region = region_of(frame, number);
    const MeshSlice& slice = region.slice;
    const Kernels& k = *frame.kernels;
    StageClock clock(worker.tally);
    uint32_t receivers[region_receivers];
    const uint32_t count = pack_wanted(region, receivers);
    if (count == 0) return;

    const auto in_batch = [&](uint32_t first) { return std::min(count - first, lanes); };
    ReceiverBounds bounds[region_batches];
    uint32_t batches = 0;
    for (uint32_t i = 0; i < count; i += lanes) {
        Batch& batch = worker.batches[i / lanes];
        load_batch(frame, slice, receivers + i, in_batch(i), batch, worker);
        if (batch.valid) bounds[batches++] = batch.bounds;
    }
    const ReceiverBounds all = unite(bounds, batches);
    uint32_t candidates = 0;
    if (batches > 0) {
        uint64_t tested = 0;
        candidates = k.select_clusters(all, frame.cluster_bounds, nullptr, frame.cluster_count,
                                       frame.tables->horizon, worker.candidates.data(), &tested);
        worker.tally.clusters_tested += tested;
    }
    clock.lap(cull_stage);
    for (uint32_t i = 0; i < count; i += lanes) {
        shadow_batch(frame, slice, receivers + i, in_batch(i), worker.batches[i / lanes],
                     worker.candidates.data(), candidates, worker, clock);
    }
}

void copy_chunk(const Frame& frame, uint32_t chunk, Worker& worker) {
    const MeshSlice& slice = slice_of(frame, &MeshSlice::first_duplicate_chunk, chunk);
    const MeshData& data = *slice.mesh;
    const uint32_t first = (chunk - slice.first_duplicate_chunk) * lanes;
    const uint32_t end = std::min(first + lanes, static_cast<uint32_t>(data.duplicates.size()));
    const size_t mask_size = mask_bytes(frame.tables->layout);
    uint32_t copied = 0;
    for (uint32_t i = first; i < end; ++i) {
        const uint32_t vertex = data.duplicates[i], original = data.duplicate_of[i];
        if (!is_needed(slice.in, vertex) || !repeats(slice.in, vertex, original)) continue;
        std::memcpy(transfer_of(slice.in, vertex), transfer_of(slice.in, original), 100);
        if (slice.in.masks.data)
            std::memcpy(mask_of(slice.in, vertex), mask_of(slice.in, original), mask_size);
        ++copied;
    }
    worker.tally.receivers_copied += copied;
    worker.tally.receivers_written += copied;
}

} // namespace

void shadow_regions(void* context, uint32_t begin, uint32_t end, uint32_t slot) {
    Frame& frame = *static_cast<Frame*>(context);
    for (uint32_t region = begin; region < end; ++region)
        shadow_region(frame, region, frame.workers[slot]);
}

void copy_duplicates(void* context, uint32_t begin, uint32_t end, uint32_t slot) {
    Frame& frame = *static_cast<Frame*>(context);
    for (uint32_t chunk = begin; chunk < end; ++chunk)
        copy_chunk(frame, chunk, frame.workers[slot]);
}

} // namespace nusselt
