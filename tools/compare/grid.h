// Sample grids on the hemisphere and what their cells weigh, in double and apart from the library: the peer
// and the floors are made of these.
#pragma once

#include <cstdint>
#include <vector>

namespace nusselt::tools {

// `side` x `side` cells (a multiple of 4) in 4x4 blocks row by row, 16 cells a block row by row. Local frame:
// z along the normal.
struct SampleGrid {
    uint32_t side = 0;
    std::vector<float> x, y, z;  // direction of each cell's sample
    std::vector<uint8_t> used;   // 0: the cell lies outside the disk
    std::vector<float> weight;   // 32 a cell (25 terms, padded): integral of basis * cos / pi over the cell
    std::vector<float> block;    // 32 a block: sum over its cells
    std::vector<double> weights; // 25 a cell: `weight` before rounding
    double total[25] = {};       // the whole hemisphere, in closed form
};

// Sample points at the cells' centres under Shirley and Chiu's map of the square to the disk; every cell has
// the same cosine-weighted solid angle.
SampleGrid concentric_grid(uint32_t side);
// Under the same map, each row and column of samples off its cells' centres by a multiple of the golden
// ratio's fraction; a cell weighs what is nearer to its sample than to any other.
SampleGrid scattered_grid(uint32_t side);
// As the library's masks, which for their own reasons (runtime/doc/adr/0003-table.md, 0004-samples.md) keep
// mask_rim cells from the horizon and mask_middle cells from the lines between their parts, and have one
// part's samples turned in all: from 64 a side on the quarter x, y > 0, below the half y > 0. A tracer needs
// neither.
constexpr double mask_rim = 0.2, mask_middle = 0.3;
SampleGrid mask_grid(uint32_t side);
// The paper's: a square grid over the unit disk. Cells whose centre lies outside are unused; the others weigh
// what they hold of the disk.
SampleGrid disk_grid(uint32_t side);

// c'(Rz(p) Ry(a) s) = c(s) for 16 vectors at once, lanes innermost. Angles by cosine and sine.
struct LaneRotation {
    float cos_a[16], sin_a[16], cos_p[16], sin_p[16];
};
void rotate_lanes(const LaneRotation& rotation, const float in[25][16], float out[25][16]);

// The same for one vector in double, from the normal.
void rotate_to_normal(double nx, double ny, double nz, const double in[25], double out[25]);

} // namespace nusselt::tools
