#pragma once

#include "nusselt/status.h"

#include <cstdint>

#define NUSSELT_VERSION_MAJOR 0
#define NUSSELT_VERSION_MINOR 1
#define NUSSELT_VERSION_PATCH 0
#define NUSSELT_VERSION (NUSSELT_VERSION_MAJOR * 10000 + NUSSELT_VERSION_MINOR * 100 + NUSSELT_VERSION_PATCH)

namespace nusselt {

// NUSSELT_VERSION of the binary: compare it with the header's to find a mixed installation.
uint32_t version();
// `unsupported` unless a program compiled with headers of that version may use this binary: the same major
// and minor version, and no later patch. To be called with no argument, once, before anything else.
Status check_version(uint32_t header_version = NUSSELT_VERSION);

// What a build may lack.
enum class Feature : uint32_t {
    tbb = 0,     // create_tbb_executor
    simd = 1,    // instruction sets beyond Isa::scalar
    checked = 2, // writes to borrowed arrays are found out (NUSSELT_CHECKED)
};
bool has_feature(Feature feature);

// Version, compiler, instruction sets and options of the binary in one line, for logs and bug reports. Never
// null.
const char* configuration();

} // namespace nusselt
