// Splitting things that have a place and a direction into small compact runs, and cluster tables.
#pragma once

#include "memory.h"
#include "mesh_data.h"
#include "topology.h"
#include "vec3.h"

#include <cstdint>

namespace nusselt {

// A place and a unit direction (or zero).
struct SplitPoint {
    float axis[6];
};

struct SplitOptions {
    uint32_t leaf = 16; // at most so many a run
    bool aligned =
        false; // every run but the last has exactly `leaf`; otherwise runs are of nearly equal size
    float direction_weight = 1; // how much a turn counts against a distance, in radii of a run
};

// Reorders `order` (indices into `points`) by splitting at the median of the widest axis, again and again;
// runs that follow one another lie near each other. `begins` gets the begin of each run and the end. Indices
// rise within a run.
void split_medians(const Vector<SplitPoint>& points, const SplitOptions& options, Vector<uint32_t>& order,
                   Vector<uint32_t>& begins);

struct Partitioner {
    explicit Partitioner(const Allocator& a)
        : order(HostAllocator<uint32_t>(a)), begins(HostAllocator<uint32_t>(a)),
          corners(HostAllocator<uint32_t>(a)), mate(HostAllocator<uint32_t>(a)),
          cluster_of(HostAllocator<uint32_t>(a)), sizes(HostAllocator<uint32_t>(a)),
          large(HostAllocator<uint32_t>(a)), squares(HostAllocator<float>(a)),
          points(HostAllocator<SplitPoint>(a)), centres(HostAllocator<SplitPoint>(a)), matcher(a) {}

    // The result: triangles by cluster.
    Vector<uint32_t> order, begins;
    // Scratch.
    Vector<uint32_t> corners, mate, cluster_of, sizes, large;
    Vector<float> squares;
    Vector<SplitPoint> points, centres;
    EdgeMatcher matcher;
};

// Splits triangles (welded triples) into clusters of at most `limit`, compact and with similar normals, with
// smooth boundaries. `local_of` (one entry a welded vertex) is all `none` before and after.
void partition_triangles(const Vector<uint32_t>& triangles, const Vec3f* positions, uint32_t limit,
                         Vector<uint32_t>& local_of, Partitioner& p);

// Large triangles among the small ones of a run would have all of them drawn as far as a large one must be:
// they move to runs that they share with those of the next runs. After partition_triangles; no run gets more
// than `limit`.
void part_large_triangles(const Vector<uint32_t>& triangles, const Vec3f* positions, uint32_t limit,
                          Partitioner& p);

struct ClusterWriter {
    explicit ClusterWriter(const Allocator& a) : edge_number(64 * 64, 0xFF, HostAllocator<uint8_t>(a)) {}
    Vector<uint8_t> edge_number; // by pair of corners; all 0xFF between calls
};

struct ClusterKind {
    uint8_t two_sided = 0, level = 0;
};

// Appends clusters of the given triangles (indices into `triangles`, welded triples): one, or more where one
// would have more than 64 vertices or 128 edges. Stored in the given order.
void append_clusters(const Vector<uint32_t>& triangles, const uint32_t* chosen, uint32_t count,
                     ClusterKind kind, ClusterWriter& writer, Vector<uint32_t>& local_of, Clusters& out);

// One entry more than there are clusters, from the start.
void begin_clusters(Clusters& out);

} // namespace nusselt
