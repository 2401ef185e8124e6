// A heap that can be told to be empty. In a file of its own: inlined, gcc takes malloc and operator new for a
// mismatch.
#include <atomic>
#include <cstdlib>
#include <new>

extern std::atomic<bool> heap_is_empty;
std::atomic<bool> heap_is_empty = false;

void* operator new(size_t size) {
    void* memory = heap_is_empty ? nullptr : std::malloc(size);
    if (!memory) throw std::bad_alloc();
    return memory;
}
void* operator new(size_t size, std::align_val_t alignment) {
    const size_t a = static_cast<size_t>(alignment);
    void* memory = heap_is_empty ? nullptr : std::aligned_alloc(a, (size + a - 1) / a * a);
    if (!memory) throw std::bad_alloc();
    return memory;
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
