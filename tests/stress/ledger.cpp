#include "tests/stress/ledger.h"

#include <cstdio>
#include <cstdlib>

namespace nusselt::test {

namespace {

uint64_t from_environment(const char* name, uint64_t otherwise) {
    const char* text = std::getenv(name);
    return text && *text ? std::strtoull(text, nullptr, 10) : otherwise;
}

} // namespace

uint64_t stress_cases() {
#if defined(__SANITIZE_THREAD__)
    constexpr uint64_t few = 200; // each takes 20 times as long, and most are on one thread
#else
    constexpr uint64_t few = 2000;
#endif
    static const uint64_t cases = from_environment("NUSSELT_STRESS_CASES", few);
    return cases;
}

uint64_t stress_seed() {
    static const uint64_t seed = [] {
        const uint64_t value = from_environment("NUSSELT_STRESS_SEED", 1);
        std::printf("NUSSELT_STRESS_SEED=%llu NUSSELT_STRESS_CASES=%llu\n",
                    static_cast<unsigned long long>(value), static_cast<unsigned long long>(stress_cases()));
        return value;
    }();
    return seed;
}

void figure(const std::string& name, double value, const std::string& unit) {
    std::printf("[  FIGURE  ] %s = %.6g %s\n", name.c_str(), value, unit.c_str());
    const char* path = std::getenv("NUSSELT_LEDGER");
    if (!path || !*path) return;
    if (std::FILE* file = std::fopen(path, "a")) {
        std::fprintf(file, "%s\t%.6g\t%s\n", name.c_str(), value, unit.c_str());
        std::fclose(file);
    }
}

} // namespace nusselt::test
