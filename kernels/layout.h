// How a mask's bits lie on the hemisphere, and how planes index the table. One place for the constants.
#pragma once

#include <bit>
#include <cstddef>
#include <cstdint>

namespace nusselt::kernels {

constexpr uint32_t lanes = 16;            // receivers of a batch; every per-lane array has this many entries
constexpr uint32_t sh_columns = 32;       // 25 terms padded to whole registers
constexpr uint32_t cluster_vertices = 64; // at most, of one cluster
constexpr uint32_t cluster_edges = 128;
constexpr uint32_t cluster_triangles = 64;

// Where the sample points lie.
enum class SampleMap : uint32_t {
    disk_grid, // the paper: a square grid around the unit disk, cells outside it unused
    scattered, // Shirley and Chiu's map of the square to the disk: every cell has the same cosine-weighted
               // solid angle. A cell's sample lies off its centre, another way in each row and column, so
               // that no edge of a shadow runs along a row of them; a bit weighs what is nearest to its
               // sample
};

// How a plane through the receiver finds its cell of the table.
enum class PlaneMap : uint32_t {
    octahedral, // half the sphere (z >= 0) as a square on its corner, the outermost cells' middles on its
                // rim; the other half by complement
    cube,       // the paper: six faces, the whole sphere
};

// A mask of side * side bits in 4x4 blocks of 16 bits, in parts of whole cache lines, each of which holds the
// samples of one sector and is drawn by jobs of its own: of 1024 bits the halves y < 0 and y > 0; of 4096 the
// quarters x, y < 0; then x > 0, y < 0; x, y > 0; and x < 0, y > 0.
//
// With octahedral planes the parts are one set of samples turned about the normal, so that a table of one
// part stands for all. A part's blocks lie row by row in the plane as it is before it is turned: where y > 0
// (and x > 0), from the middle outwards. With the cube's planes the blocks lie row by row over the whole
// mask.
struct MaskLayout {
    SampleMap samples; // scattered with octahedral planes only
    PlaneMap planes;
    uint32_t side;        // 32 or 64; 32 with the cube's planes
    uint32_t plane_cells; // a power of two: cells along a side of the square (octahedral) or of a face (cube)
};

constexpr uint32_t mask_bits(const MaskLayout& l) {
    return l.side * l.side;
}
constexpr uint32_t mask_bytes(const MaskLayout& l) {
    return mask_bits(l) / 8;
}
constexpr uint32_t mask_blocks(const MaskLayout& l) {
    return mask_bits(l) / 16;
}
constexpr uint32_t mask_parts(const MaskLayout& l) {
    return l.side / 16;
}
constexpr uint32_t part_bytes(const MaskLayout& l) {
    return mask_bytes(l) / mask_parts(l);
}
constexpr bool has_turned_parts(const MaskLayout& l) {
    return l.planes == PlaneMap::octahedral;
}
// Of a cell of the table: the part that is not turned, or the whole mask.
constexpr uint32_t cell_bytes(const MaskLayout& l) {
    return has_turned_parts(l) ? part_bytes(l) : mask_bytes(l);
}
constexpr uint32_t table_cells(const MaskLayout& l) {
    return l.plane_cells * l.plane_cells * (l.planes == PlaneMap::cube ? 6 : 1);
}
constexpr size_t plane_table_bytes(const MaskLayout& l) {
    return size_t(table_cells(l)) * cell_bytes(l);
}

// A plane's entry as jobs carry it: byte offset of its cell, with the low bits free. `entry_complement` turns
// it into the opposite half-space: bit 0 asks for the complement (octahedral), or the opposite cell of the
// opposite face (cube). `entry_invalid` marks a plane that is none (an edge of length zero as seen from the
// receiver, or not finite); the triangle is then left out.
constexpr uint32_t entry_invalid = 2;
constexpr uint32_t cell_shift(const MaskLayout& l) {
    return cell_bytes(l) == 64 ? 6 : 7;
}
// Rows of cells lie 2^row_shift apart.
constexpr uint32_t row_shift(const MaskLayout& l) {
    return static_cast<uint32_t>(std::bit_width(l.plane_cells) - 1);
}
constexpr uint32_t entry_complement(const MaskLayout& l) {
    return l.planes == PlaneMap::octahedral ? 1u : (2 * l.plane_cells * l.plane_cells - 1) << cell_shift(l);
}

// The last cell's byte offset (octahedral).
constexpr uint32_t last_cell(const MaskLayout& l) {
    return (table_cells(l) - 1) << cell_shift(l);
}
// Entries for a part's samples turned by half a turn and by a quarter (x to y), from those for the samples as
// they are (octahedral): of a plane turned back. A cell (u, v) goes to the
// last one less it, and to (last - v, u).
constexpr uint32_t half_turned(const MaskLayout& l, uint32_t entry) {
    return (last_cell(l) + 3 - entry) ^ 3;
}
constexpr uint32_t quarter_turned(const MaskLayout& l, uint32_t entry) {
    const uint32_t row = (l.plane_cells - 1) << cell_shift(l);
    return (entry & row) << row_shift(l) | (row - (entry >> row_shift(l) & row)) | (entry & 3);
}

// By how many quarters a part's samples are turned from those where y > 0 (and x > 0).
constexpr uint32_t quarters_of_part(const MaskLayout& l, uint32_t part) {
    const uint32_t parts = mask_parts(l);
    return has_turned_parts(l) ? (part + parts / 2) % parts * (4 / parts) : 0;
}
// The entry as a job of a part has it.
constexpr uint32_t entry_of_part(const MaskLayout& l, uint32_t entry, uint32_t part) {
    if (!has_turned_parts(l)) return entry + part * part_bytes(l);
    const uint32_t quarters = quarters_of_part(l, part);
    if (quarters & 2) entry = half_turned(l, entry);
    return quarters & 1 ? quarter_turned(l, entry) : entry;
}

constexpr MaskLayout paper_layout{SampleMap::disk_grid, PlaneMap::cube, 32, 128};
constexpr MaskLayout draft_layout{SampleMap::scattered, PlaneMap::octahedral, 32, 128};
constexpr MaskLayout standard_layout{SampleMap::scattered, PlaneMap::octahedral, 32, 256};
constexpr MaskLayout fine_layout{SampleMap::scattered, PlaneMap::octahedral, 64, 256};

// Integration tables of one layout; all sizes in elements.
constexpr size_t nibble_table_size(const MaskLayout& l) {
    return size_t(mask_blocks(l)) * 4 * 16 * sh_columns;
}
constexpr size_t block_table_size(const MaskLayout& l) {
    return size_t(mask_blocks(l)) * sh_columns;
}

// What kernels read; the memory belongs to the runtime. Everything aligned to 64 bytes.
struct Tables {
    MaskLayout layout{};
    const uint8_t* planes = nullptr;  // [cell][cell_bytes]: bit set where n.d >= 0, n the cell's centre
    const int16_t* nibbles = nullptr; // [block][row][pattern of 4 bits][column]: their weights, scaled
    const int16_t* blocks = nullptr;  // [block][column]: weight of all 16 bits, the sum of the four full rows
    const int16_t* total = nullptr;   // [column]: sum over all blocks
    const float* scale = nullptr;     // [column]: transfer = integer * scale
    const float* block_weights = nullptr; // [block][column]: mean weight of its used bits (4x4 integration,
                                          // paper); one more row at the end: the sum over all bits
    float horizon = 0;                    // horizon_tangent of the layout
};

} // namespace nusselt::kernels
