// Scenes whose answer is a formula: reference, peer, floor and every quality of ours must meet it. And
// planted faults: what the instrument is for must move its figures.
#include "tools/commands/engine.h"
#include "tools/compare/figures.h"
#include "tools/compare/grid.h"
#include "tools/compare/peer.h"
#include "tools/trace/sh.h"
#include "tools/trace/trace.h"

#include <glm/geometric.hpp>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <string>

namespace nusselt::tools {
namespace {

constexpr double pi = std::numbers::pi;
using Vec = glm::vec3;

// One receiver at the origin, looking along `normal`, and blockers made in its local frame.
struct Poser {
    Vec normal, t, b;

    explicit Poser(const Vec& n) : normal(glm::normalize(n)) {
        t = glm::normalize(glm::cross(std::abs(normal.y) < 0.9f ? Vec(0, 1, 0) : Vec(1, 0, 0), normal));
        b = glm::cross(normal, t);
    }
    Vec operator()(double x, double y, double z) const {
        return static_cast<float>(x) * t + static_cast<float>(y) * b + static_cast<float>(z) * normal;
    }
};

struct Case {
    std::string name;
    double seen = 0;     // cosine-weighted part
    double standard = 0; // what 1024 bits and the plane table may miss
    scenes::Mesh blockers;

    void triangle(const Vec& a, const Vec& p, const Vec& c) {
        for (const Vec& v : {a, p, c}) {
            blockers.indices.push_back(static_cast<uint32_t>(blockers.rest_positions.size()));
            blockers.rest_positions.push_back(v);
        }
    }
    void quad(const Vec& a, const Vec& p, const Vec& c, const Vec& d) {
        triangle(a, p, c);
        triangle(a, c, d);
    }
};

std::vector<Case> cases(const Poser& at) {
    std::vector<Case> all;
    const auto add = [&](std::string name, double seen, double standard) -> Case& {
        all.push_back({std::move(name), seen, standard, {}});
        return all.back();
    };
    add("nothing", 1, 1e-6).quad(at(-1, -1, -2), at(1, -1, -2), at(1, 1, -2), at(-1, 1, -2));
    {
        Case& wall = add("tangent wall", 0.5, 0.002);
        wall.quad(at(1e-3, -300, -300), at(1e-3, 300, -300), at(1e-3, 300, 300), at(1e-3, -300, 300));
    }
    for (const double tilt : {0.4, 1.1}) {
        // Everything below a plane through the receiver, tilted away from its own.
        Case& slope = add("half-space tilted by " + std::to_string(tilt), (1 + std::cos(tilt)) / 2, 0.02);
        const auto point = [&](double u, double v) {
            return at(u * std::cos(tilt) + 1e-3 * std::sin(tilt), v,
                      u * std::sin(tilt) - 1e-3 * std::cos(tilt));
        };
        slope.quad(point(-300, -300), point(300, -300), point(300, 300), point(-300, 300));
    }
    {
        // Parallel, with one corner over the receiver.
        const double x = 1.5, y = 0.8;
        const double hidden = (x / std::sqrt(1 + x * x) * std::atan(y / std::sqrt(1 + x * x)) +
                               y / std::sqrt(1 + y * y) * std::atan(x / std::sqrt(1 + y * y))) /
                              (2 * pi);
        add("rectangle", 1 - hidden, 0.04).quad(at(0, 0, 1), at(x, 0, 1), at(x, y, 1), at(0, y, 1));
    }
    {
        constexpr int around = 360;
        const double r = 0.7;
        Case& disk = add("disk", 1 - r * r / (r * r + 1), 0.065);
        for (int k = 0; k < around; ++k) {
            const double p = 2 * pi * k / around, q = 2 * pi * (k + 1) / around;
            disk.triangle(at(0, 0, 1), at(r * std::cos(p), r * std::sin(p), 1),
                          at(r * std::cos(q), r * std::sin(q), 1));
        }
    }
    for (const double angle : {0.0, 0.8}) {
        Case& ball = add("sphere at " + std::to_string(angle), 1 - std::cos(angle) / 9, 0.04);
        const auto point = [&](int ring, int k) {
            const double a = pi * ring / 64, p = 2 * pi * k / 128;
            return at(3 * std::sin(angle) + std::sin(a) * std::cos(p), std::sin(a) * std::sin(p),
                      3 * std::cos(angle) + std::cos(a));
        };
        for (int ring = 0; ring < 64; ++ring) {
            for (int k = 0; k < 128; ++k) {
                if (ring > 0) ball.triangle(point(ring, k), point(ring + 1, k), point(ring, k + 1));
                if (ring < 63) ball.triangle(point(ring, k + 1), point(ring + 1, k), point(ring + 1, k + 1));
            }
        }
    }
    {
        // In the middle of the floor of a box of side 2 and height 1: what is seen is the opening.
        const double h = 1;
        const double corner = 2 / std::sqrt(1 + h * h) * std::atan(1 / std::sqrt(1 + h * h)) / (2 * pi);
        Case& box = add("open box", 4 * corner, 0.04);
        const double floor = -1e-3;
        box.quad(at(-1, -1, floor), at(1, -1, floor), at(1, 1, floor), at(-1, 1, floor));
        for (int side = 0; side < 4; ++side) {
            const double c = std::cos(side * pi / 2), s = std::sin(side * pi / 2);
            const auto turned = [&](double x, double y, double z) {
                return at(c * x - s * y, s * x + c * y, z);
            };
            box.quad(turned(1, -1, floor), turned(1, 1, floor), turned(1, 1, h), turned(1, -1, h));
        }
    }
    return all;
}

scenes::Scene scene_of(const Case& one, const Poser& at) {
    scenes::Scene scene;
    scene.name = one.name;
    scenes::Mesh receiver;
    receiver.rest_positions = {Vec(0)};
    receiver.rest_normals = {at.normal};
    scene.meshes = {receiver, one.blockers};
    scenes::compute_normals(one.blockers.rest_positions, one.blockers.indices, scene.meshes[1].rest_normals);
    const scenes::Pose pose{{scene.meshes[0].rest_positions, scene.meshes[1].rest_positions},
                            {scene.meshes[0].rest_normals, scene.meshes[1].rest_normals}};
    scene.pose = [pose](double, scenes::Pose& out) { out = pose; };
    return scene;
}

const Vec looks[] = {{0, 0, 1}, {0.3f, -0.8f, 0.5f}, {-0.6f, 0.1f, -0.7f}};

TEST(Truth, ReferenceMeetsTheFormula) {
    for (const Vec& look : looks) {
        const Poser at(look);
        for (const Case& one : cases(at)) {
            const scenes::Scene scene = scene_of(one, at);
            scenes::Pose pose;
            scene.pose(0, pose);
            const Assembly all = assemble(scene, pose);
            Assembly only = all;
            std::fill(only.normals.begin() + 1, only.normals.end(), Vec(0));
            const TraceResult result = trace_transfer(make_trace_scene(all), only, {.rays = 16384});
            EXPECT_NEAR(seen_part(result.transfer.data()), one.seen, 0.0015) << one.name;
        }
    }
}

TEST(Truth, PeerMeetsTheFormulaAndConverges) {
    const SampleGrid coarse = concentric_grid(32), fine = concentric_grid(64);
    for (const Vec& look : looks) {
        const Poser at(look);
        for (const Case& one : cases(at)) {
            const scenes::Scene scene = scene_of(one, at);
            scenes::Pose pose;
            scene.pose(0, pose);
            const Assembly all = assemble(scene, pose);
            Peer peer(all, 1);
            std::vector<float> transfer;
            for (const PeerLoop loop : {PeerLoop::packets, PeerLoop::single}) {
                peer.frame(all, {0}, coarse, loop, transfer);
                EXPECT_NEAR(seen_part(transfer.data()), one.seen, std::max(one.standard, 0.002)) << one.name;
            }
            peer.frame(all, {0}, fine, PeerLoop::packets, transfer);
            EXPECT_NEAR(seen_part(transfer.data()), one.seen, std::max(0.5 * one.standard, 0.002))
                << one.name;
        }
    }
}

TEST(Truth, OursMeetsTheFormula) {
    // Keeps the tables between the scenes.
    const Poser first(looks[0]);
    const Engine tables(scene_of(cases(first)[0], first), {.threads = 1}, "tables");
    for (const Vec& look : looks) {
        const Poser at(look);
        for (const Case& one : cases(at)) {
            const scenes::Scene scene = scene_of(one, at);
            scenes::Pose pose;
            scene.pose(0, pose);
            Engine engine(scene, {.threads = 1}, one.name);
            for (const Quality quality : {Quality::draft, Quality::standard, Quality::fine}) {
                std::vector<float> transfer;
                engine.frame(pose, quality, transfer);
                // The plane table turns a plane by up to half a degree.
                EXPECT_NEAR(seen_part(transfer.data()), one.seen, one.standard + 0.012)
                    << one.name << ' ' << quality_name(quality);
            }
        }
    }
}

TEST(Truth, AllTermsOfTheDisk) {
    // Its zonal harmonics in closed form (cap of half-angle a), for reference and peer.
    const Poser at(looks[0]);
    for (const Case& one : cases(at)) {
        if (one.name != "disk") continue;
        const scenes::Scene scene = scene_of(one, at);
        scenes::Pose pose;
        scene.pose(0, pose);
        const Assembly all = assemble(scene, pose);
        const double c = std::cos(std::atan(0.7)), c2 = c * c, c4 = c2 * c2;
        const double hidden[5] = {(1 - c2) / 2, (1 - c2 * c) / 3, 3 * (1 - c4) / 8 - (1 - c2) / 4,
                                  (c2 * c - c4 * c) / 2,
                                  35 * (1 - c4 * c2) / 48 - 30 * (1 - c4) / 32 + 3 * (1 - c2) / 16};
        double open[25];
        open_transfer(0, 0, 1, open);
        Assembly only = all;
        std::fill(only.normals.begin() + 1, only.normals.end(), Vec(0));
        const TraceResult reference = trace_transfer(make_trace_scene(all), only, {.rays = 65536});
        std::vector<float> peer;
        Peer(all, 1).frame(all, {0}, concentric_grid(64), PeerLoop::packets, peer);
        for (int l = 0; l < 5; ++l) {
            const auto term = static_cast<size_t>(l * (l + 1));
            const double expected = open[term] - 2 * hidden[l] * std::sqrt((2 * l + 1) / (4 * pi));
            EXPECT_NEAR(reference.transfer[term], expected, 0.001) << l;
            EXPECT_NEAR(peer[term], expected, 0.01) << l;
        }
    }
}

// A bowl with a ball in it, and a small sheet above: deep shadows, soft ones, open sky.
struct Bowl {
    Assembly all;
    std::vector<uint32_t> receivers;
    std::vector<float> reference;
    std::vector<uint8_t> clear;

    Bowl() {
        constexpr uint32_t side = 25;
        std::vector<Vec>& p = all.positions;
        for (uint32_t y = 0; y < side; ++y) {
            for (uint32_t x = 0; x < side; ++x) {
                const double u = 2.0 * x / (side - 1) - 1, v = 2.0 * y / (side - 1) - 1;
                p.emplace_back(u, v, 0.5 * (u * u + v * v) + 0.05 * std::sin(9 * u) * std::cos(7 * v));
            }
        }
        for (uint32_t y = 0; y + 1 < side; ++y)
            for (uint32_t x = 0; x + 1 < side; ++x) {
                const uint32_t a = y * side + x;
                for (const uint32_t k : {a, a + 1, a + side, a + 1, a + side + 1, a + side})
                    all.indices.push_back(k);
            }
        const auto first = static_cast<uint32_t>(p.size());
        constexpr uint32_t rings = 12, around = 24;
        for (uint32_t ring = 0; ring <= rings; ++ring)
            for (uint32_t k = 0; k < around; ++k) {
                const double a = pi * ring / rings, q = 2 * pi * k / around;
                p.emplace_back(0.1 + 0.3 * std::sin(a) * std::cos(q), 0.3 * std::sin(a) * std::sin(q),
                               0.6 + 0.3 * std::cos(a));
            }
        for (uint32_t ring = 0; ring < rings; ++ring)
            for (uint32_t k = 0; k < around; ++k) {
                const uint32_t a = first + ring * around + k, b = first + ring * around + (k + 1) % around;
                for (const uint32_t corner : {a, a + around, b, b, a + around, b + around})
                    all.indices.push_back(corner);
            }
        const auto sheet = static_cast<uint32_t>(p.size());
        for (const Vec& corner :
             {Vec(-0.7f, -0.6f, 1), Vec(-0.3f, -0.6f, 1), Vec(-0.3f, -0.2f, 1), Vec(-0.7f, -0.2f, 1)})
            p.push_back(corner);
        for (const uint32_t k : {0u, 1u, 2u, 0u, 2u, 3u})
            all.indices.push_back(sheet + k);
        scenes::compute_normals(p, all.indices, all.normals);
        all.albedo.assign(p.size(), Vec(1));
        for (uint32_t v = 0; v < first; ++v)
            receivers.push_back(v);
        const TraceScene scene = make_trace_scene(all);
        reference = trace_transfer(scene, all, {.rays = 16384}).transfer;
        clear = clear_receivers(reference,
                                trace_transfer(scene, all, {.rays = 4096, .lift = clear_lift}).transfer);
    }
    ErrorFigures error(const std::vector<float>& transfer) const {
        Gatherer gatherer({});
        gatherer.add(0, transfer, reference, receivers, clear);
        return gatherer.clear();
    }
};

const Bowl& bowl() {
    static const Bowl made;
    return made;
}

std::vector<float> peer_of(const Assembly& all, const SampleGrid& grid, double lift = peer_lift) {
    Peer peer(all, 1);
    peer.lift = lift;
    std::vector<float> transfer;
    peer.frame(all, bowl().receivers, grid, PeerLoop::packets, transfer);
    return transfer;
}

TEST(Planted, PeerAloneIsNearItsFloor) {
    const ErrorFigures error = bowl().error(peer_of(bowl().all, concentric_grid(64)));
    EXPECT_GT(error.each.count, 400u);
    EXPECT_LT(error.each.mean, 0.012);
    EXPECT_LT(error.each.max, 0.2);
}

TEST(Planted, WrongSignShows) {
    const double before = bowl().error(peer_of(bowl().all, concentric_grid(64))).each.mean;
    for (const size_t term : {size_t{1}, size_t{6}, size_t{20}}) {
        std::vector<float> transfer = peer_of(bowl().all, concentric_grid(64));
        for (size_t v = 0; v * 25 < transfer.size(); ++v)
            transfer[v * 25 + term] *= -1;
        EXPECT_GT(bowl().error(transfer).each.mean, 2 * before) << term;
    }
}

TEST(Planted, OneMissingTriangleShows) {
    const ErrorFigures before = bowl().error(peer_of(bowl().all, concentric_grid(64)));
    Assembly without = bowl().all;
    // Of the sheet: behind one of the ball's the ball's other side would hide as much.
    without.indices.resize(without.indices.size() - 3);
    const ErrorFigures after = bowl().error(peer_of(without, concentric_grid(64)));
    EXPECT_GT(after.each.mean, 1.2 * before.each.mean);
    EXPECT_GT(after.pooled, 1.2 * before.pooled);
}

TEST(Planted, HalfAPixelShows) {
    const double before = bowl().error(peer_of(bowl().all, concentric_grid(32))).each.mean;
    SampleGrid shifted = concentric_grid(32);
    const SampleGrid fine = concentric_grid(64);
    // Each cell's sample at the middle of its first quarter's far corner: half a cell to the left and down.
    for (uint32_t row = 0; row < 32; ++row) {
        for (uint32_t column = 0; column < 32; ++column) {
            const auto place = [](uint32_t side, uint32_t r, uint32_t c) {
                return size_t{16} * (r / 4 * (side / 4) + c / 4) + r % 4 * 4 + c % 4;
            };
            const size_t to = place(32, row, column), from = place(64, 2 * row, 2 * column);
            shifted.x[to] = fine.x[from];
            shifted.y[to] = fine.y[from];
            shifted.z[to] = fine.z[from];
        }
    }
    EXPECT_GT(bowl().error(peer_of(bowl().all, shifted)).each.mean, 1.5 * before);
}

TEST(Peer, LiftIsTheBestThereIs) {
    const SampleGrid grid = concentric_grid(64);
    const double chosen = bowl().error(peer_of(bowl().all, grid)).each.mean;
    for (const double lift : {1e-6, 1e-5, 1e-4, 1e-3})
        EXPECT_LT(chosen, 1.02 * bowl().error(peer_of(bowl().all, grid, lift)).each.mean) << lift;
}

TEST(Peer, RefitsAndFollowsTheSurface) {
    Assembly moved = bowl().all;
    for (Vec& p : moved.positions)
        p = Vec(p.y, p.x, -p.z); // a proper rotation
    for (Vec& n : moved.normals)
        n = Vec(n.y, n.x, -n.z);
    Peer refitted(bowl().all, 1), built(moved, 1);
    std::vector<float> a, b;
    refitted.frame(moved, bowl().receivers, concentric_grid(16), PeerLoop::packets, a);
    built.frame(moved, bowl().receivers, concentric_grid(16), PeerLoop::packets, b);
    double difference = 0, size = 0;
    for (const uint32_t vertex : bowl().receivers)
        for (size_t i = vertex * 25; i < vertex * 25 + 25; ++i) {
            difference += std::pow(double{a[i]} - b[i], 2);
            size += std::pow(double{b[i]}, 2);
        }
    EXPECT_LT(std::sqrt(difference / size), 1e-3);
}

TEST(Peer, ThreadsDontChangeTheResult) {
    if (!has_feature(Feature::tbb)) GTEST_SKIP() << "several threads take TBB";
    Peer one(bowl().all, 1), two(bowl().all, 2);
    std::vector<float> a, b;
    one.frame(bowl().all, bowl().receivers, concentric_grid(16), PeerLoop::packets, a);
    two.frame(bowl().all, bowl().receivers, concentric_grid(16), PeerLoop::packets, b);
    EXPECT_EQ(a, b);
}

} // namespace
} // namespace nusselt::tools
