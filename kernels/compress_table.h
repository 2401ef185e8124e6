// Moving the chosen lanes of a register to the front, as a permutation.
#pragma once

#include <cstdint>

namespace nusselt::kernels {

// For each set of 8 lanes (or of the 4 lower ones): the numbers of its lanes in order, then zeros.
struct CompressTable {
    uint8_t from[256][8];
    constexpr CompressTable() : from() {
        for (uint32_t bits = 0; bits < 256; ++bits) {
            uint32_t count = 0;
            for (uint8_t lane = 0; lane < 8; ++lane) {
                if (bits >> lane & 1) from[bits][count++] = lane;
            }
        }
    }
};

inline constexpr CompressTable compress_table;

} // namespace nusselt::kernels
