// The engine's own job system: threads that take jobs from the end of their own queue and steal from the
// front of the others'. Nothing is allocated after it was made.
#pragma once

#include "trace.h"

#include <array>
#include <atomic>
#include <memory>
#include <mutex>
#include <thread>
#include <vector>

struct Job {
    const char* name = "";
    void (*run)(void* argument) = nullptr;
    void* argument = nullptr;
    std::atomic<uint32_t> state = 0; // 0 free, 1 queued or running, 2 returned
};

class JobSystem {
public:
    explicit JobSystem(uint32_t workers) : queues(new Queue[workers + 1]), queue_count(workers + 1) {
        for (uint32_t i = 1; i <= workers; ++i)
            threads.emplace_back([this, i] {
                this_thread = i;
                while (!stopping) {
                    const uint32_t seen = pushed;
                    if (!run_one() && !stopping) pushed.wait(seen);
                }
            });
    }
    ~JobSystem() {
        stopping = true;
        ++pushed;
        pushed.notify_all();
        for (std::thread& thread : threads)
            thread.join();
    }
    uint32_t workers() const { return queue_count - 1; }

    // Null where there is no room: the job has been run.
    Job* push(const char* name, void (*run)(void*), void* argument) {
        for (Job& job : jobs) {
            uint32_t expected = 0;
            if (!job.state.compare_exchange_strong(expected, 1)) continue;
            job.name = name;
            job.run = run;
            job.argument = argument;
            queues[this_thread].push(&job);
            ++pushed;
            pushed.notify_one();
            return &job;
        }
        run(argument);
        return nullptr;
    }
    // Runs other jobs until this one has returned. Null is ignored.
    void finish(Job* job) {
        while (job && job->state != 2)
            if (!run_one()) job->state.wait(1);
        if (job) job->state = 0;
    }

private:
    struct Queue {
        void push(Job* job) {
            const std::lock_guard lock(guard);
            ring[back++ % ring.size()] = job; // has room for all jobs
        }
        std::mutex guard;
        std::array<Job*, 256> ring{};
        uint32_t front = 0, back = 0;
    };
    bool run_one() {
        Job* job = nullptr;
        for (uint32_t i = 0; i < queue_count && !job; ++i) {
            Queue& queue = queues[(this_thread + i) % queue_count];
            const std::lock_guard lock(queue.guard);
            if (queue.front == queue.back) continue;
            job = queue.ring[(i == 0 ? --queue.back : queue.front++) % queue.ring.size()];
        }
        if (!job) return false;
        begin_zone(nullptr, job->name);
        job->run(job->argument);
        end_zone(nullptr, job->name);
        job->state = 2;
        job->state.notify_all();
        return true;
    }

    std::unique_ptr<Queue[]> queues; // the first is the main thread's
    uint32_t queue_count;
    std::array<Job, 256> jobs;
    std::atomic<uint32_t> pushed = 0;
    std::atomic<bool> stopping = false;
    std::vector<std::thread> threads;
};
