// The tables, in double and without library functions beyond the square root, so that every machine makes the
// same.
#include "kernels/light.h"
#include "kernels/outputs.h"

#include <algorithm>
#include <cmath>
#include <cstring>

namespace nusselt::kernels {

namespace {

#include "kernels/sh_formulas.inl"

constexpr double quarter_pi = 0.78539816339744830962;

// Taylor series on [0, pi / 4]: below 1e-17 of error after these terms.
double sine(double a) {
    const double s = a * a;
    double sum = 0, term = a;
    for (int k = 1; k <= 19; k += 2) {
        sum += term;
        term *= -s / double((k + 1) * (k + 2));
    }
    return sum;
}
double cosine(double a) {
    const double s = a * a;
    double sum = 0, term = 1;
    for (int k = 0; k <= 18; k += 2) {
        sum += term;
        term *= -s / double((k + 1) * (k + 2));
    }
    return sum;
}

// A point of the square [-1, 1]^2 to the hemisphere. Worked out in one octant and mirrored.
bool square_to_hemisphere(SampleMap map, double u, double v, double d[3]) {
    double x = std::fabs(u), y = std::fabs(v);
    if (map == SampleMap::scattered) {
        const bool steep = y > x;
        const double radius = steep ? y : x, across = steep ? x : y;
        const double angle = radius > 0 ? quarter_pi * (across / radius) : 0.0;
        const double along = radius * cosine(angle), aside = radius * sine(angle);
        x = steep ? aside : along;
        y = steep ? along : aside;
    }
    const double square = x * x + y * y;
    if (square >= 1) return false;
    d[0] = u < 0 ? -x : x;
    d[1] = v < 0 ? -y : y;
    d[2] = std::sqrt(1 - square);
    return true;
}

// In cells: no scattered sample lies nearer to the horizon. Nearer, more triangles reach it than it is worth
// (an open hand: 54 triangles a receiver and 0.70 % with 0.3 cells, 58 and 0.63 % with 0.2, 92 and 0.59 %
// with none).
constexpr double rim = 0.2;
// In cells: nor to the lines between a mask's parts. A triangle is drawn into the parts that it reaches, and
// a plane of the table is off by a little: of two triangles that meet there, neither would hold such a
// sample.
constexpr double middle = 0.3;

// Where in its cell, in [0, 1), a row or column has its samples: multiples of the golden ratio's fraction, so
// that neither neighbours nor far rows line up.
double shift_of(uint32_t line) {
    constexpr double golden = 0.61803398874989484820;
    const double turns = (line + 0.5) * golden;
    return turns - std::floor(turns);
}

struct Constant {
    double operator()(double value) const { return value; }
};

// A cell of the square, a quarter of a turn on (x to y).
void turn_cell(uint32_t side, uint32_t& x, uint32_t& y) {
    const uint32_t from = x;
    x = side - 1 - y;
    y = from;
}

// The cell that a bit has in its part before that is turned, and by how many quarters it is.
void unturned_cell(const MaskLayout& layout, uint32_t bit, uint32_t& x, uint32_t& y, uint32_t& quarters) {
    const bool turned = has_turned_parts(layout), narrow = turned && mask_parts(layout) == 4;
    const uint32_t bits = 8 * cell_bytes(layout), half_side = layout.side / 2;
    const uint32_t of_part = bit % bits, block = of_part / 16, along = layout.side / (narrow ? 8 : 4);
    x = (block % along) * 4 + of_part % 4 + (narrow ? half_side : 0);
    y = (block / along) * 4 + of_part / 4 % 4 + (turned ? half_side : 0);
    quarters = turned ? quarters_of_part(layout, bit / bits) : 0;
}

void cell_of_bit(const MaskLayout& layout, uint32_t bit, uint32_t& x, uint32_t& y) {
    uint32_t quarters;
    unturned_cell(layout, bit, x, y, quarters);
    for (; quarters; --quarters)
        turn_cell(layout.side, x, y);
}

// The integral of the 25 basis functions times cosine over pi over what each bit stands for,
// bits[bit].weights; zeros where a cell is unused. In the plane of the disk the measure is area over pi,
// whatever the map; the concentric map keeps areas (4 : pi). A cell of the disk grid stands for itself. A
// scattered sample stands for all that is nearer to it than to any other: with the cell instead, the errors
// of 1024 samples are a fifth larger (0.74 for 0.61 %, mean of seven real scenes).
void cell_weights(const MaskLayout& layout, SampleBit* bits) {
    constexpr uint32_t samples = 16;
    constexpr int window = 2; // cells that a point may be away from the one of the nearest sample
    const uint32_t side = layout.side, count = mask_bits(layout);
    const bool scattered = layout.samples == SampleMap::scattered;
    const double cell = 2.0 / side;
    const double area = (scattered ? cell * cell / 4 : cell * cell / (4 * quarter_pi)) / (samples * samples);
    for (uint32_t bit = 0; bit < count; ++bit) {
        for (double& weight : bits[bit].weights)
            weight = 0;
    }
    for (uint32_t bit = 0; bit < count; ++bit) {
        uint32_t cx, cy;
        cell_of_bit(layout, bit, cx, cy);
        for (uint32_t sample = 0; bits[bit].used && sample < samples * samples; ++sample) {
            const double u = (cx + (sample % samples + 0.5) / samples) * cell - 1,
                         v = (cy + (sample / samples + 0.5) / samples) * cell - 1;
            double d[3], basis[25];
            if (!square_to_hemisphere(layout.samples, u, v, d)) continue;
            uint32_t nearest = bit;
            double most = -1;
            for (int k = 0; scattered && k < (2 * window + 1) * (2 * window + 1); ++k) {
                const int x = int(cx) + k % (2 * window + 1) - window,
                          y = int(cy) + k / (2 * window + 1) - window;
                if (x < 0 || y < 0 || x >= int(side) || y >= int(side)) continue;
                const uint32_t other = bit_of_cell(layout, uint32_t(x), uint32_t(y));
                const double* at = bits[other].direction;
                const double cosine = d[0] * at[0] + d[1] * at[1] + d[2] * at[2];
                if (cosine > most) most = cosine, nearest = other;
            }
            sh_basis(Constant(), d[0], d[1], d[2], basis);
            for (int i = 0; i < 25; ++i)
                bits[nearest].weights[i] += basis[i] * area;
        }
    }
}

void cell_normal(const MaskLayout& layout, uint32_t cell, double n[3]) {
    const uint32_t k = layout.plane_cells;
    // The octahedral square has cells around its very rim, so that upright planes are exact but for their
    // azimuth: walls and the edges above a receiver would else lean inwards, all the same way.
    const bool to_rim = layout.planes == PlaneMap::octahedral;
    const auto place = [&](uint32_t i) { return to_rim ? 2.0 * i / (k - 1) - 1 : (i + 0.5) * 2 / k - 1; };
    const double u = place(cell % k), v = place(cell / k % k);
    if (to_rim) {
        n[0] = (u + v) / 2;
        n[1] = (u - v) / 2;
        n[2] = 1 - std::fabs(n[0]) - std::fabs(n[1]);
        return;
    }
    const uint32_t face = cell / (k * k), axis = face / 2;
    n[axis] = face % 2 ? -1 : 1;
    n[axis == 0 ? 1 : 0] = u;
    n[axis == 2 ? 1 : 2] = v;
}

} // namespace

uint32_t bit_of_cell(const MaskLayout& layout, uint32_t x, uint32_t y) {
    const bool turned = has_turned_parts(layout), narrow = turned && mask_parts(layout) == 4;
    const uint32_t side = layout.side, half_side = side / 2;
    uint32_t part = 0;
    if (turned) part = !narrow ? y >= half_side : y < half_side ? x >= half_side : 2 + (x < half_side);
    for (uint32_t back = (4 - quarters_of_part(layout, part)) % 4; back; --back)
        turn_cell(side, x, y);
    x -= narrow ? half_side : 0;
    y -= turned ? half_side : 0;
    const uint32_t along = side / (narrow ? 8 : 4);
    return part * part_bytes(layout) * 8 + (y / 4 * along + x / 4) * 16 + y % 4 * 4 + x % 4;
}

bool sample_direction(const MaskLayout& layout, uint32_t bit, double direction[3]) {
    uint32_t x, y, quarters;
    unturned_cell(layout, bit, x, y, quarters);
    double u = x + 0.5, v = y + 0.5;
    if (layout.samples == SampleMap::scattered) {
        const double first = layout.side / 2 + middle, last = layout.side - rim;
        u = std::clamp(x + shift_of(y), mask_parts(layout) == 4 ? first : rim, last);
        v = std::clamp(y + shift_of(x), first, last);
    }
    if (!square_to_hemisphere(layout.samples, 2 * u / layout.side - 1, 2 * v / layout.side - 1, direction))
        return false;
    for (; quarters; --quarters) {
        const double from = direction[0];
        direction[0] = -direction[1];
        direction[1] = from;
    }
    return true;
}

void build_plane_table(const MaskLayout& layout, uint32_t first_cell, uint32_t end_cell, uint8_t* planes) {
    // Some bits of all cells, then the next: the directions of all would fill the stack of a host's fibre.
    constexpr uint32_t bits_at_once = 128;
    const uint32_t bytes = cell_bytes(layout);
    const uint32_t begin = has_turned_parts(layout) ? mask_parts(layout) / 2 * bytes * 8 : 0;
    double directions[bits_at_once][3];
    bool used[bits_at_once];
    for (uint32_t first_bit = 0; first_bit < 8 * bytes; first_bit += bits_at_once) {
        for (uint32_t i = 0; i < bits_at_once; ++i)
            used[i] = sample_direction(layout, begin + first_bit + i, directions[i]);
        for (uint32_t cell = first_cell; cell < end_cell; ++cell) {
            double n[3];
            cell_normal(layout, cell, n);
            uint8_t* mask = planes + size_t(cell) * bytes + first_bit / 8;
            for (uint32_t byte = 0; byte < bits_at_once / 8; ++byte) {
                uint32_t value = 0;
                for (uint32_t i = 0; i < 8; ++i) {
                    const double* d = directions[byte * 8 + i];
                    const bool above = used[byte * 8 + i] && n[0] * d[0] + n[1] * d[1] + n[2] * d[2] >= 0;
                    value |= uint32_t(above) << i;
                }
                mask[byte] = uint8_t(value);
            }
        }
    }
}

void build_weights(const MaskLayout& layout, SampleBit* bits, int16_t* nibbles, int16_t* blocks,
                   int16_t* total, float* scale, float* block_weights) {
    const uint32_t block_count = mask_blocks(layout);
    for (uint32_t bit = 0; bit < mask_bits(layout); ++bit)
        bits[bit].used = sample_direction(layout, bit, bits[bit].direction);
    cell_weights(layout, bits);
    double positive[25] = {}, negative[25] = {};
    for (uint32_t bit = 0; bit < mask_bits(layout); ++bit) {
        for (int i = 0; i < 25; ++i)
            (bits[bit].weights[i] > 0 ? positive : negative)[i] += std::fabs(bits[bit].weights[i]);
    }
    // Sums of bits stay within 16 bits whatever the mask: intermediate sums may wrap, the result does not.
    double to_integer[25];
    for (int i = 0; i < 25; ++i)
        to_integer[i] = 32000.0 / (positive[i] > negative[i] ? positive[i] : negative[i]);
    for (uint32_t i = 0; i < sh_columns; ++i) {
        scale[i] = i < 25 ? float(1 / to_integer[i]) : 0.0f;
        total[i] = 0;
    }
    double block_total[25] = {};
    // Whole rows hand the remainder of their rounding on to the next: else all lean the same way, and 4096
    // bits would lose 0.8 % of the first term.
    double carry[25] = {};
    for (uint32_t block = 0; block < block_count; ++block) {
        int16_t* block_row = blocks + size_t(block) * sh_columns;
        std::memset(block_row, 0, sh_columns * sizeof(int16_t));
        double block_sum[25] = {};
        uint32_t in_use = 0;
        for (uint32_t row = 0; row < 4; ++row) {
            const SampleBit* of_row = bits + block * 16 + row * 4;
            for (uint32_t i = 0; i < 4; ++i)
                in_use += of_row[i].used;
            for (uint32_t pattern = 0; pattern < 16; ++pattern) {
                int16_t* out = nibbles + ((size_t(block) * 4 + row) * 16 + pattern) * sh_columns;
                std::memset(out, 0, sh_columns * sizeof(int16_t));
                for (int i = 0; i < 25; ++i) {
                    double sum = 0;
                    for (uint32_t bit = 0; bit < 4; ++bit)
                        sum += pattern >> bit & 1 ? of_row[bit].weights[i] : 0;
                    const double wanted = sum * to_integer[i] + (pattern == 15 ? carry[i] : 0);
                    out[i] = int16_t(std::floor(wanted + 0.5));
                    if (pattern == 15) {
                        carry[i] = wanted - out[i];
                        block_row[i] = int16_t(block_row[i] + out[i]);
                        block_sum[i] += sum;
                    }
                }
            }
        }
        float* mean = block_weights + size_t(block) * sh_columns;
        for (uint32_t i = 0; i < sh_columns; ++i) {
            mean[i] = i < 25 && in_use ? float(block_sum[i] / in_use) : 0.0f;
            total[i] = int16_t(total[i] + block_row[i]);
        }
        for (int i = 0; i < 25; ++i)
            block_total[i] += block_sum[i];
    }
    float* all = block_weights + size_t(block_count) * sh_columns;
    for (uint32_t i = 0; i < sh_columns; ++i)
        all[i] = i < 25 ? float(block_total[i]) : 0.0f;
}

uint32_t sky_level(double height) {
    uint32_t level = 0;
    for (double least = 0.70710678118654752; height < least && level + 1 < sky_levels; least /= 2)
        ++level;
    return level;
}

double sky_solid_angle(uint32_t mask_bits, uint32_t level) {
    // The middle of the level's cells, between once and twice the least.
    return 4 * quarter_pi / mask_bits * 1.4142135623730950 * (1u << level);
}

CellTables build_cell_tables(const MaskLayout& layout, const float* scale, SampleBit* samples,
                             float* memory) {
    const uint32_t bits = mask_bits(layout), blocks = mask_blocks(layout);
    float* next = memory;
    const auto take = [&next](size_t count) {
        float* part = next;
        next += count;
        return part;
    };
    auto* const bit_weights = reinterpret_cast<int16_t*>(take(size_t(bits) * sh_columns / 2));
    float* const share = take(bits);
    auto* const level = reinterpret_cast<uint32_t*>(take(bits));
    float* const direction[3] = {take(bits), take(bits), take(bits)};
    float* const block_direction[3] = {take(blocks), take(blocks), take(blocks)};
    for (uint32_t bit = 0; bit < bits; ++bit)
        samples[bit].used = sample_direction(layout, bit, samples[bit].direction);
    cell_weights(layout, samples);
    double largest = 0;
    for (uint32_t bit = 0; bit < bits; ++bit) {
        for (uint32_t i = 0; i < 25; ++i)
            largest = std::max(largest, std::fabs(samples[bit].weights[i]) / double(scale[i]));
    }
    double units = 1; // of 16 bits
    while (2 * units * largest < 32767)
        units *= 2;
    // Of what a bit or a block stands for, the middle: the first band is the mean direction, times a
    // constant. A sample that lies aside would be a worse place to know a BRDF or a light.
    const auto middle_of = [](const double sum[3], uint32_t k) {
        const double length = std::sqrt(sum[0] * sum[0] + sum[1] * sum[1] + sum[2] * sum[2]);
        return float(length > 0 ? sum[k] / length : k == 2 ? 1.0 : 0.0);
    };
    for (uint32_t block = 0; block < blocks; ++block) {
        double mean[3] = {};
        for (uint32_t bit = block * 16; bit < block * 16 + 16; ++bit) {
            const double* w = samples[bit].weights;
            const double own[3] = {w[3], w[1], w[2]};
            for (uint32_t k = 0; k < 3; ++k) {
                direction[k][bit] = middle_of(own, k);
                mean[k] += own[k];
            }
            share[bit] = float(w[0] / double(open_first));
            level[bit] = samples[bit].used ? sky_level(double(direction[2][bit])) : sky_levels;
            for (uint32_t i = 0; i < sh_columns; ++i) {
                const double value = i < 25 ? w[i] / double(scale[i]) * units : 0.0;
                bit_weights[(size_t(bit / 2) * sh_columns + i) * 2 + bit % 2] =
                    int16_t(std::floor(value + 0.5));
            }
        }
        for (uint32_t k = 0; k < 3; ++k)
            block_direction[k][block] = middle_of(mean, k);
    }
    return {{direction[0], direction[1], direction[2]},
            {block_direction[0], block_direction[1], block_direction[2]},
            bit_weights,
            share,
            level,
            sharpest_alpha(bits),
            float(1 / units)};
}

float horizon_tangent(const MaskLayout& layout) {
    double lowest = 1;
    for (uint32_t bit = 0; bit < mask_bits(layout); ++bit) {
        double d[3];
        if (sample_direction(layout, bit, d) && d[2] / std::sqrt(1 - d[2] * d[2]) < lowest)
            lowest = d[2] / std::sqrt(1 - d[2] * d[2]);
    }
    // Half a cell of the table turns a plane by less than this.
    const double table_error = 2.5 / (layout.plane_cells - 1);
    return float(lowest > table_error ? lowest - table_error : 0.0);
}

} // namespace nusselt::kernels
