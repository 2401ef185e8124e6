#include "bench/instructions.h"

#include <algorithm>
#include <cstdint>
#include <ctime>
#include <utility>

#if defined(__linux__)
#include <csignal>
#include <linux/perf_event.h>
#include <new>
#include <sys/ioctl.h>
#include <sys/mman.h>
#include <sys/ptrace.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>
#endif

namespace nusselt::bench {

namespace {

// Inputs in an order whose beginning is already from all over.
size_t scattered(size_t k, size_t inputs) {
    return static_cast<size_t>((static_cast<uint64_t>(k) * 0x9E3779B97F4A7C15u >> 32) * inputs >> 32);
}

#if defined(__linux__)

int counter() {
    static const int file = [] {
        perf_event_attr what{};
        what.size = sizeof what;
        what.type = PERF_TYPE_HARDWARE;
        what.config = PERF_COUNT_HW_INSTRUCTIONS;
        what.disabled = 1;
        what.exclude_kernel = 1;
        what.exclude_hv = 1;
        return static_cast<int>(syscall(SYS_perf_event_open, &what, 0, -1, -1, 0));
    }();
    return file;
}

double counted(size_t inputs, const std::function<void(size_t)>& run,
               const std::function<double(size_t)>& items) {
    double all = 0;
    for (size_t i = 0; i < inputs; ++i)
        all += items(i);
    ioctl(counter(), PERF_EVENT_IOC_RESET, 0);
    ioctl(counter(), PERF_EVENT_IOC_ENABLE, 0);
    for (size_t i = 0; i < inputs; ++i)
        run(i);
    ioctl(counter(), PERF_EVENT_IOC_DISABLE, 0);
    uint64_t count = 0;
    if (read(counter(), &count, sizeof count) != sizeof count) return 0;
    return all > 0 ? static_cast<double>(count) / all : 0;
}

// What the child has done, seen by its parent between two of its instructions.
struct Shared {
    volatile uint64_t begun = 0, done = 0;
};

double stepped(size_t inputs, const std::function<void(size_t)>& run,
               const std::function<double(size_t)>& items) {
    constexpr uint64_t enough = 12'000, too_many = 500'000;
    void* memory = mmap(nullptr, sizeof(Shared), PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
    if (memory == MAP_FAILED) return 0;
    auto* shared = new (memory) Shared;
    const pid_t child = fork();
    if (child == 0) {
        if (ptrace(PTRACE_TRACEME, 0, nullptr, nullptr) != 0) _exit(1);
        raise(SIGSTOP);
        for (size_t k = 0; k < inputs; ++k) {
            const size_t input = scattered(k, inputs);
            shared->begun = k + 1;
            run(input);
            shared->done = k + 1;
        }
        raise(SIGSTOP);
        _exit(0);
    }
    uint64_t steps = 0, at_begin = 0, begun = 0, done = 0, inside = 0;
    int status = 0;
    const bool started =
        child > 0 && waitpid(child, &status, 0) == child && WIFSTOPPED(status) && WSTOPSIG(status) == SIGSTOP;
    while (started && (done == 0 || inside < enough) && steps < too_many) {
        if (ptrace(PTRACE_SINGLESTEP, child, nullptr, nullptr) != 0) break;
        if (waitpid(child, &status, 0) != child || !WIFSTOPPED(status) || WSTOPSIG(status) != SIGTRAP) break;
        ++steps;
        if (shared->begun != begun) {
            begun = shared->begun;
            at_begin = steps;
        }
        if (shared->done != done) {
            done = shared->done;
            inside += steps - at_begin;
        }
    }
    if (child > 0) {
        kill(child, SIGKILL);
        waitpid(child, &status, 0);
    }
    munmap(memory, sizeof(Shared));
    double all = 0;
    for (size_t k = 0; k < done; ++k)
        all += items(scattered(k, inputs));
    return all > 0 ? static_cast<double>(inside) / all : 0;
}

bool can_step() {
    static const bool can = stepped(
                                1, [](size_t) {}, [](size_t) { return 1.0; }) > 0;
    return can;
}

#endif

double seconds() {
    timespec time{};
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &time);
    return static_cast<double>(time.tv_sec) + static_cast<double>(time.tv_nsec) * 1e-9;
}

#if defined(__x86_64__)
#define NUSSELT_PAIR_0 "addq $1, %%r8\n addq $1, %%r9\n"
#define NUSSELT_PAIR_1 "addq $1, %%r10\n addq $1, %%r11\n"
#define NUSSELT_PAIR_2 "addq $1, %%rax\n addq $1, %%rcx\n"
#define NUSSELT_PAIR_3 "addq $1, %%rdx\n addq $1, %%rsi\n"
#define NUSSELT_VECTOR(a) "paddd %%xmm" a ", %%xmm" a "\n"
#define NUSSELT_REGISTERS                                                                                    \
    "r8", "r9", "r10", "r11", "rax", "rcx", "rdx", "rsi", "cc", "xmm0", "xmm1", "xmm2", "xmm3", "xmm4",      \
        "xmm5", "xmm6", "xmm7"
#elif defined(__aarch64__)
#define NUSSELT_PAIR_0 "add x8, x8, #1\n add x9, x9, #1\n"
#define NUSSELT_PAIR_1 "add x10, x10, #1\n add x11, x11, #1\n"
#define NUSSELT_PAIR_2 "add x12, x12, #1\n add x13, x13, #1\n"
#define NUSSELT_PAIR_3 "add x14, x14, #1\n add x15, x15, #1\n"
#define NUSSELT_VECTOR(a) "add v" a ".4s, v" a ".4s, v" a ".4s\n"
#define NUSSELT_REGISTERS                                                                                    \
    "x8", "x9", "x10", "x11", "x12", "x13", "x14", "x15", "v0", "v1", "v2", "v3", "v4", "v5", "v6", "v7"
#endif

#if defined(NUSSELT_VECTOR)

// Independent of each other, so that nothing but issue holds them up.
void general_alone(size_t rounds) {
    for (size_t k = 0; k < rounds; ++k)
        asm volatile(".rept 4\n" NUSSELT_PAIR_0 NUSSELT_PAIR_1 NUSSELT_PAIR_2 NUSSELT_PAIR_3 ".endr" ::
                         : NUSSELT_REGISTERS);
}
void general_and_half_vector(size_t rounds) {
    for (size_t k = 0; k < rounds; ++k)
        asm volatile(".rept 4\n" NUSSELT_PAIR_0 NUSSELT_VECTOR("0") NUSSELT_PAIR_1 NUSSELT_VECTOR("1")
                         NUSSELT_PAIR_2 NUSSELT_VECTOR("2") NUSSELT_PAIR_3 NUSSELT_VECTOR("3") ".endr" ::
                             : NUSSELT_REGISTERS);
}
void general_and_vector(size_t rounds) {
    for (size_t k = 0; k < rounds; ++k)
        asm volatile(".rept 4\n" NUSSELT_PAIR_0 NUSSELT_VECTOR("0") NUSSELT_VECTOR("1")
                         NUSSELT_PAIR_1 NUSSELT_VECTOR("2") NUSSELT_VECTOR("3")
                             NUSSELT_PAIR_2 NUSSELT_VECTOR("4") NUSSELT_VECTOR("5")
                                 NUSSELT_PAIR_3 NUSSELT_VECTOR("6") NUSSELT_VECTOR("7") ".endr" ::
                                     : NUSSELT_REGISTERS);
}

double measure_issue() {
    constexpr size_t rounds = 1'000'000;
    const std::pair<void (*)(size_t), size_t> mixes[] = {
        {general_alone, 32}, {general_and_half_vector, 48}, {general_and_vector, 64}};
    double best = 0;
    for (int attempt = 0; attempt < 5; ++attempt) {
        for (const auto& [mix, count] : mixes) {
            const double start = seconds();
            mix(rounds);
            best = std::max(best, double{rounds} * static_cast<double>(count) / (seconds() - start));
        }
    }
    return best;
}
#else
double measure_issue() {
    return 0;
}
#endif

} // namespace

double instructions_per_item(size_t inputs, const std::function<void(size_t)>& run,
                             const std::function<double(size_t)>& items) {
#if defined(__linux__)
    if (inputs == 0) return 0;
    if (counter() >= 0) return counted(inputs, run, items);
    if (can_step()) return stepped(inputs, run, items);
#else
    (void)inputs, (void)run, (void)items;
#endif
    return 0;
}

const char* counting_method() {
#if defined(__linux__)
    if (counter() >= 0) return "counted by the processor";
    if (can_step()) return "counted by single steps, on some of the inputs";
#endif
    return "not counted: this system lends no counter and lets no process be stepped";
}

double issue_peak() {
    static const double peak = measure_issue();
    return peak;
}

} // namespace nusselt::bench
