#include "tests/kernels/fixture.h"

#include <algorithm>
#include <cfloat>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <map>

namespace nusselt::test {

using namespace kernels;

namespace {

struct OwnedTables {
    AlignedArray<uint8_t> planes;
    AlignedArray<int16_t> nibbles, blocks, total;
    AlignedArray<float> scale, block_weights;
    Tables tables;
};

OwnedTables make_tables(const MaskLayout& l) {
    OwnedTables o{aligned_array<uint8_t>(plane_table_bytes(l)),
                  aligned_array<int16_t>(nibble_table_size(l)),
                  aligned_array<int16_t>(block_table_size(l)),
                  aligned_array<int16_t>(sh_columns),
                  aligned_array<float>(sh_columns),
                  aligned_array<float>(block_table_size(l) + sh_columns),
                  {}};
    build_plane_table(l, 0, table_cells(l), o.planes.get());
    std::vector<SampleBit> bits(mask_bits(l));
    build_weights(l, bits.data(), o.nibbles.get(), o.blocks.get(), o.total.get(), o.scale.get(),
                  o.block_weights.get());
    o.tables = {l,
                o.planes.get(),
                o.nibbles.get(),
                o.blocks.get(),
                o.total.get(),
                o.scale.get(),
                o.block_weights.get(),
                horizon_tangent(l)};
    return o;
}

} // namespace

const Tables& tables_of(const MaskLayout& layout) {
    static std::map<std::array<uint32_t, 4>, OwnedTables> made;
    const std::array<uint32_t, 4> key{uint32_t(layout.samples), uint32_t(layout.planes), layout.side,
                                      layout.plane_cells};
    auto found = made.find(key);
    if (found == made.end()) found = made.emplace(key, make_tables(layout)).first;
    return found->second.tables;
}

std::vector<uint8_t> mask_of_cell(const MaskLayout& layout, uint32_t cell) {
    const uint8_t* planes = tables_of(layout).planes;
    std::vector<uint8_t> mask(mask_bytes(layout));
    if (layout.planes == PlaneMap::cube) {
        std::copy_n(planes + size_t(cell) * mask.size(), mask.size(), mask.begin());
        return mask;
    }
    // Halves: y < 0, then y > 0 as it is. Quarters against the clock from x, y < 0; the third as it is.
    const bool quarters = layout.side == 64;
    const uint32_t row = layout.plane_cells, last = row - 1, parts = quarters ? 4 : 2;
    const size_t bytes = mask.size() / parts;
    for (uint32_t part = 0; part < parts; ++part) {
        const uint32_t turns = quarters ? (part + 2) % 4 : part ? 0 : 2;
        uint32_t u = cell % row, v = cell / row;
        for (uint32_t turn = 0; turn < turns; ++turn) { // the plane turned back by a quarter
            const uint32_t from = u;
            u = last - v;
            v = from;
        }
        std::copy_n(planes + (size_t(v) * row + u) * bytes, bytes, mask.begin() + ptrdiff_t(part * bytes));
    }
    return mask;
}

float Random::any_float() {
    const uint32_t bits = uint32_t(engine());
    float value;
    std::memcpy(&value, &bits, 4);
    return value;
}

float Random::frame_float() {
    for (;;) {
        const float value = any_float();
        if (!(std::fabs(value) > 1 && std::isfinite(value))) return value;
    }
}

void Random::direction(float out[3]) {
    float square;
    do {
        square = 0;
        for (int k = 0; k < 3; ++k) {
            out[k] = between(-1, 1);
            square += out[k] * out[k];
        }
    } while (square < 0.01f || square > 1);
    for (int k = 0; k < 3; ++k)
        out[k] /= std::sqrt(square);
}

void random_batch(Random& random, bool hostile, float spread, BatchInput& out) {
    std::memset(&out, 0, sizeof(out));
    float centre[3], axis[3];
    const float size = random.between(0.001f, 0.2f);
    for (float& c : centre)
        c = random.between(-0.8f, 0.8f);
    random.direction(axis);
    for (uint32_t lane = 0; lane < lanes; ++lane) {
        float turn[3];
        random.direction(turn);
        for (uint32_t k = 0; k < 3; ++k) {
            out.batch.position[k][lane] = centre[k] + random.between(-size, size);
            out.normal[k][lane] = axis[k] + turn[k] * spread * float(random.unit());
        }
    }
    out.batch.valid = 0xFFFF;
    if (!hostile) return;
    if (random.one_in(2)) out.batch.valid = uint32_t(random.engine()) & 0xFFFF;
    for (uint32_t lane = 0; lane < lanes; ++lane) {
        const uint32_t kind = random.below(24);
        if (kind < 3) { // on an axis
            for (uint32_t k = 0; k < 3; ++k)
                out.normal[k][lane] = k == kind ? (random.one_in(2) ? 1.0f : -1.0f) : 0.0f;
        } else if (kind == 3) { // whole numbers of a grid
            for (uint32_t k = 0; k < 3; ++k)
                out.batch.position[k][lane] = std::floor(out.batch.position[k][lane] * 4) / 4;
        } else if (kind == 4) {
            out.normal[random.below(3)][lane] = random.any_float();
        } else if (kind == 5) {
            const float bad[] = {NAN, INFINITY, -INFINITY};
            (random.one_in(2) ? out.normal : out.batch.position)[random.below(3)][lane] =
                bad[random.below(3)];
        } else if (kind == 6) {
            for (uint32_t k = 0; k < 3; ++k)
                out.normal[k][lane] = random.one_in(2) ? 0.0f : -0.0f;
        } else if (kind == 7) {
            const float scale = std::ldexp(1.0f, int(random.below(250)) - 130);
            for (uint32_t k = 0; k < 3; ++k)
                out.normal[k][lane] *= scale;
        } else if (kind == 8 && lane > 0) { // at one place
            for (uint32_t k = 0; k < 3; ++k)
                out.batch.position[k][lane] = out.batch.position[k][lane - 1];
        } else if (kind == 9) { // near the poles of the tangent frame
            out.normal[0][lane] = random.between(-1, 1) * std::ldexp(1.0f, -int(random.below(140)));
            out.normal[1][lane] = random.between(-1, 1) * std::ldexp(1.0f, -int(random.below(140)));
            out.normal[2][lane] = random.one_in(2) ? 1.0f : -1.0f;
        }
    }
}

namespace {

bool finite_point(const float* p) {
    return std::isfinite(p[0]) && std::isfinite(p[1]) && std::isfinite(p[2]);
}

void fill_bounds(ClusterInput& c) {
    const uint32_t count = c.view.triangle_count, slots = triangle_slots(count);
    c.bounds = aligned_array<float>(8 * slots + 16);
    float* const out = c.bounds.get();
    std::fill(out + 7 * slots, out + 8 * slots, -FLT_MAX);
    for (uint32_t t = 0; t < count; ++t) {
        const float* p[3];
        for (uint32_t k = 0; k < 3; ++k)
            p[k] = c.points.get() + 4 * c.vertices[c.triangles[8 * t + k]];
        if (!finite_point(p[0]) || !finite_point(p[1]) || !finite_point(p[2])) continue;
        float u[3], v[3];
        for (uint32_t k = 0; k < 3; ++k) {
            u[k] = p[1][k] - p[0][k];
            v[k] = p[2][k] - p[0][k];
        }
        const float n[3] = {u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]};
        const float area = n[0] * n[0] + n[1] * n[1] + n[2] * n[2];
        if (!(area >= FLT_MIN)) continue;
        const float length = std::sqrt(area);
        float centre[3], far = 0, plane = 0;
        for (uint32_t k = 0; k < 3; ++k) {
            out[k * slots + t] = n[k] / length;
            plane += n[k] / length * p[0][k];
            centre[k] =
                0.5f * (std::min({p[0][k], p[1][k], p[2][k]}) + std::max({p[0][k], p[1][k], p[2][k]}));
            out[(4 + k) * slots + t] = centre[k];
        }
        for (const float* corner : p) {
            float square = 0;
            for (uint32_t k = 0; k < 3; ++k)
                square += (corner[k] - centre[k]) * (corner[k] - centre[k]);
            far = std::max(far, square);
        }
        out[3 * slots + t] = plane;
        out[7 * slots + t] = std::sqrt(far);
    }
    c.view.bounds = out;
    float low[3] = {FLT_MAX, FLT_MAX, FLT_MAX}, high[3] = {-FLT_MAX, -FLT_MAX, -FLT_MAX};
    bool any = false;
    for (const uint32_t v : c.vertices) {
        const float* p = c.points.get() + 4 * v;
        if (!finite_point(p)) continue;
        any = true;
        for (uint32_t k = 0; k < 3; ++k) {
            low[k] = std::min(low[k], p[k]);
            high[k] = std::max(high[k], p[k]);
        }
    }
    float far = 0;
    for (uint32_t k = 0; k < 3; ++k)
        c.view.centre[k] = any ? 0.5f * low[k] + 0.5f * high[k] : 0.0f;
    for (const uint32_t v : c.vertices) {
        const float* p = c.points.get() + 4 * v;
        if (!finite_point(p)) continue;
        float square = 0;
        for (uint32_t k = 0; k < 3; ++k)
            square += (p[k] - c.view.centre[k]) * (p[k] - c.view.centre[k]);
        far = std::max(far, square);
    }
    c.view.radius = std::sqrt(far);
}

} // namespace

void random_cluster(Random& random, const Batch& batch, bool hostile, ClusterInput& out) {
    const uint32_t across = 1 + random.below(5), down = 1 + random.below(5);
    const uint32_t columns = across + 1;
    const uint32_t count = columns * (down + 1);
    out = {};
    const uint32_t first = random.below(5); // the cluster isn't the first in its mesh
    out.points = aligned_array<float>(4 * (count + first));
    float x[3], y[3], centre[3];
    random.direction(x);
    random.direction(y);
    const float size = std::exp(random.between(-5, 0)), distance = std::exp(random.between(-5, 0.5f));
    float towards[3];
    random.direction(towards);
    const uint32_t lane = random.below(lanes);
    for (uint32_t k = 0; k < 3; ++k)
        centre[k] = batch.position[k][lane] + towards[k] * distance;
    for (uint32_t v = 0; v < count; ++v) {
        float* p = out.points.get() + 4 * (v + first);
        const float u = size * (float(v % columns) / float(columns) - 0.5f);
        const float w = size * (float(v / columns) / float(down + 1) - 0.5f);
        for (uint32_t k = 0; k < 3; ++k)
            p[k] = centre[k] + x[k] * u + y[k] * w + random.between(-0.1f, 0.1f) * size;
        out.vertices.push_back(v + first);
    }
    if (hostile) {
        for (uint32_t v = 0; v < count; ++v) {
            float* p = out.points.get() + 4 * (v + first);
            const uint32_t kind = random.below(20);
            const uint32_t other = random.below(lanes);
            if (kind < 2) { // a corner at a receiver
                for (uint32_t k = 0; k < 3; ++k)
                    p[k] = batch.position[k][other];
            } else if (kind == 2) { // equal corners
                const float* q = out.points.get() + 4 * (random.below(count) + first);
                std::copy(q, q + 3, p);
            } else if (kind == 3) {
                const float bad[] = {NAN, INFINITY, -INFINITY};
                p[random.below(3)] = bad[random.below(3)];
            } else if (kind == 4) { // an edge through a receiver, or in line with it
                const float* q = out.points.get() + 4 * (random.below(count) + first);
                for (uint32_t k = 0; k < 3; ++k)
                    p[k] = 2 * batch.position[k][other] - q[k];
            } else if (kind == 5) { // in the tangent plane of a receiver
                float height = 0;
                for (uint32_t k = 0; k < 3; ++k)
                    height += batch.axis[2][k][other] * (p[k] - batch.position[k][other]);
                for (uint32_t k = 0; k < 3; ++k)
                    p[k] -= height * batch.axis[2][k][other];
            } else if (kind == 6) { // on the zenith's axis
                for (uint32_t k = 0; k < 3; ++k)
                    p[k] = batch.position[k][other] + batch.axis[2][k][other] * distance;
            } else if (kind == 7) {
                const float scale = std::ldexp(1.0f, -int(random.below(140)));
                for (uint32_t k = 0; k < 3; ++k)
                    p[k] *= scale;
            } else if (kind == 8) {
                p[random.below(3)] = random.frame_float();
            }
        }
    }
    const bool flat = hostile && random.one_in(8);
    if (flat) { // a floor in which a receiver lies
        const uint32_t axis = random.below(3);
        for (uint32_t v = 0; v < count; ++v) {
            float* p = out.points.get() + 4 * (v + first);
            for (uint32_t k = 0; k < 3; ++k)
                p[k] = k == axis ? batch.position[k][lane] : p[k] + (batch.position[k][lane] - centre[k]);
        }
    }
    std::map<std::pair<uint8_t, uint8_t>, uint8_t> numbers;
    const auto add_triangle = [&](uint8_t a, uint8_t b, uint8_t c) {
        const uint8_t corner[3] = {a, b, c};
        uint8_t record[8] = {a, b, c};
        for (uint32_t k = 0; k < 3; ++k) {
            const uint8_t from = corner[k], to = corner[(k + 1) % 3];
            const auto same = numbers.find({from, to}), turned = numbers.find({to, from});
            if (same != numbers.end()) {
                record[3 + k] = same->second;
            } else if (turned != numbers.end()) {
                record[3 + k] = turned->second;
                record[6] = uint8_t(record[6] | 1u << k);
            } else {
                const auto number = uint8_t(numbers.size());
                numbers[{from, to}] = number;
                out.edges.push_back(from);
                out.edges.push_back(to);
                record[3 + k] = number;
            }
        }
        out.triangles.insert(out.triangles.end(), record, record + 8);
    };
    for (uint32_t row = 0; row < down; ++row) {
        for (uint32_t column = 0; column < across; ++column) {
            const auto a = uint8_t(row * columns + column), b = uint8_t(a + 1), c = uint8_t(a + columns),
                       d = uint8_t(c + 1);
            add_triangle(a, b, d);
            add_triangle(a, d, c);
        }
    }
    out.view.vertices = out.vertices.data();
    out.view.edges = out.edges.data();
    out.view.triangles = out.triangles.data();
    out.view.vertex_count = count;
    out.view.edge_count = uint32_t(out.edges.size() / 2);
    out.view.triangle_count = uint32_t(out.triangles.size() / 8);
    out.view.two_sided = random.one_in(3);
    out.view.full = random.one_in(2) || flat;
    out.view.clearance = random.one_in(3) ? random.between(0, 1e-2f) : 0.0f;
    out.view.nearest = random.one_in(3) ? random.between(0, 0.3f) : 0.0f;
    out.view.farthest = random.one_in(3) ? random.between(0, 1.5f) : FLT_MAX;
    fill_bounds(out);
}

Jobs::Jobs(uint32_t size) : memory(aligned_array<uint32_t>(4 * (size_t(size) + 16))), capacity(size) {
    uint32_t* const base = memory.get();
    const size_t stride = size + 16;
    list = {{base, base + stride, base + 2 * stride}, base + 3 * stride, 0};
}

std::vector<std::array<uint32_t, 4>> Jobs::sorted() const {
    std::vector<std::array<uint32_t, 4>> all;
    for (uint32_t j = 0; j < list.count; ++j)
        all.push_back({list.destination[j], list.plane[0][j], list.plane[1][j], list.plane[2][j]});
    std::sort(all.begin(), all.end());
    return all;
}

std::optional<Set> set_to_test() {
    const char* const wanted = std::getenv("NUSSELT_TEST_SET");
    for (uint32_t i = 0; wanted && i < set_count; ++i) {
        const Kernels* const kernels = kernels_for(Set(i));
        if (kernels && std::strcmp(kernels->name, wanted) == 0) return Set(i);
    }
    return {};
}

bool same_bits(const void* a, const void* b, size_t bytes) {
    return std::memcmp(a, b, bytes) == 0;
}

} // namespace nusselt::test
