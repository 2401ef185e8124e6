#include "tests/fuzz/fuzz.h"

#include <cstdio>
#include <cstdlib>

namespace nusselt::fuzz {

void broken(const char* what) {
    std::fprintf(stderr, "broken promise: %s\n", what);
    std::abort();
}

} // namespace nusselt::fuzz
