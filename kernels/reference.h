// The reference tables: scalar, obvious, and never improved.
#pragma once

#include "kernels/fading.h"
#include "kernels/light.h"
#include "kernels/outputs.h"

namespace nusselt::kernels {

extern const Kernels reference_kernels;
extern const OutputKernels reference_output_kernels;
extern const LightKernels reference_light_kernels;
extern const FadingKernels reference_fading_kernels;

} // namespace nusselt::kernels
