#include "context_data.h"
#include "jobs/float_environment.h"
#include "kernels/prepare.h"
#include "refit.h"
#include "regions.h"
#include "shared_tables.h"

#include <algorithm>
#include <bit>
#include <chrono>
#include <cstring>
#include <ctime>

namespace nusselt {

namespace {

Status check(const FrameDesc& desc) {
    const auto bad = [](const char* text) { return Status{StatusCode::invalid_argument, text}; };
    const QualitySettings* quality = quality_settings(desc.quality);
    if (!quality) return bad("no frame started: unknown quality; use one of nusselt::Quality");
    if (!desc.meshes || desc.mesh_count == 0)
        return bad("no frame started: it has no meshes; give at least one");
    for (uint32_t i = 0; i < desc.mesh_count; ++i) {
        const FrameMesh& m = desc.meshes[i];
        if (!m.positions.data || !m.normals.data)
            return bad(
                "no frame started: a mesh has no positions or no normals; both are needed every frame");
        if (m.positions.stride < 12 || m.positions.stride % 4 != 0 || m.normals.stride < 12 ||
            m.normals.stride % 4 != 0)
            return bad(
                "no frame started: a stride is under 12 bytes or no multiple of 4; strides are in bytes");
        if (m.transfer.data && (m.transfer.stride < 100 || m.transfer.stride % 4 != 0))
            return bad("no frame started: the transfer stride is under 100 bytes or no multiple of 4; "
                       "strides are in bytes");
        if (m.masks.data &&
            (m.masks.stride < kernels::mask_bytes(quality->layout) || m.masks.stride % 4 != 0))
            return bad("no frame started: the mask stride is too small for the quality, or no multiple of 4; "
                       "quality_mask_bits tells the size");
        if (m.masks.data && !m.transfer.data)
            return bad("no frame started: masks without transfer; a mesh that receives needs both");
        for (uint32_t k = 0; k < i; ++k) {
            if (desc.meshes[k].mesh.slot == m.mesh.slot)
                return bad("no frame started: a mesh is in it twice; add it twice to draw it twice");
        }
    }
    return {};
}

bool counts_fit(const FrameMesh& m, const MeshData& data) {
    const size_t count = data.vertex_count;
    return m.positions.count == count && m.normals.count == count &&
           (!m.transfer.data || m.transfer.count == count) && (!m.masks.data || m.masks.count == count);
}

// Small frames are cut finer, so that threads end together: of 128 pieces the last one makes two threads wait
// for less than a hundredth. Not below two batches: what nobody needs is packed away within a region.
uint32_t region_size(const Frame& frame) {
    size_t receivers = 0;
    for (const MeshSlice& s : frame.meshes)
        receivers += s.in.transfer.data ? s.mesh->receivers.size() : 0;
    const size_t batches = receivers / (128 * kernels::lanes);
    return static_cast<uint32_t>(std::clamp<size_t>(batches, 2, region_batches)) * kernels::lanes;
}

// Where each mesh's part of the frame's arrays begins, and the arrays' sizes.
void lay_out(Frame& frame) {
    frame.point_count = frame.point_chunks = frame.cluster_count = 0;
    frame.triangle_bounds_count = 0;
    frame.region_count = frame.duplicate_chunks = 0;
    frame.region_size = region_size(frame);
    const auto regions = [&](uint32_t receivers) {
        return (receivers + frame.region_size - 1) / frame.region_size;
    };
    for (MeshSlice& s : frame.meshes) {
        const uint32_t points = static_cast<uint32_t>(s.mesh->weld_source.size());
        s.clusters = frame.quality.paper ? &s.mesh->coarse_clusters : &s.mesh->clusters;
        s.first_point = frame.point_count;
        s.first_point_chunk = frame.point_chunks;
        s.first_cluster = frame.cluster_count;
        s.first_region = frame.region_count;
        s.first_duplicate_chunk = frame.duplicate_chunks;
        const bool receives = s.in.transfer.data != nullptr;
        const uint32_t receivers = receives ? static_cast<uint32_t>(s.mesh->receivers.size()) : 0;
        const uint32_t duplicates = receives ? static_cast<uint32_t>(s.mesh->duplicates.size()) : 0;
        s.first_own_region = s.first_region + regions(receivers);
        frame.point_count += points;
        frame.point_chunks += (points + point_chunk - 1) / point_chunk;
        frame.cluster_count += s.clusters->count();
        for (uint32_t c = 0; c < s.clusters->count(); ++c) {
            const uint32_t triangles = s.clusters->triangle_begin[c + 1] - s.clusters->triangle_begin[c];
            frame.triangle_bounds_count += 8 * kernels::triangle_slots(triangles);
        }
        frame.region_count = s.first_own_region + regions(duplicates);
        frame.duplicate_chunks += (duplicates + kernels::lanes - 1) / kernels::lanes;
    }
}

// Grows what is too small; a frame no larger than the largest so far allocates nothing.
void grow(Frame& frame) {
    frame.extents.resize(frame.point_chunks);
    frame.points.resize(4 * size_t(frame.point_count));
    for (uint32_t k = 0; k < 3; ++k) {
        frame.centre[k].resize(frame.cluster_count);
        frame.cone[k].resize(frame.cluster_count);
    }
    frame.radius.resize(frame.cluster_count);
    frame.cone_cos.resize(frame.cluster_count);
    frame.cone_sin.resize(frame.cluster_count);
    frame.triangle_radius.resize(frame.cluster_count);
    frame.nearest.resize(frame.cluster_count);
    frame.farthest.resize(frame.cluster_count);
    frame.level_errors.resize(frame.cluster_count);
    frame.views.resize(frame.cluster_count);
    frame.cluster_mesh.resize(frame.cluster_count);
    frame.cluster_bounds_begin.resize(frame.cluster_count);
    frame.triangle_bounds.resize(frame.triangle_bounds_count);
    const size_t job_capacity = job_flush + kernels::jobs_per_cluster + 64;
    for (Worker& w : frame.workers) {
        w.scratch.resize(1);
        w.masks.resize(size_t(kernels::lanes) * kernels::mask_bytes(frame.quality.layout));
        w.jobs.resize(4 * job_capacity);
        if (frame.quality.paper) w.near.resize(frame.point_count, 0);
        w.candidates.resize(frame.cluster_count + 16);
        w.selected.resize(frame.cluster_count + 16);
    }
}

// What does not change with the positions: every cluster's view of its mesh.
void connect(Frame& frame) {
    uint32_t bounds = 0;
    for (uint32_t m = 0; m < frame.meshes.size(); ++m) {
        const MeshSlice& s = frame.meshes[m];
        const Clusters& k = *s.clusters;
        for (uint32_t i = 0; i < k.count(); ++i) {
            const uint32_t c = s.first_cluster + i;
            const uint32_t triangle = k.triangle_begin[i];
            frame.cluster_mesh[c] = m;
            frame.cluster_bounds_begin[c] = bounds;
            kernels::ClusterView& view = frame.views[c];
            view.vertices = k.vertices.data() + k.vertex_begin[i];
            view.edges = reinterpret_cast<const uint8_t*>(k.edges.data() + k.edge_begin[i]);
            view.triangles = reinterpret_cast<const uint8_t*>(k.triangles.data() + triangle);
            view.vertex_count = k.vertex_begin[i + 1] - k.vertex_begin[i];
            view.edge_count = k.edge_begin[i + 1] - k.edge_begin[i];
            view.triangle_count = k.triangle_begin[i + 1] - triangle;
            view.two_sided = k.two_sided[i];
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
                            frame.cluster_count};
}

// The first finite position: then an exact translation of everything changes nothing.
void choose_origin(Frame& frame) {
    const jobs::FloatEnvironment environment; // comparing what is not a number may trap in the host's
    for (uint32_t k = 0; k < 3; ++k)
        frame.origin[k] = 0;
    for (const MeshSlice& s : frame.meshes) {
        for (size_t v = 0; v < s.in.positions.count; ++v) {
            const float* p = reinterpret_cast<const float*>(
                reinterpret_cast<const char*>(s.in.positions.data) + v * s.in.positions.stride);
            if (!kernels::is_finite(p[0]) || !kernels::is_finite(p[1]) || !kernels::is_finite(p[2])) continue;
            std::copy(p, p + 3, frame.origin);
            return;
        }
    }
}

using Work = void (*)(void* context, uint32_t begin, uint32_t end, uint32_t slot);

// A stage's work with its processor time.
template<Work work, const auto& zone_name>
void timed(void* context, uint32_t begin, uint32_t end, uint32_t slot) {
    Frame& frame = *static_cast<Frame*>(context);
    // Seen by one task, it is seen by all that follow it in the graph: no stage works on a skipped one's
    // data.
    if (frame.cancelled.load(std::memory_order_relaxed)) return;
    const Zone zone(*frame.profiler, zone_name);
    Tally& tally = frame.workers[slot].tally;
    const double start = thread_cpu_nanoseconds();
    work(context, begin, end, slot);
    tally.cpu_ns += thread_cpu_nanoseconds() - start;
}

// The same for the stages before the receivers', which keep their own account of stages.
template<Work work, const auto& zone_name>
void timed_refit(void* context, uint32_t begin, uint32_t end, uint32_t slot) {
    Tally& tally = static_cast<Frame*>(context)->workers[slot].tally;
    const uint64_t start = ticks_now();
    timed<work, zone_name>(context, begin, end, slot);
    tally.ticks[refit_stage] += ticks_now() - start;
}

// Names as a host's profiler shows them; arrays, because a template takes no literal.
constexpr char extents_zone[] = "nusselt extents";
constexpr char scale_zone[] = "nusselt scale";
constexpr char points_zone[] = "nusselt points";
constexpr char clusters_zone[] = "nusselt clusters";
constexpr char bands_zone[] = "nusselt bands";
constexpr char receivers_zone[] = "nusselt receivers";
constexpr char duplicates_zone[] = "nusselt duplicates";

void plan(Frame& frame) {
    jobs::Graph& graph = *frame.graph;
    jobs::clear(graph);
    uint32_t last = jobs::no_node;
    const auto stage = [&](const char* name, Work work, uint32_t items, uint32_t grain) {
        const uint32_t node = jobs::add_node(graph, {name, work, &frame, items, grain});
        if (last != jobs::no_node) jobs::add_edge(graph, last, node);
        last = node;
    };
    stage(extents_zone, timed_refit<measure_extents, extents_zone>, frame.point_chunks, 1);
    stage(scale_zone, timed_refit<choose_scale, scale_zone>, 1, 1);
    stage(points_zone, timed_refit<place_points, points_zone>, frame.point_chunks, 1);
    stage(clusters_zone, timed_refit<refit_clusters, clusters_zone>, frame.cluster_count, 16);
    stage(bands_zone, timed_refit<choose_bands, bands_zone>, static_cast<uint32_t>(frame.meshes.size()), 1);
    stage(receivers_zone, timed<shadow_regions, receivers_zone>, frame.region_count, 1);
    stage(duplicates_zone, timed<copy_duplicates, duplicates_zone>, frame.duplicate_chunks, 16);
}

constexpr uint32_t stages = 7;

// A frame that is not in flight, made if there is none. The guard is held. Throws std::bad_alloc.
Frame& free_frame(Context& context, uint32_t& slot) {
    for (slot = 0; slot < context.frames.size(); ++slot) {
        if (!context.frames[slot]->in_flight) return *context.frames[slot];
    }
    context.frames.reserve(context.frames.size() + 1);
    Frame* frame = make<Frame>(context.allocator, context.allocator);
    frame->generation = first_generation(context);
    context.frames.push_back(frame);
    return *frame;
}

constexpr uint32_t most_workers = 256; // each has scratch memory of its own

void prepare_workers(Context& context, Frame& frame) {
    if (frame.graph) return;
    const uint32_t workers = std::clamp(context.executor.concurrency, 1u, most_workers);
    const jobs::GraphLimits limits{stages, stages - 1, workers, 0};
    frame.graph_memory.resize(jobs::graph_bytes(limits));
    jobs::Graph* graph = jobs::create_graph(frame.graph_memory.data(), frame.graph_memory.size(), limits);
    frame.workers.reserve(workers + 1);
    while (frame.workers.size() < workers + 1)
        frame.workers.emplace_back(context.allocator);
    frame.graph = graph;
}

const kernels::Tables* tables_of(Context& context, Quality quality) {
    const kernels::Tables*& tables = context.tables[static_cast<uint32_t>(quality)];
    if (!tables) tables = acquire_tables(quality);
    return tables;
}

void release_meshes(Context& context, const Frame& frame) {
    for (const MeshSlice& s : frame.meshes)
        --context.meshes[s.in.mesh.slot].frames;
}

// The frame in flight of that handle, or null. The guard is held.
Frame* find_frame(Context& context, FrameId id) {
    Frame* const frame = id.slot < context.frames.size() ? context.frames[id.slot] : nullptr;
    return frame && frame->generation == id.generation && frame->in_flight ? frame : nullptr;
}

#if defined(NUSSELT_CHECKED)
constexpr bool checked = true;
#else
constexpr bool checked = false;
#endif

// Of the bytes of positions and normals that a frame reads.
uint64_t checksum(const FrameMesh& mesh) {
    uint64_t hash = 0xCBF29CE484222325u;
    for (const Vec3View& view : {mesh.positions, mesh.normals}) {
        for (size_t i = 0; i < view.count; ++i) {
            uint32_t words[3];
            std::memcpy(words, reinterpret_cast<const char*>(view.data) + i * view.stride, sizeof(words));
            for (const uint32_t word : words)
                hash = (hash ^ word) * 0x100000001B3u;
        }
    }
    return hash;
}

uint32_t needed_count(const MeshSlice& slice) {
    const uint32_t count = slice.mesh->vertex_count;
    if (!slice.in.needed) return count;
    uint32_t needed = 0;
    for (uint32_t i = 0; i < count / 32; ++i)
        needed += static_cast<uint32_t>(std::popcount(slice.in.needed[i]));
    if (count % 32 == 0) return needed;
    const uint32_t used = (1u << count % 32) - 1; // the last word's other bits may be anything
    return needed + static_cast<uint32_t>(std::popcount(slice.in.needed[count / 32] & used));
}

void report(const Frame& frame, FrameStats& stats) {
    stats = {};
    const double elapsed = nanoseconds_now() - frame.start_ns;
    const double per_tick = elapsed / double(std::max<uint64_t>(ticks_now() - frame.start_ticks, 1)) * 1e-6;
    double stage_ms[6] = {};
    for (const Worker& w : frame.workers) {
        const Tally& t = w.tally;
        stats.receivers_computed += t.receivers_computed;
        stats.receivers_copied += t.receivers_copied;
        stats.receivers_invalid += t.receivers_invalid;
        stats.receivers_written += t.receivers_written;
        stats.clusters_tested += t.clusters_tested;
        stats.clusters_rasterized += t.clusters_rasterized;
        stats.triangles_considered += t.counters.triangles_considered;
        stats.triangles_rasterized += t.counters.triangles_rasterized;
        stats.fan_triangles += t.counters.fan_triangles;
        stats.blocks_uniform += t.counters.blocks_uniform;
        stats.blocks_partial += t.counters.blocks_partial;
        stats.triangles_invalid += t.triangles_invalid;
        stats.cpu_ms += t.cpu_ns * 1e-6;
        for (uint32_t i = 0; i < 6; ++i)
            stage_ms[i] += double(t.ticks[i]) * per_tick;
    }
    for (const MeshSlice& s : frame.meshes) {
        if (!s.in.transfer.data) continue;
        const uint32_t needed = needed_count(s);
        stats.receivers += needed;
        stats.receivers_unneeded += s.mesh->vertex_count - needed;
    }
    stats.threads = jobs::threads(*frame.graph);
    stats.wall_ms = elapsed * 1e-6;
    stats.refit_ms = stage_ms[refit_stage];
    stats.cull_ms = stage_ms[cull_stage];
    stats.transform_ms = stage_ms[transform_stage];
    stats.raster_ms = stage_ms[raster_stage];
    stats.integrate_ms = stage_ms[integrate_stage];
    stats.rotate_ms = stage_ms[rotate_stage];
}

} // namespace

const MeshSlice& slice_of(const Frame& frame, uint32_t MeshSlice::*first, uint32_t item) {
    size_t low = 0, high = frame.meshes.size();
    while (high - low > 1) {
        const size_t middle = (low + high) / 2;
        (frame.meshes[middle].*first <= item ? low : high) = middle;
    }
    return frame.meshes[low];
}

uint64_t ticks_now() {
#if defined(__x86_64__)
    return __builtin_ia32_rdtsc();
#else
    return static_cast<uint64_t>(nanoseconds_now());
#endif
}

double nanoseconds_now() {
    return static_cast<double>(std::chrono::duration_cast<std::chrono::nanoseconds>(
                                   std::chrono::steady_clock::now().time_since_epoch())
                                   .count());
}

double thread_cpu_nanoseconds() {
    timespec t{};
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
    return double(t.tv_sec) * 1e9 + double(t.tv_nsec);
}

Status submit(Context* context, const FrameDesc& desc, FrameId* out) {
    if (!context)
        return {StatusCode::invalid_argument,
                "no frame started: the context is null; make one with create_context"};
    if (!out)
        return {StatusCode::invalid_argument,
                "no frame started: out is null; pass where to write the handle"};
    *out = {};
    if (const Status status = check(desc); !status.ok()) return status;
    const Zone zone(context->profiler, "nusselt submit");
    Frame* frame = nullptr;
    std::unique_lock lock(context->guard);
    for (uint32_t i = 0; i < desc.mesh_count; ++i) {
        const MeshSlot* slot = find_mesh(*context, desc.meshes[i].mesh);
        if (!slot)
            return {StatusCode::stale_handle, "no frame started: a mesh handle is not of this context; it "
                                              "was removed, or is another context's"};
        if (slot->frames > 0)
            return {StatusCode::busy,
                    "no frame started: a mesh is in another frame in flight; wait for that one first"};
        if (!counts_fit(desc.meshes[i], *slot->data))
            return {StatusCode::invalid_argument, "no frame started: an array of a mesh has another count "
                                                  "than its vertices; give one element each"};
    }
    try {
        uint32_t slot = 0;
        frame = &free_frame(*context, slot);
        prepare_workers(*context, *frame);
        frame->quality = *quality_settings(desc.quality);
        frame->kernels = context->kernels;
        frame->profiler = &context->profiler;
        frame->tables = tables_of(*context, desc.quality);
        if (!frame->tables)
            return {StatusCode::out_of_memory,
                    "no frame started: no memory for the tables; free some and try again"};
        frame->meshes.resize(desc.mesh_count);
        for (uint32_t i = 0; i < desc.mesh_count; ++i) {
            frame->meshes[i].mesh = context->meshes[desc.meshes[i].mesh.slot].data;
            frame->meshes[i].in = desc.meshes[i];
        }
        lay_out(*frame);
        grow(*frame);
        *out = {slot, frame->generation};
    } catch (const std::bad_alloc&) {
        return {StatusCode::out_of_memory,
                "no frame started: the allocator gave no memory; free some and try again"};
    }
    for (MeshSlice& s : frame->meshes)
        s.checksum = checked ? checksum(s.in) : 0;
    connect(*frame);
    choose_origin(*frame);
    plan(*frame);
    for (Worker& w : frame->workers)
        w.tally = {};
    for (const MeshSlice& s : frame->meshes)
        ++context->meshes[s.in.mesh.slot].frames;
    frame->cancelled.store(false, std::memory_order_relaxed);
    frame->in_flight = true;
    lock.unlock(); // an executor may run everything here and now
    frame->start_ns = nanoseconds_now();
    frame->start_ticks = ticks_now();
    jobs::start(*frame->graph, context->executor);
    return {};
}

Status poll(Context* context, FrameId id, bool* done) {
    if (!context)
        return {StatusCode::invalid_argument, "nothing polled: the context is null; pass the one of submit"};
    if (!done)
        return {StatusCode::invalid_argument, "nothing polled: done is null; pass where to write the answer"};
    *done = false;
    const std::lock_guard lock(context->guard);
    const Frame* frame = find_frame(*context, id);
    if (!frame)
        return {StatusCode::stale_handle,
                "nothing polled: no frame in flight has that handle; it was waited for, and so is done"};
    *done = jobs::done(*frame->graph);
    return {};
}

Status cancel(Context* context, FrameId id) {
    if (!context)
        return {StatusCode::invalid_argument,
                "nothing cancelled: the context is null; pass the one of submit"};
    const std::lock_guard lock(context->guard);
    Frame* frame = find_frame(*context, id);
    if (!frame)
        return {StatusCode::stale_handle,
                "nothing cancelled: no frame in flight has that handle; it was waited for, and so is done"};
    frame->cancelled.store(true, std::memory_order_relaxed);
    return {};
}

Status wait(Context* context, FrameId id, FrameStats* stats) {
    if (!context)
        return {StatusCode::invalid_argument,
                "nothing waited for: the context is null; pass the one of submit"};
    const Zone zone(context->profiler, "nusselt wait");
    Frame* frame = nullptr;
    {
        const std::lock_guard lock(context->guard);
        frame = find_frame(*context, id);
        if (!frame)
            return {StatusCode::stale_handle,
                    "nothing waited for: no frame in flight has that handle; each is waited for once"};
        if (frame->waited_for)
            return {StatusCode::busy,
                    "nothing waited for: another thread waits for that frame; let one thread wait for each"};
        frame->waited_for = true;
    }
    jobs::wait(*frame->graph);
    if (stats) report(*frame, *stats);
    bool changed = false;
    for (const MeshSlice& s : frame->meshes)
        changed = changed || (checked && checksum(s.in) != s.checksum);
    const std::lock_guard lock(context->guard);
    release_meshes(*context, *frame);
    ++frame->generation;
    frame->in_flight = frame->waited_for = false;
    if (changed)
        return {StatusCode::changed,
                "the frame is done, with results of no pose: positions or normals were written while it was "
                "in flight; write them after wait, or use a second buffer"};
    return {};
}

} // namespace nusselt
