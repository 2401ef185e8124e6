// The kernels that take light and its reflection to masks: glossy transfer for a view, radiance, and the
// products of what far objects hide. One table of
// them an instruction set, all with the same bits, as in kernels.h.
#pragma once

#include "kernels/kernels.h"

namespace nusselt::kernels {

// The directions of a mask's bits in the tangent frame, for what is not a table of weights: a BRDF with its
// view. Built when first asked for. Aligned to 64 bytes.
struct CellTables {
    const float* bit_direction[3]; // [bit]: unit, the middle of what the bit stands for; (0, 0, 1) if unused
    const float* block_direction[3]; // [block]: the same of its bits
    const int16_t* bit_weights; // [block][pair of bits][column][bit of the pair]: integral of the basis times
                                // cosine over pi over the cell; bit_unit is one Tables::scale
    const float* share;         // [bit]: the cosine over pi, integrated over the cell; all together 1
    const uint32_t* level;      // [bit]: of a SkyMap; sky_levels where the cell is unused
    float sharpest;             // alpha of the sharpest GGX lobe that the cells can carry
    float bit_unit;             // a power of two
};
constexpr float sharpest_alpha(uint32_t mask_bits) {
    // The lobe has half its greatest value 0.64 alpha from its axis as a half vector, twice that as light: it
    // is 2.6 alpha wide, 2.6 cells at the zenith. At 1.6 / side the cells miss 6 % of its energy.
    return mask_bits == 1024 ? 2.0f / 32 : 2.0f / 64;
}
constexpr size_t cell_table_size(const MaskLayout& l) { // floats
    return size_t(mask_bits(l)) * (5 + sh_columns / 2) + size_t(mask_blocks(l)) * 3;
}
// `memory` holds cell_table_size floats, `samples` is scratch, one a bit; `scale` as in Tables.
CellTables build_cell_tables(const MaskLayout& layout, const float* scale, SampleBit* samples, float* memory);

enum class Lobe : uint32_t { phong, ggx, none };

// How one receiver reflects, seen from one direction. BRDFs as nusselt/gloss.h has them.
struct Reflection {
    Lobe lobe;
    uint32_t exponent; // phong
    float alpha;       // ggx, at least CellTables::sharpest
    float core;        // blocks whose cosine with the mirrored view is above this are taken bit by bit
    float diffuse[3];  // albedo; the part that does not depend on the view is left to `integrate`
    float specular[3]; // phong: albedo at normal incidence; ggx: reflectance at normal incidence
    float view[3];     // towards the viewer in the tangent frame, unit, z > 0
};

// Transfer in each receiver's tangent frame with the whole BRDF: local[channel][term][lane] from
// diffuse_local[term][lane], which `integrate` made of the same masks. The BRDF is taken at each block's
// direction, and at each bit's where the lobe's core lies. `channels` is 3, or 1 where all receivers are
// grey.
using IntegrateGlossy = void (*)(const Tables& tables, const CellTables& cells, const uint8_t* masks,
                                 uint32_t valid, const Reflection reflections[lanes], uint32_t channels,
                                 const float diffuse_local[25][lanes], float local[][25][lanes]);

// rgb[channel][lane] = sum over terms of light[term * 3 + channel] * transfer[channel][term][lane], in the
// order of the terms.
using ShadeBatch = void (*)(const float light[75], const float transfer[3][25][lanes], float rgb[3][lanes]);

// A distant environment, filtered to the cells of a mask: octahedral maps of the whole sphere, coarser ones
// for the larger cells near the horizon.
constexpr uint32_t sky_levels = 4; // each for twice the solid angle of the one before it
struct SkyMap {
    const float* texels;        // [level][v][u][red, green, blue, 0], aligned to 64 bytes
    uint32_t size[sky_levels];  // texels along a level's side
    uint32_t begin[sky_levels]; // first texel of a level
};
// The level of a cell whose centre has that height above the tangent plane, and the solid angle that it is
// for: cells have pi / bits over the cosine.
uint32_t sky_level(double height);
double sky_solid_angle(uint32_t mask_bits, uint32_t level);

// Radiance from the masks and the environment without a basis: rgb[channel][lane] = the sum over open cells
// of weight times radiance times pi f_r, where all used cells weigh the same. `reflections` null: white
// Lambert.
using IntegrateSky = void (*)(const Tables& tables, const CellTables& cells, const SkyMap& sky,
                              const Batch& batch, const uint8_t* masks, const Reflection* reflections,
                              float rgb[3][lanes]);

// Products of two basis functions: the upper triangle of 25 x 25, row by row, padded to whole registers.
constexpr uint32_t product_entries = 325, product_stride = 336;
// hidden[entry] += the sum over blocks, in their order, of counts[block] times products[block][entry].
// `products` are rows of product_stride.
using AddHidden = void (*)(const float* products, const uint8_t* counts, uint32_t blocks, float* hidden);

// Transfer vectors times a matrix: out[term][lane] = the sum over j, in their order, of matrix[term][j] times
// transfer[j][lane].
using MultiplyTransfer = void (*)(const float matrix[25][25], const float transfer[25][lanes],
                                  float out[25][lanes]);

struct LightKernels {
    ShadeBatch shade_batch;
    IntegrateGlossy integrate_glossy;
    IntegrateSky integrate_sky;
    AddHidden add_hidden;
    MultiplyTransfer multiply_transfer;
};

// Null where kernels_for is.
const LightKernels* light_kernels_for(Set set);

} // namespace nusselt::kernels
