// The caller's allocator as a standard allocator, for the arrays of a mesh and a context.
// A failed allocation throws std::bad_alloc inside the library; the public calls catch it and answer
// out_of_memory.
#pragma once

#include "nusselt/allocator.h"

#include <cstddef>
#include <new>
#include <vector>

namespace nusselt {

// One cache line and one AVX-512 register: every array starts on one.
constexpr size_t array_alignment = 64;

template<class T>
struct HostAllocator {
    using value_type = T;

    Allocator host; // functions may be null: the C++ heap

    HostAllocator() = default;
    explicit HostAllocator(const Allocator& allocator) : host(allocator) {}
    template<class U>
    HostAllocator(const HostAllocator<U>& other) : host(other.host) {}

    T* allocate(size_t count) {
        if (count > static_cast<size_t>(-1) / sizeof(T)) throw std::bad_alloc();
        const size_t size = count * sizeof(T);
        void* memory = nullptr;
        try {
            memory = host.allocate ? host.allocate(host.user, size, array_alignment)
                                   : ::operator new(size, std::align_val_t(array_alignment), std::nothrow);
        } catch (...) {
            // A host's allocator that throws has no memory either; what it throws goes no further.
        }
        if (!memory) throw std::bad_alloc();
        return static_cast<T*>(memory);
    }
    void deallocate(T* memory, size_t count) {
        if (host.release) {
            host.release(host.user, memory, count * sizeof(T), array_alignment);
        } else {
            ::operator delete(memory, std::align_val_t(array_alignment));
        }
    }
    template<class U>
    bool operator==(const HostAllocator<U>& other) const {
        return host.user == other.host.user && host.allocate == other.host.allocate;
    }
};

template<class T>
using Vector = std::vector<T, HostAllocator<T>>;

} // namespace nusselt
