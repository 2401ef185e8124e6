// The scalar reference of the light kernels.
#include "kernels/reference.h"
#include "kernels/reflection_parts.h"

#include <cmath>

namespace nusselt::kernels {

namespace {

void shade_batch(const float light[75], const float transfer[3][25][lanes], float rgb[3][lanes]) {
    for (uint32_t c = 0; c < 3; ++c) {
        for (uint32_t lane = 0; lane < lanes; ++lane) {
            float sum = 0;
            for (uint32_t i = 0; i < 25; ++i)
                sum += light[i * 3 + c] * transfer[c][i][lane];
            rgb[c][lane] = sum;
        }
    }
}

// Mirrored about the normal; normalised as (e + 2) / (2 pi) cos^e.
float phong_lobe(const Reflection& r, const float d[3]) {
    const float cosine = r.view[2] * d[2] - (r.view[0] * d[0] + r.view[1] * d[1]);
    float power = 1, square = cosine > 0 ? cosine : 0;
    for (uint32_t e = r.exponent; e; e >>= 1) {
        if (e & 1) power = power * square;
        square = square * square;
    }
    return 0.5f * (float(r.exponent) + 2.0f) * power;
}

// The lobe without its Fresnel term, and Schlick's (1 - v.h)^5.
struct GgxLobe {
    float glitter, edge;
};
GgxLobe ggx_lobe(const Reflection& r, const float d[3]) {
    const float square = r.alpha * r.alpha, rest = 1.0f - square;
    const float view_side = r.view[2] + std::sqrt(square + rest * (r.view[2] * r.view[2]));
    const float q = 2.0f + 2.0f * (r.view[0] * d[0] + r.view[1] * d[1] + r.view[2] * d[2]); // |d + v|^2
    const float s = d[2] + r.view[2];
    const float a = q - s * s * rest;
    const float light_side = d[2] + std::sqrt(square + rest * (d[2] * d[2]));
    const float glitter = square / view_side * (q * q) / (a * a * light_side);
    const float t = 1.0f - 0.5f * std::sqrt(q); // 1 - v.h
    return {glitter, t * t * (t * t) * t};
}

// pi times the BRDF without the diffuse part that the view does not change, for each channel.
void respond(const Reflection& r, const float d[3], float out[3]) {
    if (r.lobe == Lobe::none) {
        out[0] = out[1] = out[2] = 0;
        return;
    }
    if (r.lobe == Lobe::phong) {
        const float lobe = phong_lobe(r, d);
        for (uint32_t c = 0; c < 3; ++c)
            out[c] = r.specular[c] * lobe;
        return;
    }
    const GgxLobe lobe = ggx_lobe(r, d);
    for (uint32_t c = 0; c < 3; ++c)
        out[c] =
            lobe.glitter * (r.specular[c] + (1.0f - r.specular[c]) * lobe.edge) - r.diffuse[c] * lobe.edge;
}

void fields_at(const Reflection& r, Parts kind, const float d[3], float out[3]) {
    if (kind == Parts::power) {
        out[0] = phong_lobe(r, d);
        return;
    }
    const GgxLobe lobe = ggx_lobe(r, d);
    const float fresnel = r.specular[0] + (1.0f - r.specular[0]) * lobe.edge;
    switch (kind) {
    case Parts::whole:
        out[0] = lobe.glitter * fresnel - r.diffuse[0] * lobe.edge;
        break;
    case Parts::plastic:
        out[0] = lobe.glitter * fresnel;
        out[1] = lobe.edge;
        break;
    default:
        out[0] = lobe.glitter * (1.0f - lobe.edge);
        out[1] = lobe.glitter * lobe.edge;
        out[2] = lobe.edge;
    }
}

// Whether the direction lies in the core of the lobe, where the BRDF varies within a block.
bool in_core(const Reflection& r, const float d[3]) {
    return r.view[2] * d[2] - (r.view[0] * d[0] + r.view[1] * d[1]) > r.core;
}

// The open part of a block, in the unit of the integer tables.
int16_t open_part(const Tables& tables, uint32_t block, uint32_t blocked, uint32_t column) {
    uint16_t rest = uint16_t(tables.blocks[size_t(block) * sh_columns + column]);
    for (uint32_t row = 0; row < 4; ++row) {
        const size_t pattern = (size_t(block) * 4 + row) * 16 + (blocked >> (4 * row) & 15);
        rest = uint16_t(rest - uint16_t(tables.nibbles[pattern * sh_columns + column]));
    }
    return int16_t(rest);
}

int32_t level_of(float value, const LevelUnit& unit, int bits) {
    // Above zero before the fraction goes. The greatest may round up beyond its bits.
    const int32_t middle = 1 << bits;
    return std::min(int32_t(value * unit.inverse + (float(middle) + 0.5f)) - middle, middle - 1);
}

uint32_t blocked_bits(const uint8_t* mask, uint32_t block) {
    return uint32_t(mask[2 * block]) | uint32_t(mask[2 * block + 1]) << 8;
}

// A field over some blocks of the core, bit by bit.
void add_core(const CellTables& cells, const uint8_t* mask, const Reflection& r, Parts kind, uint32_t field,
              const uint32_t* blocks, uint32_t count, float sum[sh_columns]) {
    float value[core_group][16], largest = 0;
    for (uint32_t i = 0; i < count; ++i) {
        for (uint32_t k = 0; k < 16; ++k) {
            const uint32_t bit = blocks[i] * 16 + k;
            const float d[3] = {cells.bit_direction[0][bit], cells.bit_direction[1][bit],
                                cells.bit_direction[2][bit]};
            float fields[3];
            fields_at(r, kind, d, fields);
            value[i][k] = blocked_bits(mask, blocks[i]) >> k & 1 ? 0.0f : fields[field];
            largest = std::max(largest, std::fabs(value[i][k]));
        }
    }
    const LevelUnit level = level_unit(largest, bit_levels);
    for (uint32_t i = 0; i < count; ++i) {
        int32_t bits[sh_columns] = {};
        for (uint32_t k = 0; k < 16; ++k) {
            const int16_t* weights = cells.bit_weights + (size_t(blocks[i]) * 8 + k / 2) * 2 * sh_columns;
            for (uint32_t column = 0; column < sh_columns; ++column)
                bits[column] += level_of(value[i][k], level, bit_levels) * weights[2 * column + k % 2];
        }
        for (uint32_t column = 0; column < sh_columns; ++column)
            sum[column] += level.unit * cells.bit_unit * float(bits[column]);
    }
}

// A field over the open part of the mask: sum[column], in Tables::scale.
void integrate_field(const Tables& tables, const CellTables& cells, const uint8_t* mask, const Reflection& r,
                     Parts kind, uint32_t field, float sum[sh_columns]) {
    float value[mask_blocks(fine_layout)], largest = 0;
    uint32_t group[core_group], count = 0;
    for (uint32_t block = 0; block < mask_blocks(tables.layout); ++block) {
        const float d[3] = {cells.block_direction[0][block], cells.block_direction[1][block],
                            cells.block_direction[2][block]};
        float fields[3];
        fields_at(r, kind, d, fields);
        const bool core = in_core(r, d);
        value[block] = core ? 0.0f : fields[field];
        largest = std::max(largest, std::fabs(value[block]));
        if (core && blocked_bits(mask, block) != 0xFFFF) group[count++] = block;
        if (count == core_group) {
            add_core(cells, mask, r, kind, field, group, count, sum);
            count = 0;
        }
    }
    add_core(cells, mask, r, kind, field, group, count, sum);
    const LevelUnit level = level_unit(largest, block_levels);
    int32_t blocks[sh_columns] = {};
    for (uint32_t block = 0; block < mask_blocks(tables.layout); ++block) {
        for (uint32_t i = 0; i < sh_columns; ++i)
            blocks[i] += level_of(value[block], level, block_levels) *
                         open_part(tables, block, blocked_bits(mask, block), i);
    }
    for (uint32_t i = 0; i < sh_columns; ++i)
        sum[i] += level.unit * float(blocks[i]);
}

void integrate_glossy(const Tables& tables, const CellTables& cells, const uint8_t* masks, uint32_t valid,
                      const Reflection reflections[lanes], uint32_t channels,
                      const float diffuse_local[25][lanes], float local[][25][lanes]) {
    for (uint32_t lane = 0; lane < lanes; ++lane) {
        const Reflection& r = reflections[lane];
        const ReflectionParts parts = parts_of(r, channels);
        const bool present = valid >> lane & 1;
        float sums[3][sh_columns] = {};
        for (uint32_t f = 0; present && f < parts.fields; ++f)
            integrate_field(tables, cells, masks + size_t(lane) * mask_bytes(tables.layout), r, parts.kind, f,
                            sums[f]);
        for (uint32_t c = 0; c < channels; ++c) {
            for (uint32_t i = 0; i < 25; ++i) {
                float glossy = 0;
                for (uint32_t f = 0; f < parts.fields; ++f)
                    glossy += parts.factor[f][c] * sums[f][i];
                local[c][i][lane] =
                    present ? r.diffuse[c] * diffuse_local[i][lane] + glossy * tables.scale[i] : 0.0f;
            }
        }
    }
}

// The texel of a direction in a level's octahedral map.
uint32_t texel_of(const SkyMap& sky, uint32_t level, const float d[3]) {
    const float sum = std::fabs(d[0]) + std::fabs(d[1]) + std::fabs(d[2]);
    float u = d[0] / sum, v = d[1] / sum;
    if (d[2] < 0) {
        const float across = 1.0f - std::fabs(v), along = 1.0f - std::fabs(u);
        u = u < 0 ? -across : across;
        v = v < 0 ? -along : along;
    }
    const float half = 0.5f * float(sky.size[level]), top = float(sky.size[level] - 1);
    const auto cell = [&](float x) {
        const float at = x * half + half;
        return uint32_t(at > 0 ? (at < top ? at : top) : 0.0f);
    };
    return sky.begin[level] + cell(v) * sky.size[level] + cell(u);
}

void integrate_sky(const Tables& tables, const CellTables& cells, const SkyMap& sky, const Batch& batch,
                   const uint8_t* masks, const Reflection* reflections, float rgb[3][lanes]) {
    const uint32_t bits = mask_bits(tables.layout);
    for (uint32_t lane = 0; lane < lanes; ++lane) {
        const uint8_t* mask = masks + size_t(lane) * mask_bytes(tables.layout);
        float sum[4][3] = {}; // of every fourth bit: four chains of additions
        for (uint32_t bit = 0; bit < bits && (batch.valid >> lane & 1); ++bit) {
            if ((mask[bit / 8] >> (bit % 8) & 1) || cells.level[bit] == sky_levels) continue;
            const float local[3] = {cells.bit_direction[0][bit], cells.bit_direction[1][bit],
                                    cells.bit_direction[2][bit]};
            float d[3];
            for (uint32_t k = 0; k < 3; ++k)
                d[k] = batch.axis[0][k][lane] * local[0] + batch.axis[1][k][lane] * local[1] +
                       batch.axis[2][k][lane] * local[2];
            const float* texel = sky.texels + 4 * size_t(texel_of(sky, cells.level[bit], d));
            float factor[3] = {cells.share[bit], cells.share[bit], cells.share[bit]};
            if (reflections) {
                float response[3];
                respond(reflections[lane], local, response);
                for (uint32_t c = 0; c < 3; ++c)
                    factor[c] = cells.share[bit] * (response[c] + reflections[lane].diffuse[c]);
            }
            for (uint32_t c = 0; c < 3; ++c)
                sum[bit % 4][c] += factor[c] * texel[c];
        }
        for (uint32_t c = 0; c < 3; ++c)
            rgb[c][lane] = (sum[0][c] + sum[1][c]) + (sum[2][c] + sum[3][c]);
    }
}

void add_hidden(const float* products, const uint8_t* counts, uint32_t blocks, float* hidden) {
    for (uint32_t block = 0; block < blocks; ++block) {
        for (uint32_t at = 0; counts[block] > 0 && at < product_stride; ++at)
            hidden[at] += float(counts[block]) * products[size_t(block) * product_stride + at];
    }
}

void multiply_transfer(const float matrix[25][25], const float transfer[25][lanes], float out[25][lanes]) {
    for (uint32_t i = 0; i < 25; ++i) {
        for (uint32_t lane = 0; lane < lanes; ++lane) {
            float sum = 0;
            for (uint32_t j = 0; j < 25; ++j)
                sum += matrix[i][j] * transfer[j][lane];
            out[i][lane] = sum;
        }
    }
}

} // namespace

const LightKernels reference_light_kernels = {shade_batch, integrate_glossy, integrate_sky, add_hidden,
                                              multiply_transfer};

} // namespace nusselt::kernels
