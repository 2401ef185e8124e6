// The SIMD tables, one source each (simd.cpp, fading_simd.cpp, outputs_simd.cpp, light_simd.cpp) compiled for
// every instruction set. Null where the build lacks the set; whether the processor has it is dispatch.cpp's
// to know.
#pragma once

#include "kernels/fading.h"
#include "kernels/light.h"
#include "kernels/outputs.h"

namespace nusselt::kernels {

const Kernels* simd_kernels(Set set);
const OutputKernels* simd_output_kernels(Set set);
const LightKernels* simd_light_kernels(Set set);
const FadingKernels* simd_fading_kernels(Set set);

} // namespace nusselt::kernels
