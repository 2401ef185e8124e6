#include "tools/compare/grid.h"

#include "tools/compare/widest.h"
#include "tools/trace/sh.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <numbers>
#include <utility>

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

struct Point {
    double u, v;
};

// The cell among those around (column, row) whose sample is nearest to a direction.
size_t nearest_cell(const SampleGrid& grid, int column, int row, double x, double y, double z) {
    constexpr int window = 2;
    const int side = static_cast<int>(grid.side);
    size_t nearest = 0;
    double most = -2;
    for (int r = std::max(row - window, 0); r <= std::min(row + window, side - 1); ++r) {
        for (int c = std::max(column - window, 0); c <= std::min(column + window, side - 1); ++c) {
            const auto cell = static_cast<size_t>((r / 4 * (side / 4) + c / 4) * 16 + r % 4 * 4 + c % 4);
            const double cosine = x * grid.x[cell] + y * grid.y[cell] + z * grid.z[cell];
            if (cosine > most) {
                most = cosine;
                nearest = cell;
            }
        }
    }
    return nearest;
}

// `place` maps the unit square to the disk and says whether the point counts; `part` is the part of the disk
// that the whole square stands for; `sample` says where in the square a cell's sample lies. A cell weighs
// itself, or with `by_nearness` all that is nearer to its sample than to any other.
template<class Place, class Sample>
SampleGrid make_grid(uint32_t side, double part, const Place& place, const Sample& sample, bool by_nearness) {
    SampleGrid grid;
    grid.side = side;
    const size_t cells = size_t{side} * side;
    grid.weight.assign(cells * 32, 0.0f);
    grid.weights.assign(cells * 25, 0.0);
    grid.block.assign(cells * 2, 0.0f);
    const double fine = 1.0 / (double{supersamples} * side);
    const auto column_of = [&](size_t cell) { return 4 * (cell / 16 % (side / 4)) + cell % 4; };
    const auto row_of = [&](size_t cell) { return 4 * (cell / 16 / (side / 4)) + cell % 16 / 4; };
    for (size_t cell = 0; cell < cells; ++cell) {
        const Point at = sample(static_cast<uint32_t>(column_of(cell)), static_cast<uint32_t>(row_of(cell)));
        double x = 0, y = 0;
        const bool used = place(at.u, at.v, x, y);
        grid.used.push_back(used);
        grid.x.push_back(static_cast<float>(used ? x : 0));
        grid.y.push_back(static_cast<float>(used ? y : 0));
        grid.z.push_back(static_cast<float>(used ? height(x, y) : 1));
    }
    for (size_t cell = 0; cell < cells; ++cell) {
        if (!grid.used[cell]) continue;
        const auto column = static_cast<double>(column_of(cell)), row = static_cast<double>(row_of(cell));
        double x = 0, y = 0;
        for (uint32_t j = 0; j < supersamples * supersamples; ++j) {
            const double u = column / side + (j % supersamples + 0.5) * fine,
                         v = row / side + (j / supersamples + 0.5) * fine;
            if (!place(u, v, x, y)) continue;
            double basis[25];
            const double z = height(x, y);
            sh_basis(x, y, z, basis);
            const size_t owner =
                by_nearness ? nearest_cell(grid, static_cast<int>(column), static_cast<int>(row), x, y, z)
                            : cell;
            for (size_t i = 0; i < 25; ++i)
                grid.weights[owner * 25 + i] += basis[i] * part * fine * fine;
        }
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

namespace {

bool to_disk(double u, double v, double& x, double& y) {
    concentric(u, v, x, y);
    return true;
}

// Where along its cell, in [0, 1), a row or column has its samples.
double shift_of(uint32_t line) {
    const double turns = (line + 0.5) * (std::numbers::phi - 1);
    return turns - std::floor(turns);
}

} // namespace

SampleGrid concentric_grid(uint32_t side) {
    const auto centre = [&](uint32_t column, uint32_t row) {
        return Point{(column + 0.5) / side, (row + 0.5) / side};
    };
    return make_grid(side, 1, to_disk, centre, false);
}

SampleGrid scattered_grid(uint32_t side) {
    const auto sample = [&](uint32_t column, uint32_t row) {
        return Point{(column + shift_of(row)) / side, (row + shift_of(column)) / side};
    };
    return make_grid(side, 1, to_disk, sample, true);
}

SampleGrid mask_grid(uint32_t side) {
    const bool quarters = side >= 64;
    const auto sample = [&](uint32_t column, uint32_t row) {
        const double far = side - mask_rim, first = side / 2.0 + mask_middle;
        // Back to the part whose samples are as they are, and the sample's place with the cell again.
        uint32_t turns = 0;
        for (; 2 * row < side || (quarters && 2 * column < side); turns += quarters ? 1 : 2) {
            if (!quarters) column = std::exchange(row, side - 1 - column);
            column = std::exchange(row, side - 1 - column);
        }
        const double u = std::clamp(column + shift_of(row), quarters ? first : mask_rim, far);
        const double v = std::clamp(row + shift_of(column), first, far);
        Point at{u / side, v / side};
        for (; turns; --turns)
            at = {1 - at.v, at.u};
        return at;
    };
    return make_grid(side, 1, to_disk, sample, true);
}

SampleGrid disk_grid(uint32_t side) {
    const auto place = [](double u, double v, double& x, double& y) {
        x = 2 * u - 1;
        y = 2 * v - 1;
        return x * x + y * y <= 1;
    };
    const auto centre = [&](uint32_t column, uint32_t row) {
        return Point{(column + 0.5) / side, (row + 0.5) / side};
    };
    return make_grid(side, 4 / std::numbers::pi, place, centre, false);
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
