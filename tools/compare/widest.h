// The peer's own arithmetic in wider vectors where the machine has them: compiled twice from one body, so
// that the comparison isn't won by the baseline instruction set.
#pragma once

#define NUSSELT_INLINE [[gnu::always_inline]] inline
#if defined(__x86_64__)
#define NUSSELT_AVX2 [[gnu::target("avx2")]]
#else
#define NUSSELT_AVX2
#endif

namespace nusselt::tools {

inline bool has_avx2() {
#if defined(__x86_64__)
    return __builtin_cpu_supports("avx2");
#else
    return false;
#endif
}

} // namespace nusselt::tools
