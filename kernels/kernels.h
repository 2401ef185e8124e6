// The kernels: pure functions on arrays, one table of them an instruction set. No threads, no allocation, no
// mesh. Every table gives the same bits; `scalar` is the reference, obvious and never improved.
//
// "Lanes" below: arrays of 16, one entry a receiver of the batch. All arrays are aligned to 64 bytes.
#pragma once

#include "kernels/layout.h"

#include <cstddef>
#include <cstdint>

namespace nusselt::kernels {

// What a set of receivers has in common: a sphere around their positions and a cone around their normals.
struct ReceiverBounds {
    float centre[3], radius;
    float cone[3], cone_cos, cone_sin; // cone_cos -1: wider than a right angle, of no use
};

// Sixteen receivers. Positions and everything else in the frame's own space: recentred and scaled by a power
// of two so that the group's extent is near 1.
struct alignas(64) Batch {
    float position[3][lanes];
    float axis[3][3][lanes]; // rows t, b, n of the tangent frame: local = axis * (point - position)
    uint32_t valid;          // bit a lane: receiver present, position and normal finite, normal not zero
    ReceiverBounds bounds;
};

// Builds the tangent frames from normals (lanes; need not be unit) and the bounds. `valid` on entry: lanes
// present. n = normal / |normal|; t = (cos a cos p, cos a sin p, -sin a), b = (-sin p, cos p, 0) with n's
// polar angles a, p; so the rotation to the caller's space is Rz(p) Ry(a), without a third angle.
using PrepareBatch = void (*)(Batch& batch, const float normal[3][lanes]);

// Bounds of clusters in a frame; one array a component, `count` entries and readable up to the next multiple
// of 16. A cluster stands for its surface at the distances [nearest, farthest) from the receiver.
struct ClusterBounds {
    const float* centre[3];
    const float* radius;
    const float* cone[3]; // axis of the normals
    const float*
        cone_cos; // -1 where the cone is of no use (wide, degenerate, or the cluster blocks from both sides)
    const float* cone_sin;
    const float* nearest;
    const float* farthest;
    uint32_t count;
};

// The clusters that can reach the receivers' hemispheres: in their band of distances, not wholly below the
// elevation `horizon` (tangent of the angle above the tangent plane), not wholly back-facing. Conservative.
// Looks at `candidates` (null: the first `candidate_count` clusters), keeps their order, writes up to
// candidate_count + 16 numbers to `selected`; returns how many. *tested += the clusters in their band.
using SelectClusters = uint32_t (*)(const ReceiverBounds& receivers, const ClusterBounds& clusters,
                                    const uint32_t* candidates, uint32_t candidate_count, float horizon,
                                    uint32_t* selected, uint64_t* tested);

// One cluster's triangles, as the mesh keeps them (runtime/src/mesh_data.h), and their bounds in this frame.
struct ClusterView {
    const uint32_t* vertices; // into points
    const uint8_t* edges;     // 2 an edge: corners
    const uint8_t* triangles; // 8 a triangle: corner[3], edge[3], flipped, unused
    // 8 arrays of triangle_slots(triangle_count) floats: unit normal (x, y, z) and distance of the plane,
    // centre (x, y, z) and radius of a sphere. A degenerate triangle, or one whose cross product's square is
    // below FLT_MIN, has normal and distance 0; so have the slots past the last, and radius -FLT_MAX.
    const float* bounds;
    uint32_t vertex_count, edge_count, triangle_count;
    uint32_t two_sided;
    uint32_t full; // of the full mesh: a receiver in the plane of one of its triangles may touch it
    float centre[3], radius;
    float clearance; // a triangle whose plane passes the receiver no farther off than this is left out
    // Band of distances: a triangle is in it where its nearest corner is below `farthest` and its farthest
    // (of a cluster that blocks from both sides: its middle one) is not below `nearest`, so that levels
    // overlap. A large triangle may pass right over a receiver that is far from all its corners, where the
    // coarser level leaves it out: each is drawn to twice its own radius at least.
    float nearest, farthest;
};
constexpr uint32_t triangle_slots(uint32_t triangles) {
    return (triangles + 15) / 16 * 16;
}

// Parallel rays, one a lane, from `origin` along `direction` = cross(across[0], across[1]); all three are
// unit and orthogonal, about. A sphere around the origins of the active ones.
struct alignas(64) Rays {
    float origin[3][lanes];
    float across[2][3], direction[3];
    float centre[3], radius;
    uint32_t active;
};

// Of candidates first to end (null: of the clusters with these numbers), those that the rays may meet.
// Conservative; whatever is active. As SelectClusters otherwise.
using SelectAlong = uint32_t (*)(const Rays& rays, const ClusterBounds& clusters, const uint32_t* candidates,
                                 uint32_t first, uint32_t end, uint32_t* selected);

// The cluster's triangles that the rays may meet, one bit each. Conservative; whatever is active.
using TrianglesAlong = uint64_t (*)(const Rays& rays, const ClusterView& cluster);

// Adds to winding[lane] how often the ray leaves through a triangle of the cluster (seen from behind), less
// how often it enters through one. Summed over a closed surface that is how often it winds around the origin.
// No ray slips between two triangles at their edge, or meets both: the edge has the same value for both but
// for its sign, and where it is 0 the edge's direction decides. Triangles whose plane passes the origin
// within 4e-6 do not count.
using CountCrossings = void (*)(const Rays& rays, const ClusterView& cluster, const float* points,
                                int32_t winding[lanes]);

// Rasterisation jobs: the part of a mask at `destination` |= AND of the half-spaces of three entries. Arrays
// with room for 16 more than are added.
struct JobList {
    uint32_t* plane[3];    // entries as the part has them (layout.h, entry_of_part)
    uint32_t* destination; // byte offset into the batch's masks
    uint32_t count;
};
// A cluster adds at most this many.
constexpr uint32_t jobs_per_cluster(const MaskLayout& l) {
    return cluster_triangles * lanes * mask_parts(l);
}

struct Counters {
    uint64_t triangles_considered;
    uint64_t triangles_rasterized;
    uint64_t fan_triangles;
    uint64_t blocks_uniform;
    uint64_t blocks_partial;
};

struct alignas(64) ClusterScratch {
    float local[cluster_vertices][3][lanes]; // x, y, z
    uint64_t reach[cluster_vertices]; // one bit a lane each: above the tangent plane, over the horizon,
                                      // nearer than `farthest`, not nearer than `nearest`
    uint64_t signs[cluster_vertices]; // one bit a lane each: y < 0, y > 0, x < 0, x > 0
    uint32_t entry[cluster_edges][lanes];
    // Where both sides are asked for: as `reach` (the first two) and `entry`, for receivers that look behind.
    uint32_t behind[cluster_vertices];
    uint32_t entry_behind[cluster_edges][lanes];
    uint32_t near[cluster_vertices]; // one bit a lane: nearer than where a fade begins
};

// Blockers hide all up to distance `from`, nothing from `to` on, in between as a smooth step falls.
struct Fade {
    float from, to;
    float steepness; // one over their difference, 1e30 at most
};

// Parts of masks of which each sample is hidden in part: those of a JobList, and the triangle's plane as the
// receiver has it in its tangent frame. In the unit direction d it is 1 / (inverse . d) away.
struct FadingJobs {
    JobList list;
    float* inverse[3];
};

// Adds the jobs of a cluster: transforms its vertices to each receiver's tangent frame, culls triangles by
// facing and by the elevation `horizon`, finds the planes of the edges that are left. Triangles that touch
// the receiver have an edge of length zero there and fall out; so do those whose plane contains it (within
// 1e-6 of the cluster's distance). `points` holds 4 floats a welded vertex.
using ClusterJobs = void (*)(const Batch& batch, const ClusterView& cluster, const float* points,
                             const MaskLayout& layout, float horizon, ClusterScratch& scratch, JobList& jobs,
                             Counters& counters);

// The same for both sides of a surface: `behind` holds the receivers of `batch` with their normals turned
// over (not those with a normal along z, whose tangent frames are no mirror images), and its masks lie behind
// the sixteen of `batch`. At most twice jobs_per_cluster. Layouts with an octahedral table only.
using BothSidesJobs = void (*)(const Batch& batch, const Batch& behind, const ClusterView& cluster,
                               const float* points, const MaskLayout& layout, float horizon,
                               ClusterScratch& scratch, JobList& jobs, Counters& counters);

// As ClusterJobs, but for what a fade does: triangles that lie before its beginning are `jobs`, those that
// end behind it `fading`, and those that lie beyond its end neither. What a
// receiver touches (touching.h) is in `jobs`. At most jobs_per_cluster each. Layouts with an octahedral table
// only.
using FadingClusterJobs = void (*)(const Batch& batch, const ClusterView& cluster, const float* points,
                                   const MaskLayout& layout, float horizon, const Fade& fade,
                                   ClusterScratch& scratch, JobList& jobs, FadingJobs& fading,
                                   Counters& counters);

// Adds the jobs of one triangle a lane (corners[corner][axis][lane], frame space; `active` bit a lane).
// `two_sided` bit a lane. At most a job a lane and part of the mask. As ClusterJobs otherwise.
using TriangleJobs = void (*)(const Batch& batch, const float corners[3][3][lanes], uint32_t active,
                              uint32_t two_sided, const MaskLayout& layout, float horizon, JobList& jobs,
                              Counters& counters);

// Adds what incident triangle (receiver, a, b) hides below itself: the spherical triangle (a, b, nadir), the
// part of the hemisphere under the arc from a to b. corners[0] = a, corners[1] = b in frame space. Returns
// the lanes whose arc rises above the tangent plane without running counter-clockwise, or has an end within
// 1e-4 of the zenith: their fan stands upright or hangs over, and what is under the arcs is not all that it
// hides (fill_fan). Nothing is under an arc with such an end: rounding would decide to which side it leans.
using FanJobs = uint32_t (*)(const Batch& batch, const float corners[2][3][lanes], uint32_t active,
                             const MaskLayout& layout, JobList& jobs, Counters& counters);

// Carries out the jobs and empties the list. `masks`: 16 masks, one after the other.
using RunJobs = void (*)(const Tables& tables, JobList& jobs, uint8_t* masks);

// The transfer in each receiver's tangent frame, local[term][lane]: bit weights where a block is partial.
// `per_block`: a block's blocked bits all weigh the same (the paper's 4x4 downsampling). Here and below
// `order` is the number of bands, 1 to 5: the first order^2 terms are computed, with the same bits for any
// order; the others are left as they are.
using Integrate = void (*)(const Tables& tables, const uint8_t* masks, uint32_t valid, bool per_block,
                           uint32_t order, float local[25][lanes], Counters& counters);

// Rotates to the caller's space: out[term][lane]. Lanes that are not valid become 0. `out` may be `local`.
using Rotate = void (*)(const Batch& batch, uint32_t order, const float local[25][lanes],
                        float out[25][lanes]);

// Blocked bits of each 4x4 block: counts[block], 0 to 16.
using Downsample = void (*)(const uint8_t* mask, uint32_t blocks, uint8_t* counts);

// rgb[3 i + channel] = sum over terms of light[term * 3 + channel] * transfer[i][term], in the order of the
// terms. `stride` bytes between transfer vectors.
using Shade = void (*)(const float light[75], uint32_t order, const float* transfer, size_t stride,
                       size_t count, float* rgb);

// The 25 basis functions of `count` unit directions: out[term * count + i].
using EvaluateSh = void (*)(const float* x, const float* y, const float* z, size_t count, float* out);

struct Kernels {
    const char* name;
    PrepareBatch prepare_batch;
    SelectClusters select_clusters;
    ClusterJobs cluster_jobs;
    BothSidesJobs both_sides_jobs;
    FadingClusterJobs fading_cluster_jobs;
    TriangleJobs triangle_jobs;
    FanJobs fan_jobs;
    SelectAlong select_along;
    TrianglesAlong triangles_along;
    CountCrossings count_crossings;
    RunJobs run_jobs;
    Integrate integrate;
    Rotate rotate;
    Downsample downsample;
    Shade shade;
    EvaluateSh evaluate_sh;
};

// What a closed link of triangles hides from the receiver in its middle, on the surface of something solid:
// what is under its arcs, as fan_jobs has it, and all directions that lead into the solid, out of which they
// come through back faces only, which don't block. `link` are the triangles' outer points (frame space),
// counter-clockwise as seen from outside, each once. Adds to the lane's `mask`. For the second part each arc
// counts with its sign, so that the sum is the winding number of the link around each sample, less that
// around a direction which is known to lead outside; that holds however rounding tilts an upright wall, so
// arcs that end at the zenith only count there. One function for all sets: upright and overhanging triangles
// ask for it, smooth surfaces seldom do.
void fill_fan(const Tables& tables, const Batch& batch, uint32_t lane, const float* const* link,
              uint32_t count, uint8_t* mask);

enum class Set : uint32_t { scalar, sse4, avx2, avx512, neon };
constexpr uint32_t set_count = 5;

// Null where this build or this machine (processor and operating system) lacks it.
const Kernels* kernels_for(Set set);

// Tables are built in double with arithmetic that is the same everywhere; the caller gives the memory.
void build_plane_table(const MaskLayout& layout, uint32_t first_cell, uint32_t end_cell, uint8_t* planes);
// What each bit stands for, before it is rounded: build_weights works in one for each bit of the mask.
struct SampleBit {
    double direction[3];
    double weights[25];
    bool used;
};
void build_weights(const MaskLayout& layout, SampleBit* bits, int16_t* nibbles, int16_t* blocks,
                   int16_t* total, float* scale, float* block_weights);
// The sample direction of a bit (block-ordered as in the mask), in the tangent frame. False: the cell is
// unused.
bool sample_direction(const MaskLayout& layout, uint32_t bit, double direction[3]);
// The bit of the square's cell (x, y), of `side` along each side.
uint32_t bit_of_cell(const MaskLayout& layout, uint32_t x, uint32_t y);
// The tangent of the elevation below which no sample lies, less the table's angular error: culling below it
// is invisible.
float horizon_tangent(const MaskLayout& layout);

} // namespace nusselt::kernels
