// The ray-traced reference, with Embree.
#pragma once

#include "tools/trace/assembly.h"

#include <array>
#include <atomic>
#include <cstdint>
#include <functional>
#include <memory>
#include <vector>

struct RTCDeviceTy;
struct RTCSceneTy;

namespace nusselt::tools {

// A posed scene ready to be traced. Vertices at equal posed positions count as one point, whichever mesh they
// belong to; a triangle with a corner at a point is incident to it.
struct TraceScene {
    std::unique_ptr<RTCDeviceTy, void (*)(RTCDeviceTy*)> device;
    std::unique_ptr<RTCSceneTy, void (*)(RTCSceneTy*)> scene;
    std::vector<uint32_t> point;                    // of each vertex
    std::vector<uint32_t> incident_begin, incident; // of each point: triangle numbers, rising
    float diagonal = 0;                             // of the bounds
};

// Throws Failure when Embree can't be started or has no memory. The assembly may go away afterwards.
TraceScene make_trace_scene(const Assembly& all);

// What the incident triangles hide of the hemisphere over a receiver. Direction s is hidden by triangle (p,
// a, b) where it lies in the spherical triangle (a - p, b - p, -n), below the arc from a to b: a ray that
// starts a hair above p in direction s goes through the triangle, and one that starts at p doesn't touch it.
// But for triangles with an edge within 1e-4 of the normal: those stand upright, and hide nothing so.
struct Fan {
    // Three planes through the receiver a triangle; s is hidden where all three products are positive.
    std::vector<std::array<double, 9>> planes;
};

// `corners`: 2 points a triangle, those which aren't the receiver's. Triangles that stay below the horizon
// are left out.
void make_fan(const glm::dvec3& receiver, const glm::dvec3& normal, const std::vector<glm::dvec3>& corners,
              Fan& fan);
bool hidden_by(const Fan& fan, const glm::dvec3& direction);

enum class Facing {
    both, // a triangle blocks whichever side is hit: the truth
    front // only where its front is seen: to study what culling back faces changes
};

struct TraceOptions {
    uint32_t rays = 1024; // a receiver; rounded up to a square of a multiple of 4
    uint64_t seed = 1;
    Facing facing = Facing::both;
    double lift = 0; // of the scene's diagonal: moves the rays' origins along the normal
    // Distances, in the unit of the positions, between which what blocks hides less and less, as a smooth
    // step falls: FrameDesc::falloff. The fan of incident triangles hides all. 0, 0: no falloff.
    double fade_from = 0, fade_to = 0;
    bool halves = false; // half of the rays each in two independent sets, so that the noise can be told
    const std::atomic<bool>* cancel = nullptr;
    std::function<void(double)> progress = nullptr; // from one thread at a time, in [0, 1]
};

struct TraceResult {
    std::vector<float> transfer; // 25 a vertex
    std::vector<float> half[2];  // empty without `halves`; `transfer` is their mean
    bool cancelled = false;
    double seconds = 0;
};

// Transfer vectors of all vertices: cosine-distributed rays, jittered on the concentric map (Shirley, Chiu
// 1997) of a square grid, from the exact position; the fan of incident triangles decided per ray as above;
// sums in double. A vertex whose position or normal isn't finite, or whose normal is zero, gets zeros. The
// same seed gives the same result for any number of threads.
TraceResult trace_transfer(const TraceScene& scene, const Assembly& all, const TraceOptions& options);

// Which of the directions (unit, over the hemisphere of the vertex) are blocked, by the rules of
// trace_transfer: what a mask of these samples holds when it is exact. False: position or normal isn't
// finite, or the normal is zero.
bool trace_blocked(const TraceScene& scene, const Assembly& all, uint32_t vertex,
                   const std::vector<glm::dvec3>& directions, std::vector<uint8_t>& blocked);

// Transfer vectors of vertices that nothing shadows, in closed form.
std::vector<float> open_transfers(const std::vector<glm::vec3>& normals);

// Relative L2 error of transfer vectors, |ours - reference| / |reference|, over receivers that see at least 1
// %.
struct TransferError {
    uint32_t receivers = 0;
    double mean = 0, median = 0, p95 = 0, p99 = 0, max = 0;
    double pooled = 0; // root of the summed squares over that of the reference's
};

// `only`: one flag a vertex, or empty for all.
TransferError transfer_error(const std::vector<float>& ours, const std::vector<float>& reference,
                             const std::vector<uint8_t>& only = {});

// Cosine-weighted part of the hemisphere that a transfer vector has seen.
double seen_part(const float transfer[25]);

// Receivers that don't touch another surface: they see at least 10 %, and the reference moves less than 10 %
// when its origin is lifted (by clear_lift of the diagonal).
constexpr double clear_lift = 2e-4;
std::vector<uint8_t> clear_receivers(const std::vector<float>& reference, const std::vector<float>& lifted);

} // namespace nusselt::tools
