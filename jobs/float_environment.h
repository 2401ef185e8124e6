// The floating-point environment of a task: the same bits whatever the host thread has set.
#pragma once

#include <cstdint>

#if defined(__x86_64__) || defined(_M_X64) || (defined(__i386__) && defined(__SSE__))
#define NUSSELT_FLOAT_SSE
#include <immintrin.h>
#elif defined(__aarch64__)
#define NUSSELT_FLOAT_AARCH64
#else
#include <cfenv>
#endif

namespace nusselt::jobs {

// While it lives: round to nearest, denormals kept, every exception masked. On leaving, the host's setting is
// back with its sticky flags as they were, so that what we raise is not seen. x87 is neither used nor
// touched.
class FloatEnvironment {
public:
    FloatEnvironment();
    ~FloatEnvironment();
    FloatEnvironment(const FloatEnvironment&) = delete;
    FloatEnvironment& operator=(const FloatEnvironment&) = delete;

private:
#if defined(NUSSELT_FLOAT_SSE)
    uint32_t saved;
#elif defined(NUSSELT_FLOAT_AARCH64)
    uint64_t saved_control;
    uint64_t saved_status;
#else
    fenv_t saved;
#endif
};

#if defined(NUSSELT_FLOAT_SSE)

inline FloatEnvironment::FloatEnvironment() : saved(_mm_getcsr()) {
    constexpr uint32_t power_on = 0x1f80;
    _mm_setcsr(power_on);
}
inline FloatEnvironment::~FloatEnvironment() {
    _mm_setcsr(saved);
}

#elif defined(NUSSELT_FLOAT_AARCH64)

inline FloatEnvironment::FloatEnvironment() {
    __asm__ volatile("mrs %0, fpcr" : "=r"(saved_control));
    __asm__ volatile("mrs %0, fpsr" : "=r"(saved_status));
    __asm__ volatile("msr fpcr, %0" : : "r"(uint64_t{0}) : "memory");
}
inline FloatEnvironment::~FloatEnvironment() {
    __asm__ volatile("msr fpcr, %0" : : "r"(saved_control) : "memory");
    __asm__ volatile("msr fpsr, %0" : : "r"(saved_status) : "memory");
}

#else

inline FloatEnvironment::FloatEnvironment() {
    std::fegetenv(&saved);
    std::fesetenv(FE_DFL_ENV);
}
inline FloatEnvironment::~FloatEnvironment() {
    std::fesetenv(&saved);
}

#endif

} // namespace nusselt::jobs
