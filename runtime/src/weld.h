// Welding: vertices at exactly equal positions become one.
#pragma once

#include "memory.h"
#include "nusselt/views.h"
#include "vec3.h"

#include <cstdint>
#include <cstring>

namespace nusselt {

constexpr uint32_t none = 0xFFFFFFFFu;

inline Vec3f load(const Vec3View& view, size_t index) {
    Vec3f v;
    std::memcpy(&v, reinterpret_cast<const char*>(view.data) + index * view.stride, sizeof(v));
    return v;
}

// weld[vertex] is its welded number, in order of first appearance; weld_source[welded] the first vertex at
// that position. -0 equals +0; a position that is not finite equals no other.
void weld_positions(const Vec3View& positions, Vector<uint32_t>& weld, Vector<uint32_t>& weld_source);

// The welded triples of all triangles with three distinct, finite corners. Returns how many were left out.
uint32_t weld_triangles(const Vec3View& positions, const uint32_t* indices, size_t index_count,
                        const Vector<uint32_t>& weld, Vector<uint32_t>& triangles);

} // namespace nusselt
