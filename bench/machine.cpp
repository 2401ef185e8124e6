#include "bench/machine.h"

#include "bench/recording.h"

#include <algorithm>
#include <cstring>
#include <ctime>
#include <map>

namespace nusselt::bench {

namespace {

// GCC's vectors compile to whatever the function may use.
typedef float Vector __attribute__((vector_size(64)));
typedef uint64_t Words __attribute__((vector_size(64)));

#define NUSSELT_INLINE [[gnu::always_inline]] inline

NUSSELT_INLINE uint64_t load_body(const uint8_t* data, const uint32_t* lines, size_t count) {
    Words sum[8] = {};
    for (size_t k = 0; k + 8 <= count; k += 8)
        for (size_t j = 0; j < 8; ++j) {
            Words line;
            std::memcpy(&line, data + size_t{64} * (lines ? lines[k + j] : k + j), sizeof line);
            sum[j] ^= line;
        }
    uint64_t all = 0;
    for (const Words& part : sum)
        for (int i = 0; i < 8; ++i)
            all ^= part[i];
    return all;
}

NUSSELT_INLINE float flop_body(size_t rounds) {
    Vector value[10];
    for (int j = 0; j < 10; ++j)
        for (int i = 0; i < 16; ++i)
            value[j][i] = 1.0f + static_cast<float>(i + j);
    const Vector factor = Vector{} + 0.999f, term = Vector{} + 0.001f;
    for (size_t k = 0; k < rounds; ++k)
        for (Vector& v : value)
            v = v * factor + term;
    float all = 0;
    for (const Vector& v : value)
        all += v[0];
    return all;
}

uint64_t load_any(const uint8_t* data, const uint32_t* lines, size_t count) {
    return load_body(data, lines, count);
}
float flop_any(size_t rounds) {
    return flop_body(rounds);
}
#if defined(__x86_64__)
[[gnu::target("avx2")]] uint64_t load_avx2(const uint8_t* data, const uint32_t* lines, size_t count) {
    return load_body(data, lines, count);
}
[[gnu::target("avx2")]] float flop_avx2(size_t rounds) {
    return flop_body(rounds);
}
[[gnu::target("avx512f")]] uint64_t load_avx512(const uint8_t* data, const uint32_t* lines, size_t count) {
    return load_body(data, lines, count);
}
[[gnu::target("avx512f")]] float flop_avx512(size_t rounds) {
    return flop_body(rounds);
}
#endif

using Load = uint64_t (*)(const uint8_t*, const uint32_t*, size_t);
using Flop = float (*)(size_t);

Load widest_load() {
#if defined(__x86_64__)
    if (__builtin_cpu_supports("avx512f")) return load_avx512;
    if (__builtin_cpu_supports("avx2")) return load_avx2;
#endif
    return load_any;
}

Flop widest_flop() {
#if defined(__x86_64__)
    if (__builtin_cpu_supports("avx512f")) return flop_avx512;
    if (__builtin_cpu_supports("avx2")) return flop_avx2;
#endif
    return flop_any;
}

double seconds() {
    timespec time{};
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &time);
    return static_cast<double>(time.tv_sec) + static_cast<double>(time.tv_nsec) * 1e-9;
}

volatile uint64_t kept;

double measure_load(size_t bytes, bool random) {
    const size_t lines = std::max<size_t>(bytes / 64 / 8 * 8, 8);
    Aligned<uint8_t> data(lines * 64, 1);
    std::vector<uint32_t> order(lines);
    uint64_t state = 1;
    for (size_t k = 0; k < lines; ++k) {
        state = state * 6364136223846793005u + 1442695040888963407u;
        order[k] = random ? static_cast<uint32_t>((state >> 33) % lines) : static_cast<uint32_t>(k);
    }
    const Load load = widest_load();
    const size_t rounds = std::max<size_t>((size_t{64} << 20) / (lines * 64), 1);
    double best = 0;
    for (int attempt = 0; attempt < 5; ++attempt) {
        const double start = seconds();
        for (size_t round = 0; round < rounds; ++round)
            kept = load(data.data(), random ? order.data() : nullptr, lines);
        best = std::max(best, static_cast<double>(rounds * lines * 64) / (seconds() - start));
    }
    return best;
}

} // namespace

double load_peak(size_t bytes) {
    static std::map<size_t, double> known;
    double& peak = known[bytes];
    if (peak == 0) peak = measure_load(bytes, false);
    return peak;
}

double gather_peak(size_t bytes) {
    static std::map<size_t, double> known;
    double& peak = known[bytes];
    if (peak == 0) peak = measure_load(bytes, true);
    return peak;
}

double flop_peak() {
    static const double peak = [] {
        const Flop flop = widest_flop();
        constexpr size_t rounds = 2'000'000;
        double best = 0;
        for (int attempt = 0; attempt < 5; ++attempt) {
            const double start = seconds();
            kept = static_cast<uint64_t>(flop(rounds));
            best = std::max(best, double{rounds} * 10 * 16 * 2 / (seconds() - start));
        }
        return best;
    }();
    return peak;
}

} // namespace nusselt::bench
