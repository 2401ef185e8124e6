// The floor under a mask's error: what exact rays through its own sample points give.
#pragma once

#include "tools/compare/grid.h"
#include "tools/compare/moment.h"

#include <vector>

namespace nusselt::tools {

// Transfer vectors of the moment's traced receivers, 25 a vertex. `per_block`: all used bits of a 4x4 block
// weigh the same, as in the paper's integration.
std::vector<float> exact_masks(const Moment& moment, const SampleGrid& grid, bool per_block);

} // namespace nusselt::tools
