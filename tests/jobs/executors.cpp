#include "tests/jobs/executors.h"

#include <algorithm>
#include <chrono>

namespace nusselt::test {

TestExecutor::TestExecutor(const ExecutorOptions& with) : options(with) {
    for (uint32_t i = 0; i < options.threads; ++i) {
        pool.emplace_back([this] { thread_loop(); });
    }
}

TestExecutor::~TestExecutor() {
    {
        const std::lock_guard lock(mutex);
        stopping = true;
    }
    queued.notify_all();
    for (std::thread& thread : pool) {
        thread.join();
    }
}

Executor TestExecutor::hook() {
    Executor executor;
    executor.user = this;
    executor.enqueue = enqueue;
    executor.finish = finish;
    executor.concurrency = options.concurrency;
    return executor;
}

std::string TestExecutor::broken() {
    const std::lock_guard lock(mutex);
    std::string text = complaints;
    for (const Task& task : tasks) {
        if (!task.returned) text += "a task never ran; ";
        if (!task.finished) text += "a ticket was not finished; ";
    }
    tasks.clear();
    complaints.clear();
    return text;
}

void* TestExecutor::enqueue(void* user, void (*run)(void*), void* argument) {
    TestExecutor& self = *static_cast<TestExecutor*>(user);
    ++self.enqueued;
    bool at_once = self.options.order == Order::at_once;
    Task* ticket = nullptr;
    {
        const std::lock_guard lock(self.mutex);
        if (self.options.sometimes_inline && self.random() % 3 == 0) at_once = true;
        if (!at_once) {
            self.tasks.push_back({run, argument});
            ticket = &self.tasks.back();
            self.queue.push_back(ticket);
            if (self.queue.size() > self.options.concurrency)
                self.complaints += "more tasks queued than allowed; ";
        }
    }
    if (at_once) {
        run(argument);
        return nullptr;
    }
    self.queued.notify_one();
    if (self.options.finish_helps) self.changed.notify_all();
    self.maybe_sleep(); // the ticket comes back late: the task may have returned by then
    return ticket;
}

void TestExecutor::finish(void* user, void* ticket) {
    TestExecutor& self = *static_cast<TestExecutor*>(user);
    Task* task = static_cast<Task*>(ticket);
    std::unique_lock lock(self.mutex);
    if (task->finished) self.complaints += "a ticket was finished twice; ";
    while (!task->returned) {
        const bool helps = self.options.threads == 0 || self.options.finish_helps;
        Task* other = helps ? self.take() : nullptr;
        if (other) {
            self.run(other, lock);
        } else {
            self.changed.wait(lock);
        }
    }
    task->finished = true;
}

TestExecutor::Task* TestExecutor::take() {
    if (queue.empty()) return nullptr;
    size_t index = 0;
    if (options.order == Order::lifo) index = queue.size() - 1;
    if (options.order == Order::random) index = random() % queue.size();
    Task* task = queue[index];
    queue.erase(queue.begin() + static_cast<std::ptrdiff_t>(index));
    return task;
}

void TestExecutor::run(Task* task, std::unique_lock<std::mutex>& lock) {
    if (task->started) complaints += "the executor itself is broken; ";
    task->started = true;
    lock.unlock();
    maybe_sleep();
    task->run(task->argument);
    maybe_sleep();
    lock.lock();
    task->returned = true;
    changed.notify_all();
}

void TestExecutor::thread_loop() {
    std::unique_lock lock(mutex);
    for (;;) {
        if (Task* task = take()) {
            run(task, lock);
        } else if (stopping) {
            return;
        } else {
            queued.wait(lock);
        }
    }
}

void TestExecutor::maybe_sleep() {
    if (!options.delays) return;
    thread_local std::minstd_rand local{
        static_cast<uint32_t>(std::hash<std::thread::id>()(std::this_thread::get_id()))};
    std::this_thread::sleep_for(std::chrono::microseconds(local() % 200));
}

std::vector<ExecutorOptions> hostile_executors() {
    std::vector<ExecutorOptions> all;
    all.push_back({"inline_1", Order::at_once, 0, 1});
    all.push_back({"inline_claims_8", Order::at_once, 0, 8});
    all.push_back({"lifo_in_finish", Order::lifo, 0, 4});
    all.push_back({"fifo_in_finish", Order::fifo, 0, 4});
    all.push_back({"random_in_finish", Order::random, 0, 7});
    all.push_back({"one_thread_lifo", Order::lifo, 1, 3});
    all.push_back({"one_thread_fifo", Order::fifo, 1, 1});
    all.push_back({"pool_2", Order::fifo, 2, 2});
    all.push_back({"pool_4_random", Order::random, 4, 4});
    all.push_back({"pool_8_more_tasks_than_threads", Order::random, 3, 70});
    all.push_back({"pool_8_fewer_tasks_than_threads", Order::lifo, 8, 2});
    all.push_back({"pool_4_delays", Order::random, 4, 4, true});
    all.push_back({"pool_4_sometimes_inline", Order::random, 4, 5, false, true});
    all.push_back({"pool_3_delays_finish_helps", Order::lifo, 3, 4, true, true, true});
    return all;
}

} // namespace nusselt::test
