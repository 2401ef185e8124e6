#include "kernels/scalar.h"

#include <algorithm>
#include <cstring>

namespace nusselt::kernels {

namespace {

constexpr uint32_t most_words = mask_bits(fine_layout) / 64;

// The zenith has no azimuth of its own; any will do that both of its arcs take.
Vec around(const Vec& p) {
    return p.x == 0 && p.y == 0 ? Vec{1, 0, p.z} : p;
}

Vec unit(const Vec& v) {
    const float length = std::sqrt(v.x * v.x + v.y * v.y + v.z * v.z);
    return {v.x / length, v.y / length, v.z / length};
}

struct Wedge {
    uint32_t entry[3];
    bool clockwise;
};

// Positive where q lies counter-clockwise of p around the zenith.
float turn(const Vec& p, const Vec& q) {
    return p.x * q.y - p.y * q.x;
}

// An arc through the zenith, which takes half of the hemisphere: on either side, and here counter-clockwise.
bool is_clockwise(const Vec& from, const Vec& to) {
    return turn(from, to) < 0;
}
bool has_width(const Vec& from, const Vec& to) {
    return turn(from, to) != 0 || from.x * to.x + from.y * to.y < 0;
}

// The spherical triangle (a, b, nadir), as in fan_jobs; false where it holds no sample.
bool find_wedge(const MaskLayout& layout, const Vec& a, const Vec& b, Wedge& out) {
    if (!(a.z > 0 || b.z > 0)) return false;
    const Vec from = around(a), to = around(b);
    if (!has_width(from, to)) return false;
    out.clockwise = is_clockwise(from, to);
    const Vec normals[3] = {cross(a, b), {-to.y, to.x, 0}, {from.y, -from.x, -0.0f}};
    for (uint32_t k = 0; k < 3; ++k) {
        const uint32_t e = plane_entry(layout, normals[k]);
        if (e & entry_invalid) return false;
        out.entry[k] = out.clockwise ? e ^ entry_complement(layout) : e;
    }
    return true;
}

// Whether it holds a direction: 1, or -1 where the arc runs clockwise.
int holds(const Vec& a, const Vec& b, const Vec& direction) {
    const Vec from = around(a), to = around(b), n = cross(a, b);
    if (!has_width(from, to)) return 0;
    const bool clockwise = is_clockwise(from, to);
    const Vec &first = clockwise ? to : from, &last = clockwise ? from : to;
    const float over = n.x * direction.x + n.y * direction.y + n.z * direction.z;
    if (!(turn(first, direction) >= 0 && turn(direction, last) > 0)) return 0;
    if (clockwise ? over < 0 : over > 0) return 0;
    return clockwise ? -1 : 1;
}

// A direction in front of the widest triangle, a hundredth of a radian from the middle of its arc.
template<class Local>
Vec find_outside(const Local& local, uint32_t count) {
    Vec outside{0, 0, 1};
    float widest = 0;
    for (uint32_t i = 0; i < count; ++i) {
        const Vec a = unit(local(i)), b = unit(local(i + 1 < count ? i + 1 : 0)), n = cross(a, b);
        const float width = n.x * n.x + n.y * n.y + n.z * n.z;
        if (!(width > widest)) continue;
        widest = width;
        const Vec middle = unit({a.x + b.x, a.y + b.y, a.z + b.z}), front = unit(n);
        outside = {middle.x + 0.01f * front.x, middle.y + 0.01f * front.y, middle.z + 0.01f * front.z};
    }
    return outside;
}

} // namespace

void fill_fan(const Tables& tables, const Batch& batch, uint32_t lane, const float* const* link,
              uint32_t count, uint8_t* mask) {
    const uint32_t words = mask_bytes(tables.layout) / 8, of_part = part_bytes(tables.layout);
    const auto local = [&](uint32_t i) {
        return to_local(batch, lane, {link[i][0], link[i][1], link[i][2]});
    };
    const Vec outside = find_outside(local, count);
    int winding = 0;
    for (uint32_t i = 0; i < count; ++i)
        winding += holds(local(i), local(i + 1 < count ? i + 1 : 0), outside);

    // How often the link winds around each sample, less how often around `outside`; modulo 4, a bit in either
    // array.
    uint64_t ones[most_words], twos[most_words], under[most_words] = {};
    std::fill_n(ones, words, 0 - uint64_t(-winding & 1));
    std::fill_n(twos, words, 0 - uint64_t(-winding >> 1 & 1));
    for (uint32_t i = 0; i < count; ++i) {
        const Vec a = local(i), b = local(i + 1 < count ? i + 1 : 0);
        Wedge wedge;
        if (!find_wedge(tables.layout, a, b, wedge)) continue;
        const uint64_t borrow = wedge.clockwise ? ~uint64_t(0) : 0;
        const uint64_t certain = is_upright(a) || is_upright(b) ? 0 : ~uint64_t(0);
        for (uint32_t w = 0; w < words; ++w) {
            uint64_t inside = ~uint64_t(0);
            for (const uint32_t entry : wedge.entry) {
                const uint32_t e = entry_of_part(tables.layout, entry, 8 * w / of_part);
                uint64_t plane;
                std::memcpy(&plane, tables.planes + (e & ~63u) + 8 * w % of_part, 8);
                inside &= plane ^ (0 - uint64_t(e & 1));
            }
            twos[w] ^= (ones[w] ^ borrow) & inside;
            ones[w] ^= inside;
            under[w] |= inside & certain;
        }
    }
    for (uint32_t w = 0; w < words; ++w) {
        uint64_t word;
        std::memcpy(&word, mask + 8 * w, 8);
        word |= ones[w] | twos[w] | under[w];
        std::memcpy(mask + 8 * w, &word, 8);
    }
}

} // namespace nusselt::kernels
