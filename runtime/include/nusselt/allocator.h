// The memory hook. All allocation happens when a context or a mesh is made, or when a frame is the largest so
// far; a frame in steady state allocates nothing.
#pragma once

#include <cstddef>

namespace nusselt {

// `allocate` returns `size` bytes aligned to `alignment` (a power of two, at most 128), or null when there is
// none; it may be called from any thread that calls into the library, never from a task. `release` takes back
// the same pointer with the same size and alignment, and must not throw; an `allocate` that throws counts as
// null. Both null: the C++ heap.
struct Allocator {
    void* user = nullptr;
    void* (*allocate)(void* user, size_t size, size_t alignment) = nullptr;
    void (*release)(void* user, void* memory, size_t size, size_t alignment) = nullptr;
};

} // namespace nusselt
