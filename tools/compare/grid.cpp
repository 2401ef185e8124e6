#include "tools/compare/grid.h"

#include "tools/compare/widest.h"
#include "tools/trace/sh.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <numbers>

namespace nusselt::tools {

namespace {

constexpr uint32_t supersamples = 24; // along a side of a cell

void concentric(double u, double v, double& x, double& y) {
    constexpr double quarter = std::numbers::pi / 4;
    const double a = 2 * u - 1, b = 2 * v - 1;
    x = y = 0;
    if (std::abs(a) > std::abs(b)) {
        x = a * std::cos(quarter * (b / a));
        y = a * std::sin(quarter * (b / a));
    } else if (b != 0) {
        x = b * std::sin(quarter * (a / b));
        y = b * std::cos(quarter * (a / b));
    }
}

double height(double x, double y) {
    return std::sqrt(std::max(0.0, 1 - x * x - y * y));
}

// `place` maps the unit square to the disk and says whether the point counts; `part` is the part of the disk
// that the whole square stands for.
template<class Place>
SampleGrid make_grid(uint32_t side, double part, const Place& place) {
    SampleGrid grid;
    grid.side = side;
    const size_t cells = size_t{side} * side;
    grid.weight.assign(cells * 32, 0.0f);
    grid.weights.assign(cells * 25, 0.0);
    grid.block.assign(cells * 2, 0.0f);
    const double fine = 1.0 / (double{supersamples} * side);
    for (size_t cell = 0; cell < cells; ++cell) {
        const size_t blocks = side / 4, b = cell / 16, k = cell % 16;
        const double row = static_cast<double>(4 * (b / blocks) + k / 4),
                     column = static_cast<double>(4 * (b % blocks) + k % 4);
        double x = 0, y = 0;
        const bool used = place((column + 0.5) / side, (row + 0.5) / side, x, y);
        grid.used.push_back(used);
        grid.x.push_back(static_cast<float>(used ? x : 0));
        grid.y.push_back(static_cast<float>(used ? y : 0));
        grid.z.push_back(static_cast<float>(used ? height(x, y) : 1));
        if (!used) continue;
        double sum[25] = {};
        for (uint32_t j = 0; j < supersamples * supersamples; ++j) {
            const double u = column / side + (j % supersamples + 0.5) * fine,
                         v = row / side + (j / supersamples + 0.5) * fine;
            if (!place(u, v, x, y)) continue;
            double basis[25];
            sh_basis(x, y, height(x, y), basis);
            for (int i = 0; i < 25; ++i)
                sum[i] += basis[i];
        }
        for (size_t i = 0; i < 25; ++i)
            grid.weights[cell * 25 + i] = sum[i] * part * fine * fine;
    }
    // What the supersampling misses, and what unused cells hold, is spread evenly over the used ones: a
    // hemisphere that is all blocked is all dark.
    open_transfer(0, 0, 1, grid.total);
    const auto count = static_cast<double>(std::count(grid.used.begin(), grid.used.end(), 1));
    for (size_t i = 0; i < 25; ++i) {
        double sum = 0;
        for (size_t cell = 0; cell < cells; ++cell)
            sum += grid.weights[cell * 25 + i];
        for (size_t cell = 0; cell < cells; ++cell) {
            if (!grid.used[cell]) continue;
            double& weight = grid.weights[cell * 25 + i];
            weight += (grid.total[i] - sum) / count;
            grid.weight[cell * 32 + i] = static_cast<float>(weight);
        }
        for (size_t cell = 0; cell < cells; ++cell)
            grid.block[cell / 16 * 32 + i] += grid.weight[cell * 32 + i];
    }
    return grid;
}

constexpr int degree_begin[6] = {0, 1, 4, 9, 16, 25};

// Rotation by a quarter turn about +x in each degree: coefficients of f(X^-1 s) from those of f.
struct QuarterTurn {
    double matrix[25][25] = {};
    float narrow[25][25] = {};

    QuarterTurn() {
        // Exact for the products of two basis functions: Gauss-Legendre in z, even steps in azimuth.
        constexpr int nodes = 8, steps = 16;
        for (int k = 0; k < nodes; ++k) {
            double z = std::cos(std::numbers::pi * (k + 0.75) / (nodes + 0.5)), slope = 0;
            for (int iteration = 0; iteration < 20; ++iteration) {
                double before = 1, now = z;
                for (int n = 2; n <= nodes; ++n) {
                    const double next = ((2 * n - 1) * z * now - (n - 1) * before) / n;
                    before = now;
                    now = next;
                }
                slope = nodes * (z * now - before) / (z * z - 1);
                z -= now / slope;
            }
            const double weight = 2 / ((1 - z * z) * slope * slope) * 2 * std::numbers::pi / steps;
            for (int step = 0; step < steps; ++step) {
                const double r = std::sqrt(1 - z * z), p = 2 * std::numbers::pi * step / steps;
                const double x = r * std::cos(p), y = r * std::sin(p);
                double from[25], to[25];
                sh_basis(x, y, z, from);
                sh_basis(x, -z, y, to); // y turns to z, z to -y
                for (int degree = 0; degree < 5; ++degree)
                    for (int i = degree_begin[degree]; i < degree_begin[degree + 1]; ++i)
                        for (int j = degree_begin[degree]; j < degree_begin[degree + 1]; ++j)
                            matrix[i][j] += weight * to[i] * from[j];
            }
        }
        for (auto& row : matrix)
            for (double& value : row)
                if (std::abs(value) < 1e-12) value = 0;
        for (int i = 0; i < 25; ++i)
            for (int j = 0; j < 25; ++j)
                narrow[i][j] = static_cast<float>(matrix[i][j]);
    }
};

const QuarterTurn& quarter_turn() {
    static const QuarterTurn turn;
    return turn;
}

// About +z by angle p: m and -m of a degree mix by the angle m p.
template<class Number, size_t lanes>
NUSSELT_INLINE void turn_z(const Number* cosine, const Number* sine, Number (*c)[lanes]) {
    Number cm[lanes], sm[lanes];
    for (size_t k = 0; k < lanes; ++k) {
        cm[k] = cosine[k];
        sm[k] = sine[k];
    }
    for (int m = 1; m < 5; ++m) {
        for (int l = m; l < 5; ++l) {
            Number *plus = c[l * (l + 1) + m], *minus = c[l * (l + 1) - m];
            for (size_t k = 0; k < lanes; ++k) {
                const Number a = plus[k], b = minus[k];
                plus[k] = a * cm[k] - b * sm[k];
                minus[k] = a * sm[k] + b * cm[k];
            }
        }
        for (size_t k = 0; k < lanes; ++k) {
            const Number next = cm[k] * cosine[k] - sm[k] * sine[k];
            sm[k] = sm[k] * cosine[k] + cm[k] * sine[k];
            cm[k] = next;
        }
    }
}

// Many of the entries are zero: the ones that count, in order.
struct SparseTurn {
    struct Entry {
        uint8_t row, column;
        float forth, back;
    };
    std::vector<Entry> entries;

    SparseTurn() {
        for (uint8_t i = 0; i < 25; ++i)
            for (uint8_t j = 0; j < 25; ++j)
                if (quarter_turn().matrix[i][j] != 0 || quarter_turn().matrix[j][i] != 0)
                    entries.push_back({i, j, quarter_turn().narrow[i][j], quarter_turn().narrow[j][i]});
    }
};

template<bool back>
NUSSELT_INLINE void turn_x(const SparseTurn& turn, const float (*in)[16], float (*out)[16]) {
    for (int i = 0; i < 25; ++i)
        for (int k = 0; k < 16; ++k)
            out[i][k] = 0;
    for (const SparseTurn::Entry& entry : turn.entries) {
        const float factor = back ? entry.back : entry.forth;
        const float* from = in[entry.column];
        float* to = out[entry.row];
        for (int k = 0; k < 16; ++k)
            to[k] += factor * from[k];
    }
}

NUSSELT_INLINE void rotate_body(const SparseTurn& turn, const LaneRotation& r, const float (*in)[16],
                                float (*out)[16]) {
    // Ry(a) = X^-1 Rz(a) X with X the quarter turn that brings +y to +z.
    alignas(64) float a[25][16];
    turn_x<false>(turn, in, a);
    turn_z(r.cos_a, r.sin_a, a);
    turn_x<true>(turn, a, out);
    turn_z(r.cos_p, r.sin_p, out);
}

void rotate_any(const SparseTurn& turn, const LaneRotation& r, const float (*in)[16], float (*out)[16]) {
    rotate_body(turn, r, in, out);
}
NUSSELT_AVX2 void rotate_avx2(const SparseTurn& turn, const LaneRotation& r, const float (*in)[16],
                              float (*out)[16]) {
    rotate_body(turn, r, in, out);
}

} // namespace

SampleGrid concentric_grid(uint32_t side) {
    return make_grid(side, 1, [](double u, double v, double& x, double& y) {
        concentric(u, v, x, y);
        return true;
    });
}

SampleGrid disk_grid(uint32_t side) {
    return make_grid(side, 4 / std::numbers::pi, [](double u, double v, double& x, double& y) {
        x = 2 * u - 1;
        y = 2 * v - 1;
        return x * x + y * y <= 1;
    });
}

void rotate_lanes(const LaneRotation& rotation, const float in[25][16], float out[25][16]) {
    static const SparseTurn turn;
    static const auto chosen = has_avx2() ? rotate_avx2 : rotate_any;
    chosen(turn, rotation, in, out);
}

void rotate_to_normal(double nx, double ny, double nz, const double in[25], double out[25]) {
    const double across = std::sqrt(nx * nx + ny * ny);
    const double cosine = across > 0 ? nx / across : 1, sine = across > 0 ? ny / across : 0;
    const QuarterTurn& turn = quarter_turn();
    double a[25][1] = {}, b[25][1] = {};
    for (int i = 0; i < 25; ++i)
        for (int j = 0; j < 25; ++j)
            a[i][0] += turn.matrix[i][j] * in[j];
    turn_z(&nz, &across, a);
    for (int i = 0; i < 25; ++i)
        for (int j = 0; j < 25; ++j)
            b[i][0] += turn.matrix[j][i] * a[j][0];
    turn_z(&cosine, &sine, b);
    for (int i = 0; i < 25; ++i)
        out[i] = b[i][0];
}

} // namespace nusselt::tools
