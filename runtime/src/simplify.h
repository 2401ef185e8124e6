// Edge collapse onto one of the two ends (so every level indexes the same vertices), ordered by quadric error
// (Garland, Heckbert 1997), with the distance to what was removed measured at each collapse.
#pragma once

#include "memory.h"
#include "topology.h"
#include "vec3.h"

#include <cstdint>
#include <limits>

namespace nusselt {

struct Quadric {
    double xx = 0, yy = 0, zz = 0, xy = 0, xz = 0, yz = 0, x = 0, y = 0, z = 0, c = 0;
    double weight = 0, root = 0; // area, and its square root
};

// The mesh to simplify, in and out, and scratch memory that is reused from call to call.
struct Simplifier {
    Simplifier(const Allocator& a, uint32_t welded_vertices);

    // Welded triples. `source` of a result triangle is the input triangle that it was.
    Vector<uint32_t> triangles, source;
    // Out: the vertices that were removed, as points of the triangle that lies nearest: one list a triangle,
    // head here, links in `point_next` (one entry a welded vertex; `none` ends).
    Vector<uint32_t> points;
    Vector<uint32_t> point_next;

    struct HeapEntry {
        double cost;
        uint32_t vertex;
    };
    struct Neighbour {
        uint32_t vertex, uses; // triangles of the centre vertex that have it
        double cost;
    };
    struct Moved {
        uint32_t point, triangle;
    };

    // By welded vertex: its local number during a call.
    Vector<uint32_t> local_of;
    // By local vertex. Its corners are a list, dead ones among them until somebody passes; fan_size counts
    // the living. A vertex whose common_mark is common_stamp is a neighbour of both ends of the edge looked
    // at.
    Vector<uint32_t> vertices, head, fan_size, best_vertex, mark, common_mark;
    // As they were when the call began. Pinched: not manifold. What reshaping collapses pinch counts from the
    // next call (the next level) on.
    Vector<uint8_t> pinched, border;
    // Of its quadric at itself; of the cheapest collapse; of the entry in `heap` that counts (-1: none).
    Vector<double> own_cost, best_cost, queued_cost;
    Vector<Quadric> quadrics;
    Vector<Vec3f> positions;
    // By corner and triangle.
    Vector<uint32_t> corners, next, mate;
    Vector<uint8_t> alive;
    Vector<HeapEntry> heap;
    Vector<Neighbour> ring;
    Vector<uint32_t> fan, common;
    Vector<Moved> moved;
    EdgeMatcher matcher;
    uint32_t stamp = 0, common_stamp = 0;
    uint64_t steps = 0; // of work: how many entries of fans and rings were looked at, for points too
    double dearest = 0; // out: cost of the dearest collapse
};

struct SimplifyOptions {
    uint32_t target_triangles = 0;
    bool measure = true; // false: no points, no error
    // With less than enough_triangles left nothing dearer goes.
    double most_cost = std::numeric_limits<double>::max();
    uint32_t enough_triangles = 0;
};

// Stops at the target, at the limit of cost, when nothing may collapse any more, or when it has taken so many
// times an ordinary mesh's steps that what is left is not worth them. Borders collapse along
// themselves. What changes the surface's shape (a hole or a handle closes, a part becomes flat, or was not
// manifold there when the call began) costs as much as if all that a vertex stands for moved with it: small
// holes close early, large ones late. No part goes below two triangles that lie on each other, or one with a
// border. A mesh whose edges balance (as often used one way as the other) stays so, but need not stay
// manifold. Returns a bound on the distance of the removed vertices to the result (0 without `measure`).
float simplify(Simplifier& s, const Vec3f* positions, const SimplifyOptions& options);

} // namespace nusselt
