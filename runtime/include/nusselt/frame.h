// Frames: positions in, transfer vectors out.
#pragma once

#include "nusselt/environment.h"
#include "nusselt/gloss.h"
#include "nusselt/history.h"
#include "nusselt/mesh.h"
#include "nusselt/output.h"

namespace nusselt {

struct VisibleSet; // visible_set.h

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

// What lies behind a mesh's vertices: results for the hemispheres around the opposite of its normals, as a
// mesh with those normals would get them, bit for bit. For sheets that are seen from both sides: cloth,
// leaves, paper, glTF's doubleSided. Points, bounds and levels of detail are made once. Where a mesh has no
// closed parts and the same vertices need both sides, its blockers are looked at once, and a back costs 0.8
// times what a front costs; not in frames with a history, several objects, a falloff or a visible set, where
// it costs what a front does. Not for closed parts: behind their skin is their inside, which is dark and is
// found so, at a price. Nothing in it: one side, at no cost.
struct BackSide {
    TransferView transfer; // as in FrameMesh; each side may have its own or none
    MaskView masks;
    // Bits as in FrameMesh::needed. Null: those of the front, and all where that has none either. Set the
    // doubleSided ones where only a part of the mesh is a sheet, or those of which the camera sees the back.
    const uint32_t* needed = nullptr;
    const Output* outputs = nullptr; // copied by `submit`; a gloss's materials are those of the front
    uint32_t output_count = 0;
};

// One mesh in a frame. All arrays have the mesh's V elements and are borrowed until `wait` returns: until
// then positions and normals must not be written, and results not be read unless `poll` says done. A write in
// flight makes results that belong to neither pose; builds with NUSSELT_CHECKED find it out (see `wait`). An
// engine that animates the next frame meanwhile keeps two buffers, and two meshes or a wait in between.
struct FrameMesh {
    MeshId mesh;
    Vec3View positions;    // of this frame, in the space common to all meshes of the frame
    Vec3View normals;      // unit length within 1 %; also the receivers' hemisphere axes
    TransferView transfer; // data null and no outputs, nor any of the back: it blocks but does not receive
    MaskView masks;        // optional; only of a mesh that receives
    // Bit v % 32 of word v / 32 is set where vertex v needs its results; (V + 31) / 32 words. The others' are
    // left as they are in the arrays. Null: all need them. mark_visible (visible.h) makes it from a camera.
    const uint32_t* needed = nullptr;
    // Further streams; a mesh with any receives. Their descriptions are copied by `submit`. They are made of
    // all five bands, whatever FrameDesc::order. With a history, of transfer vectors alone: not glossy, not
    // direct.
    const Output* outputs = nullptr;
    uint32_t output_count = 0;
    const Gloss* gloss = nullptr; // for outputs that depend on the view
    // 1: the mesh hides nothing, not even of itself, and its levels of detail are not looked at: a ground
    // that only takes shadows, a particle, a probe.
    uint32_t receive_only = 0;
    BackSide back = {};
    // Meshes with the same number are one object: a character and all that it wears. Meshes of other objects
    // block it as coarse proxies of themselves, finer where they are nearer, and not at all where they are
    // small and far: so an object costs about the same in a crowd as alone. Objects that touch or reach into
    // one another shadow one another at full detail where they meet. Of vertices at one place with one
    // normal, of which only some are needed, far objects may take a little more or less than of the others.
    // Of no effect with quality `paper`, whose meshes are coarse.
    uint32_t object = 0;
};

// Occlusion that fades with distance, as artists use it: blockers nearer than `from` hide all of the light
// from behind them, those beyond `to` none, in between as a smooth step. In the unit of the positions. It is
// no physical light: what is far away hides the sky in truth. Use it where only contact should darken, in a
// room say. Samples of a mask are hidden in part, in sixteenths, by how far off they meet a triangle; own
// triangles and a closed part around a receiver hide all. Masks have the samples of which anything is
// hidden. Short distances make a frame cheaper, those in the midst of a mesh up to a third dearer,
// and up to 1.7 times as dear where the fade begins at 0 (docs/outputs.md).
struct Falloff {
    float from = 0;
    float to = 0; // 0: none, all distances count
};

// The meshes of one frame form one shadow group: each blocks itself and all others, those of other objects
// (FrameMesh::object) coarsely.
struct FrameDesc {
    const FrameMesh* meshes = nullptr;
    uint32_t mesh_count = 0;
    Quality quality = Quality::standard;
    // Bands of the transfer vectors, 1 to 5: only the first order^2 terms are computed and written, with the
    // bits that they have in all 25. A smooth sky needs 3 (9 terms), sharper light more.
    uint32_t order = 5;
    // Where coordinates are most exact: 3 floats, finite, near the meshes. Null: the first finite position of
    // the first mesh. With a history, one that stays while vertices move: a new origin changes the rounding
    // of all positions, so nothing is kept.
    const float* origin = nullptr;
    HistoryId history = {}; // null: everything is computed
    // The meshes stand as in the history's last frame, or have moved since by one rigid motion together:
    // positions and normals are not read and may be null. Results are those of that frame, in its space; to
    // light an object that was moved, turn the light into the object's space (turn_light). Needs a history
    // whose last frame was of these meshes, quality and arrays.
    bool same_pose = false;
    // Microseconds from the first task on (ContextDesc::clock) after which no further batch of receivers is
    // begun; 0: no limit. At least one batch is computed, and the mesh-wide stages always are. Needs a
    // history: receivers that wait keep the results of an earlier frame, each whole; those that never had any
    // get those of a receiver without blockers. The longest stale go first, of these the most changed; so
    // all get their turn. Without a budget, same input gives the same bits; with one, time decides.
    float budget_us = 0;
    // Light for outputs of radiance, 25 terms of 3 channels as sh_project_latlong writes them; copied by
    // `submit`. Null: none of them is asked for.
    const float* light = nullptr;
    // For outputs of direct light, made for the quality's mask bits; borrowed until `wait` returns.
    const Environment* environment = nullptr;
    // Where the animation was known (visible_set.h), borrowed until `wait` returns: the blockers to look at,
    // in one of the set's segments; or a set that this frame's are added to, which takes a few times as long.
    const VisibleSet* visible = nullptr;
    VisibleSet* record = nullptr;
    uint32_t visible_segment = 0;
    Falloff falloff = {}; // not with quality `paper`, a history, a visible set,
                          // `watertight`, glossy or direct outputs
    // Where at most one in 16 of a mask's samples is open, these are decided by the triangles themselves, one
    // after the other until one is truly open: planes rounded to the table leave a few open around vertices,
    // which inside a closed surface is light from nowhere. For rooms and machines whose inside is seen; some
    // percent of the time, half as much again where many receivers are nearly dark. Not with quality `paper`
    // or a falloff.
    bool watertight = false;
};

// Counts of work done and of work skipped, summed over the frame, and CPU time summed over threads. Each side
// of a vertex is a receiver.
struct FrameStats {
    uint32_t receivers = 0;          // vertices of meshes that receive, and need it
    uint32_t receivers_unneeded = 0; // the others: their bit of `needed` is not set
    uint32_t receivers_computed = 0; // of `receivers`, through the kernels
    uint32_t receivers_copied = 0;   // of `receivers`, with the position and normal of another one
    uint32_t receivers_inside = 0; // of those computed, inside a closed part: all blocked, nothing rasterised
    uint32_t receivers_reused = 0; // of `receivers`, unchanged since the history's last frame
    uint32_t receivers_stale = 0;  // of `receivers`, with an earlier frame's result: the budget was spent
    uint32_t receivers_unshadowed = 0; // of the stale, never computed yet
    uint32_t stale_frames_max = 0; // of the stale: for how many frames their results have not been up to date
    double stale_frames_mean = 0;
    uint32_t receivers_invalid = 0; // position or normal not finite, or a zero normal: transfer is zero
    uint32_t receivers_written = 0; // whose results were written: all of them, unless the frame was cancelled
    uint32_t clusters_kept = 0;     // of which no vertex moved since the history's last frame: not refitted
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
    double rotate_ms = 0;    // SH rotation and store; outputs made from masks, and the integral of
                             // their diffuse part where they alone are asked for
};

// Starts a frame and returns at once (with the serial executor: when the work is done). `stale_handle`: a
// mesh is gone; `busy`: a mesh is in another frame in flight; `invalid_argument`: counts, strides or null
// pointers that do not fit. On any error nothing was started.
Status submit(Context* context, const FrameDesc& desc, FrameId* out);

// Whether the frame is done: *done is true when its results can be read. It returns at once and does no work;
// an executor that runs tasks only inside `finish` is never done before `wait`. `wait` must be called all the
// same. `stale_handle`: it was waited for.
Status poll(Context* context, FrameId frame, bool* done);

// Asks the frame to stop, from any thread, also while another one waits. No new piece of work is begun; what
// is begun (at most 128 vertices a thread, some milliseconds at the most) is finished. `wait` must be called
// all the same. A receiver then has either its whole result or what was in the array before;
// receivers_written counts the former. Cancelling a frame that is done changes nothing. `stale_handle`: it
// was waited for.
Status cancel(Context* context, FrameId frame);

// Helps until the frame is done; all results are then written. The handle is spent. `stats` may be null.
// `stale_handle`: it was waited for; `busy`: another thread waits for it at this moment.
// `changed`: the build is NUSSELT_CHECKED, and positions or normals are not those that were submitted; the
// frame is over all the same, with results of neither pose.
Status wait(Context* context, FrameId frame, FrameStats* stats);

} // namespace nusselt
