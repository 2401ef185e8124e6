#include "visible_set.h"

#include "context_data.h"
#include "quality.h"

#include <algorithm>
#include <atomic>
#include <bit>
#include <cstring>
#include <iterator>

namespace nusselt {

namespace {

constexpr uint32_t format_version = 2;
constexpr char magic[8] = {'N', 'U', 'S', 'S', 'P', 'V', 'S', '\n'};
constexpr uint64_t most_pairs = uint64_t(1) << 33;
static_assert(std::endian::native == std::endian::little, "the file is written as memory holds it");

// The file: this, an entry a mesh, the bits, and the checksum of all before it.
struct Header {
    char magic[8];
    uint32_t version, quality, meshes, segments, rows, clusters;
    uint32_t recorded, watertight; // 0 or 1
};
struct MeshEntry {
    uint64_t identity, has_back; // 0 or 1
};

constexpr uint64_t hash_seed = 0xCBF29CE484222325u;

uint64_t hash_words(const void* data, size_t words, uint64_t hash) {
    const char* bytes = static_cast<const char*>(data);
    for (size_t i = 0; i < words; ++i) {
        uint32_t word;
        std::memcpy(&word, bytes + 4 * i, 4);
        hash = (hash ^ word) * 0x100000001B3u;
    }
    return hash;
}

uint64_t hash_array(const Vector<uint32_t>& values, uint64_t hash) {
    const uint64_t size = values.size();
    return hash_words(values.data(), values.size(), hash_words(&size, 2, hash));
}

// What a file calls a mesh: with other angles or samples other clusters matter.
uint64_t file_identity(uint64_t mesh, Quality quality) {
    const QualitySettings& settings = *quality_settings(quality);
    const kernels::MaskLayout& l = settings.layout;
    const uint32_t words[] = {std::bit_cast<uint32_t>(settings.angle), static_cast<uint32_t>(l.samples),
                              static_cast<uint32_t>(l.planes), l.side, l.plane_cells};
    return hash_words(words, std::size(words), mesh);
}

uint32_t batches_of(const Vector<uint32_t>& receivers) {
    return static_cast<uint32_t>((receivers.size() + batch_receivers - 1) / batch_receivers);
}

Status check_shape(uint32_t mesh_count, Quality quality, uint32_t segments) {
    const auto bad = [](const char* text) { return Status{StatusCode::invalid_argument, text}; };
    if (mesh_count == 0) return bad("no set made: it has no meshes; give those of the frames");
    if (segments == 0 || segments > most_segments)
        return bad("no set made: it has no segments, or more than 4096; 1 serves the whole animation");
    if (quality == Quality::paper || static_cast<uint32_t>(quality) > static_cast<uint32_t>(Quality::fine))
        return bad("no set made: quality paper, or an unknown one, has no levels of detail to choose from; "
                   "use draft, standard or fine");
    return {};
}

// All but the bits of a set of live meshes; the guard is held. Throws std::bad_alloc.
Status lay_out(Context& context, const MeshId* meshes, uint32_t mesh_count, VisibleSet& set) {
    uint64_t rows = 0, clusters = 0;
    set.meshes.resize(mesh_count);
    for (uint32_t m = 0; m < mesh_count; ++m) {
        const MeshSlot* slot = find_mesh(context, meshes[m]);
        if (!slot)
            return {StatusCode::stale_handle,
                    "no set made: a mesh handle is not of this context; it was removed, or is another "
                    "context's"};
        const MeshData& mesh = *slot->data;
        set.meshes[m] = {mesh.identity, static_cast<uint32_t>(rows),
                         static_cast<uint32_t>(rows) + batches_of(mesh.receivers), false};
        rows += batches_of(mesh.receivers) + batches_of(mesh.duplicates);
        clusters += mesh.clusters.count();
    }
    const uint64_t words = (clusters + 31) / 32;
    if (rows > most_pairs || words > most_pairs / 32 || (rows > 0 && 32 * words > most_pairs / rows) ||
        32 * words * rows > most_pairs / set.segments)
        return {StatusCode::invalid_argument,
                "no set made: more than 2^33 pairs of a batch and a cluster; use fewer segments, or split "
                "the meshes"};
    set.rows = static_cast<uint32_t>(rows);
    set.clusters = static_cast<uint32_t>(clusters);
    set.words = static_cast<uint32_t>(words);
    return {};
}

size_t bits_of(const VisibleSet& set) {
    return size_t(set.segments) * set.rows * set.words;
}

size_t bytes_of(const VisibleSet& set) {
    return sizeof(Header) + sizeof(MeshEntry) * set.meshes.size() + sizeof(uint64_t) +
           sizeof(uint32_t) * bits_of(set);
}

Status contradiction() {
    return {StatusCode::invalid_argument,
            "set not read: what it says of its frames contradicts itself; make it anew with `nusselt pvs`"};
}

// What is wrong with a file before its meshes are looked at.
Status check_file(const void* data, size_t size, Header& header) {
    const auto bad = [](const char* text) { return Status{StatusCode::invalid_argument, text}; };
    if (!data || size < sizeof(Header) + sizeof(uint64_t))
        return bad("set not read: it is cut short, or empty; make it anew with `nusselt pvs`");
    std::memcpy(&header, data, sizeof(header));
    if (std::memcmp(header.magic, magic, sizeof(magic)) != 0)
        return bad("set not read: it is no potentially visible set; make one with `nusselt pvs`");
    if (header.version != format_version)
        return bad("set not read: it is of another version of the format; make it anew with `nusselt pvs`");
    if (size % 4 != 0) return bad("set not read: it is cut short; make it anew with `nusselt pvs`");
    uint64_t sum;
    std::memcpy(&sum, static_cast<const char*>(data) + size - sizeof(sum), sizeof(sum));
    if (sum != hash_words(data, (size - sizeof(sum)) / 4, hash_seed))
        return bad("set not read: it is cut short or damaged, its checksum is another; make it anew with "
                   "`nusselt pvs`");
    if (header.recorded > 1 || header.watertight > header.recorded) return contradiction();
    return check_shape(header.meshes, static_cast<Quality>(header.quality), header.segments);
}

// A set's shape and meshes against the file's.
Status check_meshes(const VisibleSet& set, const Header& header, const char* entries, size_t size) {
    const auto bad = [](const char* text) { return Status{StatusCode::invalid_argument, text}; };
    if (size < sizeof(Header) + sizeof(MeshEntry) * set.meshes.size() + sizeof(uint64_t))
        return bad("set not read: it is smaller than it says; make it anew with `nusselt pvs`");
    for (size_t m = 0; m < set.meshes.size(); ++m) {
        MeshEntry entry;
        std::memcpy(&entry, entries + m * sizeof(entry), sizeof(entry));
        if (entry.has_back > header.recorded) return contradiction();
        if (entry.identity != file_identity(set.meshes[m].identity, set.quality))
            return bad("set not read: it was made of other meshes, or by a version of the library that makes "
                       "or takes other levels of detail; make it anew with `nusselt pvs`");
    }
    if (header.rows != set.rows || header.clusters != set.clusters || size != bytes_of(set))
        return bad("set not read: its size does not fit its meshes; make it anew with `nusselt pvs`");
    // Bits past the last cluster are nobody's.
    const uint32_t past = set.clusters % 32 ? ~0u << set.clusters % 32 : 0;
    const char* const bits = entries + sizeof(MeshEntry) * set.meshes.size();
    for (size_t row = 1; past && row <= size_t(set.segments) * set.rows; ++row) {
        uint32_t last;
        std::memcpy(&last, bits + sizeof(last) * (row * set.words - 1), sizeof(last));
        if (last & past) return contradiction();
    }
    return {};
}

// `fits` is asked before the memory of the bits is taken.
template<class Fits>
Status make_set(Context& context, const MeshId* meshes, uint32_t mesh_count, Quality quality,
                uint32_t segments, const Fits& fits, VisibleSet** out) {
    VisibleSet* made = nullptr;
    try {
        made = make<VisibleSet>(context.allocator, context.allocator);
        made->quality = quality;
        made->segments = segments;
        Status status;
        {
            const std::lock_guard lock(context.guard);
            status = lay_out(context, meshes, mesh_count, *made);
        }
        if (status.ok()) status = fits(*made);
        if (status.ok()) {
            made->bits.assign(bits_of(*made), 0);
            *out = made;
        } else {
            unmake(context.allocator, made);
        }
        return status;
    } catch (const std::bad_alloc&) {
        unmake(context.allocator, made);
        return {StatusCode::out_of_memory,
                "no set made: the allocator gave no memory; free some and try again"};
    }
}

} // namespace

uint64_t mesh_identity(const MeshData& mesh) {
    const Clusters& c = mesh.clusters;
    uint64_t hash = hash_array(mesh.weld, hash_seed);
    for (const Vector<uint32_t>* values :
         {&mesh.receivers, &mesh.duplicates, &c.vertex_begin, &c.triangle_begin, &c.vertices})
        hash = hash_array(*values, hash);
    static_assert(sizeof(ClusterTriangle) == 8);
    hash = hash_words(c.triangles.data(), 2 * c.triangles.size(), hash);
    for (uint32_t i = 0; i < c.count(); ++i) {
        const uint32_t kind = uint32_t(c.level[i]) << 1 | c.two_sided[i];
        hash = hash_words(&kind, 1, hash);
    }
    for (const Bridge& bridge : mesh.samples.bridges)
        hash = hash_words(&bridge.vertex, 1, hash);
    return hash;
}

Status create_visible_set(Context* context, const MeshId* meshes, uint32_t mesh_count, Quality quality,
                          uint32_t segments, VisibleSet** out) {
    if (!out) return {StatusCode::invalid_argument, "no set made: out is null; pass where to write it"};
    *out = nullptr;
    if (!context || !meshes)
        return {StatusCode::invalid_argument,
                "no set made: the context or the meshes are null; make them first"};
    if (const Status status = check_shape(mesh_count, quality, segments); !status.ok()) return status;
    return make_set(
        *context, meshes, mesh_count, quality, segments, [](VisibleSet&) { return Status{}; }, out);
}

void destroy_visible_set(Context* context, VisibleSet* set) {
    if (context) unmake(context->allocator, set);
}

Status visible_set_info(const VisibleSet* set, VisibleSetInfo* out) {
    if (!set || !out)
        return {StatusCode::invalid_argument, "no answer: the set or out is null; pass where to write it"};
    uint64_t kept = 0;
    for (const uint32_t word : set->bits)
        kept += static_cast<uint64_t>(std::popcount(word));
    const double pairs = double(set->segments) * set->rows * set->clusters;
    *out = {};
    out->quality = set->quality;
    out->meshes = static_cast<uint32_t>(set->meshes.size());
    out->segments = set->segments;
    out->clusters = set->clusters;
    out->batches = set->rows;
    out->kept = pairs > 0 ? double(kept) / pairs : 0;
    out->backs = static_cast<uint32_t>(std::count_if(set->meshes.begin(), set->meshes.end(),
                                                     [](const VisibleRows& mesh) { return mesh.has_back; }));
    out->watertight = set->watertight;
    return {};
}

Status visible_set_parts(Context* context, const VisibleSet* set, uint32_t segment, uint32_t number,
                         MeshId mesh, float* parts, size_t count) {
    const auto bad = [](const char* text) { return Status{StatusCode::invalid_argument, text}; };
    if (!context || !set || !parts)
        return bad("no answer: the context, the set or the memory is null; give all three");
    const std::lock_guard lock(context->guard);
    const MeshSlot* const slot = find_mesh(*context, mesh);
    if (!slot)
        return {StatusCode::stale_handle,
                "no answer: the mesh handle is not of this context; it was removed, or is another context's"};
    const MeshData& data = *slot->data;
    if (segment >= set->segments || number >= set->meshes.size() ||
        set->meshes[number].identity != data.identity || count != data.vertex_count)
        return bad("no answer: the set has no such segment or mesh, or the count is not that of the mesh's "
                   "vertices; give those that it was made of");
    const auto fill = [&](const Vector<uint32_t>& vertices, uint32_t first_row) {
        for (size_t i = 0; i < vertices.size(); ++i) {
            const uint32_t* const row =
                visible_row(*set, segment, first_row + static_cast<uint32_t>(i / batch_receivers));
            uint32_t kept = 0;
            for (uint32_t w = 0; w < set->words; ++w)
                kept += static_cast<uint32_t>(std::popcount(row[w]));
            parts[vertices[i]] = static_cast<float>(kept) / static_cast<float>(std::max(set->clusters, 1u));
        }
    };
    fill(data.receivers, set->meshes[number].first_row);
    fill(data.duplicates, set->meshes[number].first_own_row);
    return {};
}

size_t visible_set_bytes(const VisibleSet* set) {
    return set ? bytes_of(*set) : 0;
}

Status write_visible_set(const VisibleSet* set, void* data, size_t size) {
    if (!set || !data)
        return {StatusCode::invalid_argument, "nothing written: the set or the memory is null; give both"};
    if (size != bytes_of(*set))
        return {StatusCode::invalid_argument,
                "nothing written: the size is not that of visible_set_bytes; give so many bytes"};
    Header header{};
    std::memcpy(header.magic, magic, sizeof(magic));
    header.version = format_version;
    header.quality = static_cast<uint32_t>(set->quality);
    header.meshes = static_cast<uint32_t>(set->meshes.size());
    header.segments = set->segments;
    header.rows = set->rows;
    header.clusters = set->clusters;
    header.recorded = set->recorded;
    header.watertight = set->watertight;
    char* at = static_cast<char*>(data);
    std::memcpy(at, &header, sizeof(header));
    at += sizeof(header);
    for (const VisibleRows& mesh : set->meshes) {
        const MeshEntry entry{file_identity(mesh.identity, set->quality), mesh.has_back};
        std::memcpy(at, &entry, sizeof(entry));
        at += sizeof(entry);
    }
    if (!set->bits.empty()) std::memcpy(at, set->bits.data(), set->bits.size() * sizeof(uint32_t));
    const uint64_t sum = hash_words(data, (size - sizeof(uint64_t)) / 4, hash_seed);
    std::memcpy(static_cast<char*>(data) + size - sizeof(sum), &sum, sizeof(sum));
    return {};
}

Status read_visible_set(Context* context, const MeshId* meshes, uint32_t mesh_count, const void* data,
                        size_t size, VisibleSet** out) {
    if (!out) return {StatusCode::invalid_argument, "set not read: out is null; pass where to write it"};
    *out = nullptr;
    Header header;
    if (const Status status = check_file(data, size, header); !status.ok()) return status;
    if (header.meshes != mesh_count)
        return {StatusCode::invalid_argument,
                "set not read: it was made of another number of meshes; give them all, in their order"};
    if (!context || !meshes)
        return {StatusCode::invalid_argument,
                "set not read: the context or the meshes are null; make them first"};
    const char* const entries = static_cast<const char*>(data) + sizeof(Header);
    const auto fits = [&](const VisibleSet& set) { return check_meshes(set, header, entries, size); };
    const Status status = make_set(*context, meshes, mesh_count, static_cast<Quality>(header.quality),
                                   header.segments, fits, out);
    if (!status.ok()) return status;
    VisibleSet& set = **out;
    set.recorded = header.recorded != 0;
    set.watertight = header.watertight != 0;
    for (uint32_t m = 0; m < mesh_count; ++m) {
        MeshEntry entry;
        std::memcpy(&entry, entries + m * sizeof(entry), sizeof(entry));
        set.meshes[m].has_back = entry.has_back != 0;
    }
    if (!set.bits.empty())
        std::memcpy(set.bits.data(), entries + sizeof(MeshEntry) * mesh_count,
                    set.bits.size() * sizeof(uint32_t));
    return status;
}

Status check_visible_set(const FrameDesc& desc) {
    const auto bad = [](const char* text) { return Status{StatusCode::invalid_argument, text}; };
    if (!desc.visible && !desc.record) return {};
    if (desc.visible && desc.record)
        return bad("no frame started: a visible set to look at and one to record; give one of the two");
    const VisibleSet& set = desc.visible ? *desc.visible : *desc.record;
    if (desc.visible_segment >= set.segments)
        return bad("no frame started: the visible set has fewer segments; give one of those that it has");
    if (desc.quality != set.quality)
        return bad("no frame started: the visible set is of another quality; record one of this quality");
    if (desc.history.generation != 0 || desc.falloff.to > 0)
        return bad("no frame started: a visible set with a history or a falloff, which do not know it; give "
                   "one of them");
    for (uint32_t m = 0; m < desc.mesh_count; ++m) {
        const FrameMesh& mesh = desc.meshes[m];
        if (mesh.receive_only || mesh.object != desc.meshes[0].object)
            return bad("no frame started: a visible set is of one object whose meshes all block; put others "
                       "into a frame of their own");
    }
    return {};
}

Status check_visible_meshes(const FrameDesc& desc, uint32_t m, const MeshData& mesh) {
    const auto bad = [](const char* text) { return Status{StatusCode::invalid_argument, text}; };
    const VisibleSet* set = desc.visible ? desc.visible : desc.record;
    if (!set) return {};
    if (desc.mesh_count != set->meshes.size() || set->meshes[m].identity != mesh.identity)
        return bad("no frame started: the visible set is of other meshes; give the frame all of its meshes, "
                   "in their order, and no others");
    const bool has_back = receives(desc.meshes[m].back), knows_back = set->meshes[m].has_back;
    if (desc.record) {
        if (set->recorded && (has_back != knows_back || desc.watertight != set->watertight))
            return bad("no frame started: the set has recorded frames with other sides, or watertight ones "
                       "beside others; record all frames alike");
    } else if (has_back && !knows_back) {
        return bad("no frame started: the visible set was recorded without a mesh's back, where shadows "
                   "would be missing; record frames with it (`nusselt pvs --two-sided`), or leave the back "
                   "out (`--two-sided off`)");
    } else if (desc.watertight && !set->watertight) {
        return bad("no frame started: the visible set was not recorded of watertight frames, whose last "
                   "samples it doesn't know; record such frames (`nusselt pvs --watertight`)");
    }
    return {};
}

void begin_recording(const FrameDesc& desc) {
    VisibleSet& set = *desc.record;
    set.recorded = true;
    set.watertight = desc.watertight;
    for (uint32_t m = 0; m < desc.mesh_count; ++m)
        set.meshes[m].has_back = receives(desc.meshes[m].back);
}

uint32_t keep_visible(const Frame& frame, const uint32_t* rows, uint32_t count, uint32_t candidates,
                      Worker& worker) {
    uint32_t kept = 0;
    for (uint32_t i = 0; i < candidates; ++i) {
        const uint32_t c = worker.candidates[i];
        bool any = false;
        for (uint32_t k = 0; k < count && !any; ++k) {
            if (k > 0 && rows[k] == rows[k - 1]) continue;
            any = visible_row(*frame.visible, frame.visible_segment, rows[k])[c / 32] >> (c % 32) & 1;
        }
        worker.visible[kept] = c;
        kept += any;
    }
    return kept;
}

void record_visible(const Frame& frame, const MeshSlice& slice, const uint32_t* receivers, uint32_t cluster,
                    uint32_t valid, Worker& worker) {
    const size_t bytes = kernels::mask_bytes(frame.tables->layout);
    const uint32_t own = frame.record->meshes[slice.body].first_own_row;
    // Duplicates of one row may have originals in several regions. Bits are only set: in any order the same.
    const auto note = [&](uint32_t row) {
        uint32_t& word = visible_row(*frame.record, frame.visible_segment, row)[cluster / 32];
        std::atomic_ref<uint32_t>(word).fetch_or(1u << cluster % 32, std::memory_order_relaxed);
    };
    for (uint32_t lane = 0; lane < kernels::lanes; ++lane) {
        const uint8_t* mask = worker.masks.data() + lane * bytes;
        uint8_t* before = worker.masks_before.data() + lane * bytes;
        if (!(valid >> lane & 1) || std::memcmp(mask, before, bytes) == 0) continue;
        std::memcpy(before, mask, bytes);
        note(worker.rows[lane]);
        // Those that repeat it are computed for themselves where it is not needed.
        if (worker.rows[lane] >= own) continue;
        const uint32_t* const repeats = slice.mesh->duplicate_begin.data() + receivers[lane];
        for (uint32_t k = repeats[0]; k < repeats[1]; ++k)
            note(own + k / batch_receivers);
    }
}

} // namespace nusselt
