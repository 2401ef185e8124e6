// Plane and weight tables, one set a layout for the whole process, counted by the contexts that use them.
#pragma once

#include "kernels/layout.h"
#include "quality.h"

namespace nusselt {

// The tables of a quality, built now if no context holds them; null when there is no memory. Each success
// needs one release_tables of the same quality. From any thread.
const kernels::Tables* acquire_tables(Quality quality);
void release_tables(Quality quality);

} // namespace nusselt
