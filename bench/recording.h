// The inputs that a real frame gives its kernels, kept so that they can be replayed: timings on made-up
// inputs, or on one input that stays in the nearest cache, flatter.
#pragma once

#include "kernels/kernels.h"
#include "nusselt/frame.h"
#include "runtime/src/context_data.h"

#include <cstdint>
#include <memory>
#include <new>
#include <vector>

namespace nusselt::bench {

// Cache lines, as the kernels want their arrays.
template<class T>
struct AlignedHeap {
    using value_type = T;
    AlignedHeap() = default;
    template<class U>
    AlignedHeap(const AlignedHeap<U>&) {}
    T* allocate(size_t count) {
        return static_cast<T*>(::operator new(count * sizeof(T), std::align_val_t(64)));
    }
    void deallocate(T* memory, size_t) { ::operator delete(memory, std::align_val_t(64)); }
    bool operator==(const AlignedHeap&) const { return true; }
};
template<class T>
using Aligned = std::vector<T, AlignedHeap<T>>;

struct alignas(64) Normals {
    float values[3][kernels::lanes];
};
struct alignas(64) FanCorners {
    float values[2][3][kernels::lanes];
    uint32_t active, batch;
};
struct alignas(64) TriangleCorners {
    float values[3][3][kernels::lanes];
    uint32_t active, two_sided, batch;
};
struct alignas(64) Local {
    float values[25][kernels::lanes];
};
struct Pair {
    uint32_t batch, cluster;
};

struct Jobs {
    Aligned<uint32_t> plane[3], destination; // with slack
    uint32_t count = 0;
    kernels::JobList list() {
        return {{plane[0].data(), plane[1].data(), plane[2].data()}, destination.data(), count};
    }
    void reserve(size_t capacity);
};

// Batches of a frame of the built-in scene "hand", spread over the whole mesh, taken through all stages by
// the scalar reference.
struct Recording {
    Context* context = nullptr;
    const Frame* frame = nullptr;
    const kernels::Tables* tables = nullptr;
    std::vector<float> transfer; // of the whole mesh
    Aligned<kernels::Batch> batches, unprepared;
    Aligned<Normals> normals;
    std::vector<Pair> pairs; // that were rasterised
    Aligned<FanCorners> fans;
    Aligned<TriangleCorners> triangles; // 2-rings, as quality paper takes them
    std::vector<Jobs> jobs;             // of each batch
    Aligned<uint8_t> masks;             // 16 of each batch
    Aligned<Local> locals;              // of each batch

    explicit Recording(Quality quality, uint32_t batch_count);
    ~Recording();
    Recording(const Recording&) = delete;
    Recording& operator=(const Recording&) = delete;

    const uint8_t* masks_of(size_t batch) const {
        return masks.data() + batch * kernels::lanes * kernels::mask_bytes(tables->layout);
    }
};

// Of standard and fine, made on first use.
Recording& recording(Quality quality);

} // namespace nusselt::bench
