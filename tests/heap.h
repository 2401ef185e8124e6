// The process's heap as tests want it. heap.cpp replaces it; link that file into the test.
#pragma once

#include <atomic>
#include <cstdint>

namespace nusselt::test {

// While set, allocations are counted: by whatever way where the target defines NUSSELT_COUNT_MALLOC (which
// the sanitizers, with a malloc of their own, don't go with), otherwise those of operator new.
extern std::atomic<bool> heap_is_counted;
extern std::atomic<uint64_t> heap_allocations;

// While set, operator new throws std::bad_alloc.
extern std::atomic<bool> heap_is_empty;

} // namespace nusselt::test
