// The SIMD tables, one source (simd.cpp) compiled for each instruction set. Null where the build lacks it.
#pragma once

#include "kernels/kernels.h"

namespace nusselt::kernels {

const Kernels* sse4_kernels();
const Kernels* avx2_kernels();
const Kernels* avx512_kernels();
const Kernels* neon_kernels(); // on aarch64; the others on x86-64

} // namespace nusselt::kernels
