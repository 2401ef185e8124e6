#include "batches.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>

namespace nusselt {

namespace {

using namespace kernels;

const float* element(const Vec3View& view, size_t index) {
    return reinterpret_cast<const float*>(reinterpret_cast<const char*>(view.data) + index * view.stride);
}

// Adds the time since the last lap to a stage.
struct StageClock {
    Tally& tally;
    uint64_t last;

    explicit StageClock(Tally& t) : tally(t), last(ticks_now()) {}
    void lap(Stage stage) {
        const uint64_t now = ticks_now();
        tally.ticks[stage] += now - last;
        last = now;
    }
};

JobList job_list(Worker& worker) {
    const size_t stride = worker.jobs.size() / 4;
    uint32_t* const base = worker.jobs.data();
    return {{base, base + stride, base + 2 * stride}, base + 3 * stride, 0};
}

// Positions, normals and frames of up to 16 receivers. Lanes without one repeat another, invalid.
void load_batch(const Frame& frame, const MeshSlice& slice, const uint32_t* receivers, uint32_t present,
                Batch& batch, Worker& worker) {
    for (uint32_t lane = 0; lane < lanes; ++lane) {
        const uint32_t some = static_cast<uint32_t>(std::countr_zero(present));
        const uint32_t vertex = receivers[present >> lane & 1 ? lane : some];
        const float* p = frame.points.data() + 4 * (size_t(slice.first_point) + slice.mesh->weld[vertex]);
        const float* n = element(slice.in.normals, vertex);
        for (uint32_t k = 0; k < 3; ++k) {
            batch.position[k][lane] = p[k];
            worker.normal[k][lane] = n[k];
        }
    }
    batch.valid = present;
    frame.kernels->prepare_batch(batch, worker.normal);
    worker.tally.receivers_computed += static_cast<uint32_t>(std::popcount(present));
    worker.tally.receivers_invalid += static_cast<uint32_t>(std::popcount(present & ~batch.valid));
}

// What the triangles around each receiver hide below themselves.
void shadow_fans(const Frame& frame, const MeshSlice& slice, const uint32_t* receivers, const Batch& batch,
                 Worker& worker, JobList& jobs) {
    const MeshData& mesh = *slice.mesh;
    const float* points = frame.points.data() + 4 * size_t(slice.first_point);
    uint32_t begin[lanes], count[lanes], longest = 0;
    for (uint32_t lane = 0; lane < lanes; ++lane) {
        const bool valid = batch.valid >> lane & 1;
        const uint32_t w = valid ? mesh.weld[receivers[lane]] : 0;
        begin[lane] = valid ? mesh.fan_begin[w] : 0;
        count[lane] = valid ? mesh.fan_begin[w + 1] - mesh.fan_begin[w] : 0;
        longest = std::max(longest, count[lane]);
    }
    alignas(64) float corners[2][3][lanes] = {};
    for (uint32_t i = 0; i < longest; ++i) {
        uint32_t active = 0;
        for (uint32_t lane = 0; lane < lanes; ++lane) {
            if (i >= count[lane]) continue;
            active |= 1u << lane;
            for (uint32_t side = 0; side < 2; ++side) {
                const float* p = points + 4 * size_t(mesh.fan[2 * size_t(begin[lane] + i) + side]);
                for (uint32_t k = 0; k < 3; ++k)
                    corners[side][k][lane] = p[k];
            }
        }
        frame.kernels->fan_jobs(batch, corners, active, frame.tables->layout, jobs, worker.tally.counters);
        if (jobs.count >= job_flush) frame.kernels->run_jobs(*frame.tables, jobs, worker.masks.data());
    }
}

// The full mesh around each receiver (quality `paper`).
void shadow_rings(const Frame& frame, const MeshSlice& slice, const uint32_t* receivers, const Batch& batch,
                  Worker& worker, JobList& jobs) {
    const MeshData& mesh = *slice.mesh;
    const float* points = frame.points.data() + 4 * size_t(slice.first_point);
    uint32_t longest = 0;
    for (uint32_t lane = 0; lane < lanes; ++lane) {
        if (!(batch.valid >> lane & 1)) continue;
        const uint32_t w = mesh.weld[receivers[lane]];
        longest = std::max(longest, mesh.ring_begin[w + 1] - mesh.ring_begin[w]);
    }
    alignas(64) float corners[3][3][lanes] = {};
    for (uint32_t i = 0; i < longest; ++i) {
        uint32_t active = 0, two_sided = 0;
        for (uint32_t lane = 0; lane < lanes; ++lane) {
            if (!(batch.valid >> lane & 1)) continue;
            const uint32_t w = mesh.weld[receivers[lane]];
            if (mesh.ring_begin[w] + i >= mesh.ring_begin[w + 1]) continue;
            const uint32_t t = mesh.ring[mesh.ring_begin[w] + i];
            active |= 1u << lane;
            two_sided |= uint32_t(mesh.full_two_sided[t]) << lane;
            for (uint32_t corner = 0; corner < 3; ++corner) {
                const float* p = points + 4 * size_t(mesh.full_triangles[3 * size_t(t) + corner]);
                for (uint32_t k = 0; k < 3; ++k)
                    corners[corner][k][lane] = p[k];
            }
        }
        frame.kernels->triangle_jobs(batch, corners, active, two_sided, frame.tables->layout,
                                     frame.tables->horizon, jobs, worker.tally.counters);
        if (jobs.count >= job_flush) frame.kernels->run_jobs(*frame.tables, jobs, worker.masks.data());
    }
}

// Marks the coarse vertices next to each receiver, or takes the marks away.
void mark_vicinity(const MeshSlice& slice, const uint32_t* receivers, const Batch& batch, bool set,
                   Worker& worker) {
    const MeshData& mesh = *slice.mesh;
    const auto mark = [&](uint32_t w, uint32_t lane) {
        uint16_t& bits = worker.near[slice.first_point + mesh.anchor[w]];
        bits = set ? static_cast<uint16_t>(bits | 1u << lane) : uint16_t(0);
    };
    for (uint32_t lane = 0; lane < lanes; ++lane) {
        if (!(batch.valid >> lane & 1)) continue;
        const uint32_t w = mesh.weld[receivers[lane]];
        mark(w, lane);
        for (uint32_t k = 2 * mesh.fan_begin[w]; k < 2 * mesh.fan_begin[w + 1]; ++k)
            mark(mesh.fan[k], lane);
    }
}

// A sheet's coarse triangles (quality `paper`). They block from both sides, so those of the receiver's own
// surroundings would hide all that lies behind them: there the full mesh stands for them ("for the remaining
// parts of the model we use a coarser mesh", section 3.2).
void shadow_sheet(const Frame& frame, uint32_t cluster, const Batch& batch, Worker& worker, JobList& jobs) {
    const MeshSlice& blocker = frame.meshes[frame.cluster_mesh[cluster]];
    const ClusterView& view = frame.views[cluster];
    const float* points = frame.points.data() + 4 * size_t(blocker.first_point);
    for (uint32_t t = 0; t < view.triangle_count; ++t) {
        alignas(64) float corners[3][3][lanes];
        uint32_t near = 0;
        for (uint32_t corner = 0; corner < 3; ++corner) {
            const uint32_t w = view.vertices[view.triangles[8 * t + corner]];
            near |= worker.near[blocker.first_point + w];
            for (uint32_t k = 0; k < 3; ++k)
                std::fill_n(corners[corner][k], lanes, points[4 * size_t(w) + k]);
        }
        frame.kernels->triangle_jobs(batch, corners, batch.valid & ~near, 0xFFFF, frame.tables->layout,
                                     frame.tables->horizon, jobs, worker.tally.counters);
    }
}

float* transfer_of(const TransferView& view, size_t index) {
    return reinterpret_cast<float*>(reinterpret_cast<char*>(view.data) + index * view.stride);
}

void store_batch(const Frame& frame, const MeshSlice& slice, const uint32_t* receivers, uint32_t present,
                 const Worker& worker) {
    const uint32_t bytes = mask_bytes(frame.tables->layout);
    for (uint32_t lane = 0; lane < lanes; ++lane) {
        if (!(present >> lane & 1)) continue;
        float* out = transfer_of(slice.in.transfer, receivers[lane]);
        for (uint32_t i = 0; i < 25; ++i)
            out[i] = worker.turned[i][lane];
        if (!slice.in.masks.data) continue;
        std::memcpy(reinterpret_cast<char*>(slice.in.masks.data) + receivers[lane] * slice.in.masks.stride,
                    worker.masks.data() + size_t(lane) * bytes, bytes);
    }
}

// One batch through all kernels. `candidates` are the clusters that may matter to it.
void shadow_batch(const Frame& frame, const MeshSlice& slice, const uint32_t* receivers, uint32_t present,
                  const Batch& batch, const uint32_t* candidates, uint32_t candidate_count, Worker& worker,
                  StageClock& clock) {
    const Kernels& k = *frame.kernels;
    const Tables& tables = *frame.tables;
    Counters& counters = worker.tally.counters;
    uint32_t selected = 0;
    if (batch.valid) {
        selected = k.select_clusters(batch.bounds, frame.cluster_bounds, candidates, candidate_count,
                                     tables.horizon, worker.selected.data(), &worker.tally.clusters_tested);
    }
    worker.tally.clusters_rasterized += selected;
    clock.lap(cull_stage);

    std::memset(worker.masks.data(), 0, size_t(lanes) * mask_bytes(tables.layout));
    JobList jobs = job_list(worker);
    if (frame.quality.paper) {
        shadow_rings(frame, slice, receivers, batch, worker, jobs);
    } else {
        shadow_fans(frame, slice, receivers, batch, worker, jobs);
    }
    if (frame.quality.paper) mark_vicinity(slice, receivers, batch, true, worker);
    for (uint32_t i = 0; i < selected; ++i) {
        const uint32_t c = worker.selected[i];
        const MeshSlice& blocker = frame.meshes[frame.cluster_mesh[c]];
        if (frame.quality.paper && frame.views[c].two_sided) {
            shadow_sheet(frame, c, batch, worker, jobs);
        } else {
            k.cluster_jobs(batch, frame.views[c], frame.points.data() + 4 * size_t(blocker.first_point),
                           tables.layout, tables.horizon, worker.scratch[0], jobs, counters);
        }
        if (jobs.count < job_flush && i + 1 < selected) continue;
        clock.lap(transform_stage);
        k.run_jobs(tables, jobs, worker.masks.data());
        clock.lap(raster_stage);
    }
    if (frame.quality.paper) mark_vicinity(slice, receivers, batch, false, worker);
    k.run_jobs(tables, jobs, worker.masks.data());
    clock.lap(raster_stage);
    k.integrate(tables, worker.masks.data(), batch.valid, frame.quality.paper, worker.local, counters);
    clock.lap(integrate_stage);
    k.rotate(batch, worker.local, worker.turned);
    store_batch(frame, slice, receivers, present, worker);
    clock.lap(rotate_stage);
}

uint32_t first_lanes(uint32_t count) {
    return count >= lanes ? 0xFFFFu : (1u << count) - 1;
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

void shadow_region(Frame& frame, uint32_t region, Worker& worker) {
    const MeshSlice& slice = slice_of(frame, &MeshSlice::first_region, region);
    const Kernels& k = *frame.kernels;
    StageClock clock(worker.tally);
    const uint32_t count = static_cast<uint32_t>(slice.mesh->receivers.size());
    const uint32_t first = (region - slice.first_region) * region_batches * lanes;
    const uint32_t* receivers = slice.mesh->receivers.data() + first;
    const uint32_t here = std::min(count - first, region_batches * lanes);

    ReceiverBounds bounds[region_batches];
    uint32_t batches = 0;
    for (uint32_t i = 0; i < here; i += lanes) {
        Batch& batch = worker.batches[i / lanes];
        load_batch(frame, slice, receivers + i, first_lanes(here - i), batch, worker);
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
    for (uint32_t i = 0; i < here; i += lanes) {
        shadow_batch(frame, slice, receivers + i, first_lanes(here - i), worker.batches[i / lanes],
                     worker.candidates.data(), candidates, worker, clock);
    }
}

// Vertices that had the position and normal of another one when the mesh was added get its result, unless
// their normals differ in this frame: those are receivers of their own.
void copy_chunk(const Frame& frame, uint32_t chunk, Worker& worker) {
    const MeshSlice& slice = slice_of(frame, &MeshSlice::first_duplicate_chunk, chunk);
    const uint32_t first = (chunk - slice.first_duplicate_chunk) * lanes;
    const uint32_t count = std::min(static_cast<uint32_t>(slice.mesh->duplicates.size()) - first, lanes);
    const uint32_t* vertices = slice.mesh->duplicates.data() + first;
    const uint32_t* originals = slice.mesh->duplicate_of.data() + first;
    const size_t mask_size = mask_bytes(frame.tables->layout);
    char* const masks = reinterpret_cast<char*>(slice.in.masks.data);
    uint32_t differ = 0;
    for (uint32_t i = 0; i < count; ++i) {
        if (std::memcmp(element(slice.in.normals, vertices[i]), element(slice.in.normals, originals[i]),
                        12) != 0) {
            differ |= 1u << i;
            continue;
        }
        std::memcpy(transfer_of(slice.in.transfer, vertices[i]), transfer_of(slice.in.transfer, originals[i]),
                    100);
        if (!masks) continue;
        std::memcpy(masks + vertices[i] * slice.in.masks.stride, masks + originals[i] * slice.in.masks.stride,
                    mask_size);
    }
    if (!differ) return;
    StageClock clock(worker.tally);
    Batch& batch = worker.batches[0];
    // Lanes that are not present borrow a vertex that exists.
    uint32_t receivers[lanes];
    for (uint32_t i = 0; i < lanes; ++i)
        receivers[i] = vertices[differ >> i & 1 ? i : static_cast<uint32_t>(std::countr_zero(differ))];
    load_batch(frame, slice, receivers, differ, batch, worker);
    shadow_batch(frame, slice, receivers, differ, batch, nullptr, frame.cluster_count, worker, clock);
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
