#include "shared_tables.h"

#include "jobs/float_environment.h"
#include "kernels/kernels.h"

#include <mutex>
#include <new>

namespace nusselt {

namespace {

struct SharedTables {
    kernels::Tables tables;
    void* memory = nullptr;
    uint32_t users = 0;
};

constexpr size_t line = 64;

// The only state of the process that the library holds: read-only once built, gone with the last context.
// It does not come from any context's allocator, because it may outlive that context.
std::mutex guard;
SharedTables shared[quality_count];

bool same(const kernels::MaskLayout& a, const kernels::MaskLayout& b) {
    return a.samples == b.samples && a.planes == b.planes && a.side == b.side &&
           a.plane_cells == b.plane_cells;
}

bool build(const kernels::MaskLayout& layout, SharedTables& out) {
    using namespace kernels;
    const auto rounded = [](size_t bytes) { return (bytes + line - 1) / line * line; };
    const size_t planes = rounded(plane_table_bytes(layout));
    const size_t nibbles = rounded(nibble_table_size(layout) * sizeof(int16_t));
    const size_t blocks = rounded(block_table_size(layout) * sizeof(int16_t));
    const size_t total = rounded(sh_columns * sizeof(int16_t)), scale = rounded(sh_columns * sizeof(float));
    const size_t block_weights = rounded((block_table_size(layout) + sh_columns) * sizeof(float));
    const size_t bytes = planes + nibbles + blocks + total + scale + block_weights;
    auto* memory = static_cast<uint8_t*>(::operator new(bytes, std::align_val_t(line), std::nothrow));
    if (!memory) return false;
    uint8_t* next = memory;
    const auto take = [&next](size_t size) {
        uint8_t* part = next;
        next += size;
        return part;
    };
    uint8_t* const plane_memory = take(planes);
    auto* const nibble_memory = reinterpret_cast<int16_t*>(take(nibbles));
    auto* const block_memory = reinterpret_cast<int16_t*>(take(blocks));
    auto* const total_memory = reinterpret_cast<int16_t*>(take(total));
    auto* const scale_memory = reinterpret_cast<float*>(take(scale));
    auto* const weight_memory = reinterpret_cast<float*>(take(block_weights));
    build_plane_table(layout, 0, table_cells(layout), plane_memory);
    auto* const bits = static_cast<SampleBit*>(
        ::operator new(mask_bits(layout) * sizeof(SampleBit), std::align_val_t(line), std::nothrow));
    if (!bits) {
        ::operator delete(memory, std::align_val_t(line));
        return false;
    }
    build_weights(layout, bits, nibble_memory, block_memory, total_memory, scale_memory, weight_memory);
    ::operator delete(bits, std::align_val_t(line));
    out.tables = {layout,       plane_memory, nibble_memory, block_memory,
                  total_memory, scale_memory, weight_memory, horizon_tangent(layout)};
    out.memory = memory;
    return true;
}

// Qualities of one layout share their tables.
SharedTables* entry(Quality quality) {
    const QualitySettings* q = quality_settings(quality);
    for (uint32_t i = 0; q && i < quality_count; ++i) {
        if (same(quality_settings(static_cast<Quality>(i))->layout, q->layout)) return &shared[i];
    }
    return nullptr;
}

} // namespace

const kernels::Tables* acquire_tables(Quality quality) {
    const std::lock_guard lock(guard);
    const jobs::FloatEnvironment environment;
    SharedTables* const s = entry(quality);
    if (!s) return nullptr;
    if (s->users == 0 && !build(quality_settings(quality)->layout, *s)) return nullptr;
    ++s->users;
    return &s->tables;
}

void release_tables(Quality quality) {
    const std::lock_guard lock(guard);
    SharedTables* const s = entry(quality);
    if (!s || s->users == 0 || --s->users > 0) return;
    ::operator delete(s->memory, std::align_val_t(line));
    *s = {};
}

} // namespace nusselt
