#include "nusselt/c.h"

#include "context_data.h"
#include "nusselt/nusselt.h"

#include <algorithm>
#include <cstring>

using namespace nusselt;

namespace {

static_assert(NUSSELT_C_VERSION == NUSSELT_VERSION);
static_assert(NUSSELT_CHANGED == static_cast<uint32_t>(StatusCode::changed));
static_assert(NUSSELT_ISA_NEON == static_cast<uint32_t>(Isa::neon) + 1);
static_assert(NUSSELT_QUALITY_FINE == static_cast<uint32_t>(Quality::fine) + 1);
static_assert(NUSSELT_OUTPUT_DIRECT == static_cast<uint32_t>(OutputKind::direct));
static_assert(NUSSELT_FORMAT_PACKED8 == static_cast<uint32_t>(OutputFormat::packed8));
static_assert(NUSSELT_BRDF_GGX == static_cast<uint32_t>(Brdf::ggx));
// The same structs in both languages: they are passed on as they are.
static_assert(sizeof(nusselt_mesh) == sizeof(MeshId) &&
              offsetof(nusselt_mesh, slot) == offsetof(MeshId, slot));
static_assert(sizeof(nusselt_material) == sizeof(Material));
static_assert(offsetof(nusselt_material, specular) == offsetof(Material, specular));
static_assert(offsetof(nusselt_material, exponent) == offsetof(Material, exponent));
static_assert(sizeof(nusselt_gloss) == sizeof(Gloss));
static_assert(offsetof(nusselt_gloss, materials) == offsetof(Gloss, materials));
static_assert(offsetof(nusselt_gloss, material_of) == offsetof(Gloss, material_of));
static_assert(sizeof(MeshInfo::level_triangles) == sizeof(nusselt_mesh_info::level_triangles));

nusselt_status c_status(const Status& status) {
    return {static_cast<uint32_t>(status.code), status.text};
}

nusselt_status bad(const char* text) {
    return {NUSSELT_INVALID_ARGUMENT, text};
}

// Of a struct: its size in this header, and as the caller wrote it.
nusselt_status check_size(size_t known, size_t given) {
    if (given < known)
        return bad(
            "nothing done: the size of a struct is too small; set its member size to sizeof the struct");
    if (given > known)
        return {NUSSELT_UNSUPPORTED,
                "nothing done: a struct is larger than this library knows; its header is "
                "newer, so compile with this library's header, or install a newer library"};
    return {NUSSELT_OK, "ok"};
}

Context* cpp(nusselt_context* context) {
    return reinterpret_cast<Context*>(context);
}
const Context* cpp(const nusselt_context* context) {
    return reinterpret_cast<const Context*>(context);
}
Vec3View cpp(const nusselt_vec3_view& v) {
    return {v.data, v.count, v.stride ? v.stride : 12};
}
TransferView cpp(const nusselt_transfer_view& v) {
    return {v.data, v.count, v.stride ? v.stride : 100};
}
MeshId cpp(nusselt_mesh mesh) {
    return {mesh.slot, mesh.generation};
}
FrameId cpp(nusselt_frame frame) {
    return {frame.slot, frame.generation};
}
MeshDesc cpp(const nusselt_mesh_desc& d) {
    return {cpp(d.rest_positions), cpp(d.rest_normals), d.indices, d.index_count};
}

Isa isa_of(uint32_t isa) {
    return isa == NUSSELT_ISA_BEST ? Isa::best : static_cast<Isa>(isa - 1);
}
Quality quality_of(uint32_t quality) {
    return quality == NUSSELT_QUALITY_DEFAULT ? Quality::standard : static_cast<Quality>(quality - 1);
}

nusselt_executor c_executor(const Executor& e) {
    return {e.user, e.enqueue, e.finish, e.concurrency};
}
Executor cpp(const nusselt_executor& e) {
    return {e.user, e.enqueue, e.finish, e.concurrency};
}

constexpr uint32_t most_on_stack = 64, most_outputs_on_stack = 128;

uint32_t count_outputs(const nusselt_frame_desc& desc) {
    uint32_t count = 0;
    for (uint32_t i = 0; i < desc.mesh_count; ++i) {
        const nusselt_frame_mesh& m = desc.meshes[i];
        count += m.outputs ? m.output_count : 0;
        count += m.back_outputs ? m.back_output_count : 0;
    }
    return count;
}

Output cpp(const nusselt_output& o) {
    Output made;
    made.kind = static_cast<OutputKind>(o.kind);
    made.format = static_cast<OutputFormat>(o.format);
    made.data = o.data;
    made.count = o.count;
    made.stride = o.stride;
    made.bands = o.bands;
    std::copy(std::begin(o.window), std::end(o.window), made.window);
    return made;
}

// `outputs` has room for all of them.
void convert(const nusselt_frame_desc& desc, FrameMesh* out, Output* outputs) {
    const size_t mask_stride = quality_mask_bits(quality_of(desc.quality)) / 8;
    const auto masks_of = [=](const nusselt_mask_view& v) {
        return MaskView{v.data, v.count, v.stride ? v.stride : mask_stride};
    };
    const auto take = [&](const nusselt_output* from, uint32_t count) -> const Output* {
        if (!from) return nullptr;
        const Output* const first = outputs;
        for (uint32_t k = 0; k < count; ++k)
            *outputs++ = cpp(from[k]);
        return first;
    };
    for (uint32_t i = 0; i < desc.mesh_count; ++i) {
        const nusselt_frame_mesh& m = desc.meshes[i];
        out[i] = {cpp(m.mesh),
                  cpp(m.positions),
                  cpp(m.normals),
                  cpp(m.transfer),
                  masks_of(m.masks),
                  m.needed,
                  take(m.outputs, m.output_count),
                  m.output_count,
                  reinterpret_cast<const Gloss*>(m.gloss),
                  m.receive_only,
                  {cpp(m.back_transfer), masks_of(m.back_masks), m.back_needed,
                   take(m.back_outputs, m.back_output_count), m.back_output_count},
                  m.object};
    }
}

} // namespace

uint32_t nusselt_version(void) {
    return version();
}

const char* nusselt_configuration(void) {
    return configuration();
}

nusselt_status nusselt_check_version(uint32_t header_version) {
    return c_status(check_version(header_version));
}

nusselt_status nusselt_create_tbb_executor(uint32_t threads, nusselt_executor* out) {
    if (!out) return bad("no executor was made: out is null; pass a place for it");
    *out = {};
    Executor made;
    const Status status = create_tbb_executor(threads, &made);
    if (status.ok()) *out = c_executor(made);
    return c_status(status);
}

void nusselt_destroy_executor(nusselt_executor* executor) {
    if (!executor) return;
    Executor gone = cpp(*executor);
    destroy_executor(&gone);
    *executor = c_executor(gone);
}

nusselt_status nusselt_create_context(const nusselt_context_desc* desc, nusselt_context** out) {
    if (!out) return bad("no context made: out is null; pass where to write it");
    *out = nullptr;
    ContextDesc made;
    if (desc) {
        const nusselt_status size = check_size(sizeof(*desc), desc->size);
        if (size.code != NUSSELT_OK) return size;
        made.allocator = {desc->allocator.user, desc->allocator.allocate, desc->allocator.release};
        made.executor = cpp(desc->executor);
        made.isa = isa_of(desc->isa);
        made.profiler = {desc->profiler.user, desc->profiler.begin, desc->profiler.end};
        made.clock = {desc->clock.user, desc->clock.nanoseconds};
    }
    Context* context = nullptr;
    const Status status = create_context(made, &context);
    *out = reinterpret_cast<nusselt_context*>(context);
    return c_status(status);
}

nusselt_status nusselt_destroy_context(nusselt_context* context) {
    return c_status(destroy_context(cpp(context)));
}

uint32_t nusselt_context_isa(const nusselt_context* context) {
    return static_cast<uint32_t>(context_isa(cpp(context))) + 1;
}

const char* nusselt_isa_name(uint32_t isa) {
    return isa_name(isa_of(isa));
}

nusselt_status nusselt_add_mesh(nusselt_context* context, const nusselt_mesh_desc* desc, nusselt_mesh* out) {
    if (!desc || !out) return bad("mesh not added: desc or out is null; pass both");
    *out = {};
    const nusselt_status size = check_size(sizeof(*desc), desc->size);
    if (size.code != NUSSELT_OK) return size;
    MeshId id;
    const Status status = add_mesh(cpp(context), cpp(*desc), &id);
    *out = {id.slot, id.generation};
    return c_status(status);
}

nusselt_status nusselt_share_mesh(nusselt_context* context, nusselt_mesh mesh, nusselt_mesh* out) {
    if (!out) return bad("mesh not shared: out is null; pass where to write the handle");
    MeshId id;
    const Status status = share_mesh(cpp(context), cpp(mesh), &id);
    *out = {id.slot, id.generation};
    return c_status(status);
}

nusselt_status nusselt_remove_mesh(nusselt_context* context, nusselt_mesh mesh) {
    return c_status(remove_mesh(cpp(context), cpp(mesh)));
}

nusselt_status nusselt_get_mesh_info(const nusselt_context* context, nusselt_mesh mesh,
                                     nusselt_mesh_info* out) {
    if (!out) return bad("no answer: out is null; pass where to write it");
    const nusselt_status size = check_size(sizeof(*out), out->size);
    if (size.code != NUSSELT_OK) return size;
    MeshInfo info;
    const Status status = mesh_info(cpp(context), cpp(mesh), &info);
    if (!status.ok()) return c_status(status);
    *out = {out->size,
            info.vertices,
            info.triangles,
            info.welded_vertices,
            info.degenerate_triangles,
            info.components,
            info.closed_components,
            info.boundary_edges,
            info.non_manifold_edges,
            info.flipped_edges,
            info.levels,
            info.clusters,
            {},
            info.bytes,
            info.coarse_triangles};
    std::copy(std::begin(info.level_triangles), std::end(info.level_triangles), out->level_triangles);
    return c_status(status);
}

nusselt_status nusselt_mesh_memory_bound(const nusselt_context* context, const nusselt_mesh_desc* desc,
                                         size_t* held, size_t* peak) {
    if (!desc || !held || !peak) return bad("no answer: desc, held or peak is null; pass all three");
    *held = *peak = 0;
    const nusselt_status size = check_size(sizeof(*desc), desc->size);
    if (size.code != NUSSELT_OK) return size;
    MeshMemory bound;
    const Status status = mesh_memory_bound(cpp(context), cpp(*desc), &bound);
    *held = bound.held;
    *peak = bound.peak;
    return c_status(status);
}

nusselt_status nusselt_create_history(nusselt_context* context, nusselt_history* out) {
    HistoryId id;
    const Status status = create_history(cpp(context), out ? &id : nullptr);
    if (out) *out = {id.slot, id.generation};
    return c_status(status);
}

nusselt_status nusselt_remove_history(nusselt_context* context, nusselt_history history) {
    return c_status(remove_history(cpp(context), {history.slot, history.generation}));
}

uint32_t nusselt_quality_mask_bits(uint32_t quality) {
    return quality_mask_bits(quality_of(quality));
}

nusselt_status nusselt_submit(nusselt_context* context, const nusselt_frame_desc* desc, nusselt_frame* out) {
    if (!context || !desc || !out)
        return bad("no frame started: context, desc or out is null; pass all three");
    *out = {};
    nusselt_status size = check_size(sizeof(*desc), desc->size);
    if (size.code == NUSSELT_OK) size = check_size(sizeof(nusselt_frame_mesh), desc->mesh_size);
    for (uint32_t i = 0; size.code == NUSSELT_OK && desc->meshes && i < desc->mesh_count; ++i) {
        if (desc->meshes[i].output_count > 0 || desc->meshes[i].back_output_count > 0)
            size = check_size(sizeof(nusselt_output), desc->meshes[i].output_size);
        if (size.code == NUSSELT_OK && desc->meshes[i].gloss)
            size = check_size(sizeof(nusselt_gloss), desc->meshes[i].gloss_size);
    }
    if (size.code != NUSSELT_OK) return size;
    FrameId id;
    FrameDesc frame{nullptr, desc->mesh_count, quality_of(desc->quality)};
    frame.order = desc->order ? desc->order : sh_order;
    frame.origin = desc->origin;
    frame.history = {desc->history.slot, desc->history.generation};
    frame.same_pose = desc->same_pose != 0;
    frame.budget_us = desc->budget_us;
    frame.falloff = {desc->falloff_from, desc->falloff_to};
    frame.light = desc->light;
    frame.environment = reinterpret_cast<const Environment*>(desc->environment);
    frame.visible = reinterpret_cast<const VisibleSet*>(desc->visible);
    frame.record = reinterpret_cast<VisibleSet*>(desc->record);
    frame.visible_segment = desc->visible_segment;
    frame.watertight = desc->watertight != 0;
    Status status;
    const uint32_t outputs = desc->meshes ? count_outputs(*desc) : 0;
    if (!desc->meshes) {
        status = submit(cpp(context), frame, &id);
    } else if (desc->mesh_count <= most_on_stack && outputs <= most_outputs_on_stack) {
        FrameMesh meshes[most_on_stack];
        Output made[most_outputs_on_stack];
        convert(*desc, meshes, made);
        frame.meshes = meshes;
        status = submit(cpp(context), frame, &id);
    } else {
        try {
            Vector<FrameMesh> meshes(desc->mesh_count, FrameMesh{},
                                     HostAllocator<FrameMesh>(cpp(context)->allocator));
            Vector<Output> made(outputs, Output{}, HostAllocator<Output>(cpp(context)->allocator));
            convert(*desc, meshes.data(), made.data());
            frame.meshes = meshes.data();
            status = submit(cpp(context), frame, &id);
        } catch (const std::bad_alloc&) {
            return {NUSSELT_OUT_OF_MEMORY,
                    "no frame started: the allocator gave no memory; free some and try again"};
        }
    }
    *out = {id.slot, id.generation};
    return c_status(status);
}

nusselt_status nusselt_poll(nusselt_context* context, nusselt_frame frame, int* done) {
    bool answer = false;
    const Status status = poll(cpp(context), cpp(frame), done ? &answer : nullptr);
    if (done) *done = answer;
    return c_status(status);
}

nusselt_status nusselt_cancel(nusselt_context* context, nusselt_frame frame) {
    return c_status(cancel(cpp(context), cpp(frame)));
}

nusselt_status nusselt_wait(nusselt_context* context, nusselt_frame frame, nusselt_frame_stats* stats) {
    if (stats) {
        const nusselt_status size = check_size(sizeof(*stats), stats->size);
        if (size.code != NUSSELT_OK) return size;
    }
    FrameStats s;
    const Status status = wait(cpp(context), cpp(frame), stats ? &s : nullptr);
    if (stats) {
        *stats = {stats->size,
                  s.receivers,
                  s.receivers_computed,
                  s.receivers_invalid,
                  s.receivers_written,
                  s.triangles_invalid,
                  s.threads,
                  s.clusters_tested,
                  s.clusters_rasterized,
                  s.triangles_considered,
                  s.triangles_rasterized,
                  s.fan_triangles,
                  s.blocks_uniform,
                  s.blocks_partial,
                  s.wall_ms,
                  s.cpu_ms,
                  s.receivers_unneeded,
                  s.receivers_copied,
                  s.receivers_reused,
                  s.clusters_kept,
                  s.receivers_stale,
                  s.receivers_unshadowed,
                  s.stale_frames_max,
                  0,
                  s.stale_frames_mean,
                  s.receivers_inside,
                  0};
    }
    return c_status(status);
}

nusselt_status nusselt_mark_visible(const nusselt_camera* camera, nusselt_vec3_view positions,
                                    const uint32_t* indices, size_t index_count, uint32_t* needed) {
    if (!camera) return bad("nothing marked: camera is null; give one");
    const nusselt_status size = check_size(sizeof(*camera), camera->size);
    if (size.code != NUSSELT_OK) return size;
    Camera made;
    std::copy(std::begin(camera->clip_from_position), std::end(camera->clip_from_position),
              made.clip_from_position);
    std::copy(std::begin(camera->eye), std::end(camera->eye), made.eye);
    made.margin = camera->margin;
    made.back_faces = camera->back_faces != 0;
    return c_status(mark_visible(made, cpp(positions), indices, index_count, needed));
}

size_t nusselt_output_bytes(uint32_t kind, uint32_t format, uint32_t bands) {
    return output_bytes(static_cast<OutputKind>(kind), static_cast<OutputFormat>(format), bands ? bands : 5);
}

void nusselt_unpack_transfer(const void* packed, uint32_t bands, float out[25]) {
    unpack_transfer(packed, bands, out);
}

nusselt_status nusselt_create_environment(nusselt_context* context, const float* rgb, uint32_t width,
                                          uint32_t height, uint32_t mask_bits, nusselt_environment** out,
                                          uint64_t* bad_pixels) {
    if (!out) return bad("no environment made: out is null; pass where to write it");
    EnvironmentDesc desc{rgb, width, height, mask_bits ? mask_bits : 1024};
    Environment* made = nullptr;
    const Status status = create_environment(cpp(context), desc, &made, bad_pixels);
    *out = reinterpret_cast<nusselt_environment*>(made);
    return c_status(status);
}

void nusselt_destroy_environment(nusselt_context* context, nusselt_environment* environment) {
    destroy_environment(cpp(context), reinterpret_cast<Environment*>(environment));
}

nusselt_status nusselt_create_visible_set(nusselt_context* context, const nusselt_mesh* meshes,
                                          uint32_t mesh_count, uint32_t quality, uint32_t segments,
                                          nusselt_visible_set** out) {
    return c_status(create_visible_set(cpp(context), reinterpret_cast<const MeshId*>(meshes), mesh_count,
                                       quality_of(quality), segments, reinterpret_cast<VisibleSet**>(out)));
}

void nusselt_destroy_visible_set(nusselt_context* context, nusselt_visible_set* set) {
    destroy_visible_set(cpp(context), reinterpret_cast<VisibleSet*>(set));
}

size_t nusselt_visible_set_bytes(const nusselt_visible_set* set) {
    return visible_set_bytes(reinterpret_cast<const VisibleSet*>(set));
}

nusselt_status nusselt_write_visible_set(const nusselt_visible_set* set, void* data, size_t size) {
    return c_status(write_visible_set(reinterpret_cast<const VisibleSet*>(set), data, size));
}

nusselt_status nusselt_read_visible_set(nusselt_context* context, const nusselt_mesh* meshes,
                                        uint32_t mesh_count, const void* data, size_t size,
                                        nusselt_visible_set** out) {
    return c_status(read_visible_set(cpp(context), reinterpret_cast<const MeshId*>(meshes), mesh_count, data,
                                     size, reinterpret_cast<VisibleSet**>(out)));
}

uint32_t nusselt_visible_set_segments(const nusselt_visible_set* set) {
    VisibleSetInfo info;
    const Status status = visible_set_info(reinterpret_cast<const VisibleSet*>(set), &info);
    return status.ok() ? info.segments : 0;
}

nusselt_material nusselt_metallic_roughness(const float base_color[3], float metallic, float roughness) {
    const Material m = metallic_roughness(base_color, metallic, roughness);
    nusselt_material out;
    std::memcpy(&out, &m, sizeof(out));
    return out;
}

float nusselt_sharpest_roughness(uint32_t mask_bits) {
    return sharpest_roughness(mask_bits);
}

float nusselt_lobe_beyond_bands(const nusselt_material* material, uint32_t bands) {
    Material m;
    std::memcpy(static_cast<void*>(&m), material, sizeof(m));
    return lobe_beyond_bands(m, bands);
}

void nusselt_sh_window(uint32_t window, float width, float out[5]) {
    sh_window(static_cast<ShWindow>(window), width, out);
}

void nusselt_sh_apply_window(const float window[5], uint32_t channels, float* coefficients) {
    sh_apply_window(window, channels, coefficients);
}

void nusselt_sh_evaluate(float x, float y, float z, float out[25]) {
    sh_evaluate(x, y, z, out);
}

nusselt_status nusselt_sh_project_latlong(const float* rgb, uint32_t width, uint32_t height, float out[75],
                                          uint64_t* bad_pixels) {
    return c_status(sh_project_latlong(rgb, width, height, out, bad_pixels));
}

void nusselt_sh_rotate(const float rotation[9], const float coefficients[25], float out[25]) {
    sh_rotate(rotation, coefficients, out);
}

void nusselt_turn_light(const float object_to_world[9], const float light[75], float out[75]) {
    turn_light(object_to_world, light, out);
}

nusselt_status nusselt_shade(const nusselt_context* context, const float light[75], uint32_t order,
                             nusselt_transfer_view transfer, nusselt_vec3_view albedo, float* rgb) {
    return c_status(
        shade(cpp(context), light, cpp(transfer), cpp(albedo), rgb, order ? order : uint32_t(sh_order)));
}
