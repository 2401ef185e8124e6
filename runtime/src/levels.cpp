#include "levels.h"

#include "bounds.h"
#include "clusters.h"
#include "receivers.h"
#include "simplify.h"
#include "topology.h"
#include "weld.h"

#include <algorithm>
#include <limits>

namespace nusselt {

namespace {

constexpr uint32_t max_levels = 16;
// A group that keeps more of its triangles than this is not worth a level.
constexpr float worth_keeping = 0.8f;
// So often a cluster may be tried in another group before it stays as it is.
constexpr uint8_t max_attempts = 3;
// A group's collapses beyond this share of the error that its like came to are put off. Less: up to 15 % less
// error, twice the time.
constexpr float expected_share = 1.0f;
// Vertices of more triangles than this bring no ring to their neighbours (quality `paper`): the rings of a
// hub's neighbours would grow with the square of their number.
constexpr uint32_t max_ring_valence = 256;

// Rest positions, centred and scaled by one factor to at most 1, so that no later constant meets the caller's
// unit.
void normalise_positions(const MeshDesc& desc, const Vector<uint32_t>& weld_source, Vector<Vec3f>& out) {
    Vec3d low{std::numeric_limits<double>::max(), std::numeric_limits<double>::max(),
              std::numeric_limits<double>::max()};
    Vec3d high = low * -1.0;
    for (const uint32_t v : weld_source) {
        const Vec3f f = load(desc.rest_positions, v);
        if (!is_finite(f)) continue;
        const Vec3d p = to_double(f);
        low = {std::min(low.x, p.x), std::min(low.y, p.y), std::min(low.z, p.z)};
        high = {std::max(high.x, p.x), std::max(high.y, p.y), std::max(high.z, p.z)};
    }
    const Vec3d size = high - low;
    const double extent = std::max({size.x, size.y, size.z});
    const double scale = extent > 0 ? 2 / extent : 1;
    const Vec3d centre = (low + high) * 0.5;
    out.resize(weld_source.size());
    for (size_t w = 0; w < weld_source.size(); ++w) {
        const Vec3f f = load(desc.rest_positions, weld_source[w]);
        out[w] = is_finite(f) ? to_float((to_double(f) - centre) * scale) : f;
    }
}

void build_fans(uint32_t welded, MeshData& mesh) {
    const Vector<uint32_t>& t = mesh.full_triangles;
    mesh.fan_begin.assign(welded + 1, 0);
    for (const uint32_t w : t) {
        ++mesh.fan_begin[w + 1];
    }
    for (uint32_t w = 0; w < welded; ++w) {
        mesh.fan_begin[w + 1] += mesh.fan_begin[w];
    }
    Vector<uint32_t> fill(mesh.fan_begin, mesh.fan_begin.get_allocator());
    mesh.fan.resize(2 * t.size());
    for (size_t i = 0; i < t.size(); i += 3) {
        for (size_t k = 0; k < 3; ++k) {
            const uint32_t slot = fill[t[i + k]]++;
            mesh.fan[2 * slot] = t[i + (k + 1) % 3];
            mesh.fan[2 * slot + 1] = t[i + (k + 2) % 3];
        }
    }
}

void build_rings(uint32_t welded, MeshData& mesh) {
    const Vector<uint32_t>& t = mesh.full_triangles;
    const auto numbers = mesh.ring.get_allocator();
    Vector<uint32_t> fan_triangle(t.size(), 0, numbers); // parallel to fan
    Vector<uint32_t> fill(mesh.fan_begin, numbers);
    for (size_t c = 0; c < t.size(); ++c) {
        fan_triangle[fill[t[c]]++] = static_cast<uint32_t>(c / 3);
    }
    Vector<uint32_t> seen(t.size() / 3, none, numbers);
    Vector<uint32_t> vertex_seen(welded, none, numbers);
    mesh.ring_begin.assign(1, 0);
    mesh.ring.clear();
    mesh.ring.reserve(t.size() * 2);
    for (uint32_t w = 0; w < welded; ++w) {
        const uint32_t begin = mesh.fan_begin[w], end = mesh.fan_begin[w + 1];
        for (uint32_t i = begin; i < end; ++i) {
            seen[fan_triangle[i]] = w;
        }
        for (uint32_t i = 2 * begin; i < 2 * end; ++i) {
            const uint32_t u = mesh.fan[i];
            if (vertex_seen[u] == w) continue;
            vertex_seen[u] = w;
            if (mesh.fan_begin[u + 1] - mesh.fan_begin[u] > max_ring_valence) continue;
            for (uint32_t k = mesh.fan_begin[u]; k < mesh.fan_begin[u + 1]; ++k) {
                if (seen[fan_triangle[k]] == w) continue;
                seen[fan_triangle[k]] = w;
                mesh.ring.push_back(fan_triangle[k]);
            }
        }
        mesh.ring_begin.push_back(static_cast<uint32_t>(mesh.ring.size()));
    }
    mesh.ring.shrink_to_fit();
}

struct BoundaryEdge {
    uint64_t key; // both vertices, the lower one high
    uint32_t cluster;
};

struct Link {
    uint32_t cluster;
    float weight;
};

struct Builder {
    Builder(const Allocator& a, uint32_t welded)
        : numbers(a), positions(HostAllocator<Vec3f>(a)), triangles(numbers), points(numbers), pool(numbers),
          retired(numbers), attempts(HostAllocator<uint8_t>(a)), centres(HostAllocator<Vec3f>(a)),
          group_error(HostAllocator<float>(a)), group_begin(numbers), group_members(numbers),
          group_of(numbers), edges(HostAllocator<BoundaryEdge>(a)), link_begin(numbers),
          links(HostAllocator<Link>(a)), score(HostAllocator<float>(a)), touched(numbers),
          vertex_group(welded, none, numbers), shared(welded, 0, HostAllocator<uint8_t>(a)),
          local_of(welded, none, numbers), part(numbers), saved(numbers), simplifier(a, welded),
          partitioner(a), writer(a), split_points(HostAllocator<SplitPoint>(a)) {}

    HostAllocator<uint32_t> numbers;
    Vector<Vec3f> positions; // welded

    // Parallel to the triangles of the clusters: welded triples, and the removed vertices nearest to each.
    Vector<uint32_t> triangles, points;

    // The clusters that make up the whole mesh now: those that may still be grouped, and those that stay.
    Vector<uint32_t> pool, retired;
    Vector<uint8_t> attempts; // by cluster
    Vector<Vec3f> centres;    // by cluster
    Vector<float> group_error;
    float expected_error = 0; // of the next group, from those before

    // Groups of the pool (pool indices), made anew for each level.
    Vector<uint32_t> group_begin, group_members, group_of;
    Vector<BoundaryEdge> edges;
    Vector<uint32_t> link_begin;
    Vector<Link> links;
    Vector<float> score;
    Vector<uint32_t> touched;
    Vector<uint32_t> vertex_group;
    Vector<uint8_t> shared;

    Vector<uint32_t> local_of, part, saved;
    Simplifier simplifier;
    Partitioner partitioner;
    ClusterWriter writer;
    Vector<SplitPoint> split_points;
};

uint32_t triangle_count(const Clusters& clusters, uint32_t cluster) {
    return clusters.triangle_begin[cluster + 1] - clusters.triangle_begin[cluster];
}

// What the clusters appended since `first_cluster` keep beside their tables.
void finish_new_clusters(Builder& b, const Clusters& clusters, uint32_t first_cluster) {
    for (uint32_t c = first_cluster; c < clusters.count(); ++c) {
        const uint32_t begin = clusters.vertex_begin[c], end = clusters.vertex_begin[c + 1];
        bounds::Box box;
        for (uint32_t i = begin; i < end; ++i) {
            const Vec3f p = b.positions[clusters.vertices[i]];
            bounds::extend(box, p, p);
        }
        b.centres.push_back(bounds::centre(box));
        b.attempts.push_back(0);
        b.pool.push_back(c);
    }
}

// Splits `source` triangles (welded triples, with `heads` of points where not empty) of one kind into
// clusters.
void add_clusters(Builder& b, const LevelOptions& options, const Vector<uint32_t>& source,
                  const Vector<uint32_t>* heads, ClusterKind kind, Clusters& clusters) {
    Partitioner& p = b.partitioner;
    partition_triangles(source, b.positions.data(), options.cluster_triangles, b.local_of, p);
    for (size_t i = 0; i + 1 < p.begins.size(); ++i) {
        append_clusters(source, p.order.data() + p.begins[i], p.begins[i + 1] - p.begins[i], kind, b.writer,
                        b.local_of, clusters);
    }
    if (!heads) return;
    for (const uint32_t t : p.order) {
        b.triangles.insert(b.triangles.end(), source.begin() + 3 * t, source.begin() + 3 * t + 3);
        b.points.push_back(heads->empty() ? none : (*heads)[t]);
    }
}

// Which clusters of the pool share how many edges. Edges that were locked in the last level count twice:
// unless they come to lie inside a group, they never go.
void link_pool(Builder& b, const Clusters& clusters) {
    b.edges.clear();
    for (uint32_t i = 0; i < b.pool.size(); ++i) {
        const uint32_t c = b.pool[i];
        uint8_t uses[256] = {};
        for (uint32_t t = clusters.triangle_begin[c]; t < clusters.triangle_begin[c + 1]; ++t) {
            for (const uint8_t e : clusters.triangles[t].edge) {
                uses[e] = static_cast<uint8_t>(uses[e] < 2 ? uses[e] + 1 : 2);
            }
        }
        const uint32_t edge_count = clusters.edge_begin[c + 1] - clusters.edge_begin[c];
        for (uint32_t e = 0; e < edge_count; ++e) {
            if (uses[e] != 1) continue;
            const ClusterEdge edge = clusters.edges[clusters.edge_begin[c] + e];
            const uint32_t v = clusters.vertices[clusters.vertex_begin[c] + edge.from];
            const uint32_t w = clusters.vertices[clusters.vertex_begin[c] + edge.to];
            b.edges.push_back({uint64_t(std::min(v, w)) << 32 | std::max(v, w), i});
        }
    }
    std::sort(b.edges.begin(), b.edges.end(), [](const BoundaryEdge& l, const BoundaryEdge& r) {
        return l.key != r.key ? l.key < r.key : l.cluster < r.cluster;
    });
    // Pairs of neighbours, both ways, one entry a shared edge. An edge of many clusters links each with the
    // next.
    b.link_begin.assign(b.pool.size() + 2, 0);
    const auto each_pair = [&](auto&& use) {
        for (size_t i = 1; i < b.edges.size(); ++i) {
            if (b.edges[i].key == b.edges[i - 1].key && b.edges[i].cluster != b.edges[i - 1].cluster) {
                use(b.edges[i - 1].cluster, b.edges[i].cluster);
                use(b.edges[i].cluster, b.edges[i - 1].cluster);
            }
        }
    };
    each_pair([&](uint32_t from, uint32_t) { ++b.link_begin[from + 2]; });
    for (size_t i = 2; i < b.link_begin.size(); ++i) {
        b.link_begin[i] += b.link_begin[i - 1];
    }
    b.links.resize(b.link_begin.back());
    each_pair([&](uint32_t from, uint32_t to) {
        const uint32_t own = clusters.own_group[b.pool[from]];
        const bool was_locked = own == no_group || own != clusters.own_group[b.pool[to]];
        b.links[b.link_begin[from + 1]++] = {to, was_locked ? 2.0f : 1.0f};
    });
}

// Groups the pool: grows each group along the most shared edges, gives groups that stay too small to a
// neighbour, and puts what has no neighbour together by place.
void group_pool(Builder& b, const LevelOptions& options, const Clusters& clusters) {
    link_pool(b, clusters);
    const uint32_t count = static_cast<uint32_t>(b.pool.size());
    b.split_points.resize(count);
    b.part.resize(count);
    for (uint32_t i = 0; i < count; ++i) {
        const Vec3f c = b.centres[b.pool[i]];
        b.split_points[i] = {{c.x, c.y, c.z, 0, 0, 0}};
        b.part[i] = i;
    }
    SplitOptions split;
    split.leaf = 1;
    split_medians(b.split_points, split, b.part, b.saved);

    b.group_of.assign(count, none);
    b.score.assign(count, 0);
    Vector<uint32_t> sizes(b.numbers);
    for (const uint32_t seed : b.part) {
        if (b.group_of[seed] != none) continue;
        const uint32_t group = static_cast<uint32_t>(sizes.size());
        uint32_t size = 0, joining = seed;
        b.touched.clear();
        for (;;) {
            b.group_of[joining] = group;
            ++size;
            for (uint32_t k = b.link_begin[joining]; k < b.link_begin[joining + 1]; ++k) {
                const uint32_t other = b.links[k].cluster;
                if (b.group_of[other] != none) continue;
                if (b.score[other] == 0) b.touched.push_back(other);
                b.score[other] += b.links[k].weight;
            }
            if (size == options.group_clusters) break;
            joining = none;
            for (const uint32_t candidate : b.touched) {
                if (b.group_of[candidate] != none) continue;
                if (joining == none || b.score[candidate] > b.score[joining] ||
                    (b.score[candidate] == b.score[joining] && candidate < joining)) {
                    joining = candidate;
                }
            }
            if (joining == none) break;
        }
        for (const uint32_t i : b.touched) {
            b.score[i] = 0;
        }
        sizes.push_back(size);
    }

    // Small leftovers join the neighbouring group with which they share most.
    const uint32_t small = (options.group_clusters + 1) / 2;
    const uint32_t large = options.group_clusters + small;
    for (const uint32_t i : b.part) {
        const uint32_t group = b.group_of[i];
        if (sizes[group] >= small) continue;
        b.touched.clear();
        for (uint32_t k = b.link_begin[i]; k < b.link_begin[i + 1]; ++k) {
            const uint32_t other = b.group_of[b.links[k].cluster];
            if (other == group || sizes[other] + 1 > large || sizes[other] < sizes[group]) continue;
            if (b.score[other] == 0)
                b.touched.push_back(other); // by group here; there are no more than clusters
            b.score[other] += b.links[k].weight;
        }
        uint32_t best = none;
        for (const uint32_t g : b.touched) {
            if (best == none || b.score[g] > b.score[best] || (b.score[g] == b.score[best] && g < best))
                best = g;
        }
        for (const uint32_t g : b.touched) {
            b.score[g] = 0;
        }
        if (best == none) continue;
        b.group_of[i] = best;
        --sizes[group];
        ++sizes[best];
    }

    // Groups without neighbours, in the order of their place: fill up.
    uint32_t open = none;
    Vector<uint32_t> renamed(sizes.size(), none, b.numbers);
    for (const uint32_t i : b.part) {
        const uint32_t group = b.group_of[i];
        if (sizes[group] >= small || renamed[group] != none) continue;
        if (open == none || sizes[open] + sizes[group] > options.group_clusters) {
            open = group;
            renamed[group] = group;
        } else {
            renamed[group] = open;
            sizes[open] += sizes[group];
            sizes[group] = 0;
            if (sizes[open] >= options.group_clusters) open = none;
        }
    }
    for (uint32_t i = 0; i < count; ++i) {
        if (renamed[b.group_of[i]] != none) b.group_of[i] = renamed[b.group_of[i]];
    }

    // Numbers in the order of place, members by rising number.
    std::fill(renamed.begin(), renamed.end(), none);
    b.group_begin.assign(1, 0);
    uint32_t groups = 0;
    for (const uint32_t i : b.part) {
        const uint32_t g = b.group_of[i];
        if (renamed[g] != none) continue;
        renamed[g] = groups++;
        b.group_begin.push_back(b.group_begin.back() + sizes[g]);
    }
    b.group_members.resize(count);
    Vector<uint32_t> fill(b.group_begin, b.numbers);
    for (uint32_t i = 0; i < count; ++i) {
        b.group_of[i] = renamed[b.group_of[i]];
        b.group_members[fill[b.group_of[i]]++] = i;
    }
}

// shared[w]: triangles of more than one group use welded vertex w.
void mark_shared_vertices(Builder& b, const Clusters& clusters) {
    std::fill(b.vertex_group.begin(), b.vertex_group.end(), none);
    std::fill(b.shared.begin(), b.shared.end(), uint8_t(0));
    const auto mark = [&](uint32_t cluster, uint32_t group) {
        for (uint32_t i = clusters.vertex_begin[cluster]; i < clusters.vertex_begin[cluster + 1]; ++i) {
            uint32_t& seen = b.vertex_group[clusters.vertices[i]];
            if (seen == none) seen = group;
            if (seen != group) b.shared[clusters.vertices[i]] = 1;
        }
    };
    for (uint32_t i = 0; i < b.pool.size(); ++i) {
        mark(b.pool[i], b.group_of[i]);
    }
    for (const uint32_t c : b.retired) {
        mark(c, none - 1);
    }
}

// Simplifies one group of the pool to half. False: it did not get small enough and nothing was changed.
bool build_group(Builder& b, const LevelOptions& options, uint32_t group, uint8_t level,
                 Vector<uint32_t>& next_pool, MeshData& mesh) {
    Clusters& clusters = mesh.clusters;
    Simplifier& s = b.simplifier;
    s.triangles.clear();
    s.points.clear();
    Vector<uint8_t> two_sided{HostAllocator<uint8_t>(b.numbers)};
    float child_error = 0;
    for (uint32_t i = b.group_begin[group]; i < b.group_begin[group + 1]; ++i) {
        const uint32_t c = b.pool[b.group_members[i]];
        const uint32_t begin = clusters.triangle_begin[c], end = clusters.triangle_begin[c + 1];
        s.triangles.insert(s.triangles.end(), b.triangles.begin() + 3 * begin, b.triangles.begin() + 3 * end);
        s.points.insert(s.points.end(), b.points.begin() + begin, b.points.begin() + end);
        two_sided.insert(two_sided.end(), end - begin, clusters.two_sided[c]);
        if (clusters.own_group[c] != no_group) {
            child_error = std::max(child_error, b.group_error[clusters.own_group[c]]);
        }
    }
    // The lists of points, to put them back: (point, next) pairs.
    b.saved.clear();
    for (const uint32_t head : s.points) {
        for (uint32_t p = head; p != none; p = s.point_next[p]) {
            b.saved.push_back(p);
            b.saved.push_back(s.point_next[p]);
        }
    }
    const uint32_t before = static_cast<uint32_t>(s.points.size());
    SimplifyOptions simplify_options;
    simplify_options.target_triangles = before / 2;
    simplify_options.first_error = expected_share * b.expected_error;
    const float error = simplify(s, b.positions.data(), b.shared.data(), simplify_options);
    const uint32_t after = static_cast<uint32_t>(s.points.size());
    if (static_cast<float>(after) > worth_keeping * static_cast<float>(before)) {
        for (size_t i = 0; i < b.saved.size(); i += 2) {
            s.point_next[b.saved[i]] = b.saved[i + 1];
        }
        return false;
    }

    const float reached = std::max(error, child_error);
    b.expected_error = b.expected_error > 0 ? 0.8f * b.expected_error + 0.2f * reached : reached;
    const uint32_t number = static_cast<uint32_t>(b.group_error.size());
    b.group_error.push_back(reached);
    for (uint32_t i = b.group_begin[group]; i < b.group_begin[group + 1]; ++i) {
        const uint32_t c = b.pool[b.group_members[i]];
        clusters.parent_group[c] = number;
        mesh.groups.clusters.push_back(c);
    }
    mesh.groups.cluster_begin.push_back(static_cast<uint32_t>(mesh.groups.clusters.size()));

    const uint32_t first = clusters.count();
    Vector<uint32_t> side(b.numbers), heads(b.numbers);
    for (uint8_t flag = 0; flag < 2; ++flag) {
        side.clear();
        heads.clear();
        for (uint32_t t = 0; t < after; ++t) {
            if (two_sided[s.source[t]] != flag) continue;
            side.insert(side.end(), s.triangles.begin() + 3 * t, s.triangles.begin() + 3 * t + 3);
            heads.push_back(s.points[t]);
        }
        if (!side.empty()) add_clusters(b, options, side, &heads, {number, flag, level}, clusters);
    }
    for (uint32_t c = first; c < clusters.count(); ++c) {
        next_pool.push_back(c);
    }
    return true;
}

// One mesh of a few hundred triangles, from the first level that is small enough to be quick about it.
void build_coarse(Builder& b, const LevelOptions& options, uint32_t target, MeshData& mesh) {
    Simplifier& s = b.simplifier;
    const Clusters& clusters = mesh.clusters;
    s.triangles.clear();
    Vector<uint8_t> two_sided{HostAllocator<uint8_t>(b.numbers)};
    for (const Vector<uint32_t>* list : {&b.pool, &b.retired}) {
        for (const uint32_t c : *list) {
            const uint32_t begin = clusters.triangle_begin[c], end = clusters.triangle_begin[c + 1];
            s.triangles.insert(s.triangles.end(), b.triangles.begin() + 3 * begin,
                               b.triangles.begin() + 3 * end);
            two_sided.insert(two_sided.end(), end - begin, clusters.two_sided[c]);
        }
    }
    SimplifyOptions simplify_options;
    simplify_options.target_triangles = target;
    simplify_options.measure = false;
    simplify(s, b.positions.data(), nullptr, simplify_options);
    Vector<uint32_t> side(b.numbers);
    for (uint8_t flag = 0; flag < 2; ++flag) {
        side.clear();
        for (uint32_t t = 0; t < s.source.size(); ++t) {
            if (two_sided[s.source[t]] != flag) continue;
            side.insert(side.end(), s.triangles.begin() + 3 * t, s.triangles.begin() + 3 * t + 3);
        }
        if (!side.empty()) add_clusters(b, options, side, nullptr, {no_group, flag, 0}, mesh.coarse_clusters);
    }
}

uint32_t pool_triangles(const Builder& b, const Clusters& clusters) {
    uint32_t sum = 0;
    for (const Vector<uint32_t>* list : {&b.pool, &b.retired}) {
        for (const uint32_t c : *list) {
            sum += triangle_count(clusters, c);
        }
    }
    return sum;
}

void build_levels(Builder& b, const LevelOptions& options, MeshData& mesh) {
    const uint32_t full = static_cast<uint32_t>(mesh.full_triangles.size() / 3);
    Clusters& clusters = mesh.clusters;
    Vector<uint32_t> side(b.numbers);
    const Vector<uint32_t> no_points(b.numbers);
    for (uint8_t flag = 0; flag < 2; ++flag) {
        side.clear();
        for (uint32_t t = 0; t < full; ++t) {
            if (mesh.full_two_sided[t] != flag) continue;
            side.insert(side.end(), mesh.full_triangles.begin() + 3 * t,
                        mesh.full_triangles.begin() + 3 * t + 3);
        }
        if (!side.empty()) add_clusters(b, options, side, &no_points, {no_group, flag, 0}, clusters);
    }
    finish_new_clusters(b, clusters, 0);

    const uint32_t target = uint64_t(full) * 2 < uint64_t(options.coarse_triangles) * 5
                                ? std::max(full / 10, std::min(full, 64u))
                                : options.coarse_triangles;
    bool have_coarse = false;
    const auto coarse_now = [&](bool last) {
        if (have_coarse || full == 0 || (!last && pool_triangles(b, clusters) > 8 * target)) return;
        have_coarse = true;
        build_coarse(b, options, target, mesh);
    };
    Vector<uint32_t> next_pool(b.numbers);
    for (uint8_t level = 1; level < max_levels && b.pool.size() > 1; ++level) {
        coarse_now(false);
        b.expected_error *= 2;
        group_pool(b, options, clusters);
        mark_shared_vertices(b, clusters);
        next_pool.clear();
        const uint32_t first = clusters.count();
        const uint32_t group_count = static_cast<uint32_t>(b.group_begin.size() - 1);
        bool any = false;
        for (uint32_t g = 0; g < group_count; ++g) {
            if (build_group(b, options, g, level, next_pool, mesh)) {
                any = true;
                continue;
            }
            for (uint32_t i = b.group_begin[g]; i < b.group_begin[g + 1]; ++i) {
                const uint32_t c = b.pool[b.group_members[i]];
                ++b.attempts[c];
                (b.attempts[c] < max_attempts && group_count > 1 ? next_pool : b.retired).push_back(c);
            }
        }
        b.pool.clear();
        finish_new_clusters(b, clusters, first);
        b.pool.assign(next_pool.begin(), next_pool.end());
        if (!any) break;
    }
    coarse_now(true);
}

// Errors so far are distances in normalised units: relative to the spheres that the frame will compute.
void finish_groups(const Builder& b, MeshData& mesh) {
    const HostAllocator<Sphere> spheres(b.numbers);
    const uint32_t clusters = mesh.clusters.count(), groups = static_cast<uint32_t>(b.group_error.size());
    Vector<Sphere> cluster_spheres(clusters, Sphere{}, spheres), group_spheres(groups, Sphere{}, spheres);
    Vector<Cone> cones(clusters, Cone{}, HostAllocator<Cone>(b.numbers));
    Vector<float> errors(groups, 0, HostAllocator<float>(b.numbers));
    mesh.groups.relative_error.assign(groups, 0);
    const auto position = [&](uint32_t w) { return b.positions[w]; };
    refit_bounds(position, mesh.clusters, mesh.groups, cluster_spheres.data(), cones.data(),
                 group_spheres.data(), errors.data());
    for (uint32_t g = 0; g < groups; ++g) {
        const float radius = group_spheres[g].radius;
        mesh.groups.relative_error[g] = radius > 0 ? b.group_error[g] / radius : 0;
    }
}

} // namespace

void build_mesh(const MeshDesc& desc, const LevelOptions& options, const Allocator& allocator, MeshData& mesh,
                MeshInfo& info) {
    info = {};
    mesh.vertex_count = static_cast<uint32_t>(desc.rest_positions.count);
    weld_positions(desc.rest_positions, mesh.weld, mesh.weld_source);
    const uint32_t welded = static_cast<uint32_t>(mesh.weld_source.size());
    info.vertices = mesh.vertex_count;
    info.triangles = static_cast<uint32_t>(desc.index_count / 3);
    info.welded_vertices = welded;
    info.degenerate_triangles =
        weld_triangles(desc.rest_positions, desc.indices, desc.index_count, mesh.weld, mesh.full_triangles);

    Builder builder(allocator, welded);
    normalise_positions(desc, mesh.weld_source, builder.positions);
    const uint32_t full = static_cast<uint32_t>(mesh.full_triangles.size() / 3);
    Topology topology(allocator);
    match_edges(mesh.full_triangles.data(), full, welded, builder.partitioner.matcher,
                builder.partitioner.mate);
    find_components(mesh.full_triangles.data(), full, builder.positions.data(), builder.partitioner.mate,
                    topology);
    info.components = static_cast<uint32_t>(topology.component_closed.size());
    for (const uint8_t closed : topology.component_closed) {
        info.closed_components += closed;
    }
    info.boundary_edges = topology.boundary_edges;
    info.non_manifold_edges = topology.non_manifold_edges;
    info.flipped_edges = topology.flipped_edges;
    mesh.full_two_sided.resize(full);
    for (uint32_t t = 0; t < full; ++t) {
        mesh.full_two_sided[t] = !topology.component_closed[topology.triangle_component[t]];
    }

    build_fans(welded, mesh);
    build_rings(welded, mesh);
    build_receivers(desc, builder.positions.data(), allocator, mesh);

    begin_clusters(mesh.clusters);
    begin_clusters(mesh.coarse_clusters);
    mesh.groups.cluster_begin.assign(1, 0);
    build_levels(builder, options, mesh);
    finish_groups(builder, mesh);

    info.clusters = mesh.clusters.count();
    info.levels = 1;
    for (uint32_t c = 0; c < mesh.clusters.count(); ++c) {
        const uint32_t level = mesh.clusters.level[c];
        info.level_triangles[level] += triangle_count(mesh.clusters, c);
        info.levels = std::max(info.levels, level + 1);
    }
}

} // namespace nusselt
