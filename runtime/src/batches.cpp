#include "batches.h"

#include "falloff.h"
#include "fans.h"
#include "far.h"
#include "gloss.h"
#include "inside.h"
#include "last_samples.h"
#include "visible_set.h"

#include <algorithm>
#include <bit>
#include <cstring>

namespace nusselt {

namespace {

using namespace kernels;

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

// The caller's memory is only written to, each element once: it may be a GPU's.
void store_batch(const Frame& frame, const MeshSlice& slice, const uint32_t* receivers, uint32_t count,
                 Worker& worker) {
    const uint32_t bytes = mask_bytes(frame.tables->layout);
    uint32_t written = 0;
    for (uint32_t lane = 0; lane < count; ++lane) {
        written += each_vertex(slice, receivers[lane], [&](uint32_t vertex) {
            if (slice.in.transfer.data) {
                float* out = transfer_of(slice.in, vertex);
                for (uint32_t i = 0; i < frame.order * frame.order; ++i)
                    out[i] = worker.turned[i][lane];
            }
            if (slice.in.masks.data)
                std::memcpy(mask_of(slice.in, vertex), worker.masks.data() + size_t(lane) * bytes, bytes);
        });
    }
    worker.tally.receivers_written += written;
    worker.tally.receivers_copied += written - count;
}

// Encodes `parts` times 25 rows [term][lane] into the stream, one after the other in each element; only the
// first `distinct` of them differ.
void store_rows(const Frame& frame, const OutputStream& stream, const float rows[][lanes], uint32_t parts,
                uint32_t distinct, const MeshSlice& slice, const uint32_t* receivers, uint32_t count,
                const Batch& batch, Worker& worker) {
    const uint32_t part_size = encoded_bytes(stream.encoding), size = parts * part_size;
    for (uint32_t part = 0; part < distinct; ++part)
        frame.output_kernels->encode(stream.encoding, batch, rows + 25 * part,
                                     worker.encoded + part * part_size, size);
    for (uint32_t lane = 0; lane < count; ++lane) {
        uint8_t* const element = worker.encoded + lane * size;
        for (uint32_t part = distinct; part < parts; ++part)
            std::memcpy(element + part * part_size, element, part_size);
        each_vertex(slice, receivers[lane], [&](uint32_t vertex) {
            std::memcpy(stream.data + vertex * stream.stride, element, size);
        });
    }
}

// Keeps a batch's results, for frames in which nothing changes for them.
void keep_batch(Frame& frame, const MeshSlice& slice, const uint32_t* receivers, uint32_t count,
                const Worker& worker) {
    const size_t bytes = mask_bytes(frame.tables->layout), terms = frame.order * frame.order;
    for (uint32_t lane = 0; lane < count; ++lane) {
        const size_t at = size_t(slice.first_vertex) + receivers[lane];
        float* out = frame.history.transfer.data() + terms * at;
        for (uint32_t i = 0; i < terms; ++i)
            out[i] = worker.turned[i][lane];
        if (slice.in.masks.data)
            std::memcpy(frame.history.masks.data() + bytes * at, worker.masks.data() + lane * bytes, bytes);
    }
}

// The masks' transfer vectors, turned to the caller's space.
void finish_batch(const Frame& frame, const MeshSlice& slice, const Batch& batch, Worker& worker,
                  StageClock& clock) {
    if (slice.masks_alone) return;
    // A product's low bands are made of all bands.
    const bool far = slice.looks_far && worker.far_matrix;
    const uint32_t order = slice.in.output_count > 0 || far ? 5 : frame.order;
    if (frame.fades) {
        integrate_fading(frame, batch, order, worker);
    } else {
        frame.kernels->integrate(*frame.tables, worker.masks.data(), batch.valid, frame.quality.paper, order,
                                 worker.local, worker.tally.counters);
    }
    clock.lap(integrate_stage);
    frame.kernels->rotate(batch, order, worker.local, worker.turned);
    if (far) multiply_far(frame, worker);
}

// What a batch's receivers hide from themselves, into worker.masks. Receivers inside closed parts are dark,
// and leave the batch; returns them.
uint32_t begin_batch(const Frame& frame, const MeshSlice& slice, const uint32_t* receivers, uint32_t count,
                     Batch& batch, Worker& worker, StageClock& clock) {
    const size_t mask_size = mask_bytes(frame.tables->layout);
    worker.tally.receivers_computed += count;
    worker.tally.receivers_invalid += count - static_cast<uint32_t>(std::popcount(batch.valid));
    JobList jobs = job_list(worker);
    std::memset(worker.masks.data(), 0, lanes * mask_size * (frame.fades ? 1 + fade_digits : 1));
    uint32_t folded = 0;
    if (slice.in.receive_only) {
        // Not even of itself.
    } else if (frame.quality.paper) {
        shadow_rings(frame, slice, receivers, batch, worker, jobs);
    } else {
        folded = shadow_fans(frame, slice, receivers, batch, worker, jobs);
    }
    clock.lap(transform_stage);
    frame.kernels->run_jobs(*frame.tables, jobs, worker.masks.data());
    clock.lap(raster_stage);

    const uint32_t full = folded ? fill_fans(frame, slice, receivers, batch, folded, worker) : 0;
    const uint32_t inside = find_inside(frame, batch, full, worker);
    for (uint32_t lane = 0; lane < lanes; ++lane) {
        if (inside >> lane & 1) std::memset(worker.masks.data() + lane * mask_size, 0xFF, mask_size);
    }
    batch.valid &= ~inside;
    worker.tally.receivers_inside += static_cast<uint32_t>(std::popcount(inside));
    clock.lap(cull_stage);
    return inside;
}

uint32_t select_for(const Frame& frame, const ReceiverBounds& bounds, const uint32_t* candidates,
                    uint32_t candidate_count, Worker& worker) {
    const uint32_t selected = frame.kernels->select_clusters(
        bounds, frame.cluster_bounds, candidates, candidate_count, frame.tables->horizon,
        worker.selected.data(), &worker.tally.clusters_tested);
    worker.tally.clusters_rasterized += selected;
    return selected;
}

// From masks to results.
void end_batch(Frame& frame, const MeshSlice& slice, const uint32_t* receivers, uint32_t count, Batch& batch,
               uint32_t inside, uint32_t selected, Worker& worker, StageClock& clock) {
    if (frame.watertight) cover_last_samples(frame, slice, receivers, batch, selected, worker);
    clock.lap(raster_stage);
    finish_batch(frame, slice, batch, worker, clock);
    batch.valid |= inside; // their streams have normals
    store_batch(frame, slice, receivers, count, worker);
    store_outputs(frame, slice, receivers, count, batch, worker);
    if (frame.has_history) keep_batch(frame, slice, receivers, count, worker);
    clock.lap(rotate_stage);
}

} // namespace

bool repeats(const FrameMesh& mesh, uint32_t duplicate, uint32_t original) {
    const uint16_t* const material = mesh.gloss ? mesh.gloss->material_of : nullptr;
    return is_needed(mesh, duplicate) && is_needed(mesh, original) &&
           (!material || material[duplicate] == material[original]) &&
           std::memcmp(element(mesh.normals, duplicate), element(mesh.normals, original), 12) == 0;
}

void store_outputs(const Frame& frame, const MeshSlice& slice, const uint32_t* receivers, uint32_t count,
                   const Batch& batch, Worker& worker) {
    uint32_t channels = 0; // of worker.glossy that differ, once it is made
    alignas(64) float rgb[3][lanes];
    for (uint32_t k = 0; k < slice.in.output_count; ++k) {
        const OutputStream& stream = frame.outputs[slice.first_output + k];
        const Quantity quantity = stream.encoding.quantity;
        if (channels == 0 && (quantity == Quantity::glossy || quantity == Quantity::radiance))
            channels = make_glossy(frame, slice, receivers, count, batch, worker);
        const auto store = [&](const float rows[][lanes], uint32_t parts, uint32_t distinct) {
            store_rows(frame, stream, rows, parts, distinct, slice, receivers, count, batch, worker);
        };
        switch (quantity) {
        case Quantity::glossy:
            store(worker.glossy[0], 3, channels);
            break;
        case Quantity::radiance:
            frame.light_kernels->shade_batch(frame.light, worker.glossy, rgb);
            store(rgb, 1, 1);
            break;
        case Quantity::direct:
            make_direct(frame, slice, receivers, count, batch, worker, rgb);
            store(rgb, 1, 1);
            break;
        default:
            store(worker.turned, 1, 1);
        }
    }
}

void load_batch(const Frame& frame, const MeshSlice& slice, const uint32_t* receivers, uint32_t count,
                Batch& batch, Worker& worker) {
    for (uint32_t lane = 0; lane < lanes; ++lane) {
        const uint32_t vertex = receivers[lane < count ? lane : 0];
        const float* p = frame.points.data() + 4 * (size_t(slice.first_point) + slice.mesh->weld[vertex]);
        const float* n = element(slice.in.normals, vertex);
        for (uint32_t k = 0; k < 3; ++k) {
            batch.position[k][lane] = p[k];
            worker.normal[k][lane] = slice.is_back ? -n[k] : n[k];
        }
    }
    batch.valid = count >= lanes ? 0xFFFFu : (1u << count) - 1;
    frame.kernels->prepare_batch(batch, worker.normal);
}

void shadow_batch(Frame& frame, const MeshSlice& slice, const uint32_t* receivers, uint32_t count,
                  Batch& batch, const uint32_t* candidates, uint32_t candidate_count, Worker& worker,
                  StageClock& clock) {
    const Kernels& k = *frame.kernels;
    const Tables& tables = *frame.tables;
    JobList jobs = job_list(worker);
    const uint32_t inside = begin_batch(frame, slice, receivers, count, batch, worker, clock);
    const uint32_t selected =
        batch.valid ? select_for(frame, batch.bounds, candidates, candidate_count, worker) : 0;
    clock.lap(cull_stage);

    if (frame.quality.paper) mark_vicinity(slice, receivers, batch, true, worker);
    if (frame.fades) draw_fading(frame, batch, selected, worker, jobs, clock);
    if (frame.record) std::copy(worker.masks.begin(), worker.masks.end(), worker.masks_before.begin());
    for (uint32_t i = 0; !frame.fades && i < selected; ++i) {
        const uint32_t c = worker.selected[i];
        const MeshSlice& blocker = frame.meshes[frame.cluster_mesh[c]];
        if (frame.quality.paper && frame.views[c].two_sided) {
            shadow_sheet(frame, c, batch, worker, jobs);
        } else {
            k.cluster_jobs(batch, frame.views[c], frame.points.data() + 4 * size_t(blocker.first_point),
                           tables.layout, tables.horizon, worker.scratch[0], jobs, worker.tally.counters);
        }
        if (jobs.count < job_flush && i + 1 < selected && !frame.record) continue;
        clock.lap(transform_stage);
        k.run_jobs(tables, jobs, worker.masks.data());
        clock.lap(raster_stage);
        if (frame.record) record_visible(frame, slice, receivers, c, batch.valid, worker);
    }
    if (frame.quality.paper) mark_vicinity(slice, receivers, batch, false, worker);
    k.run_jobs(tables, jobs, worker.masks.data());
    end_batch(frame, slice, receivers, count, batch, inside, selected, worker, clock);
}

bool is_mirrored(const Batch& front, const Batch& behind) {
    if (front.valid != behind.valid) return false;
    for (uint32_t lane = 0; lane < lanes; ++lane) {
        if (!(front.valid >> lane & 1)) continue;
        for (uint32_t k = 0; k < 3; ++k) {
            if (front.axis[0][k][lane] != behind.axis[0][k][lane] ||
                front.axis[1][k][lane] != -behind.axis[1][k][lane] ||
                front.axis[2][k][lane] != -behind.axis[2][k][lane])
                return false;
        }
    }
    return true;
}

void shadow_both(Frame& frame, const MeshSlice* const slices[2], const uint32_t* receivers, uint32_t count,
                 Batch* const batches[2], const uint32_t* candidates, uint32_t candidate_count,
                 Worker& worker, StageClock& clock) {
    const Kernels& k = *frame.kernels;
    const Tables& tables = *frame.tables;
    const size_t bytes = size_t(lanes) * mask_bytes(tables.layout);
    uint8_t* const masks = worker.masks.data();
    uint32_t inside[2];
    for (uint32_t side = 2; side-- > 0;) {
        inside[side] = begin_batch(frame, *slices[side], receivers, count, *batches[side], worker, clock);
        if (side == 1) std::memcpy(masks + bytes, masks, bytes);
    }
    ReceiverBounds bounds = batches[0]->bounds;
    bounds.cone_cos = -1; // next to nothing lies below all horizons of both sides
    const uint32_t selected = batches[0]->valid | batches[1]->valid
                                  ? select_for(frame, bounds, candidates, candidate_count, worker)
                                  : 0;
    clock.lap(cull_stage);
    JobList jobs = job_list(worker);
    for (uint32_t i = 0; i < selected; ++i) {
        const uint32_t c = worker.selected[i];
        const MeshSlice& blocker = frame.meshes[frame.cluster_mesh[c]];
        k.both_sides_jobs(*batches[0], *batches[1], frame.views[c],
                          frame.points.data() + 4 * size_t(blocker.first_point), tables.layout,
                          tables.horizon, worker.scratch[0], jobs, worker.tally.counters);
        if (jobs.count < job_flush) continue;
        clock.lap(transform_stage);
        k.run_jobs(tables, jobs, masks);
        clock.lap(raster_stage);
    }
    clock.lap(transform_stage);
    k.run_jobs(tables, jobs, masks);
    for (uint32_t side = 0; side < 2; ++side) {
        if (side == 1) std::memcpy(masks, masks + bytes, bytes);
        end_batch(frame, *slices[side], receivers, count, *batches[side], inside[side], selected, worker,
                  clock);
    }
}

void open_batch(const Frame& frame, const MeshSlice& slice, const uint32_t* receivers, uint32_t count,
                const Batch& batch, Worker& worker, StageClock& clock) {
    const size_t masks = frame.fades ? 1 + fade_digits : 1;
    std::memset(worker.masks.data(), 0, masks * lanes * mask_bytes(frame.tables->layout));
    finish_batch(frame, slice, batch, worker, clock);
    store_batch(frame, slice, receivers, count, worker);
    store_outputs(frame, slice, receivers, count, batch, worker);
    clock.lap(rotate_stage);
}

} // namespace nusselt
