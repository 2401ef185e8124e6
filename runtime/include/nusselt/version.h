#pragma once

#include <cstdint>

#define NUSSELT_VERSION_MAJOR 0
#define NUSSELT_VERSION_MINOR 1
#define NUSSELT_VERSION_PATCH 0
#define NUSSELT_VERSION (NUSSELT_VERSION_MAJOR * 10000 + NUSSELT_VERSION_MINOR * 100 + NUSSELT_VERSION_PATCH)

namespace nusselt {

// NUSSELT_VERSION of the binary: compare it with the header's to find a mixed installation.
uint32_t version();
// Version, compiler, instruction sets and options of the binary in one line, for logs and bug reports. Never
// null.
const char* configuration();

} // namespace nusselt
