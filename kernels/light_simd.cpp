// The light kernels for SSE4, AVX2 and AVX-512, or NEON: one source, bit for bit equal to
// light_reference.cpp.
#include "kernels/reflection_parts.h"
#include "kernels/simd.h"

#include <cstring>

#define HWY_WANT_SSE4 1
#if defined(__aarch64__)
#define HWY_COMPILE_ONLY_STATIC // NEON alone: the vectors of SVE have no size
#endif
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "kernels/light_simd.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace nusselt::kernels {
namespace HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;

using Float = hn::CappedTag<float, lanes>;
using Word = hn::RebindToUnsigned<Float>;
using Int = hn::RebindToSigned<Float>;
using V = hn::Vec<Float>;

constexpr Float df;
constexpr Word du;
constexpr Int di;
constexpr uint32_t width = hn::MaxLanes(Float()); // lanes of a chunk

HWY_INLINE V constant(float value) {
    return hn::Set(df, value);
}
HWY_INLINE V load(const float* row, uint32_t lane) {
    return hn::Load(df, row + lane);
}

void shade_batch(const float light[75], const float transfer[3][25][lanes], float rgb[3][lanes]) {
    for (uint32_t c = 0; c < 3; ++c) {
        for (uint32_t lane = 0; lane < lanes; lane += width) {
            V sum = hn::Zero(df);
            for (uint32_t i = 0; i < 25; ++i)
                sum = hn::Add(sum, hn::Mul(constant(light[i * 3 + c]), load(transfer[c][i], lane)));
            hn::Store(sum, df, rgb[c] + lane);
        }
    }
}

// As in light_reference.cpp; lanes are directions here.
HWY_INLINE V phong_lobe(const Reflection& r, V x, V y, V z) {
    const V aside = hn::Add(hn::Mul(constant(r.view[0]), x), hn::Mul(constant(r.view[1]), y));
    const V along = hn::Mul(constant(r.view[2]), z);
    V power = constant(1.0f), square = hn::Max(hn::Sub(along, aside), hn::Zero(df));
    for (uint32_t e = r.exponent; e; e >>= 1) {
        if (e & 1) power = hn::Mul(power, square);
        square = hn::Mul(square, square);
    }
    return hn::Mul(constant(0.5f * (float(r.exponent) + 2.0f)), power);
}

struct GgxLobe {
    V glitter, edge;
};
HWY_INLINE GgxLobe ggx_lobe(const Reflection& r, V x, V y, V z) {
    const V vx = constant(r.view[0]), vy = constant(r.view[1]), vz = constant(r.view[2]);
    const V aside = hn::Add(hn::Mul(vx, x), hn::Mul(vy, y)), along = hn::Mul(vz, z);
    const float square = r.alpha * r.alpha, rest = 1.0f - square;
    const float view_side =
        r.view[2] + hn::GetLane(hn::Sqrt(constant(square + rest * (r.view[2] * r.view[2]))));
    const V two = constant(2.0f);
    const V q = hn::Add(two, hn::Mul(two, hn::Add(aside, along)));
    const V s = hn::Add(z, vz);
    const V a = hn::Sub(q, hn::Mul(hn::Mul(s, s), constant(rest)));
    const V light_side =
        hn::Add(z, hn::Sqrt(hn::Add(constant(square), hn::Mul(constant(rest), hn::Mul(z, z)))));
    const V glitter =
        hn::Div(hn::Mul(constant(square / view_side), hn::Mul(q, q)), hn::Mul(hn::Mul(a, a), light_side));
    const V t = hn::Sub(constant(1.0f), hn::Mul(constant(0.5f), hn::Sqrt(q)));
    return {glitter, hn::Mul(hn::Mul(hn::Mul(t, t), hn::Mul(t, t)), t)};
}

HWY_INLINE V with_fresnel(const GgxLobe& lobe, float specular) {
    return hn::Mul(lobe.glitter, hn::Add(constant(specular), hn::Mul(constant(1.0f - specular), lobe.edge)));
}

HWY_INLINE void respond(const Reflection& r, V x, V y, V z, V out[3]) {
    if (r.lobe == Lobe::phong) {
        const V lobe = phong_lobe(r, x, y, z);
        for (uint32_t c = 0; c < 3; ++c)
            out[c] = hn::Mul(constant(r.specular[c]), lobe);
        return;
    }
    const GgxLobe lobe = ggx_lobe(r, x, y, z);
    for (uint32_t c = 0; c < 3; ++c)
        out[c] = hn::Sub(with_fresnel(lobe, r.specular[c]), hn::Mul(constant(r.diffuse[c]), lobe.edge));
}

HWY_INLINE void fields_at(const Reflection& r, Parts kind, V x, V y, V z, V out[3]) {
    if (kind == Parts::power) {
        out[0] = phong_lobe(r, x, y, z);
        return;
    }
    const GgxLobe lobe = ggx_lobe(r, x, y, z);
    switch (kind) {
    case Parts::whole:
        out[0] = hn::Sub(with_fresnel(lobe, r.specular[0]), hn::Mul(constant(r.diffuse[0]), lobe.edge));
        break;
    case Parts::plastic:
        out[0] = with_fresnel(lobe, r.specular[0]);
        out[1] = lobe.edge;
        break;
    default:
        out[0] = hn::Mul(lobe.glitter, hn::Sub(constant(1.0f), lobe.edge));
        out[1] = hn::Mul(lobe.glitter, lobe.edge);
        out[2] = lobe.edge;
    }
}

constexpr uint32_t column_registers = sh_columns / width;

HWY_INLINE V from_integers(const int16_t* row) {
    const hn::Rebind<int16_t, Float> narrow;
    return hn::ConvertTo(df, hn::PromoteTo(di, hn::Load(narrow, row)));
}

template<uint32_t fields>
struct Sums {
    V column[fields][column_registers];

    HWY_INLINE Sums() {
        for (auto& field : column) {
            for (V& v : field)
                v = hn::Zero(df);
        }
    }
    // += each field times the row.
    HWY_INLINE void add(const float field[3][lanes], uint32_t at, const V row[column_registers]) {
        for (uint32_t f = 0; f < fields; ++f) {
            const V factor = constant(field[f][at]);
            for (uint32_t i = 0; i < column_registers; ++i)
                column[f][i] = hn::Add(column[f][i], hn::Mul(factor, row[i]));
        }
    }
};

// The open part of a block, in the unit of the integer tables.
HWY_INLINE void open_row(const Tables& tables, uint32_t block, uint32_t blocked, V row[column_registers]) {
    const int16_t* full = tables.blocks + size_t(block) * sh_columns;
    if (blocked == 0) {
        for (uint32_t i = 0; i < column_registers; ++i)
            row[i] = from_integers(full + i * width);
        return;
    }
    const hn::CappedTag<int16_t, sh_columns> d;
    constexpr uint32_t step = hn::MaxLanes(hn::CappedTag<int16_t, sh_columns>());
    alignas(64) int16_t open[sh_columns];
    const int16_t* rows = tables.nibbles + size_t(block) * 4 * 16 * sh_columns;
    for (uint32_t i = 0; i < sh_columns; i += step) {
        auto rest = hn::Load(d, full + i);
        for (uint32_t k = 0; k < 4; ++k)
            rest = hn::Sub(rest, hn::Load(d, rows + (k * 16 + (blocked >> (4 * k) & 15)) * sh_columns + i));
        hn::Store(rest, d, open + i);
    }
    for (uint32_t i = 0; i < column_registers; ++i)
        row[i] = from_integers(open + i * width);
}

// A block in the core of the lobe, bit by bit.
template<uint32_t fields>
HWY_INLINE void add_core(const CellTables& cells, uint32_t block, uint32_t blocked, const Reflection& r,
                         Parts kind, Sums<fields>& even, Sums<fields>& odd) {
    alignas(64) float field[3][lanes];
    for (uint32_t k = 0; k < lanes; k += width) {
        V out[3];
        const uint32_t bit = block * 16 + k;
        fields_at(r, kind, load(cells.bit_direction[0], bit), load(cells.bit_direction[1], bit),
                  load(cells.bit_direction[2], bit), out);
        for (uint32_t f = 0; f < fields; ++f)
            hn::Store(out[f], df, field[f] + k);
    }
    const float* weights = cells.bit_weights + size_t(block) * 16 * sh_columns;
    V row[column_registers];
    for (uint32_t k = 0; k < 16; k += 2, weights += 2 * sh_columns) {
        if (!(blocked >> k & 1)) {
            for (uint32_t j = 0; j < column_registers; ++j)
                row[j] = hn::Load(df, weights + j * width);
            even.add(field, k, row);
        }
        if (!(blocked >> k & 2)) {
            for (uint32_t j = 0; j < column_registers; ++j)
                row[j] = hn::Load(df, weights + sh_columns + j * width);
            odd.add(field, k + 1, row);
        }
    }
}

template<uint32_t fields>
void integrate_lane(const Tables& tables, const CellTables& cells, const uint8_t* mask, const Reflection& r,
                    Parts kind, float sum[3][sh_columns]) {
    constexpr uint32_t group = lanes; // blocks whose BRDF is found together
    alignas(64) float field[3][group], along[group];
    const V vx = constant(r.view[0]), vy = constant(r.view[1]), vz = constant(r.view[2]);
    Sums<fields> even, odd; // bits or blocks: two chains of additions
    for (uint32_t first = 0; first < mask_blocks(tables.layout); first += group) {
        for (uint32_t i = 0; i < group; i += width) {
            const V x = load(cells.block_direction[0], first + i),
                    y = load(cells.block_direction[1], first + i),
                    z = load(cells.block_direction[2], first + i);
            V out[3];
            fields_at(r, kind, x, y, z, out);
            for (uint32_t f = 0; f < fields; ++f)
                hn::Store(out[f], df, field[f] + i);
            hn::Store(hn::Sub(hn::Mul(vz, z), hn::Add(hn::Mul(vx, x), hn::Mul(vy, y))), df, along + i);
        }
        for (uint32_t i = 0; i < group; i += 2) {
            uint16_t blocked[2];
            std::memcpy(blocked, mask + size_t(2) * (first + i), 4);
            V row[column_registers];
            if (blocked[0] != 0xFFFF) {
                if (along[i] > r.core) {
                    add_core(cells, first + i, blocked[0], r, kind, even, odd);
                } else {
                    open_row(tables, first + i, blocked[0], row);
                    even.add(field, i, row);
                }
            }
            if (blocked[1] != 0xFFFF) {
                if (along[i + 1] > r.core) {
                    add_core(cells, first + i + 1, blocked[1], r, kind, even, odd);
                } else {
                    open_row(tables, first + i + 1, blocked[1], row);
                    odd.add(field, i + 1, row);
                }
            }
        }
    }
    for (uint32_t f = 0; f < fields; ++f) {
        for (uint32_t i = 0; i < column_registers; ++i)
            hn::Store(hn::Add(even.column[f][i], odd.column[f][i]), df, sum[f] + i * width);
    }
}

void integrate_glossy(const Tables& tables, const CellTables& cells, const uint8_t* masks, uint32_t valid,
                      const Reflection reflections[lanes], uint32_t channels,
                      const float diffuse_local[25][lanes], float local[][25][lanes]) {
    constexpr decltype(&integrate_lane<1>) by_fields[] = {integrate_lane<1>, integrate_lane<2>,
                                                          integrate_lane<3>};
    for (uint32_t lane = 0; lane < lanes; ++lane) {
        const Reflection& r = reflections[lane];
        const ReflectionParts parts = parts_of(r, channels);
        alignas(64) float sum[3][sh_columns];
        const bool present = valid >> lane & 1;
        if (present)
            by_fields[parts.fields - 1](tables, cells, masks + size_t(lane) * mask_bytes(tables.layout), r,
                                        parts.kind, sum);
        for (uint32_t c = 0; c < channels; ++c) {
            alignas(64) float glossy[sh_columns];
            for (uint32_t i = 0; i < sh_columns && present; i += width) {
                V all = hn::Zero(df);
                for (uint32_t f = 0; f < parts.fields; ++f)
                    all = hn::Add(all, hn::Mul(constant(parts.factor[f][c]), load(sum[f], i)));
                hn::Store(hn::Mul(all, load(tables.scale, i)), df, glossy + i);
            }
            for (uint32_t i = 0; i < 25; ++i)
                local[c][i][lane] = present ? r.diffuse[c] * diffuse_local[i][lane] + glossy[i] : 0.0f;
        }
    }
}

// As in light_reference.cpp, of `width` cells.
HWY_INLINE hn::Vec<Word> texels_of(const SkyMap& sky, const uint32_t* level, V x, V y, V z) {
    alignas(64) float sizes[lanes];
    alignas(64) uint32_t begins[lanes], along_side[lanes];
    for (uint32_t k = 0; k < width; ++k) {
        const uint32_t l = level[k] < sky_levels ? level[k] : 0;
        sizes[k] = float(sky.size[l]);
        along_side[k] = sky.size[l];
        begins[k] = sky.begin[l];
    }
    const V zero = hn::Zero(df), one = constant(1.0f);
    const V sum = hn::Add(hn::Add(hn::Abs(x), hn::Abs(y)), hn::Abs(z));
    V u = hn::Div(x, sum), v = hn::Div(y, sum);
    const auto below = hn::Lt(z, zero);
    const V across = hn::Sub(one, hn::Abs(v)), along = hn::Sub(one, hn::Abs(u));
    const V folded_u = hn::IfThenElse(hn::Lt(u, zero), hn::Neg(across), across);
    const V folded_v = hn::IfThenElse(hn::Lt(v, zero), hn::Neg(along), along);
    u = hn::IfThenElse(below, folded_u, u);
    v = hn::IfThenElse(below, folded_v, v);
    const V size = hn::Load(df, sizes), half = hn::Mul(constant(0.5f), size), top = hn::Sub(size, one);
    const auto cell = [&](V at) HWY_ATTR {
        const V place = hn::Add(hn::Mul(at, half), half);
        return hn::BitCast(du, hn::ConvertTo(di, hn::Min(hn::Max(place, zero), top)));
    };
    return hn::Add(hn::Load(du, begins), hn::Add(hn::Mul(cell(v), hn::Load(du, along_side)), cell(u)));
}

void integrate_sky(const Tables& tables, const CellTables& cells, const SkyMap& sky, const Batch& batch,
                   const uint8_t* masks, const Reflection* reflections, float rgb[3][lanes]) {
    // Registers of four hold a colour, as the map does.
    const hn::CappedTag<float, 4> d4;
    for (uint32_t lane = 0; lane < lanes; ++lane) {
        rgb[0][lane] = rgb[1][lane] = rgb[2][lane] = 0;
        if (!(batch.valid >> lane & 1)) continue;
        const uint8_t* mask = masks + size_t(lane) * mask_bytes(tables.layout);
        auto sum0 = hn::Zero(d4), sum1 = sum0, sum2 = sum0, sum3 = sum0;
        for (uint32_t block = 0; block < mask_blocks(tables.layout); ++block) {
            uint16_t blocked;
            std::memcpy(&blocked, mask + size_t(2) * block, 2);
            if (blocked == 0xFFFF) continue;
            alignas(64) uint32_t texel[lanes];
            alignas(64) float factor[lanes][4]; // share times pi f_r
            for (uint32_t k = 0; k < lanes; k += width) {
                const uint32_t bit = block * 16 + k;
                const V lx = load(cells.bit_direction[0], bit), ly = load(cells.bit_direction[1], bit),
                        lz = load(cells.bit_direction[2], bit);
                const auto world = [&](uint32_t axis) HWY_ATTR {
                    return hn::Add(hn::Add(hn::Mul(constant(batch.axis[0][axis][lane]), lx),
                                           hn::Mul(constant(batch.axis[1][axis][lane]), ly)),
                                   hn::Mul(constant(batch.axis[2][axis][lane]), lz));
                };
                hn::Store(texels_of(sky, cells.level + bit, world(0), world(1), world(2)), du, texel + k);
                if (!reflections) continue;
                V out[3];
                alignas(64) float values[3][lanes];
                respond(reflections[lane], lx, ly, lz, out);
                for (uint32_t c = 0; c < 3; ++c)
                    hn::Store(hn::Mul(load(cells.share, bit),
                                      hn::Add(out[c], constant(reflections[lane].diffuse[c]))),
                              df, values[c]);
                for (uint32_t i = 0; i < width; ++i) {
                    for (uint32_t c = 0; c < 4; ++c)
                        factor[k + i][c] = c < 3 ? values[c][i] : 0.0f;
                }
            }
            const auto add = [&](auto& sum, uint32_t k) HWY_ATTR {
                if ((blocked >> k & 1) || cells.level[block * 16 + k] == sky_levels) return;
                const auto colour = hn::Load(d4, sky.texels + 4 * size_t(texel[k]));
                const auto own =
                    reflections ? hn::Load(d4, factor[k]) : hn::Set(d4, cells.share[block * 16 + k]);
                sum = hn::Add(sum, hn::Mul(own, colour));
            };
            for (uint32_t k = 0; k < lanes; k += 4) {
                add(sum0, k);
                add(sum1, k + 1);
                add(sum2, k + 2);
                add(sum3, k + 3);
            }
        }
        const auto total = hn::Add(hn::Add(sum0, sum1), hn::Add(sum2, sum3));
        alignas(16) float colour[4];
        hn::Store(total, d4, colour);
        for (uint32_t c = 0; c < 3; ++c)
            rgb[c][lane] = colour[c];
    }
}

void add_hidden(const float* products, const uint8_t* counts, uint32_t blocks, float* hidden) {
    constexpr uint32_t registers = 7; // at a time; their columns of all blocks before the next ones
    static_assert(product_stride % (registers * width) == 0);
    for (uint32_t first = 0; first < product_stride; first += registers * width) {
        V sum[registers];
        for (uint32_t i = 0; i < registers; ++i)
            sum[i] = load(hidden, first + i * width);
        for (uint32_t block = 0; block < blocks; ++block) {
            if (counts[block] == 0) continue;
            const V count = constant(float(counts[block]));
            const float* row = products + size_t(block) * product_stride + first;
            for (uint32_t i = 0; i < registers; ++i)
                sum[i] = hn::Add(sum[i], hn::Mul(count, load(row, i * width)));
        }
        for (uint32_t i = 0; i < registers; ++i)
            hn::Store(sum[i], df, hidden + first + i * width);
    }
}

void multiply_transfer(const float matrix[25][25], const float transfer[25][lanes], float out[25][lanes]) {
    constexpr uint32_t rows = 5; // that share a load, and are as many chains of additions
    for (uint32_t lane = 0; lane < lanes; lane += width) {
        for (uint32_t first = 0; first < 25; first += rows) {
            V sum[rows];
            for (V& s : sum)
                s = hn::Zero(df);
            for (uint32_t j = 0; j < 25; ++j) {
                const V value = load(transfer[j], lane);
                for (uint32_t i = 0; i < rows; ++i)
                    sum[i] = hn::Add(sum[i], hn::Mul(constant(matrix[first + i][j]), value));
            }
            for (uint32_t i = 0; i < rows; ++i)
                hn::Store(sum[i], df, out[first + i] + lane);
        }
    }
}

} // namespace

const LightKernels table = {shade_batch, integrate_glossy, integrate_sky, add_hidden, multiply_transfer};

} // namespace HWY_NAMESPACE
} // namespace nusselt::kernels
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace nusselt::kernels {

const LightKernels* simd_light_kernels(Set set) {
#include "kernels/simd_sets.inl"
}

} // namespace nusselt::kernels
#endif
