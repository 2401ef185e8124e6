// Public: exported from a shared library, which hides all else.
#pragma GCC visibility push(default)
#include "nusselt/executor.h"
#pragma GCC visibility pop

namespace nusselt {

static void* run_inline(void*, void (*run)(void* argument), void* argument) {
    run(argument);
    return nullptr;
}

static void finish_nothing(void*, void*) {}

Executor serial_executor() {
    Executor executor;
    executor.enqueue = run_inline;
    executor.finish = finish_nothing;
    return executor;
}

} // namespace nusselt
