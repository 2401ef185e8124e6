// The light kernels' tables: the reference, and one source (light_simd.cpp) compiled for each instruction
// set.
#pragma once

#include "kernels/light.h"

namespace nusselt::kernels {

extern const LightKernels reference_light_kernels;

const LightKernels* sse4_light_kernels();
const LightKernels* avx2_light_kernels();
const LightKernels* avx512_light_kernels();
const LightKernels* neon_light_kernels(); // on aarch64; the others on x86-64

} // namespace nusselt::kernels
