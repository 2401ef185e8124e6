// Public: exported from a shared library, which hides all else.
#pragma GCC visibility push(default)
#include "nusselt/executor.h"
#pragma GCC visibility pop

#if defined(NUSSELT_TBB)

#include <oneapi/tbb/global_control.h>
#include <oneapi/tbb/task_arena.h>
#include <oneapi/tbb/task_group.h>

#include <algorithm>
#include <atomic>
#include <new>

namespace nusselt {

namespace {

constexpr uint32_t max_threads = 1024;

enum TaskState : uint32_t { task_waiting, task_running, task_returned };

// A task and its ticket. TBB's worker and the thread in `finish` both hold it; whoever comes first runs it.
// So a thread that waits never enters TBB: it can't pick up a task of the host's, or be held up by one.
struct alignas(64) Task {
    void (*run)(void* argument) = nullptr;
    void* argument = nullptr;
    std::atomic<uint32_t> state = task_waiting;
    std::atomic<uint32_t> holders = 0;
    std::atomic<uint32_t> next_free = 0;
};

constexpr uint32_t task_count =
    2048; // enqueued and not finished, over all frames; beyond them tasks run inline
constexpr uint32_t no_task = 0xffffffffu;

struct TbbExecutor {
    explicit TbbExecutor(int threads)
        : arena(threads, 1),
          context(tbb::task_group_context::isolated,
                  tbb::task_group_context::default_traits | tbb::task_group_context::concurrent_wait),
          group(context) {
        arena.initialize();
        if (arena.max_concurrency() < 2)
            return; // the thread that calls is the only one: everything runs inline
        for (uint32_t i = 0; i < task_count; ++i) {
            tasks[i].next_free = i + 1 < task_count ? i + 1 : no_task;
        }
        free_tasks = 0;
    }

    tbb::task_arena arena;
    tbb::task_group_context context;            // isolated: a cancelled host group does not reach it
    tbb::task_group group;                      // what TBB still holds of ours
    std::atomic<uint64_t> free_tasks = no_task; // head of the list; the upper half counts changes against ABA
    Task tasks[task_count];
};

uint64_t next_head(uint64_t head, uint32_t task) {
    return ((head >> 32) + 1) << 32 | task;
}

Task* take_task(TbbExecutor& executor) {
    uint64_t head = executor.free_tasks.load(std::memory_order_acquire);
    for (;;) {
        const uint32_t index = static_cast<uint32_t>(head);
        if (index == no_task) return nullptr;
        const uint32_t next = executor.tasks[index].next_free.load(std::memory_order_relaxed);
        if (executor.free_tasks.compare_exchange_weak(head, next_head(head, next), std::memory_order_acq_rel,
                                                      std::memory_order_acquire)) {
            return &executor.tasks[index];
        }
    }
}

void give_back(TbbExecutor& executor, Task* task) {
    const uint32_t index = static_cast<uint32_t>(task - executor.tasks);
    uint64_t head = executor.free_tasks.load(std::memory_order_relaxed);
    do {
        task->next_free.store(static_cast<uint32_t>(head), std::memory_order_relaxed);
    } while (!executor.free_tasks.compare_exchange_weak(
        head, next_head(head, index), std::memory_order_release, std::memory_order_relaxed));
}

void let_go(TbbExecutor& executor, Task* task) {
    if (task->holders.fetch_sub(1, std::memory_order_acq_rel) == 1) give_back(executor, task);
}

// False when another thread was first.
bool try_run(Task* task) {
    uint32_t expected = task_waiting;
    if (!task->state.compare_exchange_strong(expected, task_running, std::memory_order_acquire)) return false;
    task->run(task->argument);
    task->state.store(task_returned, std::memory_order_release);
    task->state.notify_all();
    return true;
}

void* tbb_enqueue(void* user, void (*run)(void* argument), void* argument) {
    TbbExecutor& executor = *static_cast<TbbExecutor*>(user);
    if (Task* task = take_task(executor)) {
        task->run = run;
        task->argument = argument;
        task->holders.store(2, std::memory_order_relaxed);
        // Whoever runs it sees what the caller wrote, whatever TBB does in between.
        task->state.store(task_waiting, std::memory_order_release);
        try {
            executor.arena.enqueue(executor.group.defer([&executor, task] {
                try_run(task);
                let_go(executor, task);
            }));
            return task;
        } catch (...) { // no memory for TBB's own record
            give_back(executor, task);
        }
    }
    run(argument);
    return nullptr;
}

void tbb_finish(void* user, void* ticket) {
    Task* task = static_cast<Task*>(ticket);
    if (!try_run(task)) task->state.wait(task_running, std::memory_order_acquire);
    let_go(*static_cast<TbbExecutor*>(user), task);
}

// TBB prints a warning when an arena asks for more than the host allows, and gives no more all the same.
int allowed_threads(uint32_t threads) {
    if (threads == 0) return tbb::task_arena::automatic;
    const size_t allowed = tbb::global_control::active_value(tbb::global_control::max_allowed_parallelism);
    return static_cast<int>(std::clamp<size_t>(allowed, 1, threads));
}

} // namespace

Status create_tbb_executor(uint32_t threads, Executor* out) {
    if (!out)
        return {StatusCode::invalid_argument, "no executor was made: `out` is null; pass a place for it"};
    if (threads > max_threads) {
        return {StatusCode::invalid_argument,
                "no executor was made: more than 1024 threads; ask for fewer, or for 0"};
    }
    try {
        TbbExecutor* made = new TbbExecutor(allowed_threads(threads));
        const int slots = made->arena.max_concurrency();
        out->user = made;
        out->enqueue = tbb_enqueue;
        out->finish = tbb_finish;
        out->concurrency =
            slots < 2 ? 1 : static_cast<uint32_t>(slots - 1); // the thread that waits is the last one
        return {};
    } catch (...) {
        return {StatusCode::out_of_memory,
                "no executor was made: TBB got no memory or thread; free some, or use "
                "serial_executor()"};
    }
}

void destroy_executor(Executor* executor) {
    if (!executor || executor->enqueue != tbb_enqueue) return;
    TbbExecutor* made = static_cast<TbbExecutor*>(executor->user);
    *executor = Executor();
    try {
        // Tasks that `finish` has run are still in TBB's queue. Inside the arena this thread takes them out
        // itself, so that it does not matter whether the host leaves us a worker.
        made->arena.execute([made] { made->group.wait(); });
        delete made;
    } catch (...) {
        // Nothing of ours throws. Should TBB do so, TBB still holds `made`: better lost than freed.
    }
}

} // namespace nusselt

#else

namespace nusselt {

Status create_tbb_executor(uint32_t, Executor*) {
    return {StatusCode::unsupported, "no executor was made: this library was built without TBB; use "
                                     "serial_executor() or your own, or build with -DNUSSELT_TBB=ON"};
}

void destroy_executor(Executor*) {}

} // namespace nusselt

#endif
