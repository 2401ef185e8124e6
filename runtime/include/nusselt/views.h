// Borrowed arrays: a pointer, a count and a stride. The library never reads or writes past the last element,
// and never keeps a view longer than the call or the frame that it was given to.
#pragma once

#include <cstddef>
#include <cstdint>

namespace nusselt {

// `count` vectors of 3 floats, `stride` bytes apart (a multiple of 4, at least 12). Data null means "none".
struct Vec3View {
    const float* data = nullptr;
    size_t count = 0;
    size_t stride = 12;
};

// `count` transfer vectors of 25 floats (or of order^2, where a lower order is asked for), `stride` bytes
// apart (a multiple of 4, at least their size). Written, never read.
struct TransferView {
    float* data = nullptr;
    size_t count = 0;
    size_t stride = 100;
};

// `count` occlusion masks, `stride` bytes apart (a multiple of 4, at least bits / 8 of the quality). Written,
// never read.
struct MaskView {
    uint32_t* data = nullptr;
    size_t count = 0;
    size_t stride = 128;
};

} // namespace nusselt
