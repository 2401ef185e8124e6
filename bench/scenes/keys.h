// Key poses: rows of numbers with a time, eased from one to the next.
#pragma once

#include "portable_math.h"

#include <array>
#include <cstddef>

namespace nusselt::scenes {

template<class Row>
struct Key {
    float time; // ascending
    Row row;
};

template<size_t count, size_t width>
std::array<float, width> sample_keys(const std::array<Key<std::array<float, width>>, count>& keys,
                                     float time) {
    size_t next = 0;
    while (next < count && keys[next].time <= time)
        ++next;
    if (next == 0) return keys.front().row;
    if (next == count) return keys.back().row;
    const float along = smooth_step(keys[next - 1].time, keys[next].time, time);
    std::array<float, width> row;
    for (size_t i = 0; i < width; ++i)
        row[i] = keys[next - 1].row[i] + along * (keys[next].row[i] - keys[next - 1].row[i]);
    return row;
}

} // namespace nusselt::scenes
