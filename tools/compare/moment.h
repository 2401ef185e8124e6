// The moments of an animation at which everything is compared, each with its ray-traced reference.
#pragma once

#include "bench/scenes/scene.h"
#include "tools/compare/figures.h"
#include "tools/trace/assembly.h"

#include <cstdint>
#include <functional>
#include <vector>

namespace nusselt::tools {

// A moment that `follows` comes 1/30 s after the one before it in the list and is only there for the change
// of the error from frame to frame.
struct Moment {
    double time = 0;
    bool follows = false;
    scenes::Pose pose;
    Assembly all;
    std::vector<uint32_t> receivers;       // all with position and normal of their own
    std::vector<uint32_t> traced;          // those with a reference
    std::vector<float> reference, half[2]; // 25 a vertex
    std::vector<uint8_t> clear;            // a vertex; empty where it follows
};

// `count` moments evenly over the animation, each with the one that follows; one of a scene that stands
// still.
std::vector<Moment> make_moments(const scenes::Scene& scene, uint32_t count);

// At most `most` of `all`, evenly, in runs of `run` neighbours.
std::vector<uint32_t> evenly(const std::vector<uint32_t>& all, size_t most, size_t run);

// Fills in the reference, `rays` a receiver in two independent halves, and which receivers are clear.
// False: interrupted, and the moment has no reference. `show` is called with the part done.
bool trace_reference(Moment& moment, const std::vector<uint32_t>& wanted, uint32_t rays, uint64_t seed,
                     const std::function<void(double)>& show);

// The reference's own noise over all moments that don't follow, as a relative error of each receiver.
struct Noise {
    Distribution all, clear;
    double change = 0; // mean of the temporal figure that noise alone makes
    uint64_t dark = 0; // receivers that see under 1 %; not counted above
};
Noise reference_noise(const std::vector<Moment>& moments);

} // namespace nusselt::tools
