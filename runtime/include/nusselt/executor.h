// The task hook: where the frame's tasks run. examples/ adapts two job systems; jobs/README.md says how.
#pragma once

#include "nusselt/status.h"

#include <cstdint>

namespace nusselt {

// The contract, both ways.
// 1. `enqueue` runs `run(argument)` exactly once: later on any thread, or at once, inline, and then it
// returns null. It may be called from inside a task.
// 2. A ticket that is not null is passed to `finish` exactly once, from a thread inside `wait`; `finish`
// returns when that task has returned, and what it wrote is then visible to the caller.
// 3. A task never blocks, never waits for another task, throws nothing and allocates nothing: one thread that
// runs the tasks in any order finishes the frame, and tasks that start only inside `finish` are enough.
// 4. The thread that waits helps: it works through the frame itself before it calls `finish`.
// 5. Where frames are waited for on the executor's own threads, `finish` must not only wait: it runs the task
// itself if no thread has begun it, or other tasks; else every thread may wait for one that is queued.
// 6. At most `concurrency` tasks of one frame are queued or running at a time; 0 means 1. More than there are
// processors only cost: each is woken, and has scratch memory of its own (on two processors 64 keep four
// fifths of a small frame's throughput, 8 nine tenths).
struct Executor {
    void* user = nullptr;
    void* (*enqueue)(void* user, void (*run)(void* argument), void* argument) = nullptr;
    void (*finish)(void* user, void* ticket) = nullptr;
    uint32_t concurrency = 1;
};

// Runs every task inline. Creates no thread, holds no state; `destroy_executor` is not needed.
Executor serial_executor();

// An executor over oneTBB with an arena of its own of `threads` slots (0: as many as the machine has, the
// calling thread counted). Every wait is isolated: a waiting thread never picks up the host's tasks, and a
// cancelled host task group does not cancel ours. Uses no global_control. `unsupported` where the library was
// built without TBB.
Status create_tbb_executor(uint32_t threads, Executor* out);

// Ends an executor that create_tbb_executor made, when no context uses it any more. Others are left alone.
void destroy_executor(Executor* executor);

} // namespace nusselt
