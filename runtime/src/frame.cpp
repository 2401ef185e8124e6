#include "context_data.h"
#include "falloff.h"
#include "far.h"
#include "gloss.h"
#include "history.h"
#include "inside.h"
#include "jobs/float_environment.h"
#include "kernels/prepare.h"
#include "layout.h"
#include "plan.h"
#include "shared_tables.h"
#include "visible_set.h"

#include <algorithm>
#include <bit>
#include <chrono>
#include <cstring>
#include <ctime>

namespace nusselt {

namespace {

// The streams of a mesh, and what they need beside.
Status check_outputs(const FrameMesh& m, const FrameDesc& desc, const QualitySettings& quality) {
    const auto bad = [](const char* text) { return Status{StatusCode::invalid_argument, text}; };
    if (m.output_count > 0 && !m.outputs)
        return bad("no frame started: outputs are counted but null; give output_count of them");
    for (uint32_t k = 0; k < m.output_count; ++k) {
        const Output& output = m.outputs[k];
        if (const Status status = check_output(output); !status.ok()) return status;
        if (output.kind == OutputKind::glossy && !m.gloss)
            return bad("no frame started: an output is glossy, but the mesh has no gloss; give one");
        if (output.kind == OutputKind::radiance && !desc.light)
            return bad("no frame started: an output is radiance, but the frame has no light; give one");
        if (output.kind == OutputKind::direct &&
            (!desc.environment || desc.environment->mask_bits != kernels::mask_bits(quality.layout)))
            return bad(
                "no frame started: an output is direct light, but the frame has no environment, or one for "
                "masks of other bits; make one with the quality's mask bits");
        if (desc.history.generation != 0 && (is_from_masks(output.kind, m.gloss) || desc.order < 5))
            return bad(
                "no frame started: a history keeps transfer vectors, but an output wants masks (glossy, "
                "direct) or bands that the order lacks; use order 5 and other outputs, or no history");
    }
    return m.gloss ? check_gloss(*m.gloss) : Status{};
}

// What a frame is to write of one side of a mesh.
Status check_results(const FrameMesh& m, const FrameDesc& desc, const QualitySettings& quality) {
    const auto bad = [](const char* text) { return Status{StatusCode::invalid_argument, text}; };
    if (m.transfer.data &&
        (m.transfer.stride < size_t(4) * desc.order * desc.order || m.transfer.stride % 4 != 0))
        return bad("no frame started: the transfer stride is too small for the order (100 bytes for 5), or "
                   "no multiple of 4; strides are in bytes");
    if (m.masks.data && (m.masks.stride < kernels::mask_bytes(quality.layout) || m.masks.stride % 4 != 0))
        return bad("no frame started: the mask stride is too small for the quality, or no multiple of 4; "
                   "quality_mask_bits tells the size");
    if (const Status status = check_outputs(m, desc, quality); !status.ok()) return status;
    if (m.masks.data && !receives(m))
        return bad("no frame started: masks without transfer or outputs; a side of a mesh that receives has "
                   "one of them");
    return {};
}

Status check(const FrameDesc& desc) {
    const auto bad = [](const char* text) { return Status{StatusCode::invalid_argument, text}; };
    const QualitySettings* quality = quality_settings(desc.quality);
    if (!quality) return bad("no frame started: unknown quality; use one of nusselt::Quality");
    if (!desc.meshes || desc.mesh_count == 0)
        return bad("no frame started: it has no meshes; give at least one");
    if (desc.order < 1 || desc.order > 5)
        return bad(
            "no frame started: the order is not one of 1 to 5; it is the number of bands, 5 for all 25 "
            "terms");
    if (desc.watertight && (desc.quality == Quality::paper || desc.falloff.to > 0))
        return bad(
            "no frame started: watertight masks with quality paper or a falloff, which know none; leave "
            "one of them out");
    const bool history = desc.history.generation != 0;
    if (desc.same_pose && !history)
        return bad("no frame started: same_pose without a history; give the one that knows the pose");
    if (!(desc.budget_us >= 0 && desc.budget_us <= 1e9f))
        return bad("no frame started: the budget is negative, not a number or over 1000 s; it is in "
                   "microseconds, 0 for none");
    if (desc.budget_us > 0 && !history)
        return bad("no frame started: a budget without a history; give one, it keeps the results of those "
                   "that wait");
    if (desc.origin && !(kernels::is_finite(desc.origin[0]) && kernels::is_finite(desc.origin[1]) &&
                         kernels::is_finite(desc.origin[2])))
        return bad("no frame started: the origin is not finite; give none to have one chosen");
    for (uint32_t i = 0; i < desc.mesh_count; ++i) {
        const FrameMesh& m = desc.meshes[i];
        if (!desc.same_pose && (!m.positions.data || !m.normals.data))
            return bad(
                "no frame started: a mesh has no positions or no normals; both are needed every frame");
        if (!desc.same_pose && (m.positions.stride < 12 || m.positions.stride % 4 != 0 ||
                                m.normals.stride < 12 || m.normals.stride % 4 != 0))
            return bad(
                "no frame started: a stride is under 12 bytes or no multiple of 4; strides are in bytes");
        if (const Status status = check_results(m, desc, *quality); !status.ok()) return status;
        if (const Status status = check_results(turned_over(m), desc, *quality); !status.ok()) return status;
        for (uint32_t k = 0; k < i; ++k) {
            if (desc.meshes[k].mesh.slot == m.mesh.slot)
                return bad("no frame started: a mesh is in it twice; add it twice to draw it twice");
        }
    }
    if (const Status status = check_visible_set(desc); !status.ok()) return status;
    return check_falloff(desc);
}

bool results_fit(const FrameMesh& m, size_t count) {
    return std::all_of(m.outputs, m.outputs + m.output_count,
                       [=](const Output& output) { return output.count == count; }) &&
           (!m.transfer.data || m.transfer.count == count) && (!m.masks.data || m.masks.count == count);
}

bool counts_fit(const FrameMesh& m, bool same_pose, const MeshData& data) {
    const size_t count = data.vertex_count;
    return (same_pose || (m.positions.count == count && m.normals.count == count)) && results_fit(m, count) &&
           results_fit(turned_over(m), count);
}

// The caller's, or the first finite position: then an exact translation of everything changes nothing.
void choose_origin(Frame& frame, const float* wanted) {
    if (wanted) {
        std::copy(wanted, wanted + 3, frame.origin);
        return;
    }
    const jobs::FloatEnvironment environment; // comparing what is not a number may trap in the host's
    for (uint32_t k = 0; k < 3; ++k)
        frame.origin[k] = 0;
    for (const MeshSlice& s : frame.meshes) {
        for (size_t v = 0; v < s.in.positions.count; ++v) {
            const float* p = element(s.in.positions, v);
            if (!kernels::is_finite(p[0]) || !kernels::is_finite(p[1]) || !kernels::is_finite(p[2])) continue;
            std::copy(p, p + 3, frame.origin);
            return;
        }
    }
}

// A frame that is not in flight and of no history, made if there is none. The guard is held. Throws
// std::bad_alloc.
Frame& free_frame(Context& context, uint32_t& slot) {
    for (slot = 0; slot < context.frames.size(); ++slot) {
        const Frame& frame = *context.frames[slot];
        if (!frame.in_flight && !frame.has_history) return *context.frames[slot];
    }
    context.frames.reserve(context.frames.size() + 1);
    Frame* frame = make<Frame>(context.allocator, context.allocator);
    frame->generation = frame->history.generation = first_generation(context);
    context.frames.push_back(frame);
    return *frame;
}

// The frame of that history, or null. The guard is held.
Frame* find_history(Context& context, HistoryId id) {
    Frame* const frame = id.slot < context.frames.size() ? context.frames[id.slot] : nullptr;
    return frame && frame->has_history && frame->history.generation == id.generation ? frame : nullptr;
}

constexpr uint32_t most_workers = 256; // each has scratch memory of its own

// One that is in no frame, made if there is none. The guard is held. Throws std::bad_alloc.
Crew& free_crew(Context& context) {
    for (Crew* crew : context.crews) {
        if (!crew->in_use && crew->graph) return *crew;
    }
    const uint32_t workers = std::clamp(context.executor.concurrency, 1u, most_workers);
    const jobs::GraphLimits limits{most_stages, most_stages - 1, workers, 0};
    context.crews.reserve(context.crews.size() + 1);
    Crew* const crew = make<Crew>(context.allocator, context.allocator);
    context.crews.push_back(crew);
    crew->graph_memory.resize(jobs::graph_bytes(limits));
    crew->workers.reserve(workers + 1);
    while (crew->workers.size() < workers + 1)
        crew->workers.emplace_back(context.allocator);
    crew->graph = jobs::create_graph(crew->graph_memory.data(), crew->graph_memory.size(), limits);
    return *crew;
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
    for (const Worker& w : frame.crew->workers) {
        const Tally& t = w.tally;
        stats.receivers_computed += t.receivers_computed;
        stats.receivers_copied += t.receivers_copied;
        stats.receivers_inside += t.receivers_inside;
        stats.receivers_reused += t.receivers_reused;
        stats.receivers_stale += t.receivers_stale;
        stats.receivers_unshadowed += t.receivers_unshadowed;
        stats.stale_frames_max = std::max(stats.stale_frames_max, t.stale_frames_max);
        stats.stale_frames_mean += double(t.stale_frames_sum);
        stats.clusters_kept += t.clusters_kept;
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
    stats.stale_frames_mean /= std::max(stats.receivers_stale, 1u);
    for (const MeshSlice& s : frame.meshes) {
        if (!receives(s.in)) continue;
        const uint32_t needed = needed_count(s);
        stats.receivers += needed;
        stats.receivers_unneeded += s.mesh->vertex_count - needed;
    }
    stats.threads = jobs::threads(*frame.crew->graph);
    stats.wall_ms = elapsed * 1e-6;
    stats.refit_ms = stage_ms[refit_stage];
    stats.cull_ms = stage_ms[cull_stage];
    stats.transform_ms = stage_ms[transform_stage];
    stats.raster_ms = stage_ms[raster_stage];
    stats.integrate_ms = stage_ms[integrate_stage];
    stats.rotate_ms = stage_ms[rotate_stage];
}

// The handles of the frame, and what depends on the objects behind them. The guard is held.
Status check_handles(Context& context, const FrameDesc& desc) {
    for (uint32_t i = 0; i < desc.mesh_count; ++i) {
        const MeshSlot* slot = find_mesh(context, desc.meshes[i].mesh);
        if (!slot)
            return {StatusCode::stale_handle, "no frame started: a mesh handle is not of this context; it "
                                              "was removed, or is another context's"};
        if (slot->frames > 0)
            return {StatusCode::busy,
                    "no frame started: a mesh is in another frame in flight; wait for that one first"};
        if (!counts_fit(desc.meshes[i], desc.same_pose, *slot->data))
            return {StatusCode::invalid_argument, "no frame started: an array of a mesh has another count "
                                                  "than its vertices; give one element each"};
        if (const Status status = check_visible_meshes(desc, i, *slot->data); !status.ok()) return status;
    }
    if (desc.history.generation == 0) return {};
    const Frame* frame = find_history(context, desc.history);
    if (!frame)
        return {StatusCode::stale_handle, "no frame started: the history is not of this context; it was "
                                          "removed, or is another context's"};
    if (frame->in_flight)
        return {StatusCode::busy,
                "no frame started: its history is in another frame in flight; wait for that one first"};
    if (desc.same_pose && !(frame->history.pose_whole && is_same_group(*frame, desc)))
        return {
            StatusCode::invalid_argument,
            "no frame started: same_pose, but the history's last frame was cancelled or of another group, "
            "quality or set of arrays; give positions and normals"};
    return {};
}

// The descriptions of all streams, so that the caller's may go away.
void copy_outputs(Frame& frame) {
    size_t count = 0;
    for (const MeshSlice& s : frame.meshes)
        count += s.in.output_count;
    frame.outputs.resize(count);
    uint32_t next = 0;
    for (MeshSlice& s : frame.meshes) {
        if (s.in.gloss) {
            s.gloss = *s.in.gloss;
            s.in.gloss = &s.gloss;
        }
        s.first_output = next;
        for (uint32_t k = 0; k < s.in.output_count; ++k)
            frame.outputs[next++] = make_stream(s.in.outputs[k]);
    }
}

// The tables that outputs made from masks want, or null where there are none. Throws std::bad_alloc.
const kernels::CellTables* cells_of(Context& context, Quality quality, const Frame& frame) {
    const auto wants = [](const OutputStream& s) { return s.encoding.quantity >= kernels::Quantity::glossy; };
    if (std::none_of(frame.outputs.begin(), frame.outputs.end(), wants)) return nullptr;
    CellMemory& cells = context.cells[static_cast<uint32_t>(quality)];
    if (cells.memory.empty()) {
        const jobs::FloatEnvironment environment;
        Vector<kernels::SampleBit> samples(kernels::mask_bits(frame.quality.layout), {},
                                           HostAllocator<kernels::SampleBit>(context.allocator));
        cells.memory.resize(kernels::cell_table_size(frame.quality.layout));
        cells.tables = kernels::build_cell_tables(frame.quality.layout, frame.tables->scale, samples.data(),
                                                  cells.memory.data());
    }
    return &cells.tables;
}

// The samples' directions, or null where nothing fades. Throws std::bad_alloc.
const float* fade_directions_of(Context& context, Quality quality, const Frame& frame) {
    if (!frame.fades) return nullptr;
    Vector<float>& directions = context.fade_directions[static_cast<uint32_t>(quality)];
    if (directions.empty()) {
        const jobs::FloatEnvironment environment;
        directions.resize(kernels::fade_directions_size(frame.quality.layout));
        kernels::build_fade_directions(frame.quality.layout, directions.data());
    }
    return directions.data();
}

// The caller's meshes and their backs. Throws std::bad_alloc.
void gather_meshes(const Context& context, const FrameDesc& desc, Frame& frame) {
    const auto* const first = desc.meshes;
    const auto backs =
        std::count_if(first, first + desc.mesh_count, [](const FrameMesh& m) { return receives(m.back); });
    frame.mesh_count = desc.mesh_count;
    frame.meshes.resize(desc.mesh_count + static_cast<size_t>(backs));
    uint32_t back = desc.mesh_count;
    for (uint32_t i = 0; i < desc.mesh_count; ++i) {
        const MeshData* const data = context.meshes[first[i].mesh.slot].data;
        MeshSlice& slice = frame.meshes[i];
        slice.mesh = data;
        slice.in = first[i];
        slice.is_back = false;
        if (!receives(first[i].back)) continue;
        MeshSlice& other = frame.meshes[back++];
        other.mesh = data;
        other.in = turned_over(first[i]);
        other.is_back = true;
    }
    for (MeshSlice& s : frame.meshes) {
        const auto from_masks = [&](const Output& output) { return is_from_masks(output.kind, s.in.gloss); };
        s.masks_alone = !s.in.transfer.data && !frame.has_history &&
                        std::all_of(s.in.outputs, s.in.outputs + s.in.output_count, from_masks);
    }
}

// Which meshes look far, and the table for it. Throws std::bad_alloc.
const float* far_table_of(Context& context, Quality quality, Frame& frame) {
    bool any = false;
    for (MeshSlice& s : frame.meshes) {
        s.looks_far = receives(s.in) && may_look_far(frame, s);
        any = any || s.looks_far;
    }
    if (!any) return nullptr;
    Vector<float>& table = context.far[static_cast<uint32_t>(quality)].table;
    if (table.empty()) {
        const jobs::FloatEnvironment environment;
        table.resize(far_table_size(frame.quality.layout));
        build_far_table(frame.quality.layout, table.data());
    }
    return table.data();
}

// All that may fail for want of memory; the guard is held.
void set_up(Context& context, const FrameDesc& desc, Frame& frame) {
    if (frame.has_history) compare_group(frame, desc);
    frame.crew = &free_crew(context);
    frame.workers = frame.crew->workers.data();
    frame.quality = *quality_settings(desc.quality);
    frame.order = desc.order;
    frame.watertight = desc.watertight;
    frame.kernels = context.kernels;
    frame.output_kernels = context.output_kernels;
    frame.light_kernels = context.light_kernels;
    frame.fading_kernels = context.fading_kernels;
    frame.environment = desc.environment;
    frame.visible = desc.visible;
    frame.record = desc.record;
    frame.visible_segment = desc.visible_segment;
    frame.falloff = desc.falloff;
    frame.fades = desc.falloff.to > 0;
    if (desc.light) std::copy(desc.light, desc.light + 75, frame.light);
    frame.profiler = &context.profiler;
    frame.clock = &context.clock;
    frame.budget_ns = static_cast<uint64_t>(double(desc.budget_us) * 1000);
    gather_meshes(context, desc, frame);
    copy_outputs(frame);
    frame.cells = cells_of(context, desc.quality, frame);
    frame.fade_directions = fade_directions_of(context, desc.quality, frame);
    lay_out(frame);
    frame.far_table = far_table_of(context, desc.quality, frame);
    grow(frame);
    if (desc.record) begin_recording(desc);
    if (!frame.has_history) return;
    meet_history(frame, desc);
    for (MeshSlice& s : frame.meshes) {
        if (!desc.same_pose) continue;
        s.in.positions = {};
        s.in.normals = {};
        if (receives(s.in))
            s.in.normals = {frame.history.normals.data() + 3 * size_t(s.first_vertex), s.mesh->vertex_count,
                            12};
    }
}

} // namespace

const MeshSlice& slice_of(std::span<const MeshSlice> slices, uint32_t MeshSlice::*first, uint32_t item) {
    size_t low = 0, high = slices.size();
    while (high - low > 1) {
        const size_t middle = (low + high) / 2;
        (slices[middle].*first <= item ? low : high) = middle;
    }
    return slices[low];
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

uint64_t clock_nanoseconds(const Frame& frame) {
    const Clock& clock = *frame.clock;
    return clock.nanoseconds ? clock.nanoseconds(clock.user) : static_cast<uint64_t>(nanoseconds_now());
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
    std::unique_lock lock(context->guard);
    if (const Status status = check_handles(*context, desc); !status.ok()) return status;
    Frame* frame = nullptr;
    try {
        uint32_t slot = desc.history.slot;
        frame = desc.history.generation ? context->frames[slot] : &free_frame(*context, slot);
        frame->tables = tables_of(*context, desc.quality);
        if (frame->tables) choose_oblique(frame->tables->layout, frame->oblique);
        if (!frame->tables)
            return {StatusCode::out_of_memory,
                    "no frame started: no memory for the tables; free some and try again"};
        set_up(*context, desc, *frame);
        *out = {slot, frame->generation};
    } catch (const std::bad_alloc&) {
        return {StatusCode::out_of_memory,
                "no frame started: the allocator gave no memory; free some and try again"};
    }
    for (MeshSlice& s : frame->meshes)
        s.checksum = checked ? checksum(s.in) : 0;
    connect(*frame);
    if (!desc.same_pose) choose_origin(*frame, desc.origin);
    plan(*frame);
    for (Worker& w : frame->crew->workers)
        w.tally = {};
    for (const MeshSlice& s : frame->meshes)
        ++context->meshes[s.in.mesh.slot].frames;
    frame->cancelled.store(false, std::memory_order_relaxed);
    frame->crew->in_use = true;
    frame->in_flight = true;
    lock.unlock(); // an executor may run everything here and now
    frame->start_ns = nanoseconds_now();
    frame->start_ticks = ticks_now();
    jobs::start(*frame->crew->graph, context->executor);
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
    *done = jobs::done(*frame->crew->graph);
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
    jobs::wait(*frame->crew->graph);
    if (stats) report(*frame, *stats);
    bool changed = false;
    for (const MeshSlice& s : frame->meshes)
        changed = changed || (checked && checksum(s.in) != s.checksum);
    const std::lock_guard lock(context->guard);
    release_meshes(*context, *frame);
    if (frame->has_history) frame->history.pose_whole = !frame->cancelled.load(std::memory_order_relaxed);
    frame->crew->in_use = false;
    ++frame->generation;
    frame->in_flight = frame->waited_for = false;
    if (changed)
        return {StatusCode::changed,
                "the frame is done, with results of no pose: positions or normals were written while it was "
                "in flight; write them after wait, or use a second buffer"};
    return {};
}

Status create_history(Context* context, HistoryId* out) {
    if (!context || !out)
        return {StatusCode::invalid_argument,
                "no history made: context or out is null; make one with create_context"};
    *out = {};
    const std::lock_guard lock(context->guard);
    try {
        uint32_t slot = 0;
        Frame& frame = free_frame(*context, slot);
        frame.has_history = true;
        *out = {slot, frame.history.generation};
    } catch (const std::bad_alloc&) {
        return {StatusCode::out_of_memory,
                "no history made: the allocator gave no memory; free some and try again"};
    }
    return {};
}

Status remove_history(Context* context, HistoryId id) {
    if (!context)
        return {StatusCode::invalid_argument,
                "nothing removed: the context is null; pass the one that made the history"};
    const std::lock_guard lock(context->guard);
    Frame* frame = find_history(*context, id);
    if (!frame)
        return {StatusCode::stale_handle,
                "nothing removed: no history of this context has that handle; it was removed before"};
    if (frame->in_flight)
        return {StatusCode::busy, "history not removed: a frame in flight uses it; wait for the frame first"};
    const uint32_t generation = frame->generation, history_generation = frame->history.generation;
    frame->~Frame(); // its memory goes back now; the slot becomes that of a frame without a history
    frame = new (frame) Frame(context->allocator);
    frame->generation = generation + 1;
    frame->history.generation = history_generation + 1;
    return {};
}

} // namespace nusselt
