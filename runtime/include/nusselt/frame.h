// Frames: positions in, transfer vectors out.
#pragma once

#include "nusselt/mesh.h"

namespace nusselt {

enum class Quality : uint32_t {
    paper = 0,    // Kautz, Lehtinen, Aila 2004, faithfully: the baseline to compare with
    draft = 1,    // fewest triangles, 1024 bits
    standard = 2, // 1024 bits; the default
    fine = 3,     // 4096 bits
};

const char* quality_name(Quality quality);
bool quality_from_name(const char* name, Quality* out);
uint32_t quality_mask_bits(Quality quality);

struct FrameId {
    uint32_t slot = 0;
    uint32_t generation = 0;
};

// One mesh in a frame. All arrays are borrowed until `wait` returns, and have the mesh's V elements.
struct FrameMesh {
    MeshId mesh;
    Vec3View positions;    // of this frame, in the space common to all meshes of the frame
    Vec3View normals;      // unit length within 1 %; also the receivers' hemisphere axes
    TransferView transfer; // data null: the mesh blocks but does not receive
    MaskView masks;        // optional
};

// The meshes of one frame form one shadow group: each blocks itself and all others.
struct FrameDesc {
    const FrameMesh* meshes = nullptr;
    uint32_t mesh_count = 0;
    Quality quality = Quality::standard;
};

// Counts of work done and of work skipped, summed over the frame, and CPU time summed over threads.
struct FrameStats {
    uint32_t receivers = 0;          // vertices that asked for a transfer vector
    uint32_t receivers_computed = 0; // of these, with position and normal of their own
    uint32_t receivers_invalid = 0;  // position or normal not finite, or a zero normal: transfer is zero
    uint64_t clusters_tested = 0;
    uint64_t clusters_rasterized = 0;
    uint64_t triangles_considered = 0; // (receiver, triangle) pairs in the clusters that were left
    uint64_t triangles_rasterized = 0; // of these, rasterised
    uint64_t fan_triangles = 0;        // incident triangles that rise above the horizon
    uint64_t blocks_uniform = 0;       // integration blocks wholly open or wholly blocked
    uint64_t blocks_partial = 0;
    uint32_t triangles_invalid = 0; // triangles of the finest level with a corner that is not finite
    uint32_t threads = 0;           // threads that took part
    double wall_ms = 0;             // from submit to the end of the last task
    double cpu_ms = 0;              // summed over threads, of which:
    double refit_ms = 0;
    double cull_ms = 0;      // cluster selection
    double transform_ms = 0; // transform, facing, horizon, planes
    double raster_ms = 0;    // AND, OR
    double integrate_ms = 0; // downsampling and integration
    double rotate_ms = 0;    // SH rotation and store
};

// Starts a frame and returns at once (with the serial executor: when the work is done). `stale_handle`: a
// mesh is gone; `busy`: a mesh is in another frame in flight; `invalid_argument`: counts, strides or null
// pointers that do not fit. On any error nothing was started.
Status submit(Context* context, const FrameDesc& desc, FrameId* out);

// Helps until the frame is done; all results are then written. The handle is spent. `stats` may be null.
Status wait(Context* context, FrameId frame, FrameStats* stats);

} // namespace nusselt
