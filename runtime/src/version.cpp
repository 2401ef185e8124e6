#include "nusselt/version.h"

namespace nusselt {

#define NUSSELT_TEXT_OF(x) #x
#define NUSSELT_TEXT(x) NUSSELT_TEXT_OF(x)

uint32_t version() {
    return NUSSELT_VERSION;
}

const char* configuration() {
    return "nusselt " NUSSELT_TEXT(NUSSELT_VERSION_MAJOR) "." NUSSELT_TEXT(NUSSELT_VERSION_MINOR) "." NUSSELT_TEXT(
        NUSSELT_VERSION_PATCH) ", "
#if defined(__clang__)
                               "clang " NUSSELT_TEXT(__clang_major__) "." NUSSELT_TEXT(__clang_minor__)
#elif defined(__GNUC__)
                               "gcc " NUSSELT_TEXT(__GNUC__) "." NUSSELT_TEXT(__GNUC_MINOR__)
#else
                               "unknown compiler"
#endif
                                   ", scalar"
#if defined(__x86_64__)
                                   " sse4 avx2 avx512"
#endif
#if defined(NUSSELT_TBB)
                                   ", TBB"
#else
                                   ", no TBB"
#endif
#if defined(__OPTIMIZE__)
                                   ", optimised"
#else
                                   ", not optimised"
#endif
        ;
}

} // namespace nusselt
