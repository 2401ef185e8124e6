// A plain pool of threads behind one queue, as many as are asked for: also more than the machine has, which
// oneTBB does not make.
#pragma once

#include "nusselt/executor.h"

#include <array>
#include <condition_variable>
#include <deque>
#include <mutex>
#include <thread>
#include <vector>

namespace nusselt::bench {

class Pool {
public:
    explicit Pool(uint32_t workers) {
        for (uint32_t i = 0; i < workers; ++i)
            threads.emplace_back([this] {
                std::unique_lock lock(guard);
                for (;;) {
                    if (!run_one(lock)) {
                        if (stopping) return;
                        changed.wait(lock);
                    }
                }
            });
    }
    ~Pool() {
        {
            const std::lock_guard lock(guard);
            stopping = true;
        }
        changed.notify_all();
        for (std::thread& thread : threads)
            thread.join();
    }
    Executor executor() { return {this, enqueue, finish, static_cast<uint32_t>(threads.size())}; }

private:
    struct Task {
        void (*run)(void* argument) = nullptr;
        void* argument = nullptr;
        bool taken = false, returned = false;
    };

    static void* enqueue(void* user, void (*run)(void*), void* argument) {
        Pool& self = *static_cast<Pool*>(user);
        Task* const task = self.push(run, argument);
        if (!task) {
            run(argument);
            return nullptr;
        }
        // Not while the lock is held: whoever wakes up would wait for it, and be woken twice.
        self.changed.notify_one();
        return task;
    }
    // Null where too many are queued.
    Task* push(void (*run)(void*), void* argument) {
        const std::lock_guard lock(guard);
        for (Task& task : tasks) {
            if (task.taken) continue;
            task = {run, argument, true, false};
            queue.push_back(&task);
            return &task;
        }
        return nullptr;
    }
    static void finish(void* user, void* ticket) {
        Pool& self = *static_cast<Pool*>(user);
        Task& task = *static_cast<Task*>(ticket);
        std::unique_lock lock(self.guard);
        while (!task.returned) {
            if (!self.run_one(lock)) self.returned.wait(lock);
        }
        task.taken = false;
    }
    bool run_one(std::unique_lock<std::mutex>& lock) {
        if (queue.empty()) return false;
        Task& task = *queue.front();
        queue.pop_front();
        lock.unlock();
        task.run(task.argument);
        lock.lock();
        task.returned = true;
        returned.notify_all();
        return true;
    }

    std::mutex guard;
    std::condition_variable changed, returned;
    std::deque<Task*> queue;
    std::array<Task, 1024> tasks;
    bool stopping = false;
    std::vector<std::thread> threads;
};

} // namespace nusselt::bench
