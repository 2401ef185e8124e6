// The peer: ray tracing with Embree as an engineer would who wants it fast, so that what we claim against it
// counts.
//
//  - the mask's own concentric grid, traced as packets of 4x4 (rtcOccluded16), denormals flushed;
//  - each cell weighs its own integral of the basis (without them the error doubles); blocks that are all
//    open or all blocked are one addition or none;
//  - a BVH that is truly refitted every frame (scene DYNAMIC with quality LOW, geometry REFIT), or rebuilt
//  (quality
//    MEDIUM) where that pays; traversal told that packets are coherent, or that they are not; Embree's
//    vectors of 256 or 512 bits: `tune` finds out what is fastest here, for this scene and number of rays;
//  - no filter function: the receiver's own triangles are avoided by lifting the rays' origins off the
//    surface by `peer_lift` of the diagonal. A ray from a hair above the surface meets the incident triangles
//    that rise over the horizon, as it should, so no fan is needed.
#pragma once

#include "tools/compare/grid.h"
#include "tools/trace/assembly.h"

#include <nusselt/executor.h>

#include <atomic>
#include <cstdint>
#include <map>
#include <memory>
#include <string>
#include <vector>

struct RTCDeviceTy;
struct RTCSceneTy;
struct RTCGeometryTy;

namespace nusselt::tools {

// Of the scene's diagonal. Chosen by measured error, docs/compare.md.
constexpr double peer_lift = 5e-6;

enum class PeerLoop {
    packets, // of 4x4 rays
    single   // the naive loop, one ray at a time: for information
};

// How the peer traces: what tuning chooses among.
struct PeerSetup {
    bool rebuild = false;  // the BVH, every frame; or refit it
    bool coherent = false; // RTC_INTERSECT_CONTEXT_FLAG_COHERENT, or _INCOHERENT
};
std::string setup_name(const PeerSetup& setup);

struct PeerTime {
    double cpu_ms = 0, wall_ms = 0; // the BVH's update included
    double update_ms = 0;           // processor time of refit or rebuild
    double update_wall_ms = 0;
};

class Peer {
public:
    // Builds the BVH that is refitted over the first pose. Throws Failure when Embree can't be started.
    // `threads` 1: no thread is made.
    Peer(const Assembly& first, uint32_t threads);
    ~Peer();
    Peer(const Peer&) = delete;
    Peer& operator=(const Peer&) = delete;

    // Times all setups on some of the receivers of a pose and takes the fastest for each grid from then on:
    // the update shared among all receivers, and the tracing of one. Untuned: refitted, incoherent.
    void tune(const Assembly& all, const std::vector<uint32_t>& receivers,
              const std::vector<const SampleGrid*>& grids);
    PeerSetup setup_of(const SampleGrid& grid) const;

    // One frame: new positions, the BVH's update, transfer vectors of `receivers` (vertex numbers) into
    // transfer[25 * vertex].
    PeerTime frame(const Assembly& all, const std::vector<uint32_t>& receivers, const SampleGrid& grid,
                   PeerLoop loop, std::vector<float>& transfer);

    double lift = peer_lift;                      // for the measurement that chose it
    float tnear = 0;                              // of the diagonal; likewise
    double build_ms() const { return build_ms_; } // of the first BVH
    size_t bytes() const { return bytes_; }       // Embree's own count
    uint32_t threads() const { return threads_; }

private:
    struct Tree {
        std::unique_ptr<RTCDeviceTy, void (*)(RTCDeviceTy*)> device;
        std::unique_ptr<RTCSceneTy, void (*)(RTCSceneTy*)> scene;
        RTCGeometryTy* geometry = nullptr; // the scene's
        void* positions = nullptr;
    };
    Tree& tree_of(const PeerSetup& setup, const Assembly& all);
    void update(const Tree& tree, const Assembly& all) const;
    void trace(const Tree& tree, bool coherent, const Assembly& all, const uint32_t* receivers,
               uint32_t count, const SampleGrid& grid, PeerLoop loop, float* transfer) const;

    uint32_t threads_ = 1;
    Executor executor_;
    double build_ms_ = 0;
    std::atomic<int64_t> counted_{0}; // of the refitted BVH
    size_t bytes_ = 0;
    double diagonal_ = 0;
    std::unique_ptr<Tree> trees_[2];       // [rebuild], made when first used
    std::map<uint32_t, PeerSetup> setups_; // by the grid's side
};

// Vertices with position and normal of their own: one receiver each.
std::vector<uint32_t> distinct_receivers(const Assembly& all);

} // namespace nusselt::tools
