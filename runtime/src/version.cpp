#include "nusselt/version.h"

namespace nusselt {

#define NUSSELT_TEXT_OF(x) #x
#define NUSSELT_TEXT(x) NUSSELT_TEXT_OF(x)

uint32_t version() {
    return NUSSELT_VERSION;
}

Status check_version(uint32_t header_version) {
    if (header_version / 100 != version() / 100 || header_version > version())
        return {
            StatusCode::unsupported,
            "nothing should be called: this program was compiled with headers of another version than the "
            "library that it found; install one version, and compile against its headers"};
    return {};
}

bool has_feature(Feature feature) {
    switch (feature) {
    case Feature::tbb:
#if defined(NUSSELT_TBB)
        return true;
#else
        return false;
#endif
    case Feature::simd:
#if defined(__x86_64__) || defined(__aarch64__)
        return true;
#else
        return false;
#endif
    case Feature::checked:
#if defined(NUSSELT_CHECKED)
        return true;
#else
        return false;
#endif
    }
    return false;
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
#elif defined(__aarch64__)
                                   " neon"
#endif
#if defined(NUSSELT_TBB)
                                   ", TBB"
#else
                                   ", no TBB"
#endif
#if defined(NUSSELT_CHECKED)
                                   ", checked"
#endif
#if defined(__OPTIMIZE__)
                                   ", optimised"
#else
                                   ", not optimised"
#endif
        ;
}

} // namespace nusselt
