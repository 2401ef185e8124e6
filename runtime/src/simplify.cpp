#include "simplify.h"

#include <algorithm>
#include <limits>

namespace nusselt {

namespace {

// Normals of changed triangles turn by at most 75 degrees.
constexpr double min_turn_cosine = 0.2588;
// Border planes against surface planes, for the same length and distance.
constexpr double border_weight = 4.0;
// Share of the squared edge length in the cost: in flat regions short edges go first, so triangles keep their
// shape.
constexpr double length_weight = 1e-3;
// Twice the area over the sum of squared edges; 0.577 is equilateral. A sliver may stay but not get worse.
constexpr double sliver_shape = 0.02;
// Reshaping collapses make no hub of more triangles: everything around one would be looked at again and
// again.
constexpr size_t max_reshaped = 64;
// A vertex of more triangles stays: to try all ways to move the pole of a fan of n, each time one of its
// neighbours has moved, takes n^3 steps.
constexpr uint32_t max_moved = 256;
// A call ends after so many steps (Simplifier::steps), and as many for each triangle: what it has reached by
// then is the result. Levels of real models take 40 for each triangle, 420 at most (one of 114 triangles, the
// last of a chess-board); 44,000 were seen where 48,000 triangles joined 6,000 random points, and a strip
// that is eaten up from its end takes the square of its triangles.
constexpr uint64_t first_steps = 100000, steps_of_a_triangle = 1000;

void add(Quadric& q, const Quadric& r) {
    q.xx += r.xx, q.yy += r.yy, q.zz += r.zz;
    q.xy += r.xy, q.xz += r.xz, q.yz += r.yz;
    q.x += r.x, q.y += r.y, q.z += r.z;
    q.c += r.c, q.weight += r.weight;
}

Quadric plane_quadric(Vec3d n, Vec3d point, double weight) {
    const double d = -dot(n, point);
    const Vec3d w = n * weight;
    Quadric q;
    q.xx = w.x * n.x, q.yy = w.y * n.y, q.zz = w.z * n.z;
    q.xy = w.x * n.y, q.xz = w.x * n.z, q.yz = w.y * n.z;
    q.x = w.x * d, q.y = w.y * d, q.z = w.z * d;
    q.c = weight * d * d;
    q.weight = weight;
    return q;
}

double evaluate(const Quadric& q, Vec3d p) {
    const double x = q.xx * p.x + q.xy * p.y + q.xz * p.z + 2 * q.x;
    const double y = q.xy * p.x + q.yy * p.y + q.yz * p.z + 2 * q.y;
    const double z = q.xz * p.x + q.yz * p.y + q.zz * p.z + 2 * q.z;
    return std::max(0.0, x * p.x + y * p.y + z * p.z + q.c);
}

// Squared distance from p to the triangle (Ericson, Real-Time Collision Detection, 5.1.5).
float distance2(Vec3f p, Vec3f a, Vec3f b, Vec3f c) {
    const Vec3f ab = b - a, ac = c - a, ap = p - a;
    const float d1 = dot(ab, ap), d2 = dot(ac, ap);
    const auto to = [&](Vec3f q) { return dot(p - q, p - q); };
    if (d1 <= 0 && d2 <= 0) return dot(ap, ap);
    const Vec3f bp = p - b;
    const float d3 = dot(ab, bp), d4 = dot(ac, bp);
    if (d3 >= 0 && d4 <= d3) return dot(bp, bp);
    const float vc = d1 * d4 - d3 * d2;
    if (vc <= 0 && d1 >= 0 && d3 <= 0) return to(a + ab * (d1 / std::max(d1 - d3, 1e-37f)));
    const Vec3f cp = p - c;
    const float d5 = dot(ab, cp), d6 = dot(ac, cp);
    if (d6 >= 0 && d5 <= d6) return dot(cp, cp);
    const float vb = d5 * d2 - d1 * d6;
    if (vb <= 0 && d2 >= 0 && d6 <= 0) return to(a + ac * (d2 / std::max(d2 - d6, 1e-37f)));
    const float va = d3 * d6 - d5 * d4;
    if (va <= 0 && d4 - d3 >= 0 && d5 - d6 >= 0) {
        return to(b + (c - b) * ((d4 - d3) / std::max((d4 - d3) + (d5 - d6), 1e-37f)));
    }
    const float sum = std::max(va + vb + vc, 1e-37f);
    return to(a + ab * (vb / sum) + ac * (vc / sum));
}

uint32_t next_corner(uint32_t c) {
    return c % 3 == 2 ? c - 2 : c + 1;
}
uint32_t last_corner(uint32_t c) {
    return c % 3 == 0 ? c + 2 : c - 1;
}

bool later(const Simplifier::HeapEntry& a, const Simplifier::HeapEntry& b) {
    return a.cost != b.cost ? a.cost > b.cost : a.vertex > b.vertex;
}

Vec3d at(const Simplifier& s, uint32_t v) {
    return to_double(s.positions[v]);
}

// Calls run for each living corner of v; dead ones leave the list.
template<class Run>
void each_corner(Simplifier& s, uint32_t v, const Run& run) {
    s.steps += s.fan_size[v];
    uint32_t* link = &s.head[v];
    while (*link != none) {
        const uint32_t c = *link;
        if (!s.alive[c / 3]) {
            *link = s.next[c];
            continue;
        }
        run(c);
        link = &s.next[c];
    }
}

// The living corners of v into `fan`.
void gather_fan(Simplifier& s, uint32_t v) {
    s.fan.clear();
    each_corner(s, v, [&](uint32_t c) { s.fan.push_back(c); });
}

// The neighbours of v into `ring`, from its fan. Returns the base: mark[u] - base is u's place in the ring.
uint32_t gather_ring(Simplifier& s) {
    s.ring.clear();
    if (s.stamp > 0xF0000000u) {
        std::fill(s.mark.begin(), s.mark.end(), 0);
        s.stamp = 0;
    }
    const uint32_t base = s.stamp + 1;
    const auto use = [&](uint32_t u) {
        if (s.mark[u] < base) {
            s.mark[u] = base + static_cast<uint32_t>(s.ring.size());
            s.ring.push_back({u, 1, 0});
        } else {
            ++s.ring[s.mark[u] - base].uses;
        }
    };
    for (const uint32_t c : s.fan) {
        use(s.corners[next_corner(c)]);
        use(s.corners[last_corner(c)]);
    }
    s.stamp += static_cast<uint32_t>(s.ring.size());
    s.steps += s.ring.size();
    return base;
}

double collapse_cost(const Simplifier& s, uint32_t v, uint32_t u) {
    const Vec3d p = at(s, u), d = p - at(s, v);
    const Quadric &a = s.quadrics[v], &b = s.quadrics[u];
    // Over the root of the area, about: between the squared distance and its integral over the area. Levels
    // of a cow and an armadillo have 5 to 10 % less error than with either.
    const double roots = a.root + b.root;
    const double share = roots > 0 ? 1 / roots : 0;
    return (evaluate(a, p) + s.own_cost[u]) * share + length_weight * a.root * dot(d, d);
}

// As if all that v stands for moved as far as v does: no less than what any collapse onto u does to the
// surface, in the unit of collapse_cost.
double displacement_cost(const Simplifier& s, uint32_t v, uint32_t u) {
    const Vec3d d = at(s, u) - at(s, v);
    const double roots = s.quadrics[v].root + s.quadrics[u].root;
    return roots > 0 ? s.quadrics[v].weight * dot(d, d) / roots : 0;
}

bool may_follow(const Simplifier& s, uint32_t v, const Simplifier::Neighbour& n) {
    return !s.border[v] || n.uses == 1;
}

void enqueue(Simplifier& s, uint32_t v, double cost) {
    s.queued_cost[v] = cost;
    s.heap.push_back({cost, v});
    std::push_heap(s.heap.begin(), s.heap.end(), later);
}

// The cheapest neighbour of v, whether or not it may go there, into best_cost (-1: none) and best_vertex.
void find_best(Simplifier& s, uint32_t v) {
    s.best_cost[v] = -1;
    if (s.fan_size[v] > max_moved) return;
    gather_fan(s, v);
    gather_ring(s);
    for (const Simplifier::Neighbour& n : s.ring) {
        if (!may_follow(s, v, n)) continue;
        const double cost = collapse_cost(s, v, n.vertex);
        if (s.best_cost[v] < 0 || cost < s.best_cost[v]) s.best_cost[v] = cost, s.best_vertex[v] = n.vertex;
    }
}

// Looks at w again after its neighbour v moved onto u. Only the costs to v and u are new, and the best one if
// that neighbour has grown since; other costs may be out of date until w's turn comes, which is cheaper than
// to keep them and no worse.
void update_best(Simplifier& s, uint32_t w, uint32_t v, uint32_t u) {
    const uint32_t best = s.best_vertex[w];
    if (w == u || best == v || best == u || s.border[w] || s.best_cost[w] < 0 ||
        collapse_cost(s, w, best) != s.best_cost[w]) {
        find_best(s, w);
    } else {
        const double cost = collapse_cost(s, w, u);
        if (cost < s.best_cost[w]) s.best_cost[w] = cost, s.best_vertex[w] = u;
    }
    if (s.best_cost[w] >= 0 && s.best_cost[w] != s.queued_cost[w]) enqueue(s, w, s.best_cost[w]);
}

// Reshaping: closes a hole or a handle, lays two triangles onto each other, or makes what is not manifold.
enum class Verdict { refused, reshaping, plain };

// What it does to the surface if v moves to ring[candidate]; refused where a triangle would turn over or
// become a sliver, or nothing of a part would be left. Expects fan and ring of v.
Verdict judge_collapse(Simplifier& s, uint32_t v, uint32_t ring_base,
                       const Simplifier::Neighbour& candidate) {
    const uint32_t u = candidate.vertex;
    const uint32_t others = s.fan_size[u] - candidate.uses; // triangles of u alone
    const bool crowded = s.fan.size() + others > max_reshaped;
    if (crowded && (s.pinched[v] || s.pinched[u])) return Verdict::refused;
    if (others + s.fan.size() <= candidate.uses) return Verdict::refused; // nothing would be left
    s.steps += s.fan.size();
    const Vec3d to = at(s, u), from = at(s, v);
    for (const uint32_t c : s.fan) {
        const uint32_t a = s.corners[next_corner(c)], b = s.corners[last_corner(c)];
        if (a == u || b == u) continue;
        const Vec3d pa = at(s, a), pb = at(s, b), ab = pb - pa;
        const Vec3d before = cross(ab, from - pa), after = cross(ab, to - pa);
        const double before2 = dot(before, before), after2 = dot(after, after), turn = dot(before, after);
        if (!(after2 > 0)) return Verdict::refused;
        if (before2 > 0 &&
            (turn <= 0 || turn * turn < min_turn_cosine * min_turn_cosine * before2 * after2)) {
            return Verdict::refused;
        }
        const double base2 = dot(ab, ab);
        const double edges_after = base2 + dot(to - pa, to - pa) + dot(to - pb, to - pb);
        if (after2 < sliver_shape * sliver_shape * edges_after * edges_after) {
            const double edges_before = base2 + dot(from - pa, from - pa) + dot(from - pb, from - pb);
            if (after2 * edges_before * edges_before < before2 * edges_after * edges_after)
                return Verdict::refused;
        }
    }
    // Link condition: the common neighbours are those across the edge's own triangles.
    if (++s.common_stamp == 0) {
        std::fill(s.common_mark.begin(), s.common_mark.end(), 0);
        s.common_stamp = 1;
    }
    uint32_t common = 0;
    each_corner(s, u, [&](uint32_t c) {
        for (const uint32_t w : {s.corners[next_corner(c)], s.corners[last_corner(c)]}) {
            const bool in_ring = s.mark[w] >= ring_base && s.mark[w] - ring_base < s.ring.size();
            if (w == v || !in_ring || s.common_mark[w] == s.common_stamp) continue;
            s.common_mark[w] = s.common_stamp;
            ++common;
        }
    });
    const auto is_common = [&](uint32_t w) { return s.common_mark[w] == s.common_stamp; };
    bool reshaping = common != candidate.uses || s.pinched[v] || s.pinched[u];
    for (const uint32_t c : s.fan) {
        const uint32_t a = s.corners[next_corner(c)], b = s.corners[last_corner(c)];
        if (reshaping || a == u || b == u || !is_common(a) || !is_common(b)) continue;
        each_corner(s, u, [&](uint32_t d) { // would it lie on another one?
            const uint32_t e = s.corners[next_corner(d)], f = s.corners[last_corner(d)];
            reshaping |= (e == a && f == b) || (e == b && f == a);
        });
    }
    if (!reshaping) return Verdict::plain;
    if (crowded) return Verdict::refused;
    for (const uint32_t c : s.fan) { // a third vertex that has no other triangles would go along, unmeasured
        const uint32_t a = s.corners[next_corner(c)], b = s.corners[last_corner(c)];
        if (a != u && b != u) continue;
        const uint32_t w = a == u ? b : a;
        uint32_t with_both = 0;
        for (const uint32_t d : s.fan) {
            const auto has = [&](uint32_t x) {
                return s.corners[next_corner(d)] == x || s.corners[last_corner(d)] == x;
            };
            with_both += has(u) && has(w);
        }
        if (s.fan_size[w] == with_both) return Verdict::refused;
    }
    return Verdict::reshaping;
}

// Where the points of v's triangles, and v itself, lie after the collapse onto u: into `moved`. Returns the
// largest squared distance.
float move_points(Simplifier& s, const Vec3f* positions, uint32_t v, uint32_t u) {
    s.moved.clear();
    float worst = 0;
    const Vec3f to = s.positions[u];
    const auto place = [&](uint32_t point) {
        s.steps += 4 * s.fan.size(); // a distance to a triangle takes about four times as long
        const Vec3f p = positions[point];
        float best = std::numeric_limits<float>::max();
        uint32_t triangle = none;
        const auto test = [&](uint32_t t, Vec3f a, Vec3f b) {
            const float d = distance2(p, to, a, b);
            if (triangle == none || d < best) best = d, triangle = t;
        };
        for (const uint32_t c : s.fan) {
            const uint32_t a = s.corners[next_corner(c)], b = s.corners[last_corner(c)];
            if (a != u && b != u) test(c / 3, s.positions[a], s.positions[b]);
        }
        if (triangle == none) { // an ear goes: the rest of u's fan has to stand for it
            each_corner(s, u, [&](uint32_t c) {
                const uint32_t a = s.corners[next_corner(c)], b = s.corners[last_corner(c)];
                if (a != v && b != v) test(c / 3, s.positions[a], s.positions[b]);
            });
        }
        s.moved.push_back({point, triangle});
        worst = std::max(worst, best);
    };
    place(s.vertices[v]);
    for (const uint32_t c : s.fan) {
        for (uint32_t p = s.points[c / 3]; p != none; p = s.point_next[p]) {
            place(p);
        }
    }
    return worst;
}

// Returns the triangles that went.
uint32_t collapse(Simplifier& s, uint32_t v, uint32_t u, bool measure) {
    if (measure) {
        for (const uint32_t c : s.fan) {
            s.points[c / 3] = none;
        }
        for (const Simplifier::Moved& m : s.moved) {
            s.point_next[m.point] = s.points[m.triangle];
            s.points[m.triangle] = m.point;
        }
    }
    uint32_t gone = 0;
    for (const uint32_t c : s.fan) {
        if (s.corners[next_corner(c)] == u || s.corners[last_corner(c)] == u) {
            s.alive[c / 3] = 0;
            ++gone;
            --s.fan_size[s.corners[next_corner(c)]];
            --s.fan_size[s.corners[last_corner(c)]];
        } else {
            s.corners[c] = u;
            s.next[c] = s.head[u];
            s.head[u] = c;
            ++s.fan_size[u];
        }
    }
    add(s.quadrics[u], s.quadrics[v]);
    s.quadrics[u].root = std::sqrt(s.quadrics[u].weight);
    s.own_cost[u] = evaluate(s.quadrics[u], at(s, u));
    s.head[v] = none;
    s.fan_size[v] = 0;
    return gone;
}

// Whether the triangles around v form one fan, open or closed.
bool one_fan(const Simplifier& s, uint32_t v, uint32_t count) {
    const uint32_t start = s.head[v];
    uint32_t seen = 0;
    const auto walk = [&](uint32_t corner, bool along) {
        while (seen < count) {
            ++seen;
            const uint32_t h = along ? corner : last_corner(corner); // an edge of the triangle at v
            const uint32_t m = s.mate[h];
            if (m == h) return true; // border
            // In the next triangle: leave through the edge at v that we did not come in by.
            const bool in_along = s.corners[m] == v;
            corner = in_along ? m : next_corner(m);
            along = !in_along;
            if (corner == start) return false;
        }
        return false;
    };
    if (walk(start, true) && seen < count) {
        --seen; // the start counts once
        walk(start, false);
    }
    return seen == count;
}

void prepare(Simplifier& s, const Vec3f* positions) {
    const uint32_t triangle_count = static_cast<uint32_t>(s.triangles.size() / 3);
    s.vertices.clear();
    s.corners.resize(s.triangles.size());
    for (size_t c = 0; c < s.triangles.size(); ++c) {
        uint32_t& local = s.local_of[s.triangles[c]];
        if (local == none) {
            local = static_cast<uint32_t>(s.vertices.size());
            s.vertices.push_back(s.triangles[c]);
        }
        s.corners[c] = local;
    }
    const uint32_t n = static_cast<uint32_t>(s.vertices.size());
    s.head.assign(n, none);
    s.fan_size.assign(n, 0);
    s.common_mark.assign(n, 0);
    s.common_stamp = 0;
    s.steps = 0;
    s.own_cost.resize(n);
    s.best_cost.assign(n, -1);
    s.best_vertex.assign(n, none);
    s.queued_cost.assign(n, -1);
    s.mark.assign(n, 0);
    s.stamp = 0;
    s.pinched.assign(n, 0);
    s.border.assign(n, 0);
    s.quadrics.assign(n, Quadric{});
    s.positions.resize(n);
    for (uint32_t v = 0; v < n; ++v) {
        const uint32_t w = s.vertices[v];
        s.local_of[w] = none;
        s.positions[v] = positions[w];
    }
    s.next.resize(s.corners.size());
    s.alive.assign(triangle_count, 1);
    for (uint32_t c = 3 * triangle_count; c-- > 0;) {
        s.next[c] = s.head[s.corners[c]];
        s.head[s.corners[c]] = c;
        ++s.fan_size[s.corners[c]];
    }
    match_edges(s.corners.data(), triangle_count, n, s.matcher, s.mate);

    for (uint32_t t = 0; t < triangle_count; ++t) {
        const uint32_t* k = &s.corners[3 * t];
        const Vec3d a = at(s, k[0]), b = at(s, k[1]), c = at(s, k[2]);
        const Vec3d normal = cross(b - a, c - a);
        const double l = length(normal);
        const Vec3d unit = l > 0 ? normal * (1 / l) : Vec3d{};
        const Quadric q = plane_quadric(unit, a, 0.5 * l);
        for (uint32_t i = 0; i < 3; ++i) {
            add(s.quadrics[k[i]], q);
            const uint32_t h = 3 * t + i, m = s.mate[h];
            const uint32_t from = s.corners[h], to = edge_to(s.corners.data(), h);
            if (m == h) {
                s.border[from] = s.border[to] = 1;
                const Vec3d e = at(s, to) - at(s, from);
                const Vec3d side = cross(e, unit);
                const double side_length = length(side);
                if (!(side_length > 0)) continue;
                const Quadric r =
                    plane_quadric(side * (1 / side_length), at(s, from), border_weight * dot(e, e));
                add(s.quadrics[from], r);
                add(s.quadrics[to], r);
            } else if (s.mate[m] != h) {
                s.pinched[from] = s.pinched[to] = 1;
            }
        }
    }
    for (uint32_t v = 0; v < n; ++v) {
        s.quadrics[v].root = std::sqrt(s.quadrics[v].weight);
        s.own_cost[v] = evaluate(s.quadrics[v], at(s, v));
        if (s.pinched[v]) continue;
        if (!one_fan(s, v, s.fan_size[v])) s.pinched[v] = 1;
    }
}

} // namespace

Simplifier::Simplifier(const Allocator& a, uint32_t welded_vertices)
    : triangles(HostAllocator<uint32_t>(a)), source(HostAllocator<uint32_t>(a)),
      points(HostAllocator<uint32_t>(a)), point_next(welded_vertices, none, HostAllocator<uint32_t>(a)),
      local_of(welded_vertices, none, HostAllocator<uint32_t>(a)), vertices(HostAllocator<uint32_t>(a)),
      head(HostAllocator<uint32_t>(a)), fan_size(HostAllocator<uint32_t>(a)),
      best_vertex(HostAllocator<uint32_t>(a)), mark(HostAllocator<uint32_t>(a)),
      common_mark(HostAllocator<uint32_t>(a)), pinched(HostAllocator<uint8_t>(a)),
      border(HostAllocator<uint8_t>(a)), own_cost(HostAllocator<double>(a)),
      best_cost(HostAllocator<double>(a)), queued_cost(HostAllocator<double>(a)),
      quadrics(HostAllocator<Quadric>(a)), positions(HostAllocator<Vec3f>(a)),
      corners(HostAllocator<uint32_t>(a)), next(HostAllocator<uint32_t>(a)), mate(HostAllocator<uint32_t>(a)),
      alive(HostAllocator<uint8_t>(a)), heap(HostAllocator<HeapEntry>(a)), ring(HostAllocator<Neighbour>(a)),
      fan(HostAllocator<uint32_t>(a)), common(HostAllocator<uint32_t>(a)), moved(HostAllocator<Moved>(a)),
      matcher(a) {}

float simplify(Simplifier& s, const Vec3f* positions, const SimplifyOptions& options) {
    prepare(s, positions);
    if (options.measure) s.points.assign(s.alive.size(), none);
    uint32_t left = static_cast<uint32_t>(s.alive.size());
    s.heap.clear();
    for (uint32_t v = 0; v < s.vertices.size(); ++v) {
        find_best(s, v);
        if (s.best_cost[v] >= 0) enqueue(s, v, s.best_cost[v]);
    }
    float worst = 0;
    s.dearest = 0;
    const uint64_t most_steps = first_steps + steps_of_a_triangle * s.alive.size();
    while (left > options.target_triangles && !s.heap.empty() && s.steps < most_steps) {
        const Simplifier::HeapEntry top = s.heap.front();
        if (left < options.enough_triangles && top.cost > options.most_cost) break;
        std::pop_heap(s.heap.begin(), s.heap.end(), later);
        s.heap.pop_back();
        const uint32_t v = top.vertex;
        if (top.cost != s.queued_cost[v]) continue; // has been queued again since
        s.queued_cost[v] = -1;
        if (s.fan_size[v] > max_moved) continue; // has grown since
        gather_fan(s, v);
        const uint32_t base = gather_ring(s);
        for (Simplifier::Neighbour& n : s.ring) {
            n.cost = may_follow(s, v, n) ? collapse_cost(s, v, n.vertex) : -1;
        }
        // Cheapest valid neighbour. A vertex whose turn has passed meanwhile goes back into the queue.
        for (;;) {
            s.steps += s.ring.size();
            Simplifier::Neighbour* best = nullptr;
            for (Simplifier::Neighbour& n : s.ring) {
                if (n.cost < 0) continue;
                if (!best || n.cost < best->cost || (n.cost == best->cost && n.vertex < best->vertex))
                    best = &n;
            }
            if (!best) break;
            if (best->cost > top.cost && !s.heap.empty() && best->cost > s.heap.front().cost) {
                enqueue(s, v, best->cost);
                break;
            }
            const Verdict verdict = judge_collapse(s, v, base, *best);
            if (verdict == Verdict::refused) {
                best->cost = -1;
                continue;
            }
            const double displacement = displacement_cost(s, v, best->vertex);
            if (verdict == Verdict::reshaping && best->cost < displacement) {
                best->cost = displacement;
                continue;
            }
            const uint32_t u = best->vertex;
            s.dearest = std::max(s.dearest, best->cost);
            if (options.measure) worst = std::max(worst, move_points(s, positions, v, u));
            left -= collapse(s, v, u, options.measure);
            // The ring is overwritten below: remember who must be looked at again.
            s.common.clear();
            for (const Simplifier::Neighbour& n : s.ring)
                s.common.push_back(n.vertex);
            for (const uint32_t w : s.common) {
                update_best(s, w, v, u);
            }
            break;
        }
    }

    uint32_t out = 0;
    s.source.clear();
    for (uint32_t t = 0; t < s.alive.size(); ++t) {
        if (!s.alive[t]) continue;
        for (uint32_t k = 0; k < 3; ++k) {
            s.triangles[3 * out + k] = s.vertices[s.corners[3 * t + k]];
        }
        if (options.measure) s.points[out] = s.points[t];
        s.source.push_back(t);
        ++out;
    }
    s.triangles.resize(3 * out);
    if (options.measure) s.points.resize(out);
    return std::sqrt(worst);
}

} // namespace nusselt
