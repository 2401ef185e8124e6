// Run time against error on one scene: every quality and the peer in one process, alternating, against one
// reference.
#pragma once

#include "bench/scenes/scene.h"
#include "tools/compare/figures.h"
#include "tools/compare/moment.h"
#include "tools/compare/timing.h"
#include "tools/image/image.h"
#include "tools/report/progress.h"

#include <nusselt/nusselt.h>

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

namespace nusselt::tools {

struct MeasureOptions {
    uint32_t frames = 3;             // moments of the animation, evenly over it
    uint32_t repeats = 3;            // timed rounds over all entries
    uint32_t threads = 1;            // of every entry
    uint32_t scaling_threads = 0;    // measured from 1 up to this many; 0: as many as the machine has
    uint32_t reference_rays = 16384; // a receiver
    uint32_t most_receivers = 20000; // with a reference, a frame; more are thinned out evenly
    uint32_t most_peer_rays = 4096;
    // Of a scene; 0: none. With a limit the reference and the peer's times are taken on as many receivers as
    // it allows, what is needed least is left out when it is over, and scaling is not measured.
    double limit_seconds = 0;
    bool naive = false;
    Isa isa = Isa::best;
};

enum class Kind {
    ours,
    peer,    // Embree, packets
    centred, // the same through the centres of the cells, each weighing its cell: what better samples gain it
    naive,   // Embree, one ray at a time
    floor    // exact rays through a mask's own sample points: no time
};
const char* kind_name(Kind kind);

struct Entry {
    std::string name;
    Kind kind = Kind::ours;
    uint32_t samples = 0; // bits of the mask, or rays a receiver
    // Figures.
    ErrorFigures all, clear;
    Distribution absolute, ambient, change;
    std::vector<RadianceError> radiance; // of each light
    Histogram histogram_all{}, histogram_clear{};
    std::vector<Worst> worst;
    // Time: a repeat is all frames once.
    Time us;                         // processor microseconds a receiver
    Time wall_ms;                    // a frame
    EqualError peer_all, peer_clear; // the peer's `us.min` at this entry's mean error
    std::optional<FrameStats> stats; // ours: of the fastest repeat, summed over frames
    Time update_ms;                  // peer: refit or rebuild of a frame's BVH
    std::string setup;               // peer: what was fastest, setup_name()
};

struct ScalingPoint {
    std::string entry;
    uint32_t threads = 0, took_part = 0;
    Time wall_ms, us;
    uint64_t hash = 0; // of the transfer vectors
};

struct Shot {
    std::string name, title;
    Picture picture;
};

struct SceneReport {
    std::string name;
    bool complete = false; // all repeats were made
    uint32_t repeats = 0;
    uint64_t vertices = 0, triangles = 0, receivers = 0;  // receivers: of one frame
    std::vector<double> times;                            // moments in seconds
    uint32_t reference_rays = 0, reference_receivers = 0; // a frame
    double reference_seconds = 0;
    uint64_t peer_receivers = 0; // a frame, on which the peer was timed; its times are scaled up to all
    Noise noise;                 // of the reference itself; its counts are receivers over all frames
    std::vector<std::string> lights;
    std::vector<Entry> entries;
    std::vector<ScalingPoint> scaling;
    std::vector<Shot> shots;
    std::vector<std::string> notes;
    // Memory, bytes.
    uint64_t mesh_bytes = 0, context_bytes = 0, peer_bytes = 0;
    double add_mesh_ms = 0;
    double peer_build_ms = 0, peer_refit_ms = 0; // the refit's median; 0: always rebuilt
    std::string isa;
    uint32_t levels = 0, coarse_triangles = 0;
};

// Stops early, with what it has, when interrupted() is set; throws Failure when there is nothing to tell.
// `show` is called with the part done.
SceneReport measure_scene(const scenes::Scene& scene, const MeasureOptions& options,
                          const std::vector<Light>& lights,
                          const std::function<void(double, const char*)>& show);

} // namespace nusselt::tools
