#include "topology.h"

#include <algorithm>

namespace nusselt {

void match_edges(const uint32_t* triangles, uint32_t triangle_count, uint32_t vertex_count,
                 EdgeMatcher& scratch, Vector<uint32_t>& mate) {
    const uint32_t half_edges = 3 * triangle_count;
    mate.resize(half_edges);
    scratch.begin.assign(vertex_count + 2, 0);
    scratch.entries.resize(half_edges);
    uint32_t* begin = scratch.begin.data();
    for (uint32_t h = 0; h < half_edges; ++h) {
        ++begin[std::min(edge_from(triangles, h), edge_to(triangles, h)) + 2];
    }
    for (uint32_t v = 2; v < vertex_count + 2; ++v) {
        begin[v] += begin[v - 1];
    }
    for (uint32_t h = 0; h < half_edges; ++h) {
        const uint32_t a = edge_from(triangles, h), b = edge_to(triangles, h);
        scratch.entries[begin[std::min(a, b) + 1]++] = {std::max(a, b), h};
    }
    EdgeMatcher::Entry* entries = scratch.entries.data();
    for (uint32_t v = 0; v < vertex_count; ++v) {
        std::sort(entries + begin[v], entries + begin[v + 1], [](const auto& l, const auto& r) {
            return l.other != r.other ? l.other < r.other : l.half_edge < r.half_edge;
        });
        for (uint32_t i = begin[v]; i < begin[v + 1];) {
            uint32_t end = i + 1;
            while (end < begin[v + 1] && entries[end].other == entries[i].other)
                ++end;
            for (uint32_t k = i; k < end; ++k) {
                mate[entries[k].half_edge] = entries[k + 1 < end ? k + 1 : i].half_edge;
            }
            i = end;
        }
    }
}

namespace {

uint32_t find_root(Vector<uint32_t>& parent, uint32_t i) {
    while (parent[i] != i) {
        parent[i] = parent[parent[i]];
        i = parent[i];
    }
    return i;
}

} // namespace

void find_components(const uint32_t* triangles, uint32_t triangle_count, const Vec3f* positions,
                     const Vector<uint32_t>& mate, Topology& out) {
    Vector<uint32_t> parent(triangle_count, 0, out.triangle_component.get_allocator());
    Vector<uint8_t> open(triangle_count, 0,
                         out.component_closed.get_allocator()); // by triangle, then by root
    for (uint32_t t = 0; t < triangle_count; ++t) {
        parent[t] = t;
    }
    for (uint32_t h = 0; h < 3 * triangle_count; ++h) {
        const uint32_t first = mate[h];
        if (first > h) continue; // rings rise: only its last member closes a ring, so each edge comes up once
        uint32_t users = 0;
        for (uint32_t i = first;; i = mate[i]) {
            ++users;
            const uint32_t a = find_root(parent, i / 3), b = find_root(parent, h / 3);
            parent[std::max(a, b)] = std::min(a, b);
            if (i == h) break;
        }
        const bool flipped = users == 2 && edge_from(triangles, h) == edge_from(triangles, first);
        if (users != 2 || flipped) open[h / 3] = 1;
        out.boundary_edges += users == 1;
        out.non_manifold_edges += users > 2;
        out.flipped_edges += flipped;
    }

    Vector<uint32_t> number(triangle_count, none, out.triangle_component.get_allocator());
    out.triangle_component.resize(triangle_count);
    out.component_closed.clear();
    Vector<double> volume{HostAllocator<double>(parent.get_allocator())};
    for (uint32_t t = 0; t < triangle_count; ++t) {
        const uint32_t root = find_root(parent, t);
        if (number[root] == none) {
            number[root] = static_cast<uint32_t>(out.component_closed.size());
            out.component_closed.push_back(1);
            volume.push_back(0);
        }
        const uint32_t component = number[root];
        out.triangle_component[t] = component;
        if (open[t]) out.component_closed[component] = 0;
        const Vec3d a = to_double(positions[triangles[3 * t]]),
                    b = to_double(positions[triangles[3 * t + 1]]),
                    c = to_double(positions[triangles[3 * t + 2]]);
        volume[component] += dot(a, cross(b, c));
    }
    for (size_t i = 0; i < volume.size(); ++i) {
        if (volume[i] < 0) out.component_closed[i] = 0; // inside out
    }
}

} // namespace nusselt
