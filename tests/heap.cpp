// In a file of its own: inlined, gcc takes malloc and operator new for a mismatch.
#include "tests/heap.h"

#include <cerrno>
#include <cstdlib>
#include <new>

namespace nusselt::test {

std::atomic<bool> heap_is_counted = false;
std::atomic<uint64_t> heap_allocations = 0;
std::atomic<bool> heap_is_empty = false;

namespace {

void count() {
    if (heap_is_counted.load(std::memory_order_relaxed))
        heap_allocations.fetch_add(1, std::memory_order_relaxed);
}

} // namespace

} // namespace nusselt::test

#if defined(NUSSELT_COUNT_MALLOC)

// operator new comes to these.
extern "C" {
void* __libc_malloc(size_t size);
void* __libc_calloc(size_t count, size_t size);
void* __libc_realloc(void* memory, size_t size);
void* __libc_memalign(size_t alignment, size_t size);

void* malloc(size_t size) {
    nusselt::test::count();
    return __libc_malloc(size);
}
void* calloc(size_t number, size_t size) {
    nusselt::test::count();
    return __libc_calloc(number, size);
}
void* realloc(void* memory, size_t size) {
    nusselt::test::count();
    return __libc_realloc(memory, size);
}
void* memalign(size_t alignment, size_t size) {
    nusselt::test::count();
    return __libc_memalign(alignment, size);
}
void* aligned_alloc(size_t alignment, size_t size) {
    nusselt::test::count();
    return __libc_memalign(alignment, size);
}
int posix_memalign(void** memory, size_t alignment, size_t size) {
    nusselt::test::count();
    *memory = __libc_memalign(alignment, size);
    return *memory ? 0 : ENOMEM;
}
}

#endif

namespace {

void* taken(void* memory) {
    if (!memory) throw std::bad_alloc();
#if !defined(NUSSELT_COUNT_MALLOC)
    nusselt::test::count();
#endif
    return memory;
}

} // namespace

void* operator new(size_t size) {
    return taken(nusselt::test::heap_is_empty ? nullptr : std::malloc(size));
}
void* operator new(size_t size, std::align_val_t alignment) {
    const size_t a = static_cast<size_t>(alignment);
    return taken(nusselt::test::heap_is_empty ? nullptr : std::aligned_alloc(a, (size + a - 1) / a * a));
}
void operator delete(void* memory) noexcept {
    std::free(memory);
}
void operator delete(void* memory, size_t) noexcept {
    std::free(memory);
}
void operator delete(void* memory, std::align_val_t) noexcept {
    std::free(memory);
}
void operator delete(void* memory, size_t, std::align_val_t) noexcept {
    std::free(memory);
}
