// Tables and random inputs for the tests of kernels.
#pragma once

#include "kernels/kernels.h"

#include <gtest/gtest.h>

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <random>
#include <string>
#include <vector>

namespace nusselt::test {

struct NamedLayout {
    const char* name;
    kernels::MaskLayout layout;
};
constexpr NamedLayout layouts[] = {{"paper", kernels::paper_layout},
                                   {"draft", kernels::draft_layout},
                                   {"standard", kernels::standard_layout},
                                   {"fine", kernels::fine_layout}};

template<class T>
struct AlignedDelete {
    void operator()(T* memory) const { ::operator delete[](memory, std::align_val_t(64)); }
};
template<class T>
using AlignedArray = std::unique_ptr<T[], AlignedDelete<T>>;

// Zeroed.
template<class T>
AlignedArray<T> aligned_array(size_t count) {
    auto* const memory = static_cast<T*>(::operator new[](count * sizeof(T), std::align_val_t(64)));
    for (size_t i = 0; i < count; ++i)
        new (memory + i) T{};
    return AlignedArray<T>(memory);
}

// A layout's tables, built once a process.
const kernels::Tables& tables_of(const kernels::MaskLayout& layout);

// The whole mask of a cell of the table, put together from the parts that are this one turned (layout.h).
std::vector<uint8_t> mask_of_cell(const kernels::MaskLayout& layout, uint32_t cell);

struct Random {
    std::mt19937_64 engine;
    explicit Random(uint64_t seed) : engine(seed) {}

    // Not std's distributions: they differ from one standard library to the next.
    double unit() { return double(engine() >> 11) * 0x1p-53; }
    float between(float low, float high) { return low + (high - low) * float(unit()); }
    uint32_t below(uint32_t count) { return uint32_t(engine() % count); }
    bool one_in(uint32_t n) { return below(n) == 0; }
    float any_float();   // random bits: NaN, infinities and denormals among them
    float frame_float(); // the same, but as a frame's points are: at most 1 in size, or not finite
    void direction(float out[3]);
};

// Sixteen receivers near one another, with normals that differ by at most about `spread`.
// `hostile`: some on axes and planes, at one place, not finite, with zero normals; some lanes absent.
struct BatchInput {
    kernels::Batch batch;
    alignas(64) float normal[3][kernels::lanes];
};
void random_batch(Random& random, bool hostile, float spread, BatchInput& out);

// A cluster and its points, laid out as the runtime does.
struct ClusterInput {
    AlignedArray<float> points; // 4 a vertex
    std::vector<uint32_t> vertices;
    std::vector<uint8_t> edges, triangles;
    AlignedArray<float> bounds;
    kernels::ClusterView view;
};
// A patch of a bumpy surface near `centre`, or (hostile) with corners at receivers, equal corners, corners
// that aren't finite, and planes through receivers.
void random_cluster(Random& random, const kernels::Batch& batch, bool hostile, ClusterInput& out);

struct Jobs {
    explicit Jobs(uint32_t capacity);
    AlignedArray<uint32_t> memory;
    kernels::JobList list;
    uint32_t capacity;

    // Sorted, so that order does not matter.
    std::vector<std::array<uint32_t, 4>> sorted() const;
};

// The instruction set NUSSELT_TEST_SET; nothing where it is not set or does not run here, which sets_test.cpp
// judges.
std::optional<kernels::Set> set_to_test();

bool same_bits(const void* a, const void* b, size_t bytes);

} // namespace nusselt::test
