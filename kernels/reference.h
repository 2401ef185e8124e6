#pragma once

#include "kernels/kernels.h"

namespace nusselt::kernels {

extern const Kernels reference_kernels;

} // namespace nusselt::kernels
