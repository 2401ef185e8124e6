#include "weld.h"

#include <bit>

namespace nusselt {

namespace {

uint32_t bits_of(float value) {
    return std::bit_cast<uint32_t>(value + 0.0f);
} // + 0: -0 becomes +0

uint32_t hash(Vec3f p) {
    uint64_t h = bits_of(p.x) * 0x9E3779B97F4A7C15ull;
    h = (h ^ (h >> 32) ^ bits_of(p.y)) * 0xD6E8FEB86659FD93ull;
    h = (h ^ (h >> 32) ^ bits_of(p.z)) * 0x9E3779B97F4A7C15ull;
    return static_cast<uint32_t>(h >> 32);
}

} // namespace

void weld_positions(const Vec3View& positions, Vector<uint32_t>& weld, Vector<uint32_t>& weld_source) {
    const uint32_t count = static_cast<uint32_t>(positions.count);
    weld.resize(count);
    weld_source.clear();
    weld_source.reserve(count);
    const uint32_t slots = std::bit_ceil(count < 8 ? 16u : 2 * count);
    Vector<uint32_t> table(slots, none, weld.get_allocator());
    for (uint32_t v = 0; v < count; ++v) {
        const Vec3f p = load(positions, v);
        if (!is_finite(p)) {
            weld[v] = static_cast<uint32_t>(weld_source.size());
            weld_source.push_back(v);
            continue;
        }
        uint32_t slot = hash(p) & (slots - 1);
        while (table[slot] != none) {
            const Vec3f q = load(positions, weld_source[table[slot]]);
            if (p.x == q.x && p.y == q.y && p.z == q.z) break;
            slot = (slot + 1) & (slots - 1);
        }
        if (table[slot] == none) {
            table[slot] = static_cast<uint32_t>(weld_source.size());
            weld_source.push_back(v);
        }
        weld[v] = table[slot];
    }
}

uint32_t weld_triangles(const Vec3View& positions, const uint32_t* indices, size_t index_count,
                        const Vector<uint32_t>& weld, Vector<uint32_t>& triangles) {
    triangles.clear();
    triangles.reserve(index_count);
    uint32_t left_out = 0;
    for (size_t i = 0; i + 2 < index_count; i += 3) {
        const uint32_t a = weld[indices[i]], b = weld[indices[i + 1]], c = weld[indices[i + 2]];
        const bool finite = is_finite(load(positions, indices[i])) &&
                            is_finite(load(positions, indices[i + 1])) &&
                            is_finite(load(positions, indices[i + 2]));
        if (a == b || b == c || c == a || !finite) {
            ++left_out;
            continue;
        }
        triangles.push_back(a);
        triangles.push_back(b);
        triangles.push_back(c);
    }
    return left_out;
}

} // namespace nusselt
