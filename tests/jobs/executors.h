// Executors that keep the letter of the contract and nothing more, and that watch whether the graph keeps its
// side.
#pragma once

#include "nusselt/executor.h"

#include <atomic>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <mutex>
#include <random>
#include <string>
#include <thread>
#include <vector>

namespace nusselt::test {

enum class Order { at_once, lifo, fifo, random };

struct ExecutorOptions {
    std::string name;
    Order order = Order::fifo;
    uint32_t threads = 0;     // 0: tasks start in `finish` only (or in `enqueue`, with at_once)
    uint32_t concurrency = 1; // as told to the graph
    bool delays = false;      // threads sleep at random before and after a task
    bool sometimes_inline = false;
    bool finish_helps = false; // with threads: `finish` runs other tasks while it waits
};

// What an engine's job system might look like, with every promise counted.
class TestExecutor {
public:
    explicit TestExecutor(const ExecutorOptions& options);
    ~TestExecutor();
    Executor hook();

    // What went wrong since the last call, in words; empty when nothing. All graphs must have been waited
    // for.
    std::string broken();

    std::atomic<uint64_t> enqueued = 0;

private:
    struct Task {
        void (*run)(void*) = nullptr;
        void* argument = nullptr;
        bool started = false;
        bool returned = false;
        bool finished = false;
    };
    static void* enqueue(void* user, void (*run)(void*), void* argument);
    static void finish(void* user, void* ticket);
    Task* take(); // under the lock
    void run(Task* task, std::unique_lock<std::mutex>& lock);
    void thread_loop();
    void maybe_sleep();

    ExecutorOptions options;
    std::mutex mutex;
    std::condition_variable queued;  // a task came: one thread is enough
    std::condition_variable changed; // a task returned, or came where `finish` may take it
    std::deque<Task> tasks;          // all of them, so that a ticket stays valid
    std::vector<Task*> queue;
    std::vector<std::thread> pool;
    std::minstd_rand random{12345};
    bool stopping = false;
    std::string complaints;
};

// Every kind the tests run on.
std::vector<ExecutorOptions> hostile_executors();

} // namespace nusselt::test
