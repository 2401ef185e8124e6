#include "tests/stress/raster.h"

#include "kernels/last_samples.h"

#include <algorithm>
#include <cfloat>
#include <cmath>
#include <map>

namespace nusselt::test {

using namespace kernels;

namespace {

using Point = std::array<float, 3>;

bool finite(const float* p) {
    return std::isfinite(p[0]) && std::isfinite(p[1]) && std::isfinite(p[2]);
}

// As runtime/src/clusters.cpp writes them, with points of their own.
struct ClusterBuilder {
    ClusterInput* out = nullptr;
    std::vector<Point> points;
    std::map<uint32_t, uint8_t> corner;
    std::map<std::pair<uint8_t, uint8_t>, uint8_t> edge;

    bool fits(const std::array<uint32_t, 3>& t, uint32_t limit) const {
        size_t fresh = 0;
        for (const uint32_t v : t)
            fresh += corner.count(v) == 0;
        return points.size() + fresh <= cluster_vertices && edge.size() + 3 <= cluster_edges &&
               out->triangles.size() / 8 < limit;
    }
    void add(const Soup& soup, const std::array<uint32_t, 3>& t) {
        uint8_t record[8] = {};
        for (uint32_t k = 0; k < 3; ++k) {
            const auto [at, fresh] = corner.try_emplace(t[k], uint8_t(points.size()));
            if (fresh) {
                out->vertices.push_back(uint32_t(points.size()));
                points.push_back(soup.points[t[k]]);
            }
            record[k] = at->second;
        }
        for (uint32_t k = 0; k < 3; ++k) {
            const uint32_t next = (k + 1) % 3;
            const bool flipped = t[k] > t[next];
            const uint8_t from = record[flipped ? next : k], to = record[flipped ? k : next];
            const auto [at, fresh] = edge.try_emplace({from, to}, uint8_t(edge.size()));
            if (fresh) {
                out->edges.push_back(from);
                out->edges.push_back(to);
            }
            record[3 + k] = at->second;
            record[6] = uint8_t(record[6] | uint32_t(flipped) << k);
        }
        out->triangles.insert(out->triangles.end(), record, record + 8);
    }
};

void sphere_around(const std::vector<Point>& points, float centre[3], float& radius) {
    float low[3] = {FLT_MAX, FLT_MAX, FLT_MAX}, high[3] = {-FLT_MAX, -FLT_MAX, -FLT_MAX}, square = 0;
    for (const Point& p : points) {
        for (int k = 0; k < 3 && finite(p.data()); ++k) {
            low[k] = std::min(low[k], p[size_t(k)]);
            high[k] = std::max(high[k], p[size_t(k)]);
        }
    }
    for (int k = 0; k < 3; ++k)
        centre[k] = low[0] <= high[0] ? 0.5f * low[k] + 0.5f * high[k] : 0.0f;
    for (const Point& p : points) {
        if (!finite(p.data())) continue;
        const float x = p[0] - centre[0], y = p[1] - centre[1], z = p[2] - centre[2];
        square = std::max(square, x * x + y * y + z * z);
    }
    radius = std::sqrt(square);
}

// Planes and spheres of the triangles, as runtime/src/refit.cpp makes them.
void fill_bounds(ClusterInput& c, const std::vector<Point>& points) {
    const uint32_t count = c.view.triangle_count, slots = triangle_slots(count);
    c.bounds = aligned_array<float>(8 * slots + 16);
    float* const out = c.bounds.get();
    std::fill(out + 7 * slots, out + 8 * slots, -FLT_MAX);
    for (uint32_t t = 0; t < count; ++t) {
        const Point p[3] = {points[c.triangles[8 * t]], points[c.triangles[8 * t + 1]],
                            points[c.triangles[8 * t + 2]]};
        if (!finite(p[0].data()) || !finite(p[1].data()) || !finite(p[2].data())) continue;
        const float ux = p[1][0] - p[0][0], uy = p[1][1] - p[0][1], uz = p[1][2] - p[0][2];
        const float vx = p[2][0] - p[0][0], vy = p[2][1] - p[0][1], vz = p[2][2] - p[0][2];
        const float x = uy * vz - uz * vy, y = uz * vx - ux * vz, z = ux * vy - uy * vx;
        const float area = x * x + y * y + z * z;
        if (!(area >= FLT_MIN)) continue;
        const float length = std::sqrt(area);
        const float n[3] = {x / length, y / length, z / length};
        float centre[3], radius;
        sphere_around({p[0], p[1], p[2]}, centre, radius);
        for (uint32_t k = 0; k < 3; ++k) {
            out[k * slots + t] = n[k];
            out[(4 + k) * slots + t] = centre[k];
        }
        out[3 * slots + t] = n[0] * p[0][0] + n[1] * p[0][1] + n[2] * p[0][2];
        out[7 * slots + t] = radius;
    }
    c.view.bounds = out;
}

void finish(ClusterBuilder& builder, bool two_sided) {
    ClusterInput& c = *builder.out;
    c.points = aligned_array<float>(4 * builder.points.size());
    for (size_t i = 0; i < builder.points.size(); ++i)
        std::copy(builder.points[i].begin(), builder.points[i].end(), c.points.get() + 4 * i);
    c.view.vertices = c.vertices.data();
    c.view.edges = c.edges.data();
    c.view.triangles = c.triangles.data();
    c.view.vertex_count = uint32_t(c.vertices.size());
    c.view.edge_count = uint32_t(c.edges.size() / 2);
    c.view.triangle_count = uint32_t(c.triangles.size() / 8);
    c.view.two_sided = two_sided;
    c.view.nearest = 0;
    c.view.farthest = FLT_MAX;
    sphere_around(builder.points, c.view.centre, c.view.radius);
    fill_bounds(c, builder.points);
}

// No cone: it is the runtime's, and its tests'. The spheres cull by horizon and by nothing else.
std::vector<uint32_t> select(const Kernels& set, const Batch& batch,
                             const std::vector<ClusterInput>& clusters, float horizon) {
    const size_t count = clusters.size(), padded = (count + 15) / 16 * 16;
    auto values = aligned_array<float>(11 * padded);
    float* const v = values.get();
    for (size_t c = 0; c < count; ++c) {
        for (size_t k = 0; k < 3; ++k)
            v[k * padded + c] = clusters[c].view.centre[k];
        v[3 * padded + c] = clusters[c].view.radius;
        v[7 * padded + c] = -1;
        v[10 * padded + c] = FLT_MAX;
    }
    const ClusterBounds bounds{{v, v + padded, v + 2 * padded},
                               v + 3 * padded,
                               {v + 4 * padded, v + 5 * padded, v + 6 * padded},
                               v + 7 * padded,
                               v + 8 * padded,
                               v + 9 * padded,
                               v + 10 * padded,
                               uint32_t(count)};
    std::vector<uint32_t> selected(count + 16);
    uint64_t tested = 0;
    selected.resize(set.select_clusters(batch.bounds, bounds, nullptr, uint32_t(count), horizon,
                                        selected.data(), &tested));
    return selected;
}

struct Workbench {
    Jobs jobs{jobs_per_cluster(fine_layout) + 64};
    AlignedArray<ClusterScratch> scratch = aligned_array<ClusterScratch>(1);
    AlignedArray<uint8_t> masks = aligned_array<uint8_t>(16 * 512);
};

Workbench& workbench() {
    static Workbench bench;
    return bench;
}

} // namespace

std::vector<ClusterInput> clusters_of(const Soup& soup, uint32_t limit) {
    std::vector<ClusterInput> out;
    ClusterBuilder builder;
    const auto close = [&] {
        if (builder.out) finish(builder, soup.two_sided);
        builder = {};
    };
    out.reserve(soup.triangles.size());
    for (const auto& t : soup.triangles) {
        if (builder.out && !builder.fits(t, limit)) close();
        if (!builder.out) {
            out.emplace_back();
            builder.out = &out.back();
        }
        builder.add(soup, t);
    }
    close();
    return out;
}

Corners corners_of(const Soup& soup, size_t triangle) {
    const auto& t = soup.triangles[triangle];
    return {soup.points[t[0]], soup.points[t[1]], soup.points[t[2]]};
}

const Kernels& widest() {
    for (const Set set : {Set::avx512, Set::avx2, Set::sse4}) {
        if (const Kernels* k = kernels_for(set)) return *k;
    }
    return *kernels_for(Set::scalar);
}

Masks rasterize(const Kernels& set, const MaskLayout& layout, const Batch& batch, const Soup& soup,
                const RasterOptions& options) {
    const Tables& tables = tables_of(layout);
    Workbench& bench = workbench();
    const size_t bytes = lanes * mask_bytes(layout);
    std::fill_n(bench.masks.get(), bytes, uint8_t(0));
    const std::vector<ClusterInput> clusters = clusters_of(soup, options.per_cluster);
    // Without culling the horizon is a plane far below the tangent plane, so that it never decides.
    const float horizon = !options.cull ? 0.0f : options.horizon < 0 ? tables.horizon : options.horizon;
    std::vector<uint32_t> chosen;
    if (options.cull) {
        chosen = select(set, batch, clusters, horizon);
    } else {
        for (uint32_t c = 0; c < clusters.size(); ++c)
            chosen.push_back(c);
    }
    Counters counters{};
    for (const uint32_t c : chosen) {
        set.cluster_jobs(batch, clusters[c].view, clusters[c].points.get(), layout, horizon, bench.scratch[0],
                         bench.jobs.list, counters);
        set.run_jobs(tables, bench.jobs.list, bench.masks.get());
    }
    for (uint32_t lane = 0; options.last_samples && lane < lanes; ++lane) {
        uint8_t* const mask = bench.masks.get() + lane * mask_bytes(layout);
        uint32_t bits[most_last_samples(fine_layout)];
        const uint32_t count = find_last_samples(layout, mask, bits);
        for (uint32_t i = 0; i < count; ++i) {
            const Sample sample = sample_of(layout, batch, lane, bits[i]);
            const auto hidden = [&](const uint32_t c) {
                const ClusterView& view = clusters[c].view;
                for (uint32_t t = 0; t < view.triangle_count; ++t)
                    if (hides(batch, lane, view, clusters[c].points.get(), t, sample)) return true;
                return false;
            };
            if (std::any_of(chosen.begin(), chosen.end(), hidden))
                mask[bits[i] / 8] = uint8_t(mask[bits[i] / 8] | 1u << bits[i] % 8);
        }
    }
    return {bench.masks.get(), bench.masks.get() + bytes};
}

Masks rasterize_free(const Kernels& set, const MaskLayout& layout, const Batch& batch, const Soup& soup) {
    const Tables& tables = tables_of(layout);
    Workbench& bench = workbench();
    const size_t bytes = lanes * mask_bytes(layout);
    std::fill_n(bench.masks.get(), bytes, uint8_t(0));
    Counters counters{};
    for (size_t t = 0; t < soup.triangles.size(); ++t) {
        alignas(64) float corners[3][3][lanes];
        const Corners c = corners_of(soup, t);
        for (size_t corner = 0; corner < 3; ++corner) {
            for (size_t k = 0; k < 3; ++k)
                std::fill_n(corners[corner][k], lanes, c[corner][k]);
        }
        set.triangle_jobs(batch, corners, 0xFFFF, soup.two_sided ? 0xFFFF : 0, layout, tables.horizon,
                          bench.jobs.list, counters);
        set.run_jobs(tables, bench.jobs.list, bench.masks.get());
    }
    return {bench.masks.get(), bench.masks.get() + bytes};
}

Masks rasterize_double(const Samples& samples, const MaskLayout& layout, const Batch& batch,
                       const Soup& soup) {
    Masks masks(lanes * mask_bytes(layout));
    for (uint32_t lane = 0; lane < lanes; ++lane) {
        if (!(batch.valid >> lane & 1)) continue;
        for (size_t t = 0; t < soup.triangles.size(); ++t) {
            const auto local = local_corners(batch, lane, corners_of(soup, t));
            const Side side = side_of(local, 1e-6);
            if (side == Side::front || (side == Side::back && soup.two_sided))
                cover<double>(samples, local, masks.data() + lane * mask_bytes(layout));
        }
    }
    return masks;
}

Batch batch_of(const std::vector<Point>& positions, const std::vector<Point>& normals) {
    Batch batch{};
    alignas(64) float normal[3][lanes] = {};
    for (uint32_t lane = 0; lane < lanes && lane < positions.size(); ++lane) {
        batch.valid |= 1u << lane;
        for (uint32_t k = 0; k < 3; ++k) {
            batch.position[k][lane] = positions[lane][k];
            normal[k][lane] = normals[lane][k];
        }
    }
    widest().prepare_batch(batch, normal);
    return batch;
}

Soup sphere_soup(uint32_t subdivisions, Random* turn) {
    const float g = 1.6180339887f;
    Soup soup;
    soup.two_sided = false;
    soup.points = {{-1, g, 0},  {1, g, 0},  {-1, -g, 0}, {1, -g, 0}, {0, -1, g},  {0, 1, g},
                   {0, -1, -g}, {0, 1, -g}, {g, 0, -1},  {g, 0, 1},  {-g, 0, -1}, {-g, 0, 1}};
    soup.triangles = {{0, 11, 5},  {0, 5, 1},  {0, 1, 7},  {0, 7, 10}, {0, 10, 11}, {1, 5, 9}, {5, 11, 4},
                      {11, 10, 2}, {10, 7, 6}, {7, 1, 8},  {3, 9, 4},  {3, 4, 2},   {3, 2, 6}, {3, 6, 8},
                      {3, 8, 9},   {4, 9, 5},  {2, 4, 11}, {6, 2, 10}, {8, 6, 7},   {9, 8, 1}};
    for (uint32_t i = 0; i < subdivisions; ++i)
        soup = subdivided(soup);
    float x[3] = {1, 0, 0}, y[3] = {0, 1, 0};
    if (turn) {
        turn->direction(x);
        turn->direction(y);
    }
    const float along = x[0] * y[0] + x[1] * y[1] + x[2] * y[2];
    float square = 0;
    for (int k = 0; k < 3; ++k) {
        y[k] -= along * x[k];
        square += y[k] * y[k];
    }
    for (float& c : y)
        c /= std::sqrt(square);
    const float z[3] = {x[1] * y[2] - x[2] * y[1], x[2] * y[0] - x[0] * y[2], x[0] * y[1] - x[1] * y[0]};
    for (Point& p : soup.points) {
        const float length = std::sqrt(p[0] * p[0] + p[1] * p[1] + p[2] * p[2]);
        const Point unit{p[0] / length, p[1] / length, p[2] / length};
        for (size_t k = 0; k < 3; ++k)
            p[k] = unit[0] * x[k] + unit[1] * y[k] + unit[2] * z[k];
    }
    return soup;
}

Soup subdivided(const Soup& soup) {
    Soup out = soup;
    out.triangles.clear();
    std::map<std::pair<uint32_t, uint32_t>, uint32_t> middles;
    const auto middle = [&](uint32_t a, uint32_t b) {
        const auto [at, fresh] =
            middles.try_emplace({std::min(a, b), std::max(a, b)}, uint32_t(out.points.size()));
        if (fresh) {
            Point m;
            for (size_t k = 0; k < 3; ++k)
                m[k] = 0.5f * soup.points[std::min(a, b)][k] + 0.5f * soup.points[std::max(a, b)][k];
            out.points.push_back(m);
        }
        return at->second;
    };
    for (const auto& t : soup.triangles) {
        const uint32_t ab = middle(t[0], t[1]), bc = middle(t[1], t[2]), ca = middle(t[2], t[0]);
        out.triangles.push_back({t[0], ab, ca});
        out.triangles.push_back({ab, t[1], bc});
        out.triangles.push_back({ca, bc, t[2]});
        out.triangles.push_back({ab, bc, ca});
    }
    return out;
}

Soup random_soup(Random& random, uint32_t count) {
    Soup soup;
    for (uint32_t t = 0; t < count; ++t) {
        float centre[3], towards[3];
        random.direction(centre);
        const float distance = std::exp(random.between(-2.5f, 0)), size = std::exp(random.between(-4, 0.5f));
        for (int k = 0; k < 3; ++k) {
            random.direction(towards);
            const float thin = random.one_in(8) ? std::exp(random.between(-12, 0)) : 1;
            soup.points.push_back({});
            for (size_t i = 0; i < 3; ++i)
                soup.points.back()[i] =
                    centre[i] * distance + towards[i] * size * distance * (k == 2 ? thin : 1);
        }
        soup.triangles.push_back({3 * t, 3 * t + 1, 3 * t + 2});
    }
    return soup;
}

} // namespace nusselt::test
