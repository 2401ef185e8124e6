// The output kernels' tables: the reference, and one source (outputs_simd.cpp) compiled for each instruction
// set.
#pragma once

#include "kernels/outputs.h"

namespace nusselt::kernels {

extern const OutputKernels reference_output_kernels;

const OutputKernels* sse4_output_kernels();
const OutputKernels* avx2_output_kernels();
const OutputKernels* avx512_output_kernels();
const OutputKernels* neon_output_kernels(); // on aarch64; the others on x86-64

} // namespace nusselt::kernels
