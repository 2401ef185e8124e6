// The SIMD kernels: one source, compiled for SSE4, AVX2 and AVX-512, or for NEON, each bit for bit equal to
// reference.cpp. Products and sums are never fused and divisions are exact; only then do all widths agree. A
// batch's 16 lanes are worked on in chunks of the register's width.
#include "kernels/simd.h"

#include "kernels/compress_table.h"
#include "kernels/prepare.h"
#include "kernels/scalar.h"
#include "kernels/touching.h"

#include <cstring>

#define HWY_WANT_SSE4 1
#if defined(__aarch64__)
#define HWY_COMPILE_ONLY_STATIC // NEON alone: the vectors of SVE have no size
#endif
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "kernels/simd.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace nusselt::kernels {
namespace HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;

#include "kernels/classify_blocks.inl"
#include "kernels/sh_formulas.inl"

using Float = hn::CappedTag<float, lanes>;
using Word = hn::RebindToUnsigned<Float>;
using Int = hn::RebindToSigned<Float>;
using V = hn::Vec<Float>;
using U = hn::Vec<Word>;
using M = hn::Mask<Float>;

constexpr Float df;
constexpr Word du;
constexpr Int di;
constexpr uint32_t width = hn::MaxLanes(Float()); // lanes of a chunk
constexpr uint32_t chunk_bits = (1u << width) - 1;

struct Constant {
    V operator()(double value) const { return hn::Set(df, static_cast<float>(value)); }
};

HWY_INLINE V constant(float value) {
    return hn::Set(df, value);
}

HWY_INLINE uint32_t bits_of(M mask) {
    // As many bytes as there are written: a wider load would wait for the store.
    if constexpr (width == 16) {
        uint16_t bits;
        hn::StoreMaskBits(df, mask, reinterpret_cast<uint8_t*>(&bits));
        return bits;
    } else {
        uint8_t bits;
        hn::StoreMaskBits(df, mask, &bits);
        return bits;
    }
}

HWY_INLINE M mask_of(uint32_t bits) {
    const uint8_t bytes[8] = {uint8_t(bits), uint8_t(bits >> 8)};
    return hn::LoadMaskBits(df, bytes);
}

struct Vec3 {
    V x, y, z;
};

HWY_INLINE Vec3 cross(const Vec3& a, const Vec3& b) {
    return {hn::Sub(hn::Mul(a.y, b.z), hn::Mul(a.z, b.y)), hn::Sub(hn::Mul(a.z, b.x), hn::Mul(a.x, b.z)),
            hn::Sub(hn::Mul(a.x, b.y), hn::Mul(a.y, b.x))};
}

HWY_INLINE V dot(V ax, V ay, V az, V bx, V by, V bz) {
    return hn::Add(hn::Add(hn::Mul(ax, bx), hn::Mul(ay, by)), hn::Mul(az, bz));
}

// As a > b ? a : b; the instruction also answers b where either is not a number.
HWY_INLINE V larger(V a, V b) {
    return hn::Max(a, b);
}

struct Chunk {
    V position[3];
    V axis[3][3];
};

HWY_INLINE Chunk load_chunk(const Batch& batch, uint32_t lane) {
    Chunk c;
    for (uint32_t i = 0; i < 3; ++i) {
        c.position[i] = hn::Load(df, batch.position[i] + lane);
        for (uint32_t row = 0; row < 3; ++row)
            c.axis[row][i] = hn::Load(df, batch.axis[row][i] + lane);
    }
    return c;
}

HWY_INLINE Vec3 to_local(const Chunk& c, V px, V py, V pz) {
    const V x = hn::Sub(px, c.position[0]), y = hn::Sub(py, c.position[1]), z = hn::Sub(pz, c.position[2]);
    return {dot(c.axis[0][0], c.axis[0][1], c.axis[0][2], x, y, z),
            dot(c.axis[1][0], c.axis[1][1], c.axis[1][2], x, y, z),
            dot(c.axis[2][0], c.axis[2][1], c.axis[2][2], x, y, z)};
}

HWY_INLINE U cell_index(V value, float top) {
    const V clamped = hn::Min(hn::Max(value, hn::Zero(df)), constant(top));
    return hn::BitCast(du, hn::ConvertTo(di, clamped));
}

// reference.cpp's plane_entry.
template<PlaneMap map>
HWY_INLINE U plane_entry(const MaskLayout& layout, const Vec3& n) {
    const float top = static_cast<float>(layout.plane_cells - 1);
    const V half = constant(static_cast<float>(layout.plane_cells / 2));
    const V ax = hn::Abs(n.x), ay = hn::Abs(n.y), az = hn::Abs(n.z);
    const int shift = static_cast<int>(cell_shift(layout));
    if constexpr (map == PlaneMap::octahedral) {
        const V sum = hn::Add(hn::Add(ax, ay), az);
        const M valid = hn::And(hn::Gt(sum, hn::Zero(df)), hn::Le(sum, constant(FLT_MAX)));
        const V sign = hn::And(n.z, hn::SignBit(df));
        const V x = hn::Xor(n.x, sign), y = hn::Xor(n.y, sign);
        const V scale = hn::Div(hn::Sub(half, constant(0.5f)), sum);
        const U u = cell_index(hn::Add(hn::Mul(hn::Add(x, y), scale), half), top);
        const U v = cell_index(hn::Add(hn::Mul(hn::Sub(x, y), scale), half), top);
        const U cell = hn::Or(hn::ShiftLeftSame(v, static_cast<int>(row_shift(layout))), u);
        const U above = hn::Xor(hn::ShiftRight<31>(hn::BitCast(du, n.z)), hn::Set(du, 1));
        const U entry = hn::Or(hn::ShiftLeftSame(cell, shift), above);
        return hn::IfThenElse(hn::RebindMask(du, valid), entry, hn::Set(du, entry_invalid));
    } else {
        const int cells_log = __builtin_ctz(layout.plane_cells);
        const M on_x = hn::And(hn::Ge(ax, ay), hn::Ge(ax, az)), y_over_z = hn::Ge(ay, az);
        const V major = hn::IfThenElse(on_x, n.x, hn::IfThenElse(y_over_z, n.y, n.z));
        const V size = hn::Abs(major);
        const M valid = hn::And(hn::Gt(size, hn::Zero(df)), hn::Le(size, constant(FLT_MAX)));
        const M on_z = hn::AndNot(on_x, hn::Not(y_over_z));
        const V first = hn::IfThenElse(on_x, n.y, n.x), second = hn::IfThenElse(on_z, n.y, n.z);
        const V scale = hn::Div(half, size);
        const U u = cell_index(hn::Add(hn::Mul(first, scale), half), top);
        const U v = cell_index(hn::Add(hn::Mul(second, scale), half), top);
        const U axis =
            hn::IfThenElse(hn::RebindMask(du, on_x), hn::Zero(du),
                           hn::IfThenElse(hn::RebindMask(du, y_over_z), hn::Set(du, 1), hn::Set(du, 2)));
        const U face = hn::Add(hn::Add(axis, axis), hn::ShiftRight<31>(hn::BitCast(du, major)));
        const U cell = hn::Or(hn::ShiftLeftSame(hn::Or(hn::ShiftLeftSame(face, cells_log), v), cells_log), u);
        const U entry = hn::Xor(hn::ShiftLeftSame(cell, shift), hn::Set(du, entry_complement(layout)));
        return hn::IfThenElse(hn::RebindMask(du, valid), entry, hn::Set(du, entry_invalid));
    }
}

// Tangent of the horizon's elevation times the horizontal direction to (x, y); zero where there is none.
struct Horizon {
    V x, y;
};

HWY_INLINE Horizon horizon_towards(float tangent, V x, V y) {
    const V across = hn::Sqrt(hn::Add(hn::Mul(x, x), hn::Mul(y, y)));
    const M some = hn::Gt(across, hn::Zero(df));
    const V t = constant(tangent);
    return {hn::IfThenElseZero(some, hn::Mul(t, hn::Div(x, across))),
            hn::IfThenElseZero(some, hn::Mul(t, hn::Div(y, across)))};
}

// How high the horizon stands where p is.
HWY_INLINE V horizon_under(const Horizon& h, const Vec3& p) {
    return hn::Add(hn::Mul(h.x, p.x), hn::Mul(h.y, p.y));
}

HWY_INLINE V over_horizon(const Horizon& h, const Vec3& p) {
    return hn::Sub(p.z, horizon_under(h, p));
}

// The lanes of `bits` moved to the front, in order. Our own below AVX-512: the library's copies its table to
// the stack at every call with gcc 12, which made half of the AVX2 frame.
HWY_INLINE U compress(U values, uint32_t bits) {
    if constexpr (width == 16) {
        return hn::Compress(values, hn::RebindMask(du, mask_of(bits)));
    } else {
        const hn::Rebind<uint8_t, Word> bytes;
        const U from = hn::PromoteTo(du, hn::LoadU(bytes, compress_table.from[bits]));
        return hn::TableLookupLanes(values, hn::IndicesFromVec(du, from));
    }
}

HWY_INLINE void append(const U entry[3], U destination, uint32_t bits, JobList& jobs) {
    for (uint32_t k = 0; k < 3; ++k)
        hn::StoreU(compress(entry[k], bits), du, jobs.plane[k] + jobs.count);
    hn::StoreU(compress(destination, bits), du, jobs.destination + jobs.count);
    jobs.count += static_cast<uint32_t>(__builtin_popcount(bits));
}

// Where each lane's mask lies.
HWY_INLINE U destinations(const MaskLayout& layout, uint32_t lane) {
    return hn::Mul(hn::Iota(du, lane), hn::Set(du, mask_bytes(layout)));
}

// A bit a lane each: y < 0, y > 0, and where the mask has quarters x < 0, x > 0.
HWY_INLINE uint64_t signs_of(const MaskLayout& layout, V x, V y) {
    const V zero = hn::Zero(df);
    const uint64_t halves = bits_of(hn::Lt(y, zero)) | bits_of(hn::Gt(y, zero)) << 16;
    if (mask_parts(layout) == 2) return halves;
    return halves | uint64_t(bits_of(hn::Lt(x, zero)) | bits_of(hn::Gt(x, zero)) << 16) << 32;
}

// The lanes of `active` in which a triangle reaches each part of the mask, in the order in which add_jobs
// adds them; returns how many parts there are. `signs`: the OR of its corners'.
HWY_INLINE uint32_t lanes_by_part(const MaskLayout& layout, uint32_t active, uint64_t signs,
                                  uint32_t out[4]) {
    const uint32_t lower = active & static_cast<uint32_t>(signs),
                   upper = active & static_cast<uint32_t>(signs >> 16),
                   left = static_cast<uint32_t>(signs >> 32), right = static_cast<uint32_t>(signs >> 48);
    if (mask_parts(layout) == 2) {
        out[0] = lower;
        out[1] = upper;
        return 2;
    }
    out[0] = lower & left;
    out[1] = lower & right;
    out[2] = upper & right;
    out[3] = upper & left;
    return 4;
}

// One job for each part of the mask that the triangle reaches.
template<PlaneMap map>
HWY_INLINE void add_jobs(const MaskLayout& layout, const U entry[3], U destination, uint32_t active,
                         uint64_t signs, JobList& jobs) {
    uint32_t reaching[4];
    const uint32_t parts = lanes_by_part(layout, active, signs, reaching);
    const U part = hn::Set(du, part_bytes(layout));
    U turned[3];
    if constexpr (map == PlaneMap::cube) {
        append(entry, destination, reaching[0], jobs);
        for (uint32_t k = 0; k < 3; ++k)
            turned[k] = hn::Add(entry[k], part);
        append(turned, hn::Add(destination, part), reaching[1], jobs);
        return;
    }
    const auto half_turn = [&](const U from[3]) HWY_ATTR {
        const U last = hn::Set(du, last_cell(layout) + 3), flags = hn::Set(du, 3);
        for (uint32_t k = 0; k < 3; ++k)
            turned[k] = hn::Xor(hn::Sub(last, from[k]), flags);
    };
    if (parts == 2) {
        if (reaching[0]) {
            half_turn(entry);
            append(turned, destination, reaching[0], jobs);
        }
        if (reaching[1]) append(entry, hn::Add(destination, part), reaching[1], jobs);
        return;
    }
    U quarter[3] = {entry[0], entry[1], entry[2]}; // not read unturned, which gcc for aarch64 does not see
    if (reaching[1] | reaching[3]) {
        const int shift = static_cast<int>(row_shift(layout));
        const U row = hn::Set(du, (layout.plane_cells - 1) << cell_shift(layout));
        for (uint32_t k = 0; k < 3; ++k)
            quarter[k] = hn::Or(hn::Or(hn::ShiftLeftSame(hn::And(entry[k], row), shift),
                                       hn::Sub(row, hn::And(hn::ShiftRightSame(entry[k], shift), row))),
                                hn::And(entry[k], hn::Set(du, 3)));
    }
    if (reaching[0]) {
        half_turn(entry);
        append(turned, destination, reaching[0], jobs);
    }
    if (reaching[1]) {
        half_turn(quarter);
        append(turned, hn::Add(destination, part), reaching[1], jobs);
    }
    if (reaching[2]) append(entry, hn::Add(destination, hn::Add(part, part)), reaching[2], jobs);
    if (reaching[3]) append(quarter, hn::Add(destination, hn::Mul(part, hn::Set(du, 3))), reaching[3], jobs);
}

HWY_INLINE M valid_entries(const U entry[3]) {
    const U any = hn::And(hn::Or(hn::Or(entry[0], entry[1]), entry[2]), hn::Set(du, entry_invalid));
    return hn::RebindMask(df, hn::Eq(any, hn::Zero(du)));
}

void prepare_batch(Batch& batch, const float normal[3][lanes]) {
    kernels::prepare_batch(batch, normal);
}

// Which of a register's clusters are in their band, and which of those reach the receivers.
struct Reach {
    M in_band, reaches;
};

// `load` reads a register's clusters from one of the bounds' arrays.
template<class Load>
HWY_INLINE Reach cluster_reach(const ReceiverBounds& receivers, const ClusterBounds& clusters,
                               const Load& load, float horizon) {
    const V zero = hn::Zero(df);
    const V x = hn::Sub(load(clusters.centre[0]), constant(receivers.centre[0])),
            y = hn::Sub(load(clusters.centre[1]), constant(receivers.centre[1])),
            z = hn::Sub(load(clusters.centre[2]), constant(receivers.centre[2]));
    const V square = dot(x, y, z, x, y, z), distance = hn::Sqrt(square);
    const V reach =
        hn::Add(hn::Mul(hn::Add(load(clusters.radius), constant(receivers.radius)), constant(1.00001f)),
                hn::Mul(distance, constant(1e-6f)));
    const M in_band = hn::And(hn::Lt(hn::Sub(distance, reach), load(clusters.farthest)),
                              hn::Ge(hn::Add(distance, reach), load(clusters.nearest)));
    const V cone_cos = constant(receivers.cone_cos), cone_sin = constant(receivers.cone_sin);
    const V along =
        dot(x, y, z, constant(receivers.cone[0]), constant(receivers.cone[1]), constant(receivers.cone[2]));
    const V across = hn::Sqrt(larger(hn::Sub(square, hn::Mul(along, along)), zero));
    const V height = hn::Add(hn::Mul(along, cone_cos), hn::Mul(across, cone_sin));
    const V side = hn::Sub(hn::Mul(across, cone_cos), hn::Mul(along, cone_sin));
    const V steep = hn::Mul(reach, constant(std::sqrt(1 + horizon * horizon)));
    const M under = hn::Lt(hn::Add(height, reach), zero);
    const M lower = hn::And(hn::Lt(hn::Add(hn::Sub(height, hn::Mul(constant(horizon), side)), steep), zero),
                            hn::Gt(square, hn::Mul(steep, steep)));
    const V facing =
        hn::Sub(zero, dot(x, y, z, load(clusters.cone[0]), load(clusters.cone[1]), load(clusters.cone[2])));
    const V beside = hn::Sqrt(larger(hn::Sub(square, hn::Mul(facing, facing)), zero));
    const V cosine = load(clusters.cone_cos);
    const M back = hn::Lt(
        hn::Add(hn::Add(hn::Mul(facing, cosine), hn::Mul(beside, load(clusters.cone_sin))), reach), zero);
    const M low = hn::And(hn::Gt(cone_cos, zero), hn::Or(under, lower));
    const M culled = hn::Or(low, hn::And(back, hn::Gt(cosine, zero)));
    return {in_band, hn::AndNot(culled, in_band)};
}

uint32_t select_clusters(const ReceiverBounds& receivers, const ClusterBounds& clusters,
                         const uint32_t* candidates, uint32_t candidate_count, float horizon,
                         uint32_t* selected, uint64_t* tested) {
    uint32_t count = 0;
    uint64_t in_band = 0;
    for (uint32_t i = 0; i < candidate_count; i += width) {
        const M present = hn::FirstN(df, candidate_count - i);
        U numbers = hn::Iota(du, i);
        Reach reach;
        if (candidates) {
            // Lanes past the end look at cluster 0: a number read there may be anything.
            numbers = hn::IfThenElseZero(hn::RebindMask(du, present), hn::LoadU(du, candidates + i));
            const auto index = hn::BitCast(di, numbers);
            const auto load = [&](const float* array) HWY_ATTR { return hn::GatherIndex(df, array, index); };
            reach = cluster_reach(receivers, clusters, load, horizon);
        } else {
            const auto load = [&](const float* array) HWY_ATTR { return hn::LoadU(df, array + i); };
            reach = cluster_reach(receivers, clusters, load, horizon);
        }
        const M keep = hn::And(reach.reaches, present);
        in_band += hn::CountTrue(df, hn::And(reach.in_band, present));
        const uint32_t kept = bits_of(keep);
        hn::StoreU(compress(numbers, kept), du, selected + count);
        count += static_cast<uint32_t>(__builtin_popcount(kept));
    }
    *tested += in_band;
    return count;
}

// Of a cluster's triangles, one bit each: those that some receiver of the batch may see, and those of them
// that face all receivers, or none. The first is conservative, and so is the second, the other way round.
struct FirstLook {
    uint64_t visible, faces_all, faces_none;
    uint64_t large; // drawn beyond the cluster's band (triangle_reach)
    // Of those that fade: wholly before a fade's beginning for all receivers, and perhaps beyond its end for
    // some.
    uint64_t before, may_end;
};

// Lanes are triangles here, so that a triangle which no receiver sees costs a sixteenth of one that is worked
// on.
// `fade` null: none.
HWY_INLINE FirstLook first_look(const ReceiverBounds& receivers, const ClusterView& cluster, float horizon,
                                const Fade* fade) {
    const uint32_t slots = triangle_slots(cluster.triangle_count);
    const V zero = hn::Zero(df), slope = constant(std::sqrt(1 + horizon * horizon)),
            tangent = constant(horizon);
    const V px = constant(receivers.centre[0]), py = constant(receivers.centre[1]),
            pz = constant(receivers.centre[2]);
    const V cone_cos = constant(receivers.cone_cos), cone_sin = constant(receivers.cone_sin);
    // A little more than the sphere: the tests' own rounding must not cull. Distances are below 4.
    const V radius = constant(receivers.radius * 1.00001f + 4e-6f);
    const V nearest = constant(cluster.nearest), farthest = constant(cluster.farthest);
    // Of the full mesh also what a receiver may touch from behind, by rounding.
    const V clearance = constant(cluster.full ? -cluster.clearance - 1e-5f : cluster.clearance);
    const M narrow = hn::Gt(cone_cos, zero);
    const M two_sided = hn::Gt(constant(cluster.two_sided ? 1.0f : 0.0f), zero);
    // What kernels add to the clearance is below 6e-6.
    const V clear = constant(cluster.clearance + 1e-5f), opposite = constant(-cluster.clearance - 1e-5f);
    FirstLook look{};
    for (uint32_t t = 0; t < slots; t += width) {
        const auto load = [&](uint32_t array)
                              HWY_ATTR { return hn::LoadU(df, cluster.bounds + array * slots + t); };
        const V height_over = hn::Sub(dot(load(0), load(1), load(2), px, py, pz), load(3));
        const M front = hn::Or(two_sided, hn::Gt(hn::Add(height_over, radius), clearance));
        const V x = hn::Sub(load(4), px), y = hn::Sub(load(5), py), z = hn::Sub(load(6), pz);
        const V square = dot(x, y, z, x, y, z);
        const V reach = hn::Add(load(7), radius);
        // distance - reach < farthest, and distance + reach >= nearest, without the root.
        const V own = hn::Add(load(7), load(7));
        const V outer = hn::Add(larger(farthest, own), reach), inner = larger(hn::Sub(nearest, reach), zero);
        M in_band = hn::And(hn::Lt(square, hn::Mul(outer, outer)), hn::Ge(square, hn::Mul(inner, inner)));
        if (fade) {
            const V distance = hn::Sqrt(square), off = hn::Mul(reach, constant(1.0001f));
            const V last = hn::Mul(hn::Add(distance, off), constant(1.0001f)), end = constant(fade->to);
            in_band = hn::And(in_band, hn::Lt(hn::Sub(distance, off), end));
            look.before |= uint64_t(bits_of(hn::Lt(last, constant(fade->from)))) << t;
            look.may_end |= uint64_t(bits_of(hn::Ge(last, end))) << t;
        }
        const V along = dot(x, y, z, constant(receivers.cone[0]), constant(receivers.cone[1]),
                            constant(receivers.cone[2]));
        const V across = hn::Sqrt(larger(hn::Sub(square, hn::Mul(along, along)), zero));
        const V height = hn::Add(hn::Mul(along, cone_cos), hn::Mul(across, cone_sin));
        const V side = hn::Sub(hn::Mul(across, cone_cos), hn::Mul(along, cone_sin));
        const V steep = hn::Mul(reach, slope);
        const M under = hn::Lt(hn::Add(height, reach), zero);
        const M lower = hn::And(hn::Lt(hn::Add(hn::Sub(height, hn::Mul(tangent, side)), steep), zero),
                                hn::Gt(square, hn::Mul(steep, steep)));
        const M low = hn::And(narrow, hn::Or(under, lower));
        look.visible |= uint64_t(bits_of(hn::AndNot(low, hn::And(front, in_band)))) << t;
        look.large |= uint64_t(bits_of(hn::Gt(own, farthest))) << t;
        look.faces_all |= uint64_t(bits_of(hn::Gt(hn::Sub(height_over, radius), clear))) << t;
        look.faces_none |= uint64_t(bits_of(hn::Lt(hn::Add(height_over, radius), opposite))) << t;
    }
    if (cluster.triangle_count < 64) look.visible &= (1ull << cluster.triangle_count) - 1;
    look.faces_all &= look.visible;
    look.faces_none &= look.visible;
    return look;
}

// `load` reads a register's spheres: centre 0 to 2, radius 3.
template<class Load>
HWY_INLINE M meets(const Rays& rays, const Load& load) {
    const V x = hn::Sub(load(0), constant(rays.centre[0])), y = hn::Sub(load(1), constant(rays.centre[1])),
            z = hn::Sub(load(2), constant(rays.centre[2]));
    const V square = dot(x, y, z, x, y, z);
    const V along =
        dot(x, y, z, constant(rays.direction[0]), constant(rays.direction[1]), constant(rays.direction[2]));
    const V reach = hn::Add(hn::Mul(hn::Add(load(3), constant(rays.radius)), constant(1.00001f)),
                            hn::Mul(constant(1e-3f), hn::Sqrt(square)));
    return hn::And(hn::Ge(hn::Add(along, reach), hn::Zero(df)),
                   hn::Le(hn::Sub(square, hn::Mul(along, along)), hn::Mul(reach, reach)));
}

uint32_t select_along(const Rays& rays, const ClusterBounds& clusters, const uint32_t* candidates,
                      uint32_t first, uint32_t end, uint32_t* selected) {
    const auto array = [&](uint32_t k) { return k < 3 ? clusters.centre[k] : clusters.radius; };
    uint32_t count = 0;
    for (uint32_t i = first; i < end; i += width) {
        const M present = hn::FirstN(df, end - i);
        U numbers = hn::Iota(du, i);
        M met;
        if (candidates) {
            // Lanes past the end look at cluster 0: a number read there may be anything.
            numbers = hn::IfThenElseZero(hn::RebindMask(du, present), hn::LoadU(du, candidates + i));
            const auto index = hn::BitCast(di, numbers);
            met = meets(rays, [&](uint32_t k) HWY_ATTR { return hn::GatherIndex(df, array(k), index); });
        } else {
            met = meets(rays, [&](uint32_t k) HWY_ATTR { return hn::LoadU(df, array(k) + i); });
        }
        const uint32_t kept = bits_of(hn::And(met, present));
        if (!kept) continue;
        hn::StoreU(compress(numbers, kept), du, selected + count);
        count += static_cast<uint32_t>(__builtin_popcount(kept));
    }
    return count;
}

uint64_t triangles_along(const Rays& rays, const ClusterView& cluster) {
    const uint32_t slots = triangle_slots(cluster.triangle_count);
    uint64_t met = 0;
    for (uint32_t t = 0; t < slots; t += width) {
        const auto load = [&](uint32_t array)
                              HWY_ATTR { return hn::LoadU(df, cluster.bounds + (4 + array) * slots + t); };
        met |= uint64_t(bits_of(meets(rays, load))) << t;
    }
    return cluster.triangle_count < 64 ? met & ((1ull << cluster.triangle_count) - 1) : met;
}

// Rays along the axis 0 to 2, or 3: in any direction. (x, y, z): from their origin to a sphere's centre.
template<uint32_t axis>
HWY_INLINE M ray_meets(const Rays& rays, V x, V y, V z, V radius) {
    const V offset[3] = {x, y, z};
    V u, v, along;
    if constexpr (axis < 3) {
        // A sum of a component and two zeros is the component; its sign falls out of the squares.
        u = offset[(axis + 1) % 3];
        v = offset[(axis + 2) % 3];
        along = hn::Mul(offset[axis], constant(rays.direction[axis]));
    } else {
        const auto turn = [&](const float unit[3]) HWY_ATTR {
            return dot(x, y, z, constant(unit[0]), constant(unit[1]), constant(unit[2]));
        };
        u = turn(rays.across[0]);
        v = turn(rays.across[1]);
        along = turn(rays.direction);
    }
    const V reach = hn::Add(hn::Mul(radius, constant(1.0001f)), constant(4e-6f));
    return hn::And(hn::Ge(hn::Add(along, reach), hn::Zero(df)),
                   hn::Le(hn::Add(hn::Mul(u, u), hn::Mul(v, v)), hn::Mul(reach, reach)));
}

// Of triangles by their planes and spheres: those that a ray may cross in front of its origin.
template<uint32_t axis, class Load>
HWY_INLINE M ray_may_cross(const Rays& rays, V ox, V oy, V oz, V height, const Load& load) {
    const V dx = constant(rays.direction[0]), dy = constant(rays.direction[1]),
            dz = constant(rays.direction[2]);
    V slope;
    if constexpr (axis < 3) {
        slope = hn::Mul(load(axis), constant(rays.direction[axis])); // the same sum, but for zeros' signs
    } else {
        slope = dot(load(0), load(1), load(2), dx, dy, dz);
    }
    const V steep = hn::Abs(slope), away = hn::Div(height, slope);
    const M behind =
        hn::And(hn::Gt(hn::Mul(height, slope), hn::Zero(df)), hn::Gt(steep, constant(crossing_slope)));
    const V x = hn::Sub(hn::Sub(ox, hn::Mul(away, dx)), load(4)),
            y = hn::Sub(hn::Sub(oy, hn::Mul(away, dy)), load(5)),
            z = hn::Sub(hn::Sub(oz, hn::Mul(away, dz)), load(6));
    const V reach = hn::Add(hn::Mul(load(7), constant(1.0001f)), constant(meeting_margin));
    const M beside =
        hn::And(hn::Gt(dot(x, y, z, x, y, z), hn::Mul(reach, reach)), hn::Gt(steep, constant(meeting_slope)));
    return hn::Not(hn::Or(hn::Or(behind, beside), hn::Eq(slope, hn::Zero(df))));
}

// Lanes are rays for the cluster's sphere, then triangles for each ray that meets it: of a receiver's own
// surroundings, where all rays start, each ray meets but a few triangles.
template<uint32_t axis>
void count_crossings_of(const Rays& rays, const ClusterView& cluster, const float* points,
                        int32_t winding[lanes]) {
    uint32_t met = 0;
    for (uint32_t lane = 0; lane < lanes; lane += width) {
        const auto offset = [&](uint32_t i) HWY_ATTR {
            return hn::Sub(constant(cluster.centre[i]), hn::Load(df, rays.origin[i] + lane));
        };
        met |= bits_of(ray_meets<axis>(rays, offset(0), offset(1), offset(2), constant(cluster.radius)))
               << lane;
    }
    const uint32_t slots = triangle_slots(cluster.triangle_count);
    const V margin = constant(crossing_margin);
    for (met &= rays.active; met; met &= met - 1) {
        const uint32_t lane = static_cast<uint32_t>(__builtin_ctz(met));
        const V ox = constant(rays.origin[0][lane]), oy = constant(rays.origin[1][lane]),
                oz = constant(rays.origin[2][lane]);
        for (uint32_t t = 0; t < slots; t += width) {
            const auto load = [&](uint32_t array)
                                  HWY_ATTR { return hn::LoadU(df, cluster.bounds + array * slots + t); };
            const V height = hn::Sub(dot(load(0), load(1), load(2), ox, oy, oz), load(3));
            const M near = ray_meets<axis>(rays, hn::Sub(load(4), ox), hn::Sub(load(5), oy),
                                           hn::Sub(load(6), oz), load(7));
            const M off = hn::And(near, hn::Gt(hn::Abs(height), margin));
            if (!bits_of(off)) continue;
            uint32_t left = bits_of(hn::And(off, ray_may_cross<axis>(rays, ox, oy, oz, height, load)));
            alignas(64) float heights[width];
            hn::Store(height, df, heights);
            for (; left; left &= left - 1) {
                const uint32_t i = static_cast<uint32_t>(__builtin_ctz(left));
                winding[lane] += crossing(rays, lane, cluster, points, t + i, heights[i]);
            }
        }
    }
}

void count_crossings(const Rays& rays, const ClusterView& cluster, const float* points,
                     int32_t winding[lanes]) {
    const float* d = rays.direction;
    const uint32_t zeros = uint32_t(d[0] == 0) | uint32_t(d[1] == 0) << 1 | uint32_t(d[2] == 0) << 2;
    switch (zeros) {
    case 6:
        return count_crossings_of<0>(rays, cluster, points, winding);
    case 5:
        return count_crossings_of<1>(rays, cluster, points, winding);
    case 3:
        return count_crossings_of<2>(rays, cluster, points, winding);
    default:
        return count_crossings_of<3>(rays, cluster, points, winding);
    }
}

// Receivers at one of the triangle's corners: all that touch it, nearly always.
HWY_INLINE M at_corner(const Chunk& chunk, const ClusterView& cluster, const float* points,
                       const uint8_t* triangle) {
    const auto at = [&](uint32_t k) HWY_ATTR {
        const float* p = points + 4 * size_t(cluster.vertices[triangle[k]]);
        return hn::And(
            hn::And(hn::Eq(chunk.position[0], constant(p[0])), hn::Eq(chunk.position[1], constant(p[1]))),
            hn::Eq(chunk.position[2], constant(p[2])));
    };
    return hn::Or(hn::Or(at(0), at(1)), at(2));
}

// The lanes in which a corner of the triangle lies nearer than that.
HWY_INLINE uint32_t nearer_than(float distance, const ClusterScratch& scratch, const uint8_t* triangle) {
    uint32_t near = 0;
    for (uint32_t k = 0; k < 3; ++k) {
        const auto& corner = scratch.local[triangle[k]];
        const V x = hn::Load(df, corner[0]), y = hn::Load(df, corner[1]), z = hn::Load(df, corner[2]);
        near |= bits_of(hn::Lt(dot(x, y, z, x, y, z), constant(distance * distance)));
    }
    return near;
}

// What a cluster's jobs are made of. `behind`: the same receivers looking the other way, where both sides are
// asked for.
struct ClusterWork {
    const Batch& batch;
    const Batch& behind;
    const ClusterView& cluster;
    const float* points;
    const MaskLayout& layout;
    float horizon;
    ClusterScratch& scratch;
    JobList& jobs;
    Counters& counters;
    const Fade* fade = nullptr; // none
    FadingJobs* fading = nullptr;
};

// Of each triangle, one bit a lane of a register.
struct TriangleLanes {
    uint32_t valid[2];                                          // receivers, and those that look behind
    uint32_t front[cluster_triangles], back[cluster_triangles]; // in front of it, behind a two-sided one
    uint32_t visible[2][cluster_triangles];                     // over the horizon too, and in its band
    // One bit a triangle, a corner, an edge.
    uint64_t seen, corners, drawn, edges[2][2];
};

HWY_INLINE void touch(const ClusterWork& work, uint32_t triangle, uint32_t touching, uint32_t behind) {
    if (touching)
        touching_jobs(work.batch, work.cluster, work.points, triangle, touching, work.layout, work.horizon,
                      work.jobs, work.counters);
    if (!behind) return;
    const uint32_t first = work.jobs.count;
    touching_jobs(work.behind, work.cluster, work.points, triangle, behind, work.layout, work.horizon,
                  work.jobs, work.counters);
    for (uint32_t j = first; j < work.jobs.count; ++j)
        work.jobs.destination[j] += lanes * mask_bytes(work.layout);
}

HWY_INLINE uint64_t corners_of(const ClusterView& cluster, uint32_t t) {
    const uint8_t* triangle = cluster.triangles + 8 * t;
    return 1ull << triangle[0] | 1ull << triangle[1] | 1ull << triangle[2];
}

// Of the receivers over a triangle's plane.
HWY_INLINE V height_above(const ClusterView& cluster, uint32_t triangle, const Chunk& chunk) {
    const uint32_t slots = triangle_slots(cluster.triangle_count);
    const float* plane = cluster.bounds + triangle;
    return hn::Sub(dot(constant(plane[0]), constant(plane[slots]), constant(plane[2 * slots]),
                       chunk.position[0], chunk.position[1], chunk.position[2]),
                   constant(plane[3 * slots]));
}

// Facing, from the planes alone: it spares half of the corners their transformation. Which way a receiver
// looks does not matter.
HWY_INLINE void face_triangles(const ClusterWork& work, const FirstLook& look, const Chunk& chunk,
                               uint32_t lane, V margin, TriangleLanes& out) {
    const ClusterView& cluster = work.cluster;
    const uint32_t valid = out.valid[0] | out.valid[1];
    const V opposite = hn::Sub(hn::Zero(df), margin);
    const V touch_margin = cluster.full ? margin : constant(-1.0f); // none: coarse surfaces lie off
    out.corners = 0;
    out.seen = look.faces_all | look.faces_none;
    for (uint64_t left = out.seen; left; left &= left - 1) {
        const uint32_t t = static_cast<uint32_t>(__builtin_ctzll(left));
        const bool faces = look.faces_all >> t & 1;
        out.front[t] = faces ? valid : 0;
        out.back[t] = faces ? 0 : valid;
        out.corners |= corners_of(cluster, t);
    }
    for (uint64_t left = look.visible & ~out.seen; left; left &= left - 1) {
        const uint32_t t = static_cast<uint32_t>(__builtin_ctzll(left));
        const V height = height_above(cluster, t, chunk);
        out.front[t] = bits_of(hn::Gt(height, margin)) & valid;
        out.back[t] = cluster.two_sided ? bits_of(hn::Lt(height, opposite)) & valid : 0;
        const M touches = hn::Le(hn::Abs(height), touch_margin);
        if (HWY_UNLIKELY(!hn::AllFalse(df, touches))) {
            const uint8_t* triangle = cluster.triangles + 8 * t;
            const uint32_t touching =
                bits_of(hn::AndNot(at_corner(chunk, cluster, work.points, triangle), touches));
            touch(work, t, (touching & out.valid[0]) << lane, (touching & out.valid[1]) << lane);
        }
        const bool any = (out.front[t] | out.back[t]) != 0;
        out.corners |= any ? corners_of(cluster, t) : 0;
        out.seen |= uint64_t(any) << t;
    }
}

// Leaves out what is beyond the fade's end, of the triangles that may be: is_beyond of sixteen receivers.
HWY_INLINE void leave_out_beyond(const ClusterWork& work, const Chunk& chunk, uint64_t may_end,
                                 TriangleLanes& out) {
    const ClusterView& cluster = work.cluster;
    const uint32_t slots = triangle_slots(cluster.triangle_count);
    const V end = constant(work.fade->to);
    const uint64_t seen = out.seen;
    for (uint64_t left = seen & may_end; left; left &= left - 1) {
        const uint32_t t = static_cast<uint32_t>(__builtin_ctzll(left));
        const float* sphere = cluster.bounds + 4 * slots + t;
        const V height = hn::Abs(height_above(cluster, t, chunk));
        const V x = hn::Sub(constant(sphere[0]), chunk.position[0]),
                y = hn::Sub(constant(sphere[slots]), chunk.position[1]),
                z = hn::Sub(constant(sphere[2 * slots]), chunk.position[2]);
        const V reach = hn::Add(hn::Mul(constant(sphere[3 * slots]), constant(1.00001f)), end);
        const M beyond = hn::Or(hn::Ge(height, end), hn::Ge(dot(x, y, z, x, y, z), hn::Mul(reach, reach)));
        const uint32_t near = ~bits_of(beyond);
        out.front[t] &= near;
        out.back[t] &= near;
        if (!(out.front[t] | out.back[t])) out.seen &= ~(1ull << t);
    }
    if (out.seen == seen) return;
    out.corners = 0;
    for (uint64_t left = out.seen; left; left &= left - 1)
        out.corners |= corners_of(cluster, static_cast<uint32_t>(__builtin_ctzll(left)));
}

// Corners in the receivers' tangent frames, and what a triangle needs to know of them: it is the OR of
// theirs, one bit a lane, 16 bits a question. From behind a corner lies at (x, -y, -z).
template<bool both, bool fading>
HWY_INLINE void place_corners(const ClusterWork& work, const Chunk& chunk, const Horizon& towards,
                              uint64_t corners) {
    const ClusterView& cluster = work.cluster;
    ClusterScratch& scratch = work.scratch;
    const V farthest = constant(cluster.farthest * cluster.farthest),
            nearest = constant(cluster.nearest * cluster.nearest), zero = hn::Zero(df);
    for (uint64_t left = corners; left; left &= left - 1) {
        const uint32_t v = static_cast<uint32_t>(__builtin_ctzll(left));
        const float* p = work.points + 4 * size_t(cluster.vertices[v]);
        const Vec3 local = to_local(chunk, constant(p[0]), constant(p[1]), constant(p[2]));
        hn::Store(local.x, df, scratch.local[v][0]);
        hn::Store(local.y, df, scratch.local[v][1]);
        hn::Store(local.z, df, scratch.local[v][2]);
        const V square = dot(local.x, local.y, local.z, local.x, local.y, local.z);
        const V rise = horizon_under(towards, local);
        const uint64_t above = bits_of(hn::Gt(local.z, zero));
        const uint64_t over = bits_of(hn::Gt(hn::Sub(local.z, rise), zero));
        const uint64_t near = bits_of(hn::Lt(square, farthest)), far = bits_of(hn::Ge(square, nearest));
        scratch.reach[v] = above | over << 16 | near << 32 | far << 48;
        scratch.signs[v] = signs_of(work.layout, local.x, local.y);
        if constexpr (fading)
            scratch.near[v] = bits_of(hn::Lt(square, constant(work.fade->from * work.fade->from)));
        if constexpr (both) {
            const V depth = hn::Sub(zero, local.z);
            scratch.behind[v] = bits_of(hn::Lt(local.z, zero)) | bits_of(hn::Gt(hn::Sub(depth, rise), zero))
                                                                     << 16;
        }
    }
}

template<bool both>
HWY_INLINE void find_visible(const ClusterWork& work, uint64_t large, TriangleLanes& out) {
    const ClusterView& cluster = work.cluster;
    const ClusterScratch& scratch = work.scratch;
    out.drawn = 0;
    std::memset(out.edges, 0, sizeof(out.edges));
    for (uint64_t left = out.seen; left; left &= left - 1) {
        const uint32_t t = static_cast<uint32_t>(__builtin_ctzll(left));
        const uint8_t* triangle = cluster.triangles + 8 * t;
        const uint64_t c0 = scratch.reach[triangle[0]], c1 = scratch.reach[triangle[1]],
                       c2 = scratch.reach[triangle[2]], any = c0 | c1 | c2;
        const uint64_t far = cluster.two_sided ? (c0 & c1) | (c1 & c2) | (c2 & c0) : any;
        const uint32_t near = HWY_UNLIKELY(large >> t & 1)
                                  ? nearer_than(triangle_reach(cluster, t), scratch, triangle)
                                  : static_cast<uint32_t>(any >> 32);
        const uint32_t drawn = static_cast<uint32_t>(far >> 48) & near & (out.front[t] | out.back[t]);
        out.visible[0][t] = static_cast<uint32_t>(any & any >> 16) & drawn & out.valid[0];
        if constexpr (both) {
            const uint32_t above =
                scratch.behind[triangle[0]] | scratch.behind[triangle[1]] | scratch.behind[triangle[2]];
            out.visible[1][t] = above & above >> 16 & drawn & out.valid[1];
        }
        for (uint32_t side = 0; side < (both ? 2 : 1); ++side) {
            if (!out.visible[side][t]) continue;
            out.drawn |= 1ull << t;
            for (uint32_t k = 3; k < 6; ++k)
                out.edges[side][triangle[k] >> 6] |= 1ull << (triangle[k] & 63);
        }
    }
}

// The plane of an edge as one batch has it.
template<PlaneMap map>
HWY_INLINE U edge_entry(const ClusterWork& work, const Batch& batch, uint32_t lane, uint32_t edge) {
    const Chunk chunk = load_chunk(batch, lane);
    const auto corner = [&](uint32_t end) HWY_ATTR {
        const float* p = work.points + 4 * size_t(work.cluster.vertices[work.cluster.edges[2 * edge + end]]);
        return to_local(chunk, constant(p[0]), constant(p[1]), constant(p[2]));
    };
    return plane_entry<map>(work.layout, cross(corner(0), corner(1)));
}

template<PlaneMap map, bool both>
HWY_INLINE void find_planes(const ClusterWork& work, uint32_t lane, const TriangleLanes& drawn) {
    ClusterScratch& scratch = work.scratch;
    for (uint32_t word = 0; word < 2; ++word) {
        const uint64_t front = drawn.edges[0][word], behind = both ? drawn.edges[1][word] : 0;
        for (uint64_t left = front | behind; left; left &= left - 1) {
            const uint32_t bit = static_cast<uint32_t>(__builtin_ctzll(left)), e = word * 64 + bit;
            const auto& a = scratch.local[work.cluster.edges[2 * e]];
            const auto& b = scratch.local[work.cluster.edges[2 * e + 1]];
            const Vec3 from{hn::Load(df, a[0]), hn::Load(df, a[1]), hn::Load(df, a[2])};
            const Vec3 to{hn::Load(df, b[0]), hn::Load(df, b[1]), hn::Load(df, b[2])};
            const Vec3 normal = cross(from, to);
            if (!both || (front >> bit & 1))
                hn::Store(plane_entry<map>(work.layout, normal), du, scratch.entry[e]);
            if (!(behind >> bit & 1)) continue;
            U entry = plane_entry<map>(work.layout, Vec3{normal.x, hn::Neg(normal.y), hn::Neg(normal.z)});
            // The sign of a zero chooses the cell, and a sum that cancels is +0 on either side.
            if (HWY_UNLIKELY(!hn::AllFalse(df, hn::Eq(normal.z, hn::Zero(df)))))
                entry = edge_entry<map>(work, work.behind, lane, e);
            hn::Store(entry, du, scratch.entry_behind[e]);
        }
    }
}

// The triangle's planes; returns the lanes of `visible` in which they are planes.
HWY_INLINE uint32_t load_entries(const ClusterWork& work, uint32_t t, const uint32_t entries[][lanes],
                                 uint32_t visible, uint32_t back, U entry[3]) {
    const uint8_t* triangle = work.cluster.triangles + 8 * t;
    const uint32_t complement = entry_complement(work.layout);
    for (uint32_t k = 0; k < 3; ++k) {
        const U flip = hn::Set(du, triangle[6] >> k & 1 ? complement : 0);
        entry[k] = hn::Xor(hn::Load(du, entries[triangle[3 + k]]), flip);
    }
    if (back) {
        const U turned = hn::IfThenElseZero(hn::RebindMask(du, mask_of(back)), hn::Set(du, complement));
        for (uint32_t k = 0; k < 3; ++k)
            entry[k] = hn::Xor(entry[k], turned);
    }
    const uint32_t active = visible & bits_of(valid_entries(entry));
    work.counters.triangles_rasterized += static_cast<uint32_t>(__builtin_popcount(active));
    return active;
}

template<PlaneMap map>
HWY_INLINE void add_triangle(const ClusterWork& work, uint32_t t, const uint32_t entries[][lanes],
                             uint32_t visible, uint32_t back, U destination, uint64_t signs) {
    U entry[3];
    const uint32_t active = load_entries(work, t, entries, visible, back, entry);
    add_jobs<map>(work.layout, entry, destination, active, signs, work.jobs);
}

// Signs as a receiver that looks the other way has them: y turns over.
uint64_t from_behind(uint64_t signs) {
    return (signs & ~0xFFFFFFFFull) | (signs >> 16 & 0xFFFF) | (signs & 0xFFFF) << 16;
}

// The same of a triangle of which a fade may leave a part.
HWY_INLINE void add_fading(const ClusterWork& work, const Chunk& chunk, uint32_t t, uint32_t visible,
                           uint32_t back, U destination, uint64_t signs) {
    const ClusterScratch& scratch = work.scratch;
    const uint8_t* triangle = work.cluster.triangles + 8 * t;
    U entry[3];
    const uint32_t active = load_entries(work, t, scratch.entry, visible, back, entry);
    const uint32_t whole =
        active & scratch.near[triangle[0]] & scratch.near[triangle[1]] & scratch.near[triangle[2]];
    add_jobs<PlaneMap::octahedral>(work.layout, entry, destination, whole, signs, work.jobs);
    const uint32_t in_part = active & ~whole;
    if (!in_part) return;
    const uint32_t slots = triangle_slots(work.cluster.triangle_count);
    const float* plane = work.cluster.bounds + t;
    const V scale = hn::Div(constant(-1), height_above(work.cluster, t, chunk));
    const V nx = constant(plane[0]), ny = constant(plane[slots]), nz = constant(plane[2 * slots]);
    uint32_t reaching[4];
    const uint32_t parts = lanes_by_part(work.layout, in_part, signs, reaching);
    for (uint32_t row = 0; row < 3; ++row) {
        const V inverse =
            hn::Mul(dot(chunk.axis[row][0], chunk.axis[row][1], chunk.axis[row][2], nx, ny, nz), scale);
        float* to = work.fading->inverse[row] + work.fading->list.count;
        for (uint32_t part = 0; part < parts; ++part) {
            hn::StoreU(hn::BitCast(df, compress(hn::BitCast(du, inverse), reaching[part])), df, to);
            to += __builtin_popcount(reaching[part]);
        }
    }
    add_jobs<PlaneMap::octahedral>(work.layout, entry, destination, in_part, signs, work.fading->list);
}

template<PlaneMap map, bool both, bool fading>
void cluster_jobs_of(const ClusterWork& work) {
    const ClusterView& cluster = work.cluster;
    const uint32_t receivers = static_cast<uint32_t>(__builtin_popcount(work.batch.valid)) +
                               (both ? static_cast<uint32_t>(__builtin_popcount(work.behind.valid)) : 0);
    work.counters.triangles_considered += uint64_t(receivers) * cluster.triangle_count;
    ReceiverBounds bounds = work.batch.bounds;
    if constexpr (both) bounds.cone_cos = -1; // next to nothing lies below all horizons of both sides
    const FirstLook look = first_look(bounds, cluster, work.horizon, fading ? work.fade : nullptr);
    if (!look.visible) return;
    for (uint32_t lane = 0; lane < lanes; lane += width) {
        TriangleLanes triangles;
        triangles.valid[0] = work.batch.valid >> lane & chunk_bits;
        triangles.valid[1] = both ? work.behind.valid >> lane & chunk_bits : 0;
        if (!(triangles.valid[0] | triangles.valid[1])) continue;
        const Chunk chunk = load_chunk(work.batch, lane);
        const Vec3 middle = to_local(chunk, constant(cluster.centre[0]), constant(cluster.centre[1]),
                                     constant(cluster.centre[2]));
        const V distance = hn::Sqrt(dot(middle.x, middle.y, middle.z, middle.x, middle.y, middle.z));
        const V margin = hn::Add(constant(cluster.clearance),
                                 hn::Mul(constant(1e-6f), hn::Add(distance, constant(cluster.radius))));
        face_triangles(work, look, chunk, lane, margin, triangles);
        if constexpr (fading) leave_out_beyond(work, chunk, look.may_end, triangles);
        place_corners<both, fading>(work, chunk, horizon_towards(work.horizon, middle.x, middle.y),
                                    triangles.corners);
        find_visible<both>(work, look.large, triangles);
        find_planes<map, both>(work, lane, triangles);
        const U destination = destinations(work.layout, lane);
        const U destination_behind = hn::Add(destination, hn::Set(du, lanes * mask_bytes(work.layout)));
        const ClusterScratch& scratch = work.scratch;
        for (uint64_t left = triangles.drawn; left; left &= left - 1) {
            const uint32_t t = static_cast<uint32_t>(__builtin_ctzll(left));
            const uint8_t* triangle = cluster.triangles + 8 * t;
            const uint64_t signs =
                scratch.signs[triangle[0]] | scratch.signs[triangle[1]] | scratch.signs[triangle[2]];
            if (fading && !(look.before >> t & 1)) {
                add_fading(work, chunk, t, triangles.visible[0][t],
                           triangles.back[t] & triangles.visible[0][t], destination, signs);
                continue;
            }
            if (!both || triangles.visible[0][t])
                add_triangle<map>(work, t, scratch.entry, triangles.visible[0][t],
                                  triangles.back[t] & triangles.visible[0][t], destination, signs);
            if (both && triangles.visible[1][t])
                add_triangle<map>(work, t, scratch.entry_behind, triangles.visible[1][t],
                                  triangles.back[t] & triangles.visible[1][t], destination_behind,
                                  from_behind(signs));
        }
    }
}

void cluster_jobs(const Batch& batch, const ClusterView& cluster, const float* points,
                  const MaskLayout& layout, float horizon, ClusterScratch& scratch, JobList& jobs,
                  Counters& counters) {
    const ClusterWork work{batch, batch, cluster, points, layout, horizon, scratch, jobs, counters};
    if (layout.planes == PlaneMap::octahedral) {
        cluster_jobs_of<PlaneMap::octahedral, false, false>(work);
    } else {
        cluster_jobs_of<PlaneMap::cube, false, false>(work);
    }
}

void fading_cluster_jobs(const Batch& batch, const ClusterView& cluster, const float* points,
                         const MaskLayout& layout, float horizon, const Fade& fade, ClusterScratch& scratch,
                         JobList& jobs, FadingJobs& fading, Counters& counters) {
    cluster_jobs_of<PlaneMap::octahedral, false, true>(
        {batch, batch, cluster, points, layout, horizon, scratch, jobs, counters, &fade, &fading});
}

void both_sides_jobs(const Batch& batch, const Batch& behind, const ClusterView& cluster, const float* points,
                     const MaskLayout& layout, float horizon, ClusterScratch& scratch, JobList& jobs,
                     Counters& counters) {
    cluster_jobs_of<PlaneMap::octahedral, true, false>(
        {batch, behind, cluster, points, layout, horizon, scratch, jobs, counters});
}

HWY_INLINE void free_jobs(const MaskLayout& layout, const Vec3 corner[3], const Vec3 normal[3], M behind,
                          M active, uint32_t lane, JobList& jobs, uint64_t& counter) {
    const U turned = hn::IfThenElseZero(hn::RebindMask(du, behind), hn::Set(du, entry_complement(layout)));
    U entry[3];
    for (uint32_t k = 0; k < 3; ++k) {
        entry[k] = layout.planes == PlaneMap::octahedral
                       ? plane_entry<PlaneMap::octahedral>(layout, normal[k])
                       : plane_entry<PlaneMap::cube>(layout, normal[k]);
        entry[k] = hn::Xor(entry[k], turned);
    }
    const M left = hn::And(active, valid_entries(entry));
    const uint32_t bits = bits_of(left);
    counter += static_cast<uint32_t>(__builtin_popcount(bits));
    uint64_t signs = 0;
    for (uint32_t k = 0; k < 3; ++k)
        signs |= signs_of(layout, corner[k].x, corner[k].y);
    if (layout.planes == PlaneMap::octahedral) {
        add_jobs<PlaneMap::octahedral>(layout, entry, destinations(layout, lane), bits, signs, jobs);
    } else {
        add_jobs<PlaneMap::cube>(layout, entry, destinations(layout, lane), bits, signs, jobs);
    }
}

HWY_INLINE Vec3 load_corner(const Chunk& chunk, const float corner[3][lanes], uint32_t lane) {
    return to_local(chunk, hn::Load(df, corner[0] + lane), hn::Load(df, corner[1] + lane),
                    hn::Load(df, corner[2] + lane));
}

void triangle_jobs(const Batch& batch, const float corners[3][3][lanes], uint32_t active, uint32_t two_sided,
                   const MaskLayout& layout, float horizon, JobList& jobs, Counters& counters) {
    active &= batch.valid;
    counters.triangles_considered += static_cast<uint32_t>(__builtin_popcount(active));
    for (uint32_t lane = 0; lane < lanes; lane += width) {
        if (!(active >> lane & chunk_bits)) continue;
        const Chunk chunk = load_chunk(batch, lane);
        const Vec3 corner[3] = {load_corner(chunk, corners[0], lane), load_corner(chunk, corners[1], lane),
                                load_corner(chunk, corners[2], lane)};
        const Vec3 &a = corner[0], &b = corner[1], &c = corner[2];
        const Vec3 normal[3] = {cross(a, b), cross(b, c), cross(c, a)};
        const V volume = dot(normal[0].x, normal[0].y, normal[0].z, c.x, c.y, c.z);
        const V edge = hn::Add(hn::Add(hn::Abs(normal[0].x), hn::Abs(normal[0].y)), hn::Abs(normal[0].z));
        const V reach = hn::Add(hn::Add(hn::Abs(c.x), hn::Abs(c.y)), hn::Abs(c.z));
        const V margin = hn::Mul(constant(1e-6f), hn::Mul(edge, reach));
        const M front = hn::Lt(volume, hn::Sub(hn::Zero(df), margin));
        const M back = hn::And(hn::Gt(volume, margin), mask_of(two_sided >> lane & chunk_bits));
        const V sum_x = hn::Add(hn::Add(a.x, b.x), c.x), sum_y = hn::Add(hn::Add(a.y, b.y), c.y);
        const Horizon towards = horizon_towards(horizon, sum_x, sum_y);
        const V height = larger(larger(a.z, b.z), c.z);
        const V over =
            larger(larger(over_horizon(towards, a), over_horizon(towards, b)), over_horizon(towards, c));
        const M above = hn::Gt(hn::Min(height, over), hn::Zero(df));
        const M drawn = hn::And(hn::And(hn::Or(front, back), above), mask_of(active >> lane & chunk_bits));
        free_jobs(layout, corner, normal, back, drawn, lane, jobs, counters.triangles_rasterized);
    }
}

uint32_t fan_jobs(const Batch& batch, const float corners[2][3][lanes], uint32_t active,
                  const MaskLayout& layout, JobList& jobs, Counters& counters) {
    active &= batch.valid;
    const V zero = hn::Zero(df);
    uint32_t folded = 0;
    for (uint32_t lane = 0; lane < lanes; lane += width) {
        if (!(active >> lane & chunk_bits)) continue;
        const Chunk chunk = load_chunk(batch, lane);
        const Vec3 corner[3] = {load_corner(chunk, corners[0], lane), load_corner(chunk, corners[1], lane),
                                Vec3{zero, zero, constant(-1.0f)}};
        const Vec3 &a = corner[0], &b = corner[1];
        const M above = hn::Or(hn::Gt(a.z, zero), hn::Gt(b.z, zero));
        const M drawn = hn::And(above, mask_of(active >> lane & chunk_bits));
        if (!bits_of(drawn)) continue;
        const Vec3 normal[3] = {cross(a, b), Vec3{hn::Neg(b.y), b.x, zero},
                                Vec3{a.y, hn::Neg(a.x), hn::Neg(zero)}};
        const auto is_upright = [&](const Vec3& p) HWY_ATTR {
            const V across = hn::Add(hn::Mul(p.x, p.x), hn::Mul(p.y, p.y));
            return hn::And(hn::Gt(p.z, zero), hn::Lt(across, hn::Mul(constant(upright), hn::Mul(p.z, p.z))));
        };
        const M leaning = hn::AndNot(hn::Or(is_upright(a), is_upright(b)), drawn);
        folded |= bits_of(hn::AndNot(hn::And(hn::Gt(normal[0].z, zero), leaning), drawn)) << lane;
        free_jobs(layout, corner, normal, hn::Lt(normal[0].z, zero), leaning, lane, jobs,
                  counters.fan_triangles);
    }
    return folded;
}

template<uint32_t bytes>
void run_jobs_of(const Tables& tables, JobList& jobs, uint8_t* masks) {
    const hn::CappedTag<uint32_t, 16> d;
    constexpr uint32_t step = hn::MaxLanes(hn::CappedTag<uint32_t, 16>()) * 4;
    constexpr uint32_t ahead = 12; // jobs: covers a miss in L2 at the rate at which they are carried out
    const uint8_t* planes = tables.planes;
    for (uint32_t j = 0; j < jobs.count; ++j) {
        const uint32_t next = j + ahead;
        for (uint32_t k = 0; k < 3; ++k) {
            for (uint32_t line = 0; line < bytes; line += 64)
                __builtin_prefetch(planes + (jobs.plane[k][next < jobs.count ? next : j] & ~63u) + line);
        }
        const uint32_t e0 = jobs.plane[0][j], e1 = jobs.plane[1][j], e2 = jobs.plane[2][j];
        const auto s0 = hn::Set(d, 0u - (e0 & 1)), s1 = hn::Set(d, 0u - (e1 & 1)),
                   s2 = hn::Set(d, 0u - (e2 & 1));
        const uint8_t* p0 = planes + (e0 & ~63u);
        const uint8_t* p1 = planes + (e1 & ~63u);
        const uint8_t* p2 = planes + (e2 & ~63u);
        uint8_t* mask = masks + jobs.destination[j];
        for (uint32_t i = 0; i < bytes; i += step) {
            const auto load = [&](const uint8_t* p)
                                  HWY_ATTR { return hn::Load(d, reinterpret_cast<const uint32_t*>(p + i)); };
            const auto inside =
                hn::And(hn::And(hn::Xor(load(p0), s0), hn::Xor(load(p1), s1)), hn::Xor(load(p2), s2));
            hn::Store(hn::Or(load(mask), inside), d, reinterpret_cast<uint32_t*>(mask + i));
        }
    }
    jobs.count = 0;
}

void run_jobs(const Tables& tables, JobList& jobs, uint8_t* masks) {
    if (part_bytes(tables.layout) == 64) {
        run_jobs_of<64>(tables, jobs, masks);
    } else {
        run_jobs_of<128>(tables, jobs, masks);
    }
}

void downsample(const uint8_t* mask, uint32_t blocks, uint8_t* counts) {
    const hn::CappedTag<uint16_t, 16> d;
    const hn::RebindToSigned<decltype(d)> ds;
    const hn::Rebind<uint8_t, decltype(d)> bytes;
    for (uint32_t block = 0; block < blocks; block += static_cast<uint32_t>(hn::Lanes(d))) {
        const auto bits = hn::LoadU(d, reinterpret_cast<const uint16_t*>(mask) + block);
        hn::StoreU(hn::DemoteTo(bytes, hn::BitCast(ds, hn::PopulationCount(bits))), bytes, counts + block);
    }
}

constexpr uint32_t column_registers = sh_columns / width;

void integrate_blocks(const Tables& tables, const uint8_t* mask, float* sum) {
    const uint32_t blocks = mask_blocks(tables.layout);
    alignas(64) uint8_t counts[256];
    downsample(mask, blocks, counts);
    V rest[column_registers];
    const float* row = tables.block_weights + size_t(blocks) * sh_columns;
    for (uint32_t i = 0; i < column_registers; ++i)
        rest[i] = hn::Load(df, row + i * width);
    row = tables.block_weights;
    for (uint32_t block = 0; block < blocks; ++block, row += sh_columns) {
        const V count = constant(static_cast<float>(counts[block]));
        for (uint32_t i = 0; i < column_registers; ++i)
            rest[i] = hn::Sub(rest[i], hn::Mul(count, hn::Load(df, row + i * width)));
    }
    for (uint32_t i = 0; i < column_registers; ++i)
        hn::Store(rest[i], df, sum + i * width);
}

// The first `columns` terms, 8, 16 or 32.
template<uint32_t columns>
void integrate_bits(const Tables& tables, const uint8_t* mask, float* sum, Counters& counters) {
    const hn::CappedTag<int16_t, columns> d;
    constexpr uint32_t step = hn::MaxLanes(hn::CappedTag<int16_t, columns>());
    constexpr uint32_t registers = columns / step;
    hn::Vec<decltype(d)> rest[registers];
    for (uint32_t i = 0; i < registers; ++i)
        rest[i] = hn::Load(d, tables.total + i * step);
    const auto subtract = [&](const int16_t* row) HWY_ATTR {
        for (uint32_t i = 0; i < registers; ++i)
            rest[i] = hn::Sub(rest[i], hn::Load(d, row + i * step));
    };
    for (uint32_t first = 0; first < mask_blocks(tables.layout); first += 64) {
        uint64_t full, open;
        classify_blocks(mask + 2 * first, full, open);
        uint64_t partial = ~(full | open);
        counters.blocks_partial += static_cast<uint32_t>(__builtin_popcountll(partial));
        counters.blocks_uniform += 64 - static_cast<uint32_t>(__builtin_popcountll(partial));
        for (; full; full &= full - 1)
            subtract(tables.blocks +
                     size_t(first + static_cast<uint32_t>(__builtin_ctzll(full))) * sh_columns);
        for (; partial; partial &= partial - 1) {
            const uint32_t block = first + static_cast<uint32_t>(__builtin_ctzll(partial));
            uint16_t bits;
            std::memcpy(&bits, mask + 2 * block, 2);
            const int16_t* rows = tables.nibbles + size_t(block) * 4 * 16 * sh_columns;
            for (uint32_t row = 0; row < 4; ++row)
                subtract(rows + (row * 16 + (bits >> (4 * row) & 15)) * sh_columns);
        }
    }
    alignas(64) int16_t integer[columns < width ? width : columns] = {};
    for (uint32_t i = 0; i < registers; ++i)
        hn::Store(rest[i], d, integer + i * step);
    const hn::Rebind<int16_t, Float> narrow;
    for (uint32_t i = 0; i < columns; i += width) {
        const V value = hn::ConvertTo(df, hn::PromoteTo(di, hn::Load(narrow, integer + i)));
        hn::Store(hn::Mul(value, hn::Load(df, tables.scale + i)), df, sum + i);
    }
}

void integrate(const Tables& tables, const uint8_t* masks, uint32_t valid, bool per_block, uint32_t order,
               float local[25][lanes], Counters& counters) {
    const auto bits = order <= 2   ? integrate_bits<8>
                      : order <= 4 ? integrate_bits<16>
                                   : integrate_bits<sh_columns>;
    const uint32_t bytes = mask_bytes(tables.layout), blocks = mask_blocks(tables.layout);
    for (uint32_t lane = 0; lane < lanes; ++lane) {
        alignas(64) float sum[sh_columns] = {};
        if (valid >> lane & 1) {
            const uint8_t* mask = masks + size_t(lane) * bytes;
            if (per_block) {
                integrate_blocks(tables, mask, sum);
                for (uint32_t first = 0; first < blocks; first += 64) {
                    uint64_t full, open;
                    classify_blocks(mask + 2 * first, full, open);
                    const auto uniform = static_cast<uint32_t>(__builtin_popcountll(full | open));
                    counters.blocks_partial += 64 - uniform;
                    counters.blocks_uniform += uniform;
                }
            } else {
                bits(tables, mask, sum, counters);
            }
        }
        for (uint32_t i = 0; i < order * order; ++i)
            local[i][lane] = sum[i];
    }
}

// Bands don't mix: what is not stored is not computed either.
template<uint32_t order>
void rotate_bands(const Batch& batch, const float local[25][lanes], float out[25][lanes]) {
    for (uint32_t lane = 0; lane < lanes; lane += width) {
        const V zero = hn::Zero(df);
        V in[25], turned[25];
        for (uint32_t i = 0; i < 25; ++i)
            in[i] = i < order * order ? hn::Load(df, local[i] + lane) : zero;
        sh_rotate_zy(Constant(), hn::Load(df, batch.axis[2][2] + lane),
                     hn::Sub(zero, hn::Load(df, batch.axis[0][2] + lane)),
                     hn::Load(df, batch.axis[1][1] + lane),
                     hn::Sub(zero, hn::Load(df, batch.axis[1][0] + lane)), in, turned);
        const M valid = mask_of(batch.valid >> lane & chunk_bits);
        for (uint32_t i = 0; i < order * order; ++i)
            hn::Store(hn::IfThenElseZero(valid, turned[i]), df, out[i] + lane);
    }
}

void rotate(const Batch& batch, uint32_t order, const float local[25][lanes], float out[25][lanes]) {
    constexpr decltype(&rotate_bands<1>) by_order[] = {rotate_bands<1>, rotate_bands<2>, rotate_bands<3>,
                                                       rotate_bands<4>, rotate_bands<5>};
    by_order[order - 1](batch, local, out);
}

void shade(const float light[75], uint32_t order, const float* transfer, size_t stride, size_t count,
           float* rgb) {
    // Lanes are the channels: each channel's sum keeps the order of the terms.
    const hn::CappedTag<float, 4> d;
    alignas(16) float rows[25][4];
    for (uint32_t term = 0; term < 25; ++term) {
        for (uint32_t c = 0; c < 4; ++c)
            rows[term][c] = c < 3 ? light[term * 3 + c] : 0.0f;
    }
    for (size_t i = 0; i < count; ++i) {
        const float* t = reinterpret_cast<const float*>(reinterpret_cast<const char*>(transfer) + i * stride);
        auto sum = hn::Zero(d);
        for (uint32_t term = 0; term < order * order; ++term)
            sum = hn::Add(sum, hn::Mul(hn::Load(d, rows[term]), hn::Set(d, t[term])));
        alignas(16) float out[4];
        hn::Store(sum, d, out);
        std::memcpy(rgb + 3 * i, out, 3 * sizeof(float));
    }
}

void evaluate_sh(const float* x, const float* y, const float* z, size_t count, float* out) {
    size_t i = 0;
    const auto evaluate = [&](const float* px, const float* py, const float* pz, V basis[25]) HWY_ATTR {
        sh_basis(Constant(), hn::LoadU(df, px), hn::LoadU(df, py), hn::LoadU(df, pz), basis);
    };
    V basis[25];
    for (; i + width <= count; i += width) {
        evaluate(x + i, y + i, z + i, basis);
        for (uint32_t term = 0; term < 25; ++term)
            hn::StoreU(basis[term], df, out + term * count + i);
    }
    if (i == count) return;
    float rest[3][lanes] = {};
    for (size_t k = 0; i + k < count; ++k) {
        rest[0][k] = x[i + k];
        rest[1][k] = y[i + k];
        rest[2][k] = z[i + k];
    }
    evaluate(rest[0], rest[1], rest[2], basis);
    for (uint32_t term = 0; term < 25; ++term) {
        float values[lanes];
        hn::StoreU(basis[term], df, values);
        std::memcpy(out + term * count + i, values, (count - i) * sizeof(float));
    }
}

constexpr const char* set_name() {
    return HWY_TARGET == HWY_AVX3   ? "avx512"
           : HWY_TARGET == HWY_AVX2 ? "avx2"
           : HWY_TARGET == HWY_NEON ? "neon"
                                    : "sse4";
}

} // namespace

const Kernels table = {
    set_name(),    prepare_batch, select_clusters, cluster_jobs,    both_sides_jobs, fading_cluster_jobs,
    triangle_jobs, fan_jobs,      select_along,    triangles_along, count_crossings, run_jobs,
    integrate,     rotate,        downsample,      shade,           evaluate_sh};

} // namespace HWY_NAMESPACE
} // namespace nusselt::kernels
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace nusselt::kernels {

const Kernels* simd_kernels(Set set) {
#include "kernels/simd_sets.inl"
}

} // namespace nusselt::kernels
#endif
