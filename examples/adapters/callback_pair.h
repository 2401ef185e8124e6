// nusselt over a host's pair of callbacks of the shape that enkiTS and Box2D have: parallel ranges with a
// worker index, and a handle to finish. Copy it and put your types in place of Host's.
#pragma once

#include <nusselt/executor.h>

#include <atomic>

namespace adapters {

using RangeTask = void(int begin, int end, uint32_t worker, void* task_context);

struct Host {
    void* user = nullptr;
    // Runs task over [0, items) in pieces of `least` or more; null: it has run already.
    void* (*enqueue_task)(RangeTask* task, int items, int least, void* task_context, void* user) = nullptr;
    void (*finish_task)(void* task, void* user) = nullptr;
    uint32_t workers = 1;
};

// Lives as long as the contexts that use its executor.
class CallbackPair {
public:
    explicit CallbackPair(const Host& h) : host(h) {}

    nusselt::Executor executor() { return {this, enqueue, finish, host.workers}; }

private:
    struct Record {
        void (*run)(void* argument) = nullptr;
        void* argument = nullptr;
        void* task = nullptr; // the host's
        std::atomic<bool> taken = false;
    };

    static void* enqueue(void* user, void (*run)(void*), void* argument) {
        CallbackPair& self = *static_cast<CallbackPair*>(user);
        for (Record& record : self.records) {
            if (record.taken.exchange(true)) continue;
            record.run = run;
            record.argument = argument;
            record.task = self.host.enqueue_task(run_record, 1, 1, &record, self.host.user);
            if (record.task) return &record;
            record.taken = false; // it has run
            return nullptr;
        }
        run(argument); // more than 64 on their way: this thread does it itself
        return nullptr;
    }
    static void run_record(int, int, uint32_t, void* task_context) {
        const Record& record = *static_cast<Record*>(task_context);
        record.run(record.argument);
    }
    static void finish(void* user, void* ticket) {
        CallbackPair& self = *static_cast<CallbackPair*>(user);
        Record& record = *static_cast<Record*>(ticket);
        self.host.finish_task(record.task, self.host.user);
        record.taken = false;
    }

    Host host;
    Record records[64];
};

} // namespace adapters
