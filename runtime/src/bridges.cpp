#include "bridges.h"

#include "weld.h"

#include <algorithm>
#include <limits>

namespace nusselt {

namespace {

constexpr uint32_t leaf_triangles = 4;
constexpr uint32_t most_depth = 64; // of a tree of halves, with room to spare
// A query looks at some ten leaves of a real model; where all boxes lie on one another, at no more than so
// many: what it has found is then farther than the nearest, and the level serves farther off.
constexpr uint32_t most_leaves = 1000;

// Of the largest distance of a lost vertex. What lies above the closed surface that it stands for hides what
// it should not, and counts sooner; sheets have no above.
constexpr double beyond = 1, beyond_above = 0.75;
// Of positions within 1: what rounding alone may give.
constexpr double least_square = 1e-12;

constexpr double third = 1.0 / 3, sixth = 1.0 / 6;
constexpr Vec3d looked_at[4] = {
    {third, third, third}, {4 * sixth, sixth, sixth}, {sixth, 4 * sixth, sixth}, {sixth, sixth, 4 * sixth}};

struct Corners {
    Vec3d a, b, c;
};

Corners corners_of(const uint32_t* triangle, const Vec3f* positions) {
    return {to_double(positions[triangle[0]]), to_double(positions[triangle[1]]),
            to_double(positions[triangle[2]])};
}

Vec3d least(Vec3d a, Vec3d b) {
    return {std::min(a.x, b.x), std::min(a.y, b.y), std::min(a.z, b.z)};
}

Vec3d largest(Vec3d a, Vec3d b) {
    return {std::max(a.x, b.x), std::max(a.y, b.y), std::max(a.z, b.z)};
}

double square_to_box(Vec3d p, const SurfaceTree::Node& node) {
    const Vec3d nearest = largest(to_double(node.low), least(p, to_double(node.high)));
    return dot(p - nearest, p - nearest);
}

// What only building a tree needs.
struct TreeBuilder {
    const Vector<uint32_t>& triangles;
    const Vec3f* positions;
    Vector<uint32_t> order; // numbers of triangles
    Vector<Vec3d> centres;  // by number
};

void add_node(TreeBuilder& b, uint32_t begin, uint32_t end, SurfaceTree& tree) {
    const size_t own = tree.nodes.size();
    tree.nodes.push_back({{}, {}, begin, end, 0});
    if (end - begin <= leaf_triangles) {
        constexpr double none_yet = std::numeric_limits<double>::max();
        Vec3d low{none_yet, none_yet, none_yet}, high = low * -1.0;
        for (uint32_t i = begin; i < end; ++i) {
            const Corners t = corners_of(&b.triangles[3 * size_t(b.order[i])], b.positions);
            low = least(low, least(t.a, least(t.b, t.c)));
            high = largest(high, largest(t.a, largest(t.b, t.c)));
        }
        tree.nodes[own].low = to_float(low); // exact: they are corners' coordinates
        tree.nodes[own].high = to_float(high);
        return;
    }
    Vec3d low = b.centres[b.order[begin]], high = low;
    for (uint32_t i = begin; i < end; ++i) {
        low = least(low, b.centres[b.order[i]]);
        high = largest(high, b.centres[b.order[i]]);
    }
    const Vec3d size = high - low;
    const auto along = [&](uint32_t t) {
        const Vec3d& c = b.centres[t];
        return size.x >= size.y && size.x >= size.z ? c.x : size.y >= size.z ? c.y : c.z;
    };
    const uint32_t middle = begin + (end - begin) / 2;
    std::nth_element(
        b.order.begin() + begin, b.order.begin() + middle, b.order.begin() + end,
        [&](uint32_t s, uint32_t t) { return along(s) < along(t) || (along(s) == along(t) && s < t); });
    add_node(b, begin, middle, tree);
    const uint32_t second = static_cast<uint32_t>(tree.nodes.size());
    add_node(b, middle, end, tree);
    SurfaceTree::Node& node = tree.nodes[own];
    const SurfaceTree::Node &one = tree.nodes[own + 1], &other = tree.nodes[second];
    node.second = second;
    node.low = to_float(least(to_double(one.low), to_double(other.low)));
    node.high = to_float(largest(to_double(one.high), to_double(other.high)));
}

// Nodes that so many triangles have at most: as many leaves as halving needs, all as deep.
size_t most_nodes(uint32_t triangles) {
    size_t leaves = 1;
    while (leaves * leaf_triangles < triangles)
        leaves *= 2;
    return 2 * leaves - 1;
}

} // namespace

Vec3d nearest_weights(Vec3d p, Vec3d a, Vec3d b, Vec3d c) {
    const Vec3d ab = b - a, ac = c - a, ap = p - a;
    const double d1 = dot(ab, ap), d2 = dot(ac, ap);
    if (d1 <= 0 && d2 <= 0) return {1, 0, 0};
    const Vec3d bp = p - b;
    const double d3 = dot(ab, bp), d4 = dot(ac, bp);
    if (d3 >= 0 && d4 <= d3) return {0, 1, 0};
    const double vc = d1 * d4 - d3 * d2;
    if (vc <= 0 && d1 >= 0 && d3 <= 0) return {1 - d1 / (d1 - d3), d1 / (d1 - d3), 0};
    const Vec3d cp = p - c;
    const double d5 = dot(ab, cp), d6 = dot(ac, cp);
    if (d6 >= 0 && d5 <= d6) return {0, 0, 1};
    const double vb = d5 * d2 - d1 * d6;
    if (vb <= 0 && d2 >= 0 && d6 <= 0) return {1 - d2 / (d2 - d6), 0, d2 / (d2 - d6)};
    const double va = d3 * d6 - d5 * d4;
    if (va <= 0 && d4 >= d3 && d5 >= d6) {
        const double w = (d4 - d3) / (d4 - d3 + d5 - d6);
        return {0, 1 - w, w};
    }
    const double sum = va + vb + vc;
    if (!(sum > 0)) return {1, 0, 0};
    return {va / sum, vb / sum, vc / sum};
}

void build_surface_tree(const Vector<uint32_t>& triangles, const Vec3f* positions, SurfaceTree& tree) {
    const uint32_t count = static_cast<uint32_t>(triangles.size() / 3);
    tree.triangles.resize(triangles.size());
    tree.nodes.clear();
    if (count == 0) return;
    const auto numbers = tree.triangles.get_allocator();
    TreeBuilder b{triangles, positions, Vector<uint32_t>(count, 0, numbers),
                  Vector<Vec3d>(count, {}, HostAllocator<Vec3d>(numbers))};
    for (uint32_t t = 0; t < count; ++t) {
        const Corners c = corners_of(&triangles[3 * size_t(t)], positions);
        b.order[t] = t;
        b.centres[t] = (c.a + c.b + c.c) * third;
    }
    tree.nodes.reserve(most_nodes(count));
    add_node(b, 0, count, tree);
    for (uint32_t i = 0; i < count; ++i)
        std::copy_n(&triangles[3 * size_t(b.order[i])], 3, &tree.triangles[3 * size_t(i)]);
}

SurfacePoint find_near(const SurfaceTree& tree, const Vec3f* positions, Vec3d p, double enough,
                       uint32_t& leaf) {
    SurfacePoint near{std::numeric_limits<double>::max(), {}, none};
    const auto look_at = [&](uint32_t number) {
        const SurfaceTree::Node& node = tree.nodes[number];
        for (uint32_t i = node.begin; i < node.end; ++i) {
            const uint32_t* triangle = &tree.triangles[3 * size_t(i)];
            const Corners t = corners_of(triangle, positions);
            const Vec3d w = nearest_weights(p, t.a, t.b, t.c);
            const Vec3d point = t.a * w.x + t.b * w.y + t.c * w.z;
            const double square = dot(p - point, p - point);
            if (!(square < near.square)) continue; // not where triangles are so thin that it is none
            const uint32_t corner = w.x >= w.y && w.x >= w.z ? 0 : w.y >= w.z ? 1 : 2;
            near = {square, point, triangle[corner]};
            leaf = number;
        }
    };
    look_at(leaf);
    struct Entry {
        uint32_t node;
        double square;
    };
    Entry stack[most_depth];
    uint32_t depth = 0, leaves = 0;
    stack[depth++] = {0, 0};
    while (depth > 0 && near.square > enough) {
        const Entry entry = stack[--depth];
        if (entry.square >= near.square) continue;
        const SurfaceTree::Node& node = tree.nodes[entry.node];
        if (!node.second) {
            if (++leaves > most_leaves) break;
            look_at(entry.node);
            continue;
        }
        const Entry first{entry.node + 1, square_to_box(p, tree.nodes[entry.node + 1])};
        const Entry second{node.second, square_to_box(p, tree.nodes[node.second])};
        const bool swap = first.square < second.square; // the nearer is looked at first
        stack[depth++] = swap ? second : first;
        stack[depth++] = swap ? first : second;
    }
    return near;
}

Bridge find_bridge(const SurfaceTree& tree, const Vec3f* positions, const uint32_t* corners,
                   const uint32_t* triangles, uint32_t count, bool two_sided, double most_square) {
    Bridge bridge{none, {}, {}, 0};
    double farthest = 0;
    uint32_t leaf = static_cast<uint32_t>(tree.nodes.size()) - 1; // the last node is one
    const double sooner = two_sided ? beyond : beyond_above;
    const double least_far = std::max(sooner * sooner * most_square, least_square);
    for (uint32_t i = 0; i < count; ++i) {
        const uint32_t* corner = corners + 3 * size_t(triangles[i]);
        const Corners t = corners_of(corner, positions);
        for (const Vec3d& w : looked_at) {
            const Vec3d p = t.a * w.x + t.b * w.y + t.c * w.z;
            const SurfacePoint near = find_near(tree, positions, p, std::max(farthest, least_far), leaf);
            if (!(near.square > std::max(farthest, least_far))) continue;
            const bool above = dot(cross(t.b - t.a, t.c - t.a), p - near.point) > 0;
            if (!two_sided && !above && near.square <= beyond * beyond * most_square) continue;
            const Vec3d away = p - to_double(positions[near.vertex]);
            if (!(dot(away, away) > 0)) continue;
            farthest = near.square;
            const Vec3f weight = to_float(w);
            bridge = {near.vertex,
                      {corner[0], corner[1], corner[2]},
                      {weight.x, weight.y, weight.z},
                      static_cast<float>(near.square / dot(away, away))};
        }
    }
    return bridge;
}

} // namespace nusselt
