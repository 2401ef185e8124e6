// What the opaque Environment holds.
#pragma once

#include "kernels/light.h"
#include "memory.h"
#include "nusselt/environment.h"

namespace nusselt {

struct Environment {
    explicit Environment(const Allocator& a) : texels(HostAllocator<float>(a)) {}

    Vector<float> texels;
    kernels::SkyMap map{};
    uint32_t mask_bits = 0;
};

} // namespace nusselt
