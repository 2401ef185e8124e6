#include "clusters.h"

#include <algorithm>
#include <iterator>
#include <limits>

namespace nusselt {

namespace {

constexpr uint32_t max_vertices = 64;
constexpr uint32_t max_edges = 128;

// A turn counts against a distance in the cuts and in the smoothing, in radii of a cluster.
constexpr float split_direction = 0.3f;
constexpr float smooth_direction = 0.3f;
// Nearness to the middle against edges of boundary.
constexpr float smooth_nearness = 0.5f;
constexpr int smooth_passes = 6;
// A triangle is large beside those of its run from so many times their median on, by its longest edge; the
// large ones of so many runs share one.
constexpr float large_triangle = 3;
constexpr uint32_t large_runs = 8;

struct Span {
    uint32_t begin, end, parts;
};

} // namespace

void split_medians(const Vector<SplitPoint>& points, const SplitOptions& options, Vector<uint32_t>& order,
                   Vector<uint32_t>& begins) {
    begins.clear();
    const uint32_t count = static_cast<uint32_t>(order.size());
    Vector<Span> stack{HostAllocator<Span>(order.get_allocator())};
    if (count > 0) stack.push_back({0, count, (count + options.leaf - 1) / options.leaf});
    while (!stack.empty()) {
        const Span span = stack.back();
        stack.pop_back();
        uint32_t* begin = order.data() + span.begin;
        uint32_t* end = order.data() + span.end;
        const uint32_t size = span.end - span.begin;
        if (span.parts <= 1) {
            std::sort(begin, end);
            begins.push_back(span.begin);
            continue;
        }
        float low[6], high[6];
        std::fill_n(low, 6, std::numeric_limits<float>::max());
        std::fill_n(high, 6, -std::numeric_limits<float>::max());
        for (const uint32_t* i = begin; i != end; ++i) {
            for (int k = 0; k < 6; ++k) {
                low[k] = std::min(low[k], points[*i].axis[k]);
                high[k] = std::max(high[k], points[*i].axis[k]);
            }
        }
        const float extent = std::max({high[0] - low[0], high[1] - low[1], high[2] - low[2]});
        // About the size of a run, were the points spread over a surface of this extent.
        const float run = extent * std::sqrt(static_cast<float>(options.leaf) / static_cast<float>(size));
        int widest = 0;
        float width = -1;
        for (int k = 0; k < 6; ++k) {
            const float w = (high[k] - low[k]) * (k < 3 ? 1.0f : options.direction_weight * run);
            if (w > width) widest = k, width = w;
        }
        const uint32_t left_parts = span.parts / 2;
        const uint32_t left = options.aligned
                                  ? options.leaf * left_parts
                                  : static_cast<uint32_t>(uint64_t(size) * left_parts / span.parts);
        std::nth_element(begin, begin + left, end, [&](uint32_t a, uint32_t b) {
            const float x = points[a].axis[widest], y = points[b].axis[widest];
            return x != y ? x < y : a < b;
        });
        stack.push_back({span.begin + left, span.end, span.parts - left_parts});
        stack.push_back({span.begin, span.begin + left, left_parts});
    }
    begins.push_back(count);
}

namespace {

// The median cuts run zigzag and leave splinters. Triangles move to a neighbouring cluster, where there is
// room, if that saves boundary or brings them nearer to the middle.
void smooth_cuts(Partitioner& p, uint32_t count, uint32_t clusters, uint32_t limit) {
    p.centres.assign(clusters, SplitPoint{});
    float spread = 0;
    for (uint32_t t = 0; t < count; ++t) {
        SplitPoint& sum = p.centres[p.cluster_of[t]];
        for (int k = 0; k < 6; ++k) {
            sum.axis[k] += p.points[t].axis[k];
        }
    }
    const auto distance2 = [&](uint32_t t, uint32_t c, float direction2) {
        const float scale = 1.0f / static_cast<float>(p.sizes[c]);
        float d[6];
        for (int k = 0; k < 6; ++k) {
            d[k] = p.points[t].axis[k] - p.centres[c].axis[k] * scale;
        }
        return d[0] * d[0] + d[1] * d[1] + d[2] * d[2] +
               direction2 * (d[3] * d[3] + d[4] * d[4] + d[5] * d[5]);
    };
    for (uint32_t t = 0; t < count; ++t) {
        spread += distance2(t, p.cluster_of[t], 0);
    }
    spread /= static_cast<float>(count);
    if (!(spread > 0)) return;
    const float nearness = smooth_nearness / spread;
    const float direction2 = smooth_direction * spread;
    for (int pass = 0; pass < smooth_passes; ++pass) {
        bool changed = false;
        for (uint32_t t = 0; t < count; ++t) {
            const uint32_t own = p.cluster_of[t];
            if (p.sizes[own] == 1) continue;
            uint32_t around[3];
            uint32_t at_home = 0;
            for (uint32_t k = 0; k < 3; ++k) {
                const uint32_t m = p.mate[3 * t + k];
                around[k] = p.cluster_of[m / 3];
                at_home += around[k] == own && m != 3 * t + k;
            }
            if (at_home == 3) continue;
            uint32_t best = own;
            float best_gain = 1e-3f;
            for (uint32_t k = 0; k < 3; ++k) {
                const uint32_t other = around[k];
                if (other == own || p.sizes[other] >= limit) continue;
                const float edges =
                    static_cast<float>(std::count(around, around + 3, other)) - static_cast<float>(at_home);
                const float gain =
                    edges + nearness * (distance2(t, own, direction2) - distance2(t, other, direction2));
                if (gain > best_gain) best = other, best_gain = gain;
            }
            if (best == own) continue;
            p.cluster_of[t] = best;
            ++p.sizes[best];
            --p.sizes[own];
            for (int k = 0; k < 6; ++k) {
                p.centres[best].axis[k] += p.points[t].axis[k];
                p.centres[own].axis[k] -= p.points[t].axis[k];
            }
            changed = true;
        }
        if (!changed) break;
    }
}

} // namespace

void partition_triangles(const Vector<uint32_t>& triangles, const Vec3f* positions, uint32_t limit,
                         Vector<uint32_t>& local_of, Partitioner& p) {
    const uint32_t count = static_cast<uint32_t>(triangles.size() / 3);
    p.order.resize(count);
    p.points.resize(count);
    for (uint32_t t = 0; t < count; ++t) {
        const Vec3f a = positions[triangles[3 * t]], b = positions[triangles[3 * t + 1]],
                    c = positions[triangles[3 * t + 2]];
        const Vec3f centre = (a + b + c) * (1.0f / 3);
        const Vec3f n = unit_or_zero(cross(to_double(b) - to_double(a), to_double(c) - to_double(a)));
        p.points[t] = {{centre.x, centre.y, centre.z, n.x, n.y, n.z}};
        p.order[t] = t;
    }
    SplitOptions options;
    options.direction_weight = split_direction;
    options.leaf = limit - limit / 16; // room to smooth the cuts
    split_medians(p.points, options, p.order, p.begins);

    const uint32_t clusters = static_cast<uint32_t>(p.begins.size() - 1);
    if (clusters < 2) return;
    p.corners.resize(triangles.size());
    uint32_t vertices = 0;
    for (size_t c = 0; c < triangles.size(); ++c) {
        uint32_t& local = local_of[triangles[c]];
        if (local == none) local = vertices++;
        p.corners[c] = local;
    }
    for (const uint32_t w : triangles) {
        local_of[w] = none;
    }
    match_edges(p.corners.data(), count, vertices, p.matcher, p.mate);
    p.cluster_of.resize(count);
    p.sizes.resize(clusters);
    for (uint32_t c = 0; c < clusters; ++c) {
        p.sizes[c] = p.begins[c + 1] - p.begins[c];
        for (uint32_t i = p.begins[c]; i < p.begins[c + 1]; ++i) {
            p.cluster_of[p.order[i]] = c;
        }
    }
    smooth_cuts(p, count, clusters, limit);
    p.begins[0] = 0;
    for (uint32_t c = 0; c < clusters; ++c) {
        p.begins[c + 1] = p.begins[c] + p.sizes[c];
        p.sizes[c] = p.begins[c];
    }
    for (uint32_t t = 0; t < count; ++t) {
        p.order[p.sizes[p.cluster_of[t]]++] = t;
    }
}

void part_large_triangles(const Vector<uint32_t>& triangles, const Vec3f* positions, uint32_t limit,
                          Partitioner& p) {
    // The square of the longest edge.
    const auto size2 = [&](uint32_t t) {
        const uint32_t* corner = &triangles[3 * size_t(t)];
        const Vec3f a = positions[corner[0]], b = positions[corner[1]], c = positions[corner[2]];
        return std::max({dot(b - a, b - a), dot(c - b, c - b), dot(a - c, a - c)});
    };
    const uint32_t runs = static_cast<uint32_t>(p.begins.size() - 1);
    // Both are rewritten in place from copies: what is parted changes places and begins alike.
    p.cluster_of.assign(p.order.begin(), p.order.end());
    p.sizes.assign(p.begins.begin(), p.begins.end());
    p.order.clear();
    p.begins.assign(1, 0);
    p.large.clear();
    const auto end_run = [&] {
        if (p.order.size() > p.begins.back()) p.begins.push_back(static_cast<uint32_t>(p.order.size()));
    };
    const auto end_large = [&] {
        p.order.insert(p.order.end(), p.large.begin(), p.large.end());
        p.large.clear();
        end_run();
    };
    for (uint32_t run = 0; run < runs; ++run) {
        const uint32_t *begin = p.cluster_of.data() + p.sizes[run],
                       *end = p.cluster_of.data() + p.sizes[run + 1];
        p.squares.clear();
        for (const uint32_t* t = begin; t != end; ++t)
            p.squares.push_back(size2(*t));
        const auto middle = p.squares.begin() + p.squares.size() / 2;
        std::nth_element(p.squares.begin(), middle, p.squares.end());
        const float least = large_triangle * large_triangle * *middle;
        const auto is_large = [&](uint32_t t) { return size2(t) > least; };
        const size_t found = static_cast<size_t>(std::count_if(begin, end, is_large));
        if (run % large_runs == 0 || p.large.size() + found > limit) end_large();
        std::copy_if(begin, end, std::back_inserter(p.large), is_large);
        std::copy_if(begin, end, std::back_inserter(p.order), [&](uint32_t t) { return !is_large(t); });
        end_run();
    }
    end_large();
}

void begin_clusters(Clusters& out) {
    out.vertex_begin.assign(1, 0);
    out.edge_begin.assign(1, 0);
    out.triangle_begin.assign(1, 0);
}

namespace {

void end_cluster(ClusterKind kind, Clusters& out) {
    out.vertex_begin.push_back(static_cast<uint32_t>(out.vertices.size()));
    out.edge_begin.push_back(static_cast<uint32_t>(out.edges.size()));
    out.triangle_begin.push_back(static_cast<uint32_t>(out.triangles.size()));
    out.two_sided.push_back(kind.two_sided);
    out.level.push_back(kind.level);
}

void clear_edges(ClusterWriter& writer, const Clusters& out) {
    for (size_t e = out.edge_begin.back(); e < out.edges.size(); ++e) {
        writer.edge_number[out.edges[e].from * 64u + out.edges[e].to] = 0xFF;
    }
}

} // namespace

void append_clusters(const Vector<uint32_t>& triangles, const uint32_t* chosen, uint32_t count,
                     ClusterKind kind, ClusterWriter& writer, Vector<uint32_t>& local_of, Clusters& out) {
    const auto finish = [&] {
        clear_edges(writer, out);
        for (size_t i = out.vertex_begin.back(); i < out.vertices.size(); ++i) {
            local_of[out.vertices[i]] = none;
        }
        end_cluster(kind, out);
    };
    for (uint32_t i = 0; i < count; ++i) {
        const uint32_t* triangle = &triangles[3 * size_t(chosen[i])];
        uint32_t fresh = 0;
        for (uint32_t k = 0; k < 3; ++k) {
            fresh += local_of[triangle[k]] == none;
        }
        if (out.vertices.size() - out.vertex_begin.back() + fresh > max_vertices ||
            out.edges.size() - out.edge_begin.back() + 3 > max_edges) {
            finish();
        }
        ClusterTriangle t = {};
        for (uint32_t k = 0; k < 3; ++k) {
            uint32_t& local = local_of[triangle[k]];
            if (local == none) {
                local = static_cast<uint32_t>(out.vertices.size() - out.vertex_begin.back());
                out.vertices.push_back(triangle[k]);
            }
            t.corner[k] = static_cast<uint8_t>(local);
        }
        // Every cluster takes an edge from its lower vertex to its higher. A plane that holds the zenith has
        // two cells in the table, one for each way round, and clusters that took one each left a crack.
        for (uint32_t k = 0; k < 3; ++k) {
            const uint32_t next = (k + 1) % 3;
            const bool flipped = triangle[k] > triangle[next];
            const uint8_t from = t.corner[flipped ? next : k], to = t.corner[flipped ? k : next];
            uint8_t& number = writer.edge_number[from * 64u + to];
            if (number == 0xFF) {
                number = static_cast<uint8_t>(out.edges.size() - out.edge_begin.back());
                out.edges.push_back({from, to});
            }
            t.edge[k] = number;
            t.flipped = static_cast<uint8_t>(t.flipped | uint32_t(flipped) << k);
        }
        out.triangles.push_back(t);
    }
    if (out.triangles.size() > out.triangle_begin.back()) finish();
}

} // namespace nusselt
