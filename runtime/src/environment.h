// What the opaque Environment holds.
#pragma once

#include "kernels/light.h"
#include "memory.h"
#include "nusselt/environment.h"

namespace nusselt {

// Brighter pixels count as this: an environment all of it has SH coefficients below 3e36, 25 products with a
// transfer vector stay finite, and so do the sums over a mask's blocks.
constexpr float brightest = 1e35f;

struct Environment {
    explicit Environment(const Allocator& a) : texels(HostAllocator<float>(a)) {}

    Vector<float> texels;
    kernels::SkyMap map{};
    uint32_t mask_bits = 0;
};

} // namespace nusselt
