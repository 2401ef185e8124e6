// The peer: ray tracing with Embree as an engineer would who wants it fast, so that what we claim against it
// counts.
//
//  - the mask's own concentric grid, traced as 4x4 coherent packets (rtcOccluded16), denormals flushed;
//  - each cell weighs its own integral of the basis (without them the error doubles); blocks that are all
//  open or all
//    blocked are one addition or none;
//  - a BVH that is refitted every frame, never rebuilt (scene DYNAMIC with quality LOW, geometry REFIT);
//  - no filter function: the receiver's own triangles are avoided by lifting the rays' origins off the
//  surface by
//    `peer_lift` of the diagonal. A ray from a hair above the surface meets the incident triangles that rise
//    over the horizon, as it should, so no fan is needed.
#pragma once

#include "tools/compare/grid.h"
#include "tools/trace/assembly.h"

#include <nusselt/executor.h>

#include <atomic>
#include <cstdint>
#include <memory>
#include <vector>

struct RTCDeviceTy;
struct RTCSceneTy;
struct RTCGeometryTy;

namespace nusselt::tools {

// Of the scene's diagonal. Chosen by measured error, docs/compare.md.
constexpr double peer_lift = 5e-6;

enum class PeerLoop {
    packets, // 4x4 coherent packets
    single   // the naive loop, one ray at a time: for information
};

struct PeerTime {
    double cpu_ms = 0, wall_ms = 0; // refit included
    double refit_ms = 0;            // processor time
    double refit_wall_ms = 0;
};

class Peer {
public:
    // Builds the BVH over the first pose. Throws Failure when Embree can't be started. `threads` 1: no thread
    // is made.
    Peer(const Assembly& first, uint32_t threads);
    ~Peer();
    Peer(const Peer&) = delete;
    Peer& operator=(const Peer&) = delete;

    // One frame: new positions, refit, transfer vectors of `receivers` (vertex numbers) into transfer[25 *
    // vertex].
    PeerTime frame(const Assembly& all, const std::vector<uint32_t>& receivers, const SampleGrid& grid,
                   PeerLoop loop, std::vector<float>& transfer);

    double lift = peer_lift;                      // for the measurement that chose it
    float tnear = 0;                              // of the diagonal; likewise
    double build_ms() const { return build_ms_; } // of the first BVH
    size_t bytes() const { return bytes_; }       // Embree's own count
    uint32_t threads() const { return threads_; }

private:
    void trace(const Assembly& all, const uint32_t* receivers, uint32_t count, const SampleGrid& grid,
               PeerLoop loop, float* transfer) const;

    uint32_t threads_ = 1;
    Executor executor_;
    double build_ms_ = 0;
    std::atomic<int64_t> counted_{0};
    size_t bytes_ = 0;
    double diagonal_ = 0;
    std::unique_ptr<RTCDeviceTy, void (*)(RTCDeviceTy*)> device_;
    std::unique_ptr<RTCSceneTy, void (*)(RTCSceneTy*)> scene_;
    RTCGeometryTy* geometry_ = nullptr; // the scene's
    void* positions_ = nullptr;
};

// Vertices with position and normal of their own: one receiver each.
std::vector<uint32_t> distinct_receivers(const Assembly& all);

} // namespace nusselt::tools
