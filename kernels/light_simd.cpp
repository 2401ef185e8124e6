// The light kernels for SSE4, AVX2 and AVX-512, or NEON: one source, bit for bit equal to
// light_reference.cpp.
#include "kernels/reflection_parts.h"
#include "kernels/simd.h"

#include <algorithm>
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

#include "kernels/classify_blocks.inl"

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
HWY_INLINE hn::Mask<Float> mask_of(uint32_t bits) {
    const uint8_t bytes[8] = {uint8_t(bits), uint8_t(bits >> 8)};
    return hn::LoadMaskBits(df, bytes);
}
HWY_INLINE uint64_t bits_of(hn::Mask<Float> mask) {
    uint8_t bytes[8] = {};
    hn::StoreMaskBits(df, mask, bytes);
    return uint64_t(bytes[0]) | uint64_t(bytes[1]) << 8;
}
// As in light_reference.cpp.
HWY_INLINE hn::Vec<Int> levels_of(V value, V inverse, int bits) {
    const int32_t middle = 1 << bits;
    const V above = hn::Add(hn::Mul(value, inverse), constant(float(middle) + 0.5f));
    return hn::Min(hn::Sub(hn::ConvertTo(di, above), hn::Set(di, middle)), hn::Set(di, middle - 1));
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

// What a GGX lobe has of its view alone: a root and a division less for each direction.
struct GgxView {
    float square, rest, peak;
};
HWY_INLINE GgxView ggx_view(const Reflection& r) {
    const hn::CappedTag<float, 1> one;
    const float square = r.alpha * r.alpha, rest = 1.0f - square;
    const float inner = square + rest * (r.view[2] * r.view[2]);
    return {square, rest, square / (r.view[2] + hn::GetLane(hn::Sqrt(hn::Set(one, inner))))};
}

struct GgxLobe {
    V glitter, edge;
};
HWY_INLINE GgxLobe ggx_lobe(const Reflection& r, const GgxView& view, V x, V y, V z) {
    const V vx = constant(r.view[0]), vy = constant(r.view[1]), vz = constant(r.view[2]);
    const V aside = hn::Add(hn::Mul(vx, x), hn::Mul(vy, y)), along = hn::Mul(vz, z);
    const V two = constant(2.0f), rest = constant(view.rest);
    const V q = hn::Add(two, hn::Mul(two, hn::Add(aside, along)));
    const V s = hn::Add(z, vz);
    const V a = hn::Sub(q, hn::Mul(hn::Mul(s, s), rest));
    const V light_side = hn::Add(z, hn::Sqrt(hn::Add(constant(view.square), hn::Mul(rest, hn::Mul(z, z)))));
    const V glitter =
        hn::Div(hn::Mul(constant(view.peak), hn::Mul(q, q)), hn::Mul(hn::Mul(a, a), light_side));
    const V t = hn::Sub(constant(1.0f), hn::Mul(constant(0.5f), hn::Sqrt(q)));
    return {glitter, hn::Mul(hn::Mul(hn::Mul(t, t), hn::Mul(t, t)), t)};
}

HWY_INLINE V with_fresnel(const GgxLobe& lobe, float specular) {
    return hn::Mul(lobe.glitter, hn::Add(constant(specular), hn::Mul(constant(1.0f - specular), lobe.edge)));
}

HWY_INLINE void respond(const Reflection& r, const GgxView& view, V x, V y, V z, V out[3]) {
    if (r.lobe == Lobe::none) {
        out[0] = out[1] = out[2] = hn::Zero(df);
        return;
    }
    if (r.lobe == Lobe::phong) {
        const V lobe = phong_lobe(r, x, y, z);
        for (uint32_t c = 0; c < 3; ++c)
            out[c] = hn::Mul(constant(r.specular[c]), lobe);
        return;
    }
    const GgxLobe lobe = ggx_lobe(r, view, x, y, z);
    for (uint32_t c = 0; c < 3; ++c)
        out[c] = hn::Sub(with_fresnel(lobe, r.specular[c]), hn::Mul(constant(r.diffuse[c]), lobe.edge));
}

template<Parts kind>
HWY_INLINE void fields_at(const Reflection& r, const GgxView& view, V x, V y, V z, V out[fields_of(kind)]) {
    if constexpr (kind == Parts::power) {
        out[0] = phong_lobe(r, x, y, z);
        return;
    } else {
        const GgxLobe lobe = ggx_lobe(r, view, x, y, z);
        if constexpr (kind == Parts::whole) {
            out[0] = hn::Sub(with_fresnel(lobe, r.specular[0]), hn::Mul(constant(r.diffuse[0]), lobe.edge));
        } else if constexpr (kind == Parts::plastic) {
            out[0] = with_fresnel(lobe, r.specular[0]);
            out[1] = lobe.edge;
        } else {
            out[0] = hn::Mul(lobe.glitter, hn::Sub(constant(1.0f), lobe.edge));
            out[1] = hn::Mul(lobe.glitter, lobe.edge);
            if constexpr (kind == Parts::mixed) out[2] = lobe.edge;
        }
    }
}

constexpr uint32_t most_blocks = mask_blocks(fine_layout);

using Short = hn::CappedTag<int16_t, sh_columns>;
constexpr Short d16;
constexpr uint32_t short_width = hn::MaxLanes(Short());
using Shorts = hn::Vec<Short>;
using Sum = hn::RepartitionToWide<Short>;
constexpr Sum d32;
using Sums = hn::Vec<Sum>;

// sum + the sums of neighbours' products.
HWY_INLINE Sums add_products(Sums sum, Shorts a, Shorts b) {
#if HWY_ARCH_X86
    Sums none = hn::Zero(d32);
    return hn::ReorderWidenMulAccumulate(d32, a, b, sum, none);
#else
    const auto even = [](Shorts v)
                          HWY_ATTR { return hn::ShiftRight<16>(hn::ShiftLeft<16>(hn::BitCast(d32, v))); };
    const auto odd = [](Shorts v) HWY_ATTR { return hn::ShiftRight<16>(hn::BitCast(d32, v)); };
    return hn::Add(sum, hn::Add(hn::Mul(even(a), even(b)), hn::Mul(odd(a), odd(b))));
#endif
}

// Two factors, for neighbours in every pair.
HWY_INLINE Shorts both(int16_t first, int16_t second) {
    return hn::BitCast(d16,
                       hn::Set(d32, int32_t(uint32_t(uint16_t(first)) | uint32_t(uint16_t(second)) << 16)));
}

// The greatest lane of each field's magnitudes, as a unit.
template<uint32_t fields>
HWY_INLINE void find_levels(const V largest[fields], int bits, LevelUnit level[3]) {
    for (uint32_t f = 0; f < fields; ++f)
        level[f] = level_unit(hn::GetLane(hn::MaxOfLanes(df, largest[f])), bits);
}

// The fields at the blocks' middles, nothing in the core.
struct BlockFields {
    alignas(64) float value[3][most_blocks];
    alignas(64) int16_t factor[3][most_blocks]; // the same in the level's unit
    LevelUnit level[3];
    uint64_t core[most_blocks / 64], any[most_blocks / 64]; // any: some factor is not zero
};

template<Parts kind>
HWY_INLINE void find_fields(const CellTables& cells, uint32_t blocks, const Reflection& r,
                            const GgxView& view, BlockFields& out) {
    constexpr uint32_t fields = fields_of(kind);
    const V vx = constant(r.view[0]), vy = constant(r.view[1]), vz = constant(r.view[2]);
    V largest[fields];
    for (V& v : largest)
        v = hn::Zero(df);
    std::memset(out.core, 0, sizeof(out.core));
    for (uint32_t first = 0; first < blocks; first += width) {
        const V x = load(cells.block_direction[0], first), y = load(cells.block_direction[1], first),
                z = load(cells.block_direction[2], first);
        const auto core =
            hn::Gt(hn::Sub(hn::Mul(vz, z), hn::Add(hn::Mul(vx, x), hn::Mul(vy, y))), constant(r.core));
        V value[fields];
        fields_at<kind>(r, view, x, y, z, value);
        for (uint32_t f = 0; f < fields; ++f) {
            value[f] = hn::IfThenZeroElse(core, value[f]);
            largest[f] = hn::Max(largest[f], hn::Abs(value[f]));
            hn::Store(value[f], df, out.value[f] + first);
        }
        out.core[first / 64] |= bits_of(core) << first % 64;
    }
    find_levels<fields>(largest, block_levels, out.level);
}

template<uint32_t fields>
HWY_INLINE void find_factors(uint32_t blocks, BlockFields& at) {
    const hn::Rebind<int16_t, Float> narrow;
    std::memset(at.any, 0, sizeof(at.any));
    for (uint32_t first = 0; first < blocks; first += width) {
        auto all = hn::Zero(di);
        for (uint32_t f = 0; f < fields; ++f) {
            const auto factor =
                levels_of(load(at.value[f], first), constant(at.level[f].inverse), block_levels);
            all = hn::Or(all, factor);
            hn::Store(hn::DemoteTo(narrow, factor), narrow, at.factor[f] + first);
        }
        at.any[first / 64] |= bits_of(hn::RebindMask(df, hn::Ne(all, hn::Zero(di)))) << first % 64;
    }
}

// Calls add(block, other) for pairs of those in the set; the last one's other may be itself.
template<class Add>
HWY_INLINE void each_pair(const uint64_t* set, uint32_t blocks, const Add& add) {
    for (uint32_t first = 0; first < blocks; first += 64) {
        for (uint64_t rest = set[first / 64]; rest;) {
            const uint32_t block = first + uint32_t(__builtin_ctzll(rest));
            rest &= rest - 1;
            const uint32_t other = rest ? first + uint32_t(__builtin_ctzll(rest)) : block;
            rest &= rest - 1;
            add(block, other);
        }
    }
}

// What fields have by blocks, wholly open ones and others: sums[field][column].
template<uint32_t fields>
HWY_INLINE void add_blocks(const Tables& tables, const uint8_t* mask, const BlockFields& at,
                           const uint64_t* open, const uint64_t* partial, int32_t sums[3][sh_columns]) {
    const uint32_t blocks = mask_blocks(tables.layout);
    for (uint32_t column = 0; column < sh_columns; column += short_width) {
        Sums lower[fields], upper[fields];
        for (uint32_t f = 0; f < fields; ++f)
            lower[f] = upper[f] = hn::Zero(d32);
        const auto add = [&](uint32_t block, Shorts a, uint32_t other, Shorts b) HWY_ATTR {
            const Shorts low = hn::InterleaveLower(d16, a, b), high = hn::InterleaveUpper(d16, a, b);
            for (uint32_t f = 0; f < fields; ++f) {
                const int16_t second = other != block ? at.factor[f][other] : int16_t(0);
                const Shorts factors = both(at.factor[f][block], second);
                lower[f] = add_products(lower[f], low, factors);
                upper[f] = add_products(upper[f], high, factors);
            }
        };
        const auto whole = [&](uint32_t block) HWY_ATTR {
            return hn::Load(d16, tables.blocks + size_t(block) * sh_columns + column);
        };
        const auto part = [&](uint32_t block) HWY_ATTR {
            uint16_t blocked;
            std::memcpy(&blocked, mask + size_t(2) * block, 2);
            const int16_t* rows = tables.nibbles + size_t(block) * 4 * 16 * sh_columns + column;
            Shorts rest = whole(block);
            for (uint32_t k = 0; k < 4; ++k)
                rest = hn::Sub(rest, hn::Load(d16, rows + (k * 16 + (blocked >> (4 * k) & 15)) * sh_columns));
            return rest;
        };
        each_pair(open, blocks, [&](uint32_t block, uint32_t other) HWY_ATTR {
            add(block, whole(block), other, whole(other));
        });
        each_pair(partial, blocks, [&](uint32_t block, uint32_t other) HWY_ATTR {
            add(block, part(block), other, part(other));
        });
        // Interleaving works within 128 bits: back to the order of the columns, four at a time.
        const hn::Full128<int32_t> four;
        for (uint32_t f = 0; f < fields; ++f) {
            alignas(64) int32_t low[short_width / 2], high[short_width / 2];
            hn::Store(lower[f], d32, low);
            hn::Store(upper[f], d32, high);
            for (uint32_t i = 0; i < short_width / 8; ++i) {
                hn::Store(hn::Load(four, low + 4 * i), four, sums[f] + column + 8 * i);
                hn::Store(hn::Load(four, high + 4 * i), four, sums[f] + column + 8 * i + 4);
            }
        }
    }
}

constexpr uint32_t sum_registers = 2 * sh_columns / short_width;
constexpr hn::RebindToFloat<Sum> as_float;
using FieldSums = hn::Vec<hn::RebindToFloat<Sum>>[sum_registers];

// Some blocks of the core, bit by bit.
template<Parts kind>
HWY_INLINE void add_core(const CellTables& cells, const uint8_t* mask, const Reflection& r,
                         const GgxView& view, const uint16_t* blocks, uint32_t count,
                         FieldSums sums[fields_of(kind)]) {
    constexpr uint32_t fields = fields_of(kind);
    alignas(64) float value[fields][core_group][lanes];
    V largest[fields];
    for (V& v : largest)
        v = hn::Zero(df);
    for (uint32_t i = 0; i < count; ++i) {
        uint16_t blocked;
        std::memcpy(&blocked, mask + size_t(2) * blocks[i], 2);
        for (uint32_t k = 0; k < lanes; k += width) {
            const uint32_t bit = blocks[i] * 16u + k;
            V own[fields];
            fields_at<kind>(r, view, load(cells.bit_direction[0], bit), load(cells.bit_direction[1], bit),
                            load(cells.bit_direction[2], bit), own);
            for (uint32_t f = 0; f < fields; ++f) {
                const V open = hn::IfThenZeroElse(mask_of(uint32_t(blocked) >> k), own[f]);
                largest[f] = hn::Max(largest[f], hn::Abs(open));
                hn::Store(open, df, value[f][i] + k);
            }
        }
    }
    LevelUnit level[3];
    find_levels<fields>(largest, bit_levels, level);
    const hn::Rebind<int16_t, Float> narrow;
    for (uint32_t i = 0; i < count; ++i) {
        const int16_t* weights = cells.bit_weights + size_t(blocks[i]) * 16 * sh_columns;
        for (uint32_t f = 0; f < fields; ++f) {
            alignas(64) int32_t pairs[lanes / 2];
            for (uint32_t k = 0; k < lanes; k += width) {
                const auto levels = levels_of(load(value[f][i], k), constant(level[f].inverse), bit_levels);
                hn::Store(hn::DemoteTo(narrow, levels), narrow, reinterpret_cast<int16_t*>(pairs) + k);
            }
            Sums sum[sum_registers];
            for (Sums& v : sum)
                v = hn::Zero(d32);
            for (uint32_t k = 0; k < lanes / 2; ++k) {
                const Shorts factors = hn::BitCast(d16, hn::Set(d32, pairs[k]));
                for (uint32_t j = 0; j < sum_registers; ++j)
                    sum[j] = add_products(
                        sum[j], hn::Load(d16, weights + 2 * k * sh_columns + j * short_width), factors);
            }
            const auto unit = hn::Set(as_float, level[f].unit * cells.bit_unit);
            for (uint32_t j = 0; j < sum_registers; ++j)
                sums[f][j] = hn::Add(sums[f][j], hn::Mul(unit, hn::ConvertTo(as_float, sum[j])));
        }
    }
}

template<Parts kind>
void integrate_lane(const Tables& tables, const CellTables& cells, const uint8_t* mask, const Reflection& r,
                    float sum[3][sh_columns]) {
    constexpr uint32_t fields = fields_of(kind);
    const uint32_t blocks = mask_blocks(tables.layout);
    const GgxView view = ggx_view(r);
    BlockFields at;
    find_fields<kind>(cells, blocks, r, view, at);
    uint64_t full[most_blocks / 64], open[most_blocks / 64], partial[most_blocks / 64];
    uint16_t in_core[most_blocks];
    uint32_t core_count = 0;
    for (uint32_t i = 0; i < blocks / 64; ++i) {
        classify_blocks(mask + 128 * i, full[i], open[i]);
        for (uint64_t rest = at.core[i] & ~full[i]; rest; rest &= rest - 1)
            in_core[core_count++] = uint16_t(64 * i + uint32_t(__builtin_ctzll(rest)));
    }
    FieldSums sums[fields];
    for (auto& field : sums) {
        for (auto& v : field)
            v = hn::Zero(as_float);
    }
    for (uint32_t i = 0; i < core_count; i += core_group)
        add_core<kind>(cells, mask, r, view, in_core + i, std::min(core_count - i, core_group), sums);
    find_factors<fields>(blocks, at);
    for (uint32_t i = 0; i < blocks / 64; ++i) {
        partial[i] = at.any[i] & ~(open[i] | full[i]);
        open[i] &= at.any[i];
    }
    alignas(64) int32_t by_blocks[3][sh_columns];
    add_blocks<fields>(tables, mask, at, open, partial, by_blocks);
    for (uint32_t f = 0; f < fields; ++f) {
        const auto unit = hn::Set(as_float, at.level[f].unit);
        for (uint32_t j = 0; j < sum_registers; ++j) {
            const uint32_t column = j * (short_width / 2);
            const auto rest = hn::ConvertTo(as_float, hn::Load(d32, by_blocks[f] + column));
            hn::Store(hn::Add(sums[f][j], hn::Mul(unit, rest)), as_float, sum[f] + column);
        }
    }
}

void integrate_glossy(const Tables& tables, const CellTables& cells, const uint8_t* masks, uint32_t valid,
                      const Reflection reflections[lanes], uint32_t channels,
                      const float diffuse_local[25][lanes], float local[][25][lanes]) {
    constexpr decltype(&integrate_lane<Parts::power>) by_kind[] = {
        integrate_lane<Parts::power>, integrate_lane<Parts::whole>, integrate_lane<Parts::metal>,
        integrate_lane<Parts::plastic>, integrate_lane<Parts::mixed>};
    // The fields' sums take the channels' place until these are made: there are never more fields.
    std::memset(local, 0, sizeof(local[0]) * channels);
    alignas(64) float factors[3][3][lanes] = {}, diffuse[3][lanes];
    uint32_t most_fields = 0;
    for (uint32_t lane = 0; lane < lanes; ++lane) {
        const Reflection& r = reflections[lane];
        const ReflectionParts parts = parts_of(r, channels);
        for (uint32_t c = 0; c < 3; ++c)
            diffuse[c][lane] = r.diffuse[c];
        if (!(valid >> lane & 1) || parts.fields == 0) continue;
        alignas(64) float sum[3][sh_columns];
        by_kind[uint32_t(parts.kind)](tables, cells, masks + size_t(lane) * mask_bytes(tables.layout), r,
                                      sum);
        most_fields = std::max(most_fields, parts.fields);
        for (uint32_t f = 0; f < parts.fields; ++f) {
            for (uint32_t c = 0; c < 3; ++c)
                factors[f][c][lane] = parts.factor[f][c];
            for (uint32_t i = 0; i < 25; ++i)
                local[f][i][lane] = sum[f][i];
        }
    }
    for (uint32_t lane = 0; lane < lanes; lane += width) {
        const auto present = mask_of(valid >> lane);
        for (uint32_t i = 0; i < 25; ++i) {
            V sums[3];
            for (uint32_t f = 0; f < most_fields; ++f)
                sums[f] = load(local[f][i], lane);
            for (uint32_t c = 0; c < channels; ++c) {
                V glossy = hn::Zero(df);
                for (uint32_t f = 0; f < most_fields; ++f)
                    glossy = hn::Add(glossy, hn::Mul(load(factors[f][c], lane), sums[f]));
                const V all = hn::Add(hn::Mul(load(diffuse[c], lane), load(diffuse_local[i], lane)),
                                      hn::Mul(glossy, constant(tables.scale[i])));
                hn::Store(hn::IfThenElseZero(present, all), df, local[c][i] + lane);
            }
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
        const GgxView view = reflections ? ggx_view(reflections[lane]) : GgxView{};
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
                respond(reflections[lane], view, lx, ly, lz, out);
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
