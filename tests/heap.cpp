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

void* plain(size_t size) {
    return nusselt::test::heap_is_empty ? nullptr : std::malloc(size);
}
void* aligned(size_t size, std::align_val_t alignment) {
    const size_t a = static_cast<size_t>(alignment);
    return nusselt::test::heap_is_empty ? nullptr : std::aligned_alloc(a, (size + a - 1) / a * a);
}
void* counted(void* memory) {
#if !defined(NUSSELT_COUNT_MALLOC)
    if (memory) nusselt::test::count();
#endif
    return memory;
}
void* or_throw(void* memory) {
    if (!memory) throw std::bad_alloc();
    return memory;
}

} // namespace

// All forms: the address sanitizer has those of its own that a program leaves out, and they don't go
// together.
void* operator new(size_t size) {
    return counted(or_throw(plain(size)));
}
void* operator new(size_t size, std::align_val_t alignment) {
    return counted(or_throw(aligned(size, alignment)));
}
void* operator new(size_t size, const std::nothrow_t&) noexcept {
    return counted(plain(size));
}
void* operator new(size_t size, std::align_val_t alignment, const std::nothrow_t&) noexcept {
    return counted(aligned(size, alignment));
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
