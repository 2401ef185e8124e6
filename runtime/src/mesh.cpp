#include "context_data.h"
#include "jobs/float_environment.h"
#include "levels.h"
#include "visible_set.h"
#include "weld.h"

#include <algorithm>

namespace nusselt {

namespace {

constexpr size_t most = size_t(1) << 27; // vertices or triangles of a mesh

Status check(const MeshDesc& desc) {
    const auto bad = [](const char* text) { return Status{StatusCode::invalid_argument, text}; };
    const Vec3View& p = desc.rest_positions;
    const Vec3View& n = desc.rest_normals;
    if (!p.data || p.count == 0)
        return bad("mesh not added: it has no vertices; give at least one rest position");
    if (p.count > most || desc.index_count / 3 > most)
        return bad("mesh not added: more than 2^27 vertices or triangles; split it into several meshes");
    if (p.stride < 12 || p.stride % 4 != 0 || (n.data && (n.stride < 12 || n.stride % 4 != 0)))
        return bad("mesh not added: a stride is under 12 bytes or no multiple of 4; strides are in bytes");
    if (n.data && n.count != p.count)
        return bad(
            "mesh not added: as many rest normals as rest positions are needed; give none to have them made");
    if (desc.index_count % 3 != 0)
        return bad("mesh not added: the index count is no multiple of 3; give three indices a triangle");
    if (desc.index_count > 0 && !desc.indices)
        return bad("mesh not added: indices is null; give index_count indices, or a count of 0");
    for (size_t i = 0; i < desc.index_count; ++i) {
        if (desc.indices[i] >= p.count)
            return bad(
                "mesh not added: an index is not below the number of vertices; check the index buffer");
    }
    return {};
}

// Calls run for each array of a mesh.
template<class Cluster, class Run>
void each_array_of_clusters(Cluster& c, const Run& run) {
    run(c.vertex_begin), run(c.edge_begin), run(c.triangle_begin);
    run(c.two_sided), run(c.level), run(c.vertices), run(c.edges), run(c.triangles);
    run(c.cover_begin), run(c.covers);
}
template<class Mesh, class Run>
void each_array(Mesh& m, const Run& run) {
    run(m.weld), run(m.weld_source), run(m.fan_begin), run(m.fan), run(m.solid);
    run(m.receivers), run(m.duplicates), run(m.duplicate_of), run(m.duplicate_begin);
    run(m.full_triangles), run(m.ring_begin), run(m.ring), run(m.full_two_sided), run(m.anchor);
    each_array_of_clusters(m.clusters, run);
    each_array_of_clusters(m.coarse_clusters, run);
    run(m.samples.begin), run(m.samples.cluster_begin), run(m.samples.vertex), run(m.samples.corner);
    run(m.samples.weight), run(m.samples.tangential), run(m.samples.bridges);
}

size_t bytes_of(const MeshData& m) {
    size_t sum = sizeof(m);
    each_array(m, [&]<class T>(const Vector<T>& v) { sum += v.capacity() * sizeof(T); });
    return sum;
}

// Lists that grew hold up to twice what is in them. Not shrink_to_fit, which keeps still where there is no
// memory: then add_mesh would take more than it says.
void fit(MeshData& m) {
    each_array(m, []<class T>(Vector<T>& v) {
        if (v.capacity() > v.size()) Vector<T>(v).swap(v);
    });
}

const Status no_context{StatusCode::invalid_argument,
                        "nothing done: the context is null; make one with create_context"};
const Status stale{
    StatusCode::stale_handle,
    "nothing done: no mesh of this context has that handle; it was removed, or is another context's"};

// The guard is held. Throws std::bad_alloc.
MeshId take_slot(Context& context, MeshData* data, const MeshInfo& info) {
    uint32_t slot = 0;
    while (slot < context.meshes.size() && context.meshes[slot].data)
        ++slot;
    if (slot == context.meshes.size()) {
        context.meshes.emplace_back();
        context.meshes[slot].generation = first_generation(context);
    }
    context.meshes[slot].data = data;
    context.meshes[slot].info = info;
    return {slot, context.meshes[slot].generation};
}

} // namespace

Status add_mesh(Context* context, const MeshDesc& desc, MeshId* out) {
    if (!context) return no_context;
    if (!out)
        return {StatusCode::invalid_argument, "mesh not added: out is null; pass where to write the handle"};
    *out = {};
    if (const Status status = check(desc); !status.ok()) return status;
    const Zone zone(context->profiler, "nusselt add_mesh");
    MeshData* data = nullptr;
    const jobs::FloatEnvironment environment;
    try {
        MeshInfo info;
        data = make<MeshData>(context->allocator, context->allocator);
        build_mesh(desc, LevelOptions{}, context->allocator, *data, info);
        fit(*data);
        data->identity = mesh_identity(*data);
        info.bytes = bytes_of(*data);
        const std::lock_guard lock(context->guard);
        *out = take_slot(*context, data, info);
    } catch (const std::bad_alloc&) {
        unmake(context->allocator, data);
        return {StatusCode::out_of_memory,
                "mesh not added: the allocator gave no memory; free some and try again"};
    }
    return {};
}

// As in levels.cpp: vertices of more triangles bring no ring to their neighbours.
constexpr size_t max_ring_valence = 256;

// What is held: 73 bytes a vertex and 37 a triangle at most; of levels and coarse mesh, 26 a triangle where
// it shares nothing, 2 for its cluster and 16 for what covers that, and no more than two and a half times the
// mesh's triangles on every mesh tried. The rings of the quality `paper` differ most from mesh to mesh and
// are bounded apart. While they are made they are there three times, as lists grow; later the levels' scratch
// takes their place, at most 200 bytes a vertex and 600 a triangle on every mesh tried.
Status mesh_memory_bound(const Context* context, const MeshDesc& desc, MeshMemory* out) {
    if (!context) return no_context;
    if (!out) return {StatusCode::invalid_argument, "no answer: out is null; pass where to write it"};
    *out = {};
    if (const Status status = check(desc); !status.ok()) return status;
    const jobs::FloatEnvironment environment;
    try {
        const HostAllocator<uint32_t> numbers(context->allocator);
        Vector<uint32_t> weld(numbers), source(numbers), triangles(numbers);
        weld_positions(desc.rest_positions, weld, source);
        Vector<uint32_t> valence(source.size(), 0, numbers);
        for (size_t i = 0; i < desc.index_count; ++i)
            ++valence[weld[desc.indices[i]]];
        const size_t vertices = desc.rest_positions.count, count = desc.index_count / 3;
        // A triangle at a vertex is in the rings of the vertex's neighbours, unless that is a hub; and in
        // none twice.
        size_t ring = 0, with_triangles = 0;
        for (const size_t v : valence) {
            ring += v <= max_ring_valence ? 2 * v * v : 0;
            with_triangles += v > 0;
        }
        ring = std::min(ring, with_triangles * count);
        out->held = sizeof(MeshData) + 4096 + 80 * vertices + 152 * count + sizeof(uint32_t) * ring;
        out->peak =
            out->held + 8192 +
            std::max(64 * vertices + 128 * count + 2 * sizeof(uint32_t) * ring, 256 * vertices + 640 * count);
    } catch (const std::bad_alloc&) {
        return {StatusCode::out_of_memory,
                "no answer: the allocator gave no memory; free some and try again"};
    }
    return {};
}

MeshSlot* find_mesh(Context& context, MeshId mesh) {
    if (mesh.generation == 0 || mesh.slot >= context.meshes.size()) return nullptr;
    MeshSlot& slot = context.meshes[mesh.slot];
    return slot.data && slot.generation == mesh.generation ? &slot : nullptr;
}

Status share_mesh(Context* context, MeshId mesh, MeshId* out) {
    if (!context) return no_context;
    if (!out)
        return {StatusCode::invalid_argument, "mesh not shared: out is null; pass where to write the handle"};
    *out = {};
    const std::lock_guard lock(context->guard);
    const MeshSlot* slot = find_mesh(*context, mesh);
    if (!slot) return stale;
    try {
        // By value: the slots may move.
        *out = take_slot(*context, slot->data, MeshInfo(slot->info));
    } catch (const std::bad_alloc&) {
        return {StatusCode::out_of_memory,
                "mesh not shared: the allocator gave no memory; free some and try again"};
    }
    return {};
}

Status remove_mesh(Context* context, MeshId mesh) {
    if (!context) return no_context;
    const std::lock_guard lock(context->guard);
    MeshSlot* slot = find_mesh(*context, mesh);
    if (!slot) return stale;
    if (slot->frames > 0)
        return {StatusCode::busy, "mesh not removed: a frame in flight uses it; wait for the frame first"};
    MeshData* const data = slot->data;
    slot->data = nullptr;
    const auto shares = [&](const MeshSlot& other) { return other.data == data; };
    if (std::none_of(context->meshes.begin(), context->meshes.end(), shares))
        unmake(context->allocator, data);
    ++slot->generation;
    return {};
}

Status mesh_info(const Context* context, MeshId mesh, MeshInfo* out) {
    if (!context) return no_context;
    if (!out) return {StatusCode::invalid_argument, "no answer: out is null; pass where to write it"};
    Context& c = *const_cast<Context*>(context); // to lock it
    const std::lock_guard lock(c.guard);
    const MeshSlot* slot = find_mesh(c, mesh);
    if (!slot) return stale;
    *out = slot->info;
    return {};
}

} // namespace nusselt
