#include "tests/stress/oracle.h"

#include <algorithm>
#include <bit>
#include <cmath>

namespace nusselt::test {

namespace {

using kernels::Batch;
using kernels::MaskLayout;

template<class Real>
using Triple = std::array<Real, 3>;

template<class Real>
Triple<Real> cross(const Triple<Real>& a, const Triple<Real>& b) {
    return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}

template<class Real>
Real dot(const Triple<Real>& a, const Triple<Real>& b) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

// Inside, as the apex at the receiver sees it: at or below all three edges' planes when the triangle is
// counter- clockwise seen from outside, at or above them when it is seen from behind.
template<class Real, class Value>
bool inside(const Triple<Real> normal[3], bool behind, const Value& along) {
    for (int k = 0; k < 3; ++k) {
        const auto height = along(normal[k]);
        if (behind ? height < 0 : height > 0) return false;
    }
    return true;
}

} // namespace

Samples::Samples(const MaskLayout& layout) : bits(kernels::mask_bits(layout)), used(bits) {
    for (int k = 0; k < 3; ++k) {
        whole[k].resize(bits);
        direction[k].resize(bits);
    }
    for (uint32_t bit = 0; bit < bits; ++bit) {
        double d[3];
        used[bit] = kernels::sample_direction(layout, bit, d);
        for (int k = 0; k < 3; ++k) {
            whole[k][bit] = used[bit] ? int32_t(std::lround(d[k] * 0x1p24)) : 0;
            direction[k][bit] = whole[k][bit] * 0x1p-24;
        }
    }
}

template<class Real>
void cover(const Samples& samples, const std::array<std::array<Real, 3>, 3>& local, uint8_t* mask) {
    const Triple<Real> normal[3] = {cross(local[0], local[1]), cross(local[1], local[2]),
                                    cross(local[2], local[0])};
    const Real volume = dot(normal[0], local[2]);
    if (!(std::fabs(volume) > 0)) return;
    for (uint32_t bit = 0; bit < samples.bits; ++bit) {
        const Triple<Real> d{Real(samples.direction[0][bit]), Real(samples.direction[1][bit]),
                             Real(samples.direction[2][bit])};
        if (samples.used[bit] && inside(normal, volume > 0, [&](const Triple<Real>& n) { return dot(n, d); }))
            mask[bit / 8] = uint8_t(mask[bit / 8] | 1u << bit % 8);
    }
}

template void cover<float>(const Samples&, const std::array<std::array<float, 3>, 3>&, uint8_t*);
template void cover<double>(const Samples&, const std::array<std::array<double, 3>, 3>&, uint8_t*);

void cover_exactly(const Samples& samples, const std::array<std::array<int32_t, 3>, 3>& local,
                   uint8_t* mask) {
    __extension__ using Wide = __int128;
    std::array<std::array<int64_t, 3>, 3> corner{};
    for (int i = 0; i < 3; ++i)
        std::copy(local[i].begin(), local[i].end(), corner[i].begin());
    const Triple<int64_t> normal[3] = {cross(corner[0], corner[1]), cross(corner[1], corner[2]),
                                       cross(corner[2], corner[0])};
    const auto along = [](const Triple<int64_t>& n, const Triple<int64_t>& d) {
        return Wide(n[0]) * d[0] + Wide(n[1]) * d[1] + Wide(n[2]) * d[2];
    };
    const Wide volume = along(normal[0], corner[2]);
    if (volume == 0) return;
    for (uint32_t bit = 0; bit < samples.bits; ++bit) {
        const Triple<int64_t> d{samples.whole[0][bit], samples.whole[1][bit], samples.whole[2][bit]};
        if (samples.used[bit] &&
            inside(normal, volume > 0, [&](const Triple<int64_t>& n) { return along(n, d); }))
            mask[bit / 8] = uint8_t(mask[bit / 8] | 1u << bit % 8);
    }
}

std::array<double, 3> local_corner(const Batch& batch, uint32_t lane, const std::array<float, 3>& corner) {
    std::array<double, 3> from{}, out{};
    for (uint32_t k = 0; k < 3; ++k)
        from[k] = double(corner[k]) - double(batch.position[k][lane]);
    for (uint32_t row = 0; row < 3; ++row) {
        for (uint32_t k = 0; k < 3; ++k)
            out[row] += double(batch.axis[row][k][lane]) * from[k];
    }
    return out;
}

std::array<std::array<double, 3>, 3> local_corners(const Batch& batch, uint32_t lane,
                                                   const Corners& corners) {
    return {local_corner(batch, lane, corners[0]), local_corner(batch, lane, corners[1]),
            local_corner(batch, lane, corners[2])};
}

Side side_of(const std::array<std::array<double, 3>, 3>& local, double margin) {
    Triple<double> u{}, v{};
    double far = 0;
    for (int k = 0; k < 3; ++k) {
        u[k] = local[1][k] - local[0][k];
        v[k] = local[2][k] - local[0][k];
        far = std::max(far, dot(local[k], local[k]));
    }
    const Triple<double> n = cross(u, v);
    const double length = std::sqrt(dot(n, n));
    if (!(length > 0)) return Side::edge_on;
    const double height = -dot(n, local[0]) / length;
    if (std::fabs(height) <= margin * std::sqrt(far)) return Side::edge_on;
    return height > 0 ? Side::front : Side::back;
}

uint32_t count_bits(const uint8_t* mask, uint32_t bytes) {
    uint32_t count = 0;
    for (uint32_t i = 0; i < bytes; ++i)
        count += uint32_t(std::popcount(mask[i]));
    return count;
}

} // namespace nusselt::test
