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

template<class T>
size_t bytes_of(const Vector<T>& v) {
    return v.capacity() * sizeof(T);
}

size_t bytes_of(const Clusters& c) {
    return bytes_of(c.vertex_begin) + bytes_of(c.edge_begin) + bytes_of(c.triangle_begin) +
           bytes_of(c.two_sided) + bytes_of(c.level) + bytes_of(c.vertices) + bytes_of(c.edges) +
           bytes_of(c.triangles) + bytes_of(c.cover_begin) + bytes_of(c.covers);
}

size_t bytes_of(const MeshData& m) {
    return sizeof(m) + bytes_of(m.weld) + bytes_of(m.weld_source) + bytes_of(m.fan_begin) + bytes_of(m.fan) +
           bytes_of(m.solid) + bytes_of(m.receivers) + bytes_of(m.duplicates) + bytes_of(m.duplicate_of) +
           bytes_of(m.duplicate_begin) + bytes_of(m.full_triangles) + bytes_of(m.ring_begin) +
           bytes_of(m.ring) + bytes_of(m.full_two_sided) + bytes_of(m.anchor) + bytes_of(m.clusters) +
           bytes_of(m.samples.begin) + bytes_of(m.samples.cluster_begin) + bytes_of(m.samples.vertex) +
           bytes_of(m.samples.corner) + bytes_of(m.samples.weight) + bytes_of(m.samples.tangential) +
           bytes_of(m.coarse_clusters);
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

// The rings of the quality `paper` are bounded exactly; they are what differs most from mesh to mesh. The
// rest comes to at most 74 bytes a vertex and 70 a triangle on every mesh tried, and adding to 200 and 600
// more.
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
        // A triangle at a vertex is in the rings of the vertex's neighbours, unless those are hubs.
        size_t ring = 0;
        for (const size_t v : valence)
            ring += v <= max_ring_valence ? 2 * v * v : 0;
        const size_t vertices = desc.rest_positions.count, count = desc.index_count / 3;
        out->held = sizeof(MeshData) + 4096 + 96 * vertices + 96 * count + sizeof(uint32_t) * ring;
        out->peak = out->held + 8192 + 256 * vertices + 640 * count;
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
