#include "levels.h"

#include "bridges.h"
#include "clusters.h"
#include "covers.h"
#include "receivers.h"
#include "simplify.h"
#include "topology.h"
#include "weld.h"

#include <algorithm>
#include <limits>

namespace nusselt {

namespace {

// A level that keeps more of its triangles than this is not worth having.
constexpr double worth_keeping = 0.8;
// The dearest collapse of a level costs 5 to 25 times that of the level before it. From so many times on,
// parts that can't go on are paid for by crushing the others: a level that has lost enough ends there.
constexpr double dear = 40;
constexpr double enough = 0.6;
// The coarse mesh is made from the last level that has so many times its triangles.
constexpr uint32_t coarse_start = 4;
// Vertices of more triangles than this bring no ring to their neighbours (quality `paper`): the rings of a
// hub's neighbours would grow with the square of their number.
constexpr uint32_t max_ring_valence = 256;
// Closed parts of so many triangles have clusters of their own.
constexpr uint32_t own_clusters = 16;

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

struct Builder {
    Builder(const Allocator& a, uint32_t welded)
        : numbers(a), positions(HostAllocator<Vec3f>(a)), two_sided(HostAllocator<uint8_t>(a)), side(numbers),
          side_source(numbers), clustered(numbers), local_of(welded, none, numbers),
          coarse_triangles(numbers), coarse_two_sided(HostAllocator<uint8_t>(a)), before(a),
          simplifier(a, welded), partitioner(a), writer(a) {}

    HostAllocator<uint32_t> numbers;
    Vector<Vec3f> positions;            // welded
    Vector<uint8_t> two_sided;          // of the simplifier's triangles
    Vector<uint32_t> side, side_source; // welded triples of one kind, and the simplifier's triangles they are
    Vector<uint32_t> clustered;         // the simplifier's triangles in the order of the clusters
    Vector<uint32_t> local_of;          // by welded vertex
    Vector<uint32_t> coarse_triangles;  // what the coarse mesh is made from; none: the full mesh
    Vector<uint8_t> coarse_two_sided;
    SurfaceTree before; // the level before the current one
    uint32_t coarse_target = 0;
    double last_cost = 0;  // of the current level's dearest collapse; 0: the full mesh
    Simplifier simplifier; // its triangles are the current level's
    Partitioner partitioner;
    ClusterWriter writer;
};

// Gives the memory of making clusters back: simplifying, which comes next, takes most of all.
void release_clustering(Builder& b) {
    for (Vector<uint32_t>* v : {&b.side, &b.side_source, &b.clustered})
        Vector<uint32_t>(b.numbers).swap(*v);
    b.partitioner = Partitioner(b.numbers.host);
}

// Triangles of the simplifier's as clusters: those whose numbers are in b.side_source.
void add_side(Builder& b, const LevelOptions& options, ClusterKind kind, Clusters& clusters) {
    const Vector<uint32_t>& all = b.simplifier.triangles;
    b.side.clear();
    for (const uint32_t t : b.side_source)
        b.side.insert(b.side.end(), all.begin() + 3 * size_t(t), all.begin() + 3 * size_t(t) + 3);
    if (b.side.empty()) return;
    Partitioner& p = b.partitioner;
    partition_triangles(b.side, b.positions.data(), options.cluster_triangles, b.local_of, p);
    part_large_triangles(b.side, b.positions.data(), options.cluster_triangles, p);
    for (size_t i = 0; i + 1 < p.begins.size(); ++i) {
        append_clusters(b.side, p.order.data() + p.begins[i], p.begins[i + 1] - p.begins[i], kind, b.writer,
                        b.local_of, clusters);
    }
    for (const uint32_t i : p.order)
        b.clustered.push_back(b.side_source[i]);
}

// The simplifier's triangles as clusters; never both kinds in one. `b.clustered`: their numbers in the
// clusters' order.
void add_clusters(Builder& b, const LevelOptions& options, uint8_t level, Clusters& clusters) {
    b.clustered.clear();
    for (uint8_t flag = 0; flag < 2; ++flag) {
        b.side_source.clear();
        for (uint32_t t = 0; t < b.two_sided.size(); ++t) {
            if (b.two_sided[t] == flag) b.side_source.push_back(t);
        }
        add_side(b, options, {flag, level}, clusters);
    }
}

// The same for the full mesh, part by part where they are closed.
void add_full_clusters(Builder& b, const LevelOptions& options, const Topology& topology, MeshData& mesh) {
    const Vector<uint32_t>& component = topology.triangle_component;
    const uint32_t components = static_cast<uint32_t>(topology.component_closed.size());
    Vector<uint32_t> size(components, 0, b.numbers);
    for (const uint32_t c : component)
        ++size[c];
    // Open parts, then closed ones, then all small closed ones.
    Vector<uint32_t> part(components, 0, b.numbers);
    uint32_t parts = 1;
    for (uint32_t c = 0; c < components; ++c) {
        if (topology.component_closed[c] && size[c] >= own_clusters) part[c] = parts++;
    }
    for (uint32_t c = 0; c < components; ++c) {
        if (topology.component_closed[c] && size[c] < own_clusters) part[c] = parts;
    }
    Vector<uint32_t> begin(parts + 2, 0, b.numbers);
    for (const uint32_t c : component)
        ++begin[part[c] + 1];
    for (uint32_t i = 0; i <= parts; ++i)
        begin[i + 1] += begin[i];
    Vector<uint32_t> fill(begin, b.numbers), order(component.size(), 0, b.numbers);
    for (uint32_t t = 0; t < component.size(); ++t)
        order[fill[part[component[t]]]++] = t;

    b.clustered.clear();
    const auto add = [&](uint32_t i, uint8_t two_sided) {
        b.side_source.assign(order.begin() + begin[i], order.begin() + begin[i + 1]);
        add_side(b, options, {two_sided, 0}, mesh.clusters);
    };
    for (uint32_t i = 1; i <= parts; ++i) {
        add(i, 0);
        mesh.closed_parts.push_back(mesh.clusters.count());
    }
    mesh.closed_clusters = mesh.clusters.count();
    add(0, 1);
}

// Simplifies the current level to about `target` triangles. False: there was too little to gain.
bool coarsen(Builder& b, uint32_t target, bool measure) {
    Simplifier& s = b.simplifier;
    const size_t before = s.triangles.size() / 3;
    SimplifyOptions options;
    options.target_triangles = target;
    options.measure = measure;
    if (measure && b.last_cost > 0) {
        options.most_cost = dear * b.last_cost;
        options.enough_triangles = static_cast<uint32_t>(enough * double(before));
    }
    simplify(s, b.positions.data(), options);
    if (measure) b.last_cost = s.dearest;
    const size_t after = s.triangles.size() / 3;
    for (size_t t = 0; t < after; ++t) // `source` rises: what is read was not yet written
        b.two_sided[t] = b.two_sided[s.source[t]];
    b.two_sided.resize(after);
    return after > 0 && double(after) < worth_keeping * double(before);
}

// Samples of one triangle of the current level. Returns the square of the largest distance.
double add_samples_of(const Builder& b, uint32_t triangle, LevelSamples& samples) {
    const Simplifier& s = b.simplifier;
    const auto at = [&](uint32_t w) { return to_double(b.positions[w]); };
    const uint32_t* corner = s.triangles.data() + 3 * size_t(triangle);
    const Vec3d normal = cross(at(corner[1]) - at(corner[0]), at(corner[2]) - at(corner[0]));
    double most = 0;
    for (uint32_t p = s.points[triangle]; p != none; p = s.point_next[p]) {
        const Vec3f weight = to_float(nearest_weights(at(p), at(corner[0]), at(corner[1]), at(corner[2])));
        samples.vertex.push_back(p);
        samples.corner.insert(samples.corner.end(), corner, corner + 3);
        samples.weight.insert(samples.weight.end(), {weight.x, weight.y, weight.z});
        const Vec3d nearest = at(corner[0]) * double(weight.x) + at(corner[1]) * double(weight.y) +
                              at(corner[2]) * double(weight.z);
        const Vec3d away = at(p) - nearest;
        const double square = dot(away, away), across = dot(away, normal);
        const double along =
            square * dot(normal, normal) > 0 ? 1 - across * across / (square * dot(normal, normal)) : 0.0;
        samples.tangential.push_back(static_cast<float>(std::clamp(along, 0.0, 1.0)));
        most = std::max(most, square);
    }
    return most;
}

// Samples of the current level at the vertices that the one before it has and it lacks, and where it bridges
// that one, cluster by cluster.
void add_samples(const Builder& b, uint8_t level, const Clusters& clusters, LevelSamples& samples) {
    const uint32_t* numbers = b.clustered.data();
    for (uint32_t c = static_cast<uint32_t>(samples.bridges.size()); c < clusters.count(); ++c) {
        const uint32_t count = clusters.triangle_begin[c + 1] - clusters.triangle_begin[c];
        samples.cluster_begin.push_back(static_cast<uint32_t>(samples.vertex.size()));
        Bridge bridge{none, {}, {}, 0};
        if (level > 0) {
            double most = 0;
            for (uint32_t i = 0; i < count; ++i)
                most = std::max(most, add_samples_of(b, numbers[i], samples));
            bridge = find_bridge(b.before, b.positions.data(), b.simplifier.triangles.data(), numbers, count,
                                 clusters.two_sided[c] != 0, most);
        }
        samples.bridges.push_back(bridge);
        numbers += count;
    }
}

void build_levels(Builder& b, const LevelOptions& options, const Topology& topology, MeshData& mesh) {
    b.simplifier.triangles = mesh.full_triangles;
    b.two_sided = mesh.full_two_sided;
    const uint32_t full = static_cast<uint32_t>(b.two_sided.size());
    b.coarse_target = uint64_t(full) * 2 < uint64_t(options.coarse_triangles) * 5
                          ? std::max(full / 10, std::min(full, 64u))
                          : options.coarse_triangles;
    mesh.samples.begin.assign(2, 0);
    mesh.closed_parts.assign(1, 0);
    for (uint8_t level = 0; !b.two_sided.empty(); ++level) {
        if (level == 0) {
            add_full_clusters(b, options, topology, mesh);
        } else {
            add_clusters(b, options, level, mesh.clusters);
        }
        add_samples(b, level, mesh.clusters, mesh.samples);
        if (level > 0) mesh.samples.begin.push_back(static_cast<uint32_t>(mesh.samples.vertex.size()));
        const uint32_t count = static_cast<uint32_t>(b.two_sided.size());
        if (level > 0 && count >= coarse_start * b.coarse_target) {
            b.coarse_triangles = b.simplifier.triangles;
            b.coarse_two_sided = b.two_sided;
        }
        const uint32_t target = static_cast<uint32_t>(float(count) * options.level_ratio);
        if (level + 1 == max_levels || target < options.least_triangles) break;
        release_clustering(b);
        build_surface_tree(b.simplifier.triangles, b.positions.data(), b.before);
        if (!coarsen(b, target, true)) break;
    }
    mesh.samples.cluster_begin.push_back(static_cast<uint32_t>(mesh.samples.vertex.size()));
}

// One mesh of a few hundred triangles, for the quality `paper`.
void build_coarse(Builder& b, const LevelOptions& options, MeshData& mesh) {
    const auto coarsen_to = [&](uint32_t target) {
        b.simplifier.triangles = b.coarse_triangles.empty() ? mesh.full_triangles : b.coarse_triangles;
        b.two_sided = b.coarse_triangles.empty() ? mesh.full_two_sided : b.coarse_two_sided;
        coarsen(b, target, false);
        return static_cast<uint32_t>(b.two_sided.size());
    };
    // Where the target is out of reach, everything that could go has gone: parts are crushed to a triangle or
    // two next to others that are stuck. Nothing measures this mesh, so it gets as many triangles again.
    const uint32_t left = coarsen_to(b.coarse_target);
    if (left > b.coarse_target) coarsen_to(2 * left);
    add_clusters(b, options, 0, mesh.coarse_clusters);
}

// Breadth first over the full mesh's edges, from the coarse mesh's vertices. What no edge leads to is its own
// anchor.
void build_anchors(MeshData& mesh) {
    const uint32_t welded = static_cast<uint32_t>(mesh.weld_source.size());
    mesh.anchor.assign(welded, none);
    Vector<uint32_t> queue(mesh.anchor.get_allocator());
    for (const uint32_t w : mesh.coarse_clusters.vertices) {
        if (mesh.anchor[w] != none) continue;
        mesh.anchor[w] = w;
        queue.push_back(w);
    }
    for (size_t i = 0; i < queue.size(); ++i) {
        const uint32_t w = queue[i];
        for (uint32_t k = 2 * mesh.fan_begin[w]; k < 2 * mesh.fan_begin[w + 1]; ++k) {
            const uint32_t next = mesh.fan[k];
            if (mesh.anchor[next] != none) continue;
            mesh.anchor[next] = mesh.anchor[w];
            queue.push_back(next);
        }
    }
    for (uint32_t w = 0; w < welded; ++w)
        mesh.anchor[w] = mesh.anchor[w] == none ? w : mesh.anchor[w];
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
    mesh.solid.assign(welded, 1);
    for (size_t c = 0; c < mesh.full_triangles.size(); ++c) {
        if (mesh.full_two_sided[c / 3]) mesh.solid[mesh.full_triangles[c]] = 0;
    }
    build_rings(welded, mesh);
    build_receivers(desc, builder.positions.data(), allocator, mesh);

    begin_clusters(mesh.clusters);
    begin_clusters(mesh.coarse_clusters);
    build_levels(builder, options, topology, mesh);
    build_covers(allocator, mesh);
    build_coarse(builder, options, mesh);
    build_anchors(mesh);

    info.clusters = mesh.clusters.count();
    info.levels = 1;
    for (uint32_t c = 0; c < mesh.clusters.count(); ++c) {
        const uint32_t level = mesh.clusters.level[c];
        info.level_triangles[level] += mesh.clusters.triangle_begin[c + 1] - mesh.clusters.triangle_begin[c];
        info.levels = std::max(info.levels, level + 1);
    }
    info.coarse_triangles = mesh.coarse_clusters.triangle_begin[mesh.coarse_clusters.count()];
}

} // namespace nusselt
