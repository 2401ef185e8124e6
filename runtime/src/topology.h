// Which triangles share an edge, and what they form together. Vertices are welded and compact numbers.
// Half-edge 3 t + k runs from corner k of triangle t to corner (k + 1) % 3.
#pragma once

#include "memory.h"
#include "vec3.h"
#include "weld.h"

#include <cstdint>

namespace nusselt {

struct EdgeMatcher {
    struct Entry {
        uint32_t other, half_edge;
    };
    explicit EdgeMatcher(const Allocator& a)
        : begin(HostAllocator<uint32_t>(a)), entries(HostAllocator<Entry>(a)) {}

    Vector<uint32_t> begin;
    Vector<Entry> entries;
};

inline uint32_t edge_from(const uint32_t* triangles, uint32_t half_edge) {
    return triangles[half_edge];
}
inline uint32_t edge_to(const uint32_t* triangles, uint32_t half_edge) {
    return triangles[half_edge % 3 == 2 ? half_edge - 2 : half_edge + 1];
}

// mate[h]: the next half-edge along the same edge, in a ring; h itself on a border. For a manifold edge
// mate[mate[h]] is h.
void match_edges(const uint32_t* triangles, uint32_t triangle_count, uint32_t vertex_count,
                 EdgeMatcher& scratch, Vector<uint32_t>& mate);

struct Topology {
    explicit Topology(const Allocator& a)
        : triangle_component(HostAllocator<uint32_t>(a)), component_closed(HostAllocator<uint8_t>(a)) {}

    Vector<uint32_t> triangle_component;
    // 1: every edge is used twice, in opposite directions, and the volume is not negative.
    Vector<uint8_t> component_closed;
    uint32_t boundary_edges = 0, non_manifold_edges = 0, flipped_edges = 0;
};

void find_components(const uint32_t* triangles, uint32_t triangle_count, const Vec3f* positions,
                     const Vector<uint32_t>& mate, Topology& out);

} // namespace nusselt
