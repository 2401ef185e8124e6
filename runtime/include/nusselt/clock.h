// The clock hook: what a frame's time budget is measured with.
#pragma once

#include <cstdint>

namespace nusselt {

// `nanoseconds` never goes back; it is called from tasks, some times a batch of 16 receivers, and must
// neither throw nor block. Null: std::chrono::steady_clock.
struct Clock {
    void* user = nullptr;
    uint64_t (*nanoseconds)(void* user) = nullptr;
};

} // namespace nusselt
