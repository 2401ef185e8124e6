// What a mesh keeps after it was added: plain arrays, read-only in a frame. Built by levels.h.
//
// Levels of detail are a chain: each level is the one before it, simplified as a whole, over the same welded
// vertices, so that all of them deform with the mesh. A receiver takes each level for the blockers in a band
// of distances (see runtime/doc/adr). How far a level lies from the full mesh is measured anew in every pose,
// on samples: a level that was made from the rest pose may fit a strong deformation badly.
#pragma once

#include "memory.h"

#include <cstdint>

namespace nusselt {

constexpr uint32_t max_levels = 16;
constexpr uint32_t batch_receivers = 16; // receivers that go through all kernels together

// Corners and edges are numbers within the cluster. Edge k runs between corners k and (k + 1) % 3; bit k of
// `flipped` is set where the cluster's edge is stored the other way round: from the mesh's lower vertex to
// its higher.
struct ClusterTriangle {
    uint8_t corner[3];
    uint8_t edge[3];
    uint8_t flipped;
    uint8_t unused;
};

struct ClusterEdge {
    uint8_t from, to; // corners, from the cluster's vertices
};

struct Clusters {
    explicit Clusters(const Allocator& a)
        : vertex_begin(HostAllocator<uint32_t>(a)), edge_begin(HostAllocator<uint32_t>(a)),
          triangle_begin(HostAllocator<uint32_t>(a)), two_sided(HostAllocator<uint8_t>(a)),
          level(HostAllocator<uint8_t>(a)), vertices(HostAllocator<uint32_t>(a)),
          edges(HostAllocator<ClusterEdge>(a)), triangles(HostAllocator<ClusterTriangle>(a)),
          cover_begin(HostAllocator<uint32_t>(a)), covers(HostAllocator<uint32_t>(a)) {}

    // One entry a cluster, plus one end entry for the three begins. Finer levels first.
    Vector<uint32_t> vertex_begin, edge_begin, triangle_begin;
    Vector<uint8_t> two_sided; // 1: blocks from both sides (component not closed or not consistently wound)
    Vector<uint8_t> level;

    Vector<uint32_t> vertices; // welded vertex numbers; unique within a cluster
    Vector<ClusterEdge> edges; // unique within a cluster
    Vector<ClusterTriangle> triangles;

    // The clusters of the next level that stand for cluster c's surface: covers[cover_begin[c]] and on; none
    // at the coarsest level, and where they would be too many to list (covers.cpp). Not for coarse_clusters.
    Vector<uint32_t> cover_begin, covers;

    uint32_t count() const { return static_cast<uint32_t>(level.size()); }
};

// A point of one of a cluster's triangles that lies far from the level before it, where the triangle bridges
// a hollow or a hole (bridges.h).
struct Bridge {
    uint32_t vertex;    // welded, of that level, beside the surface's nearest point; `none`: no such point
    uint32_t corner[3]; // welded: the triangle
    float weight[3];    // of the corners, summing to 1
    // Its squared distance from that level is this part of the one from the vertex, in the rest pose and, it
    // is taken, in all others.
    float part;
};

// Samples of the distance between a level and the full mesh: vertices that the level lacks and the level
// before it has, each with the point of the level's surface that lies nearest in the rest pose.
struct LevelSamples {
    explicit LevelSamples(const Allocator& a)
        : begin(HostAllocator<uint32_t>(a)), cluster_begin(HostAllocator<uint32_t>(a)),
          vertex(HostAllocator<uint32_t>(a)), corner(HostAllocator<uint32_t>(a)),
          weight(HostAllocator<float>(a)), tangential(HostAllocator<float>(a)),
          bridges(HostAllocator<Bridge>(a)) {}

    Vector<uint32_t> begin;         // one a level plus an end; level 0 has none
    Vector<uint32_t> cluster_begin; // one a cluster plus an end: samples on its triangles
    Vector<uint32_t> vertex;        // welded
    Vector<uint32_t> corner;        // 3 a sample, welded: a triangle of the level
    Vector<float> weight;           // 3 a sample: of the corners, summing to 1
    // Of the squared distance in the rest pose, the part along the triangle: 0 for a point over its inside,
    // which may slide along the surface as the mesh bends without lying farther from it; 1 for one beside it.
    Vector<float> tangential;
    Vector<Bridge> bridges; // one a cluster
};

inline uint32_t level_count(const LevelSamples& samples) {
    return static_cast<uint32_t>(samples.begin.size()) - 1;
}

struct MeshData {
    explicit MeshData(const Allocator& a)
        : weld(HostAllocator<uint32_t>(a)), weld_source(HostAllocator<uint32_t>(a)),
          fan_begin(HostAllocator<uint32_t>(a)), fan(HostAllocator<uint32_t>(a)),
          solid(HostAllocator<uint8_t>(a)), receivers(HostAllocator<uint32_t>(a)),
          duplicates(HostAllocator<uint32_t>(a)), duplicate_of(HostAllocator<uint32_t>(a)),
          duplicate_begin(HostAllocator<uint32_t>(a)), full_triangles(HostAllocator<uint32_t>(a)),
          ring_begin(HostAllocator<uint32_t>(a)), ring(HostAllocator<uint32_t>(a)),
          full_two_sided(HostAllocator<uint8_t>(a)), anchor(HostAllocator<uint32_t>(a)), clusters(a),
          closed_parts(HostAllocator<uint32_t>(a)), coarse_clusters(a), samples(a) {}

    uint32_t vertex_count = 0; // the caller's, V
    uint64_t identity = 0;     // see mesh_identity (visible_set.h)
    Vector<uint32_t> weld;     // V: welded vertex of each vertex
    Vector<uint32_t>
        weld_source; // W: the first vertex welded into it; its position in a frame stands for all

    // Fans: the incident triangles of welded vertex w are (w, fan[2 k], fan[2 k + 1]), counter-clockwise, for
    // k in [fan_begin[w], fan_begin[w + 1]). W + 1 begins. Full mesh, degenerate triangles left out.
    Vector<uint32_t> fan_begin, fan;
    Vector<uint8_t> solid; // W: 1 where all of them bound closed, consistently wound parts

    // Receivers in batches of 16 that lie together and look the same way (rest pose), one for each distinct
    // pair of welded position and rest normal; the last batch may be short. `duplicates` are the remaining
    // vertices, and duplicate_of the receiver vertex that each repeats; those of vertex v are numbers
    // duplicate_begin[v] up to duplicate_begin[v + 1].
    Vector<uint32_t> receivers, duplicates, duplicate_of, duplicate_begin;

    // For the quality `paper`: the full mesh as welded triples; for each welded vertex the triangles of its
    // 2-ring (those that touch one of its neighbours), incident ones left out, as indices into full_triangles
    // / 3; and one coarse mesh of a few hundred triangles as clusters of their own (coarse_clusters).
    Vector<uint32_t> full_triangles, ring_begin, ring;
    Vector<uint8_t> full_two_sided; // one a full triangle
    Vector<uint32_t> anchor; // of each welded vertex, along the surface: a nearest vertex of the coarse mesh

    Clusters clusters;            // all levels
    uint32_t closed_clusters = 0; // of them, the first: the full mesh of closed parts
    // The closed parts' first clusters, and the end: a part each, last all that have but few triangles.
    Vector<uint32_t> closed_parts;
    Clusters coarse_clusters;
    LevelSamples samples;
};

} // namespace nusselt
