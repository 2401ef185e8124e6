// One frame's working memory: plain arrays over all meshes of the group, sized when a frame is the largest so
// far.
#pragma once

#include "environment.h"
#include "history_data.h"
#include "jobs/graph.h"
#include "kernels/fading.h"
#include "kernels/kernels.h"
#include "kernels/light.h"
#include "memory.h"
#include "mesh_data.h"
#include "nusselt/clock.h"
#include "nusselt/frame.h"
#include "nusselt/profiler.h"
#include "outputs.h"
#include "quality.h"

#include <atomic>
#include <cfloat>
#include <cstdint>
#include <span>

namespace nusselt {

constexpr uint32_t region_batches = 8; // batches that share one look at all clusters, at most
constexpr uint32_t region_receivers = region_batches * kernels::lanes;
constexpr uint32_t point_chunk = 1024; // vertices, or samples of a level, of one task
constexpr uint32_t far_faces = 6;      // masks that look along the axes (far.h)
constexpr uint32_t most_mask_bytes = kernels::mask_bytes(kernels::fine_layout);
constexpr uint32_t job_flush =
    512; // jobs after which masks are worked on: the list stays in the nearest cache

// A bit of the mask and its direction in the tangent frame.
struct ObliqueSample {
    uint32_t bit;
    float direction[3];
};
constexpr uint32_t oblique_samples = 9, oblique_asked = 3;

// Where a mesh's entries begin in the arrays of the frame.
struct MeshSlice {
    const MeshData* mesh = nullptr;
    const Clusters* clusters = nullptr; // all levels, or the coarse mesh (paper)
    FrameMesh in;                       // the caller's arrays
    uint64_t checksum = 0;              // of what is read, at `submit` (NUSSELT_CHECKED)
    uint32_t first_point = 0, first_point_chunk = 0;
    uint32_t first_cluster = 0, first_group = 0, first_part = 0;
    uint32_t first_region = 0, first_own_region = 0; // of receivers; from first_own_region on of duplicates
    uint32_t first_output = 0;                       // of in.output_count
    Gloss gloss;                                     // what in.gloss points to
    uint32_t first_vertex = 0;                       // in the history's arrays
    bool is_back = false;     // of an earlier slice's mesh: its points, no clusters, and normals turned over
    bool looks_far = false;   // far objects are multiplied into its results, not drawn into its masks (far.h)
    bool masks_alone = false; // all results are made from masks: no transfer vectors of white surfaces
    uint32_t body = 0;        // its own number, or that of the slice whose back it is
    uint32_t back = 0;        // number of its back's slice; 0: none
};

inline bool receives(const FrameMesh& mesh) {
    return mesh.transfer.data || mesh.output_count > 0;
}

inline bool receives(const BackSide& back) {
    return back.transfer.data || back.output_count > 0;
}

// What is asked for on the back of a mesh, as if it were asked for on the front of another one.
inline FrameMesh turned_over(const FrameMesh& mesh) {
    FrameMesh back = mesh;
    back.transfer = mesh.back.transfer;
    back.masks = mesh.back.masks;
    back.needed = mesh.back.needed ? mesh.back.needed : mesh.needed;
    back.outputs = mesh.back.outputs;
    back.output_count = mesh.back.output_count;
    back.back = {};
    return back;
}

struct Tally {
    kernels::Counters counters{};
    uint64_t clusters_tested = 0, clusters_rasterized = 0;
    uint32_t receivers_computed = 0, receivers_copied = 0, receivers_invalid = 0, receivers_written = 0;
    uint32_t receivers_inside = 0, receivers_reused = 0, receivers_stale = 0, receivers_unshadowed = 0,
             stale_frames_max = 0;
    uint64_t stale_frames_sum = 0;
    uint32_t triangles_invalid = 0, clusters_kept = 0;
    double cpu_ns = 0;
    uint64_t ticks[6] = {}; // by Stage
};

// Clusters that are looked at together: so many of one level, one after the other. Cuts by medians put
// neighbours there.
constexpr uint32_t group_clusters = 16;

constexpr uint32_t groups_of(uint32_t clusters) {
    return (clusters + group_clusters - 1) / group_clusters;
}

// Sets of the mesh's closed parts that have clusters of their own (MeshData::closed_parts).
inline uint32_t part_count(const MeshSlice& slice) {
    return static_cast<uint32_t>(slice.mesh->closed_parts.size()) - 1;
}

// The levels of a mesh: their clusters, and the distances at which some of these are drawn.
struct LevelBands {
    struct Level {
        uint32_t begin, end;
        float nearest, farthest;
        uint32_t first_group;
    };
    Level levels[max_levels];
    uint32_t count = 0;
};

// What of other objects is seen from the middle of a mesh, for all of its receivers (far.h).
struct FarView {
    bool wanted = false; // some of them look far
    bool empty = true;   // nothing is hidden
    alignas(64) uint8_t masks[far_faces * most_mask_bytes] = {};
    float matrix[25][25] = {};
};

struct MeshBox {
    float low[3], high[3]; // low above high: nothing
};
constexpr MeshBox no_box{{FLT_MAX, FLT_MAX, FLT_MAX}, {-FLT_MAX, -FLT_MAX, -FLT_MAX}};
constexpr MeshBox every_box{{-FLT_MAX, -FLT_MAX, -FLT_MAX}, {FLT_MAX, FLT_MAX, FLT_MAX}};

enum Stage : uint32_t {
    refit_stage,
    cull_stage,
    transform_stage,
    raster_stage,
    integrate_stage,
    rotate_stage
};

// One worker's scratch memory; it fits the second-level cache.
struct Worker {
    explicit Worker(const Allocator& a)
        : scratch(HostAllocator<kernels::ClusterScratch>(a)), masks(HostAllocator<uint8_t>(a)),
          jobs(HostAllocator<uint32_t>(a)), near(HostAllocator<uint16_t>(a)),
          candidates(HostAllocator<uint32_t>(a)), selected(HostAllocator<uint32_t>(a)),
          groups(HostAllocator<uint32_t>(a)), along(HostAllocator<uint32_t>(a)),
          meshes(HostAllocator<uint32_t>(a)), visible(HostAllocator<uint32_t>(a)),
          far_meshes(HostAllocator<uint32_t>(a)), masks_before(HostAllocator<uint8_t>(a)),
          points_before(HostAllocator<float>(a)), parts(HostAllocator<uint8_t>(a)),
          touched(HostAllocator<uint64_t>(a)), fading_jobs(HostAllocator<uint32_t>(a)),
          inverse(HostAllocator<float>(a)) {}

    Vector<kernels::ClusterScratch> scratch; // one
    Vector<uint8_t> masks;                   // of a batch, for each digit of a fade or each side
    Vector<uint32_t> jobs;                   // the job list's four arrays
    Vector<uint16_t> near; // by welded vertex, one bit a lane (quality `paper`); zero between batches
    Vector<uint32_t> candidates, selected;
    Vector<uint32_t> groups;            // of clusters, that may matter
    Vector<uint32_t> along;             // of `selected`, that a ray may meet
    Vector<uint32_t> meshes;            // of the frame, that may matter
    Vector<uint32_t> visible;           // of the candidates (frames with a visible set)
    Vector<uint32_t> far_meshes;        // of other objects, seen from one point alone
    Vector<uint8_t> masks_before;       // of a batch, before a cluster was drawn (frames that record)
    uint32_t rows[kernels::lanes] = {}; // of the visible set, of a batch's receivers
    Vector<float> points_before;        // of a chunk (frames with a history)
    // Where the frame fades: kernels::FadingParts, zero between batches, and the arrays of FadingJobs.
    Vector<uint8_t> parts;
    Vector<uint64_t> touched;
    Vector<uint32_t> fading_jobs;
    Vector<float> inverse;
    uint32_t far_count = 0; // of far_meshes
    kernels::Batch far_batch = {};
    alignas(64) float own_matrix[25][25] = {};
    bool has_far_view = false; // the mesh's FarView is for this region too
    // What far objects leave of a region's transfer vectors; null: all.
    const float (*far_matrix)[25] = nullptr;
    kernels::Batch batches[region_batches] = {};
    kernels::Batch behind[region_batches] = {}; // the same receivers' backs
    kernels::Rays rays = {};
    alignas(64) float normal[3][kernels::lanes] = {};
    alignas(64) float local[25][kernels::lanes] = {};
    alignas(64) float turned[25][kernels::lanes] = {};
    alignas(64) float glossy[3][25][kernels::lanes] = {}; // by channel, where an output asks for it
    alignas(64) uint8_t encoded[3 * kernels::lanes * kernels::most_encoded_bytes] = {};
    Tally tally;
};

inline kernels::JobList job_list(Worker& worker) {
    const size_t stride = worker.jobs.size() / 4;
    uint32_t* const base = worker.jobs.data();
    return {{base, base + stride, base + 2 * stride}, base + 3 * stride, 0};
}

// The threads' side of a frame: its graph and its workers' scratch memory. Any frame takes any that is free.
struct Crew {
    explicit Crew(const Allocator& a)
        : graph_memory(HostAllocator<uint8_t>(a)), workers(HostAllocator<Worker>(a)) {}

    Vector<uint8_t> graph_memory;
    jobs::Graph* graph = nullptr;
    Vector<Worker> workers;
    bool in_use = false;
};

struct Frame {
    explicit Frame(const Allocator& a)
        : no_clusters(a), meshes(HostAllocator<MeshSlice>(a)), outputs(HostAllocator<OutputStream>(a)),
          extents(HostAllocator<float>(a)), level_errors(HostAllocator<LevelError>(a)),
          broken(HostAllocator<uint8_t>(a)), points(a),
          triangle_bounds(a), centre{FloatArray(a), FloatArray(a), FloatArray(a)},
          radius(a), cone{FloatArray(a), FloatArray(a), FloatArray(a)}, cone_cos(a), cone_sin(a),
          triangle_radius(a), nearest(a), farthest(a), cluster_boxes(HostAllocator<MeshBox>(a)),
          views(HostAllocator<kernels::ClusterView>(a)), cluster_mesh(HostAllocator<uint32_t>(a)),
          cluster_bounds_begin(HostAllocator<uint32_t>(a)), group_bounds(a), mesh_bounds(a),
          far_views(HostAllocator<FarView>(a)), closed_boxes(HostAllocator<MeshBox>(a)),
          part_boxes(HostAllocator<MeshBox>(a)), level_bands(HostAllocator<LevelBands>(a)), history(a) {}

    // Fixed in `submit`.
    const kernels::Kernels* kernels = nullptr;
    const kernels::OutputKernels* output_kernels = nullptr;
    const kernels::LightKernels* light_kernels = nullptr;
    const kernels::FadingKernels* fading_kernels = nullptr;
    const Profiler* profiler = nullptr; // the context's
    const kernels::Tables* tables = nullptr;
    const kernels::CellTables* cells = nullptr; // where an output is made from masks
    const float* far_table = nullptr;           // where a mesh looks far
    float light[75] = {};
    const Environment* environment = nullptr;
    const VisibleSet* visible = nullptr;
    VisibleSet* record = nullptr;
    uint32_t visible_segment = 0;           // of either
    const float* fade_directions = nullptr; // where `fades`
    Falloff falloff = {};
    bool fades = false;
    QualitySettings quality{};
    uint32_t order = 5; // bands of the transfer vectors
    bool watertight = false;
    bool both_at_once = false;    // blockers are drawn once for both sides of a mesh, where both are wanted
    Clusters no_clusters;         // of meshes that only receive
    Vector<MeshSlice> meshes;     // the caller's, and after them the backs of those that have one
    uint32_t mesh_count = 0;      // the caller's
    Vector<OutputStream> outputs; // of all slices in turn
    uint32_t point_count = 0, point_chunks = 0, cluster_count = 0, group_count = 0, part_count = 0,
             triangle_bounds_count = 0;
    // Meshes of other objects are drawn as proxies: the arrays of clusters below then hold cluster c once
    // more at cluster_count + c, as receivers of other objects see it.
    bool proxies = false;
    uint32_t region_size = region_receivers; // receivers of a region, whole batches
    uint32_t region_count = 0;

    // Made by the tasks. Frame space: (position - origin) * scale, scale a power of two that brings the
    // extent near 1.
    float origin[3] = {}, scale = 1;
    kernels::Fade fade = {};         // where `fades`
    Vector<float> extents;           // largest distance from the origin along an axis, by chunk of points
    Vector<LevelError> level_errors; // one a cluster
    Vector<uint8_t> broken;          // of each cluster: a corner is not finite
    ObliqueSample oblique[oblique_samples] = {};
    bool any_closed = false;    // some mesh has a closed part
    FloatArray points;          // 4 a welded vertex
    FloatArray triangle_bounds; // of each cluster in turn, see kernels::ClusterView
    FloatArray centre[3], radius, cone[3], cone_cos, cone_sin;
    FloatArray triangle_radius;   // largest sphere around one of the cluster's triangles
    FloatArray nearest, farthest; // band of distances of the cluster's level
    Vector<MeshBox> cluster_boxes;
    Vector<kernels::ClusterView> views;
    Vector<uint32_t> cluster_mesh, cluster_bounds_begin;
    kernels::ClusterBounds cluster_bounds{};
    ClusterBoundsArrays group_bounds; // a sphere around each group of clusters, of proxies at group_count + g
    ClusterBoundsArrays mesh_bounds;  // a sphere around each mesh
    Vector<FarView> far_views;        // of each mesh, where there is a far_table
    Vector<MeshBox> closed_boxes;     // around what of each mesh can hold a receiver
    Vector<MeshBox> part_boxes;       // and around each closed part
    Vector<LevelBands> level_bands;   // of each mesh, then of each mesh's proxy

    // A frame with a history is kept for it: the arrays above are then those of its last frame.
    bool has_history = false;
    History history;

    Crew* crew = nullptr;                    // while in flight
    Worker* workers = nullptr;               // the crew's
    const Clock* clock = nullptr;            // the context's
    uint64_t budget_ns = 0, deadline_ns = 0; // 0: none
    std::atomic<bool> is_spent = false;      // somebody has seen that the deadline is past

    uint32_t generation = 1;
    bool in_flight = false;
    bool waited_for = false;             // a thread is in `wait`
    std::atomic<bool> cancelled = false; // set at most once a frame; a task that sees it does nothing
    uint64_t start_ticks = 0;
    double start_ns = 0;
};

// The slices that have points and clusters.
inline std::span<const MeshSlice> bodies(const Frame& frame) {
    return {frame.meshes.data(), frame.mesh_count};
}

// The slice to which an item of a stage belongs; `first` says where each slice's items begin.
const MeshSlice& slice_of(std::span<const MeshSlice> slices, uint32_t MeshSlice::*first, uint32_t item);

inline const float* element(const Vec3View& view, size_t index) {
    return reinterpret_cast<const float*>(reinterpret_cast<const char*>(view.data) + index * view.stride);
}
inline float* transfer_of(const FrameMesh& mesh, size_t vertex) {
    return reinterpret_cast<float*>(reinterpret_cast<char*>(mesh.transfer.data) +
                                    vertex * mesh.transfer.stride);
}
inline char* mask_of(const FrameMesh& mesh, size_t vertex) {
    return reinterpret_cast<char*>(mesh.masks.data) + vertex * mesh.masks.stride;
}
inline bool is_needed(const FrameMesh& mesh, uint32_t vertex) {
    return !mesh.needed || (mesh.needed[vertex / 32] >> (vertex % 32) & 1);
}

// A monotonic count that is cheap to read, and the time in nanoseconds that gives it a unit.
uint64_t ticks_now();
double nanoseconds_now();
double thread_cpu_nanoseconds();
// Of the caller's clock, that of time budgets.
uint64_t clock_nanoseconds(const Frame& frame);
inline bool is_out_of_time(Frame& frame) {
    if (frame.budget_ns == 0 || clock_nanoseconds(frame) < frame.deadline_ns) return false;
    frame.is_spent.store(true, std::memory_order_relaxed);
    return true;
}

} // namespace nusselt
