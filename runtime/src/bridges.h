// Where a level's triangles bridge what they stand for.
//
// A level's lost vertices say how far the level before it lies from its triangles; not how far a triangle
// lies from that level where it spans a hollow or a hole whose rim alone has vertices.
#pragma once

#include "mesh_data.h"
#include "vec3.h"

#include <cstdint>

namespace nusselt {

// The triangles of one level, in a tree of boxes: each node's halves follow it, the first at once. Halves
// have as many triangles, wherever these lie, so a tree of 2^27 triangles is 26 deep.
struct SurfaceTree {
    explicit SurfaceTree(const Allocator& a)
        : triangles(HostAllocator<uint32_t>(a)), nodes(HostAllocator<Node>(a)) {}

    struct Node {
        Vec3f low, high;
        uint32_t begin, end; // of the triangles
        uint32_t second;     // node of the second half; 0: a leaf
    };
    Vector<uint32_t> triangles; // welded triples in the order of the leaves
    Vector<Node> nodes;
};

// `triangles`: welded triples with finite corners.
void build_surface_tree(const Vector<uint32_t>& triangles, const Vec3f* positions, SurfaceTree& tree);

struct SurfacePoint {
    double square; // of its distance
    Vec3d point;
    uint32_t vertex; // the corner of its triangle that weighs most in it
};

// A point of the surface no farther from p than the root of `enough`, or else the nearest, of a great many
// triangles that lie on one another one of the nearest. `leaf`: a node without halves, looked at first; out:
// the one that has the point, where the next query may begin.
SurfacePoint find_near(const SurfaceTree& tree, const Vec3f* positions, Vec3d p, double enough,
                       uint32_t& leaf);

// The barycentric weights of the point of triangle (a, b, c) that lies nearest to p (Ericson, Real-Time
// Collision Detection, 5.1.5).
Vec3d nearest_weights(Vec3d p, Vec3d a, Vec3d b, Vec3d c);

// The farthest point of some triangles from the level before theirs (`tree`), among four of each, where it
// lies farther than `most_square` (its root, in the rest pose) allows. `triangles`: numbers of welded triples
// in `corners`, `two_sided` where they block from both sides. Its vertex is `none` where no point does.
Bridge find_bridge(const SurfaceTree& tree, const Vec3f* positions, const uint32_t* corners,
                   const uint32_t* triangles, uint32_t count, bool two_sided, double most_square);

} // namespace nusselt
