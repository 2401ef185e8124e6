// Which instruction sets this processor and its operating system really run. Our own cpuid, so that nothing
// of the SIMD library's dispatch is linked and no global state is shared with another user of it in the
// process.
#include "kernels/reference.h"
#include "kernels/simd.h"

#if defined(__x86_64__)
#include <cpuid.h>
#endif

namespace nusselt::kernels {

namespace {

#if defined(__x86_64__)
struct Features {
    bool sse4 = false, avx2 = false, avx512 = false;
};

uint64_t enabled_state() {
    uint32_t low, high;
    __asm__ volatile("xgetbv" : "=a"(low), "=d"(high) : "c"(0));
    return uint64_t(high) << 32 | low;
}

// The whole cluster of features that the compiler is told of for each set, not just the one that names it.
Features detect() {
    Features f;
    uint32_t a, b, c, d;
    if (!__get_cpuid(1, &a, &b, &c, &d)) return f;
    const auto bit = [](uint32_t word, uint32_t n) { return (word >> n & 1) != 0; };
    f.sse4 = bit(c, 0) && bit(c, 9) && bit(c, 19) && bit(c, 20) && bit(c, 23) && bit(c, 1) && bit(c, 25);
    if (!f.sse4 || !bit(c, 27)) return f; // no XGETBV: no wider state
    const uint64_t state = enabled_state();
    const bool fma = bit(c, 12), f16c = bit(c, 29), avx = bit(c, 28);
    uint32_t ea, eb, ec, ed;
    if (!__get_cpuid_count(7, 0, &ea, &eb, &ec, &ed)) return f;
    uint32_t xa, xb, xc = 0, xd;
    if (!__get_cpuid(0x80000001u, &xa, &xb, &xc, &xd)) return f;
    f.avx2 = (state & 6) == 6 && avx && fma && f16c && bit(xc, 5) && bit(eb, 3) && bit(eb, 5) && bit(eb, 8);
    f.avx512 = f.avx2 && (state & 0xE6) == 0xE6 && bit(eb, 16) && bit(eb, 17) && bit(eb, 28) && bit(eb, 30) &&
               bit(eb, 31);
    return f;
}

#endif

// What SIMD sources are compiled for and the processor runs.
bool runs(Set set) {
#if defined(__x86_64__)
    static const Features features = detect();
    return (set == Set::sse4 && features.sse4) || (set == Set::avx2 && features.avx2) ||
           (set == Set::avx512 && features.avx512);
#elif defined(__aarch64__)
    return set == Set::neon; // part of the architecture
#else
    return false;
#endif
}

} // namespace

const Kernels* kernels_for(Set set) {
    if (set == Set::scalar) return &reference_kernels;
    return runs(set) ? simd_kernels(set) : nullptr;
}

const OutputKernels* output_kernels_for(Set set) {
    if (set == Set::scalar) return &reference_output_kernels;
    return runs(set) ? simd_output_kernels(set) : nullptr;
}

const FadingKernels* fading_kernels_for(Set set) {
    if (set == Set::scalar) return &reference_fading_kernels;
    return runs(set) ? simd_fading_kernels(set) : nullptr;
}

const LightKernels* light_kernels_for(Set set) {
    if (set == Set::scalar) return &reference_light_kernels;
    return runs(set) ? simd_light_kernels(set) : nullptr;
}

} // namespace nusselt::kernels
