#include "jobs/float_environment.h"

#include "nusselt/executor.h"
#include "tests/jobs/graph_fixture.h"

#include <cfenv>
#include <cstring>
#include <limits>

namespace nusselt::test {

namespace {

// Depends on the rounding mode and on denormals; the volatile keeps it from being computed by the compiler.
uint32_t sensitive() {
    volatile float third = 1.0f, tiny = std::numeric_limits<float>::min(), sum = 0.0f;
    third = third / 3.0f;
    tiny = tiny * third; // denormal
    sum = third + 1e-8f;
    const float values[3] = {third, tiny * 4.0f, sum};
    uint32_t hash = 2166136261u;
    for (const float value : values) {
        uint32_t bits;
        std::memcpy(&bits, &value, sizeof bits);
        hash = (hash ^ bits) * 16777619u;
    }
    return hash;
}

#if defined(NUSSELT_FLOAT_SSE)

const std::vector<uint32_t>& modes() {
    static const std::vector<uint32_t> all = [] {
        std::vector<uint32_t> made;
        for (uint32_t rounding = 0; rounding < 4; ++rounding) {
            for (const uint32_t flush : {0u, 0x8000u, 0x40u, 0x8040u}) {
                made.push_back(0x1f80u | rounding << 13 | flush);
            }
        }
        return made;
    }();
    return all;
}

struct ModeGuard {
    uint32_t before = _mm_getcsr();
    ~ModeGuard() { _mm_setcsr(before); }
};

void expect_same_bits(const Executor& executor, uint32_t expected) {
    const ModeGuard guard;
    struct Results {
        uint32_t hash[64];
    } results;
    const jobs::GraphLimits limits{1, 0, 8, 0};
    AlignedMemory memory(jobs::graph_bytes(limits));
    jobs::Graph* graph = jobs::create_graph(memory.data, memory.bytes, limits);
    const auto work = [](void* context, uint32_t begin, uint32_t, uint32_t) {
        static_cast<Results*>(context)->hash[begin] = sensitive();
    };
    jobs::add_node(*graph, {"sensitive", work, &results, 64, 1});
    for (const uint32_t mode : modes()) {
        for (const uint32_t sticky : {0u, 0x3fu, 0x21u}) {
            _mm_setcsr(mode | sticky);
            EXPECT_TRUE(jobs::start(*graph, executor));
            const uint32_t after_start = _mm_getcsr();
            jobs::wait(*graph);
            const uint32_t after_wait = _mm_getcsr();
            _mm_setcsr(guard.before);
            EXPECT_EQ(after_start, mode | sticky);
            EXPECT_EQ(after_wait, mode | sticky);
            for (const uint32_t hash : results.hash) {
                ASSERT_EQ(hash, expected) << "mode " << std::hex << mode;
            }
        }
    }
}

TEST(FloatEnvironment, TheTestCanSeeTheDifference) {
    const ModeGuard guard;
    const uint32_t expected = sensitive();
    for (const uint32_t mode : modes()) {
        if (mode == 0x1f80u || mode == 0x1fc0u) continue; // DAZ alone: results are read back as bits
        _mm_setcsr(mode);
        const uint32_t hash = sensitive();
        _mm_setcsr(guard.before);
        EXPECT_NE(hash, expected) << std::hex << mode;
    }
}

TEST(FloatEnvironment, SetsAndRestores) {
    const ModeGuard guard;
    for (const uint32_t mode : modes()) {
        _mm_setcsr(mode | 0x11u);
        {
            const jobs::FloatEnvironment environment;
            EXPECT_EQ(_mm_getcsr(), 0x1f80u);
            volatile float one = 1.0f;
            one = one / 3.0f; // inexact
        }
        EXPECT_EQ(_mm_getcsr(), mode | 0x11u);
    }
    // Exceptions that the host traps don't reach our work.
    _mm_setcsr(0x0080u);
    {
        const jobs::FloatEnvironment environment;
        volatile float zero = 0.0f, result = 1.0f;
        result = result / zero;
    }
    EXPECT_EQ(_mm_getcsr(), 0x0080u);
}

TEST(FloatEnvironment, SameBitsInlineAndOnTbb) {
    const uint32_t expected = sensitive();
    expect_same_bits(Executor(), expected);
    expect_same_bits(serial_executor(), expected);
    const ModeGuard guard;
    for (const uint32_t mode_at_creation : {0x1f80u, 0x9fc0u, 0x7f80u}) {
        _mm_setcsr(mode_at_creation);
        Executor executor;
        const Status status = create_tbb_executor(3, &executor);
        _mm_setcsr(guard.before);
        if (status.code == StatusCode::unsupported) GTEST_SKIP() << status.text;
        ASSERT_TRUE(status.ok()) << status.text;
        expect_same_bits(executor, expected);
        destroy_executor(&executor);
    }
}

#else

TEST(FloatEnvironment, SetsAndRestores) {
    const uint32_t expected = sensitive();
    const int before = std::fegetround();
    std::fesetround(FE_UPWARD);
    {
        const jobs::FloatEnvironment environment;
        EXPECT_EQ(sensitive(), expected);
    }
    EXPECT_EQ(std::fegetround(), FE_UPWARD);
    std::fesetround(before);
}

#endif

} // namespace

} // namespace nusselt::test
