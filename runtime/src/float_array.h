#pragma once

#include "memory.h"

namespace nusselt {

// Floats, with slack to read whole registers past the end.
struct FloatArray {
    explicit FloatArray(const Allocator& a) : values(HostAllocator<float>(a)) {}
    Vector<float> values;

    void resize(size_t count) { values.resize(count + 16); }
    float* data() { return values.data(); }
    const float* data() const { return values.data(); }
};

} // namespace nusselt
