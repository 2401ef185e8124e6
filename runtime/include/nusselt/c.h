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
nusselt_status nusselt_share_mesh(nusselt_context* context, nusselt_mesh mesh, nusselt_mesh* out);
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

/* ---- frames: more than 64 meshes or 128 outputs in one take a temporary allocation ---- */

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

/* As in nusselt/output.h, with the same numbers. */
enum {
    NUSSELT_OUTPUT_TRANSFER = 0,
    NUSSELT_OUTPUT_AMBIENT_OCCLUSION = 1,
    NUSSELT_OUTPUT_BENT_NORMAL = 2,
    NUSSELT_OUTPUT_GLOSSY = 3,
    NUSSELT_OUTPUT_RADIANCE = 4,
    NUSSELT_OUTPUT_DIRECT = 5
};
enum { NUSSELT_FORMAT_FLOAT32 = 0, NUSSELT_FORMAT_FLOAT16 = 1, NUSSELT_FORMAT_PACKED8 = 2 };

typedef struct nusselt_output {
    uint32_t kind;
    uint32_t format;
    void* data;
    size_t count;
    size_t stride;   /* 0: nusselt_output_bytes */
    uint32_t bands;  /* 0: 5 */
    float window[5]; /* all 0: none */
} nusselt_output;

size_t nusselt_output_bytes(uint32_t kind, uint32_t format, uint32_t bands);
void nusselt_unpack_transfer(const void* packed, uint32_t bands, float out[25]);

/* As in nusselt/environment.h. `mask_bits` 0: 1024. `bad` may be null. */
typedef struct nusselt_environment nusselt_environment;
nusselt_status nusselt_create_environment(nusselt_context* context, const float* rgb, uint32_t width,
                                          uint32_t height, uint32_t mask_bits, nusselt_environment** out,
                                          uint64_t* bad);
void nusselt_destroy_environment(nusselt_context* context, nusselt_environment* environment);

/* As in nusselt/gloss.h, with the same members. */
enum { NUSSELT_BRDF_PHONG = 0, NUSSELT_BRDF_GGX = 1 };

typedef struct nusselt_material {
    uint32_t brdf;
    float diffuse[3];
    float specular[3];
    float roughness;   /* ggx */
    uint32_t exponent; /* phong */
} nusselt_material;

typedef struct nusselt_gloss {
    float eye[3];
    uint32_t distant;
    const nusselt_material* materials;
    uint32_t material_count;
    const uint16_t* material_of;
} nusselt_gloss;

nusselt_material nusselt_metallic_roughness(const float base_color[3], float metallic, float roughness);
float nusselt_sharpest_roughness(uint32_t mask_bits);
float nusselt_lobe_beyond_bands(const nusselt_material* material, uint32_t bands);

typedef struct nusselt_frame_mesh {
    nusselt_mesh mesh;
    nusselt_vec3_view positions;
    nusselt_vec3_view normals;
    nusselt_transfer_view transfer;
    nusselt_mask_view masks;
    const uint32_t* needed; /* bits of the vertices that need results; null: all */
    const nusselt_output* outputs;
    size_t output_size; /* sizeof(nusselt_output), where there are any, on either side */
    uint32_t output_count;
    uint32_t receive_only;      /* 1: it hides nothing */
    const nusselt_gloss* gloss; /* for outputs of glossy light and radiance; may be null */
    size_t gloss_size;          /* sizeof(nusselt_gloss), where there is one */
    /* What lies behind the vertices, as nusselt::BackSide; all zero: one side. */
    nusselt_transfer_view back_transfer;
    nusselt_mask_view back_masks;
    const uint32_t* back_needed;
    const nusselt_output* back_outputs; /* elements of output_size */
    uint32_t back_output_count;
    uint32_t object; /* meshes of other objects are seen coarsely, as nusselt::FrameMesh::object */
} nusselt_frame_mesh;

/* As in nusselt/visible_set.h: what matters to a list of meshes, in the order that frames have them. */
typedef struct nusselt_visible_set nusselt_visible_set;
nusselt_status nusselt_create_visible_set(nusselt_context* context, const nusselt_mesh* meshes,
                                          uint32_t mesh_count, uint32_t quality, uint32_t segments,
                                          nusselt_visible_set** out);
void nusselt_destroy_visible_set(nusselt_context* context, nusselt_visible_set* set);
size_t nusselt_visible_set_bytes(const nusselt_visible_set* set);
nusselt_status nusselt_write_visible_set(const nusselt_visible_set* set, void* data, size_t size);
nusselt_status nusselt_read_visible_set(nusselt_context* context, const nusselt_mesh* meshes,
                                        uint32_t mesh_count, const void* data, size_t size,
                                        nusselt_visible_set** out);
/* How many segments it has; 0 for null. */
uint32_t nusselt_visible_set_segments(const nusselt_visible_set* set);

typedef struct nusselt_frame_desc {
    size_t size;
    const nusselt_frame_mesh* meshes;
    size_t mesh_size; /* sizeof(nusselt_frame_mesh) */
    uint32_t mesh_count;
    uint32_t quality;
    uint32_t order;      /* bands of the transfer vectors, 1 to 5; 0: 5 */
    uint32_t same_pose;  /* 1: positions and normals are those of the history's last frame, and not read */
    const float* origin; /* 3 floats; null: chosen */
    nusselt_history history;                /* zero: everything is computed */
    float budget_us;                        /* 0: no limit */
    float falloff_from, falloff_to;         /* as nusselt::Falloff; 0: none */
    const float* light;                     /* 75, for outputs of radiance; may be null */
    const nusselt_environment* environment; /* for outputs of direct light; may be null */
    const nusselt_visible_set* visible;     /* blockers to look at; null: all */
    nusselt_visible_set* record;            /* null, or what matters in this frame is added to it */
    uint32_t visible_segment;               /* of either */
    uint32_t watertight;                    /* 1: as nusselt::FrameDesc::watertight */
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
enum { NUSSELT_WINDOW_HANN = 0, NUSSELT_WINDOW_LANCZOS = 1 };
void nusselt_sh_window(uint32_t window, float width, float out[5]);
void nusselt_sh_apply_window(const float window[5], uint32_t channels, float* coefficients);
/* `order`: that of the frame; 0: 5. */
nusselt_status nusselt_shade(const nusselt_context* context, const float light[75], uint32_t order,
                             nusselt_transfer_view transfer, nusselt_vec3_view albedo, float* rgb);

#ifdef __cplusplus
}
#endif

#endif
