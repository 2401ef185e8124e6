/* The library from C and from languages that call C. The same objects and rules as the C++ headers, whose
 * comments say more; nusselt.h has the conventions.
 *
 * A descriptor begins with its size: set it to sizeof the struct and zero the rest; what is left zero has its
 * default. A later library knows the smaller structs of earlier headers by it. What the library fills begins
 * with a size in the same way, set by the caller. */
#ifndef NUSSELT_C_H
#define NUSSELT_C_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* As NUSSELT_VERSION in nusselt/version.h: 10000 major + 100 minor + patch. */
#define NUSSELT_C_VERSION 100

/* ---- status ---- */

enum {
    NUSSELT_OK = 0,
    NUSSELT_INVALID_ARGUMENT = 1,
    NUSSELT_OUT_OF_MEMORY = 2,
    NUSSELT_STALE_HANDLE = 3,
    NUSSELT_BUSY = 4,
    NUSSELT_UNSUPPORTED = 5,
    NUSSELT_CHANGED = 6
};

/* `text` names the consequence and the cure; never null, valid for ever. */
typedef struct nusselt_status {
    uint32_t code;
    const char* text;
} nusselt_status;

/* ---- version ---- */

uint32_t nusselt_version(void);
const char* nusselt_configuration(void);
/* To be called with NUSSELT_C_VERSION before anything else. */
nusselt_status nusselt_check_version(uint32_t header_version);

/* ---- hooks: allocator.h, executor.h and profiler.h say what the functions may and must do ---- */

typedef struct nusselt_allocator {
    void* user;
    void* (*allocate)(void* user, size_t size, size_t alignment);
    void (*release)(void* user, void* memory, size_t size, size_t alignment);
} nusselt_allocator;

typedef struct nusselt_executor {
    void* user;
    void* (*enqueue)(void* user, void (*run)(void* argument), void* argument);
    void (*finish)(void* user, void* ticket);
    uint32_t concurrency;
} nusselt_executor;

typedef struct nusselt_profiler {
    void* user;
    void (*begin)(void* user, const char* zone);
    void (*end)(void* user, const char* zone);
} nusselt_profiler;

typedef struct nusselt_clock {
    void* user;
    uint64_t (*nanoseconds)(void* user);
} nusselt_clock;

nusselt_status nusselt_create_tbb_executor(uint32_t threads, nusselt_executor* out);
void nusselt_destroy_executor(nusselt_executor* executor);

/* ---- context ---- */

/* 0 is the default; the others are one more than nusselt::Isa. */
enum {
    NUSSELT_ISA_BEST = 0,
    NUSSELT_ISA_SCALAR = 1,
    NUSSELT_ISA_SSE4 = 2,
    NUSSELT_ISA_AVX2 = 3,
    NUSSELT_ISA_AVX512 = 4,
    NUSSELT_ISA_NEON = 5
};

typedef struct nusselt_context nusselt_context;

typedef struct nusselt_context_desc {
    size_t size;
    nusselt_allocator allocator; /* default: the heap */
    nusselt_executor executor;   /* default: serial, on the calling thread */
    nusselt_profiler profiler;   /* default: none */
    uint32_t isa;
    nusselt_clock clock; /* of time budgets; default: the machine's steady clock */
} nusselt_context_desc;

/* `desc` null: all defaults. */
nusselt_status nusselt_create_context(const nusselt_context_desc* desc, nusselt_context** out);
nusselt_status nusselt_destroy_context(nusselt_context* context);
uint32_t nusselt_context_isa(const nusselt_context* context);
const char* nusselt_isa_name(uint32_t isa);

/* ---- meshes ---- */

/* A stride of 0 is that of an array without gaps: 12 for vectors, 100 for transfer, the quality's mask for
 * masks. */
typedef struct nusselt_vec3_view {
    const float* data;
    size_t count;
    size_t stride;
} nusselt_vec3_view;

typedef struct nusselt_transfer_view {
    float* data;
    size_t count;
    size_t stride;
} nusselt_transfer_view;

typedef struct nusselt_mask_view {
    uint32_t* data;
    size_t count;
    size_t stride;
} nusselt_mask_view;

typedef struct nusselt_mesh {
    uint32_t slot;
    uint32_t generation;
} nusselt_mesh;

typedef struct nusselt_mesh_desc {
    size_t size;
    nusselt_vec3_view rest_positions;
    nusselt_vec3_view rest_normals;
    const uint32_t* indices;
    size_t index_count;
} nusselt_mesh_desc;

typedef struct nusselt_mesh_info {
    size_t size;
    uint32_t vertices, triangles, welded_vertices, degenerate_triangles;
    uint32_t components, closed_components;
    uint32_t boundary_edges, non_manifold_edges, flipped_edges;
    uint32_t levels, clusters;
    uint32_t level_triangles[16];
    size_t bytes;
    uint32_t coarse_triangles;
} nusselt_mesh_info;

nusselt_status nusselt_add_mesh(nusselt_context* context, const nusselt_mesh_desc* desc, nusselt_mesh* out);
nusselt_status nusselt_remove_mesh(nusselt_context* context, nusselt_mesh mesh);
nusselt_status nusselt_get_mesh_info(const nusselt_context* context, nusselt_mesh mesh,
                                     nusselt_mesh_info* out);
/* Bytes at most that adding the mesh would hold, and that it would take meanwhile. */
nusselt_status nusselt_mesh_memory_bound(const nusselt_context* context, const nusselt_mesh_desc* desc,
                                         size_t* held, size_t* peak);

/* ---- histories: history.h says more ---- */

typedef struct nusselt_history {
    uint32_t slot;
    uint32_t generation;
} nusselt_history;

nusselt_status nusselt_create_history(nusselt_context* context, nusselt_history* out);
nusselt_status nusselt_remove_history(nusselt_context* context, nusselt_history history);

/* ---- frames: more than 64 meshes in one take a temporary allocation ---- */

/* 0 is the default, NUSSELT_QUALITY_STANDARD; the others are one more than nusselt::Quality. */
enum {
    NUSSELT_QUALITY_DEFAULT = 0,
    NUSSELT_QUALITY_PAPER = 1,
    NUSSELT_QUALITY_DRAFT = 2,
    NUSSELT_QUALITY_STANDARD = 3,
    NUSSELT_QUALITY_FINE = 4
};

uint32_t nusselt_quality_mask_bits(uint32_t quality);

typedef struct nusselt_frame {
    uint32_t slot;
    uint32_t generation;
} nusselt_frame;

typedef struct nusselt_frame_mesh {
    nusselt_mesh mesh;
    nusselt_vec3_view positions;
    nusselt_vec3_view normals;
    nusselt_transfer_view transfer;
    nusselt_mask_view masks;
    const uint32_t* needed; /* bits of the vertices that need results; null: all */
} nusselt_frame_mesh;

typedef struct nusselt_frame_desc {
    size_t size;
    const nusselt_frame_mesh* meshes;
    size_t mesh_size; /* sizeof(nusselt_frame_mesh) */
    uint32_t mesh_count;
    uint32_t quality;
    uint32_t order;      /* bands of the transfer vectors, 1 to 5; 0: 5 */
    uint32_t same_pose;  /* 1: positions and normals are those of the history's last frame, and not read */
    const float* origin; /* 3 floats; null: chosen */
    nusselt_history history; /* zero: everything is computed */
    float budget_us;         /* 0: no limit */
} nusselt_frame_desc;

typedef struct nusselt_frame_stats {
    size_t size;
    uint32_t receivers, receivers_computed, receivers_invalid, receivers_written;
    uint32_t triangles_invalid, threads;
    uint64_t clusters_tested, clusters_rasterized;
    uint64_t triangles_considered, triangles_rasterized, fan_triangles;
    uint64_t blocks_uniform, blocks_partial;
    double wall_ms, cpu_ms;
    uint32_t receivers_unneeded, receivers_copied, receivers_reused, clusters_kept;
    uint32_t receivers_stale, receivers_unshadowed, stale_frames_max, reserved; /* reserved: 0 */
    double stale_frames_mean;
    uint32_t receivers_inside, reserved2; /* reserved2: 0 */
} nusselt_frame_stats;

nusselt_status nusselt_submit(nusselt_context* context, const nusselt_frame_desc* desc, nusselt_frame* out);
nusselt_status nusselt_poll(nusselt_context* context, nusselt_frame frame, int* done);
nusselt_status nusselt_cancel(nusselt_context* context, nusselt_frame frame);
/* `stats` may be null. */
nusselt_status nusselt_wait(nusselt_context* context, nusselt_frame frame, nusselt_frame_stats* stats);

/* ---- what cameras need: visible.h says more ---- */

typedef struct nusselt_camera {
    size_t size;
    float clip_from_position[16];
    float eye[4];
    float margin;
    uint32_t back_faces; /* 1: triangles seen from behind count too */
} nusselt_camera;

/* Sets bits for nusselt_frame_mesh::needed, clears none. */
nusselt_status nusselt_mark_visible(const nusselt_camera* camera, nusselt_vec3_view positions,
                                    const uint32_t* indices, size_t index_count, uint32_t* needed);

/* ---- lighting ---- */

void nusselt_sh_evaluate(float x, float y, float z, float out[25]);
nusselt_status nusselt_sh_project_latlong(const float* rgb, uint32_t width, uint32_t height, float out[75],
                                          uint64_t* bad);
void nusselt_sh_rotate(const float rotation[9], const float coefficients[25], float out[25]);
void nusselt_turn_light(const float object_to_world[9], const float light[75], float out[75]);
/* `order`: that of the frame; 0: 5. */
nusselt_status nusselt_shade(const nusselt_context* context, const float light[75], uint32_t order,
                             nusselt_transfer_view transfer, nusselt_vec3_view albedo, float* rgb);

#ifdef __cplusplus
}
#endif

#endif
