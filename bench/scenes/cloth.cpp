// Cloth: a sheet falls over a ball that then rolls about and drags it over the floor. Position-based
// dynamics, run once; poses are blends of stored frames, so whatever holds for all frames and is convex
// (above the floor) holds for all poses.
#include "builtin.h"
#include "portable_math.h"
#include "shapes.h"

#include <glm/common.hpp>
#include <glm/geometric.hpp>

#include <algorithm>
#include <memory>

namespace nusselt::scenes {

namespace {

constexpr uint32_t columns = 39, rows = 31;
constexpr float spacing = 0.05f; // metres
constexpr float thickness = 0.012f;
constexpr float ball_radius = 0.36f;
constexpr float cloth_ball_radius = ball_radius + thickness;
constexpr uint32_t frame_rate = 60, substeps = 8;
constexpr uint32_t frame_count = 241;
constexpr double duration = 4;

glm::vec3 ball_center(float time) {
    const float go = smooth_step(1.0f, 1.5f, time);
    const float angle = 2.2f * std::max(time - 1.1f, 0.0f);
    return {0.36f * go * sine(angle), ball_radius + 0.004f + 0.16f * go * (1 - cosine(angle)) * 0.5f,
            0.2f * go * sine(2 * angle)};
}

struct Link {
    uint32_t a, b;
    float length, stiffness;
};

std::vector<Link> make_links(const std::vector<glm::vec3>& points) {
    std::vector<Link> links;
    const auto link = [&](uint32_t c0, uint32_t r0, uint32_t c1, uint32_t r1, float stiffness) {
        if (std::max(c0, c1) >= columns || r1 >= rows) return;
        const uint32_t a = r0 * columns + c0, b = r1 * columns + c1;
        links.push_back({a, b, glm::distance(points[a], points[b]), stiffness});
    };
    for (uint32_t r = 0; r < rows; ++r) {
        for (uint32_t c = 0; c < columns; ++c) {
            link(c, r, c + 1, r, 1);
            link(c, r, c, r + 1, 1);
            link(c, r, c + 1, r + 1, 0.35f);
            link(c + 1, r, c, r + 1, 0.35f);
            link(c, r, c + 2, r, 0.06f);
            link(c, r, c, r + 2, 0.06f);
        }
    }
    return links;
}

// Cells in a hashed grid, as lists threaded through `next`.
struct Neighbours {
    static constexpr uint32_t buckets = 4096, none = 0xFFFFFFFFu;
    std::vector<uint32_t> head, next;
    float cell;

    static uint32_t bucket(const glm::ivec3& at) {
        const uint32_t hash = static_cast<uint32_t>(at.x) * 73856093u ^
                              static_cast<uint32_t>(at.y) * 19349663u ^
                              static_cast<uint32_t>(at.z) * 83492791u;
        return hash % buckets;
    }
    glm::ivec3 at(const glm::vec3& point) const { return glm::ivec3(glm::floor(point / cell)); }
    void fill(const std::vector<glm::vec3>& points) {
        head.assign(buckets, none);
        next.resize(points.size());
        for (uint32_t v = 0; v < points.size(); ++v) {
            const uint32_t slot = bucket(at(points[v]));
            next[v] = head[slot];
            head[slot] = v;
        }
    }
};

// Keeps vertices that are no neighbours in the sheet apart.
void separate(std::vector<glm::vec3>& points, Neighbours& neighbours) {
    constexpr float least = 0.9f * spacing;
    neighbours.fill(points);
    for (uint32_t v = 0; v < points.size(); ++v) {
        const glm::ivec3 center = neighbours.at(points[v]);
        for (int k = 0; k < 27; ++k) {
            const glm::ivec3 cell = center + glm::ivec3(k % 3 - 1, k / 3 % 3 - 1, k / 9 - 1);
            for (uint32_t w = neighbours.head[Neighbours::bucket(cell)]; w != Neighbours::none;
                 w = neighbours.next[w]) {
                if (w <= v) continue;
                const int dc = std::abs(static_cast<int>(v % columns) - static_cast<int>(w % columns));
                const int dr = std::abs(static_cast<int>(v / columns) - static_cast<int>(w / columns));
                if (dc <= 1 && dr <= 1) continue;
                const glm::vec3 apart = points[w] - points[v];
                const float square = glm::dot(apart, apart);
                if (square >= least * least || square < 1e-12f) continue;
                const float length = std::sqrt(square);
                const glm::vec3 push = apart * (0.4f * (least - length) / length);
                points[v] -= push;
                points[w] += push;
            }
        }
    }
}

std::vector<std::vector<glm::vec3>> simulate(const std::vector<glm::vec3>& start) {
    const std::vector<Link> links = make_links(start);
    std::vector<glm::vec3> points = start, before = start;
    Neighbours neighbours;
    neighbours.cell = spacing;
    std::vector<std::vector<glm::vec3>> frames{points};
    constexpr float dt = 1.0f / (frame_rate * substeps);
    float time = 0;
    glm::vec3 ball = ball_center(0);
    for (uint32_t frame = 1; frame < frame_count; ++frame) {
        for (uint32_t substep = 0; substep < substeps; ++substep) {
            time += dt;
            const glm::vec3 ball_before = ball;
            ball = ball_center(time);
            for (size_t v = 0; v < points.size(); ++v) {
                const glm::vec3 moved = (points[v] - before[v]) * 0.9975f;
                before[v] = points[v];
                points[v] += moved + glm::vec3(0, -9.81f * dt * dt, 0);
            }
            for (const Link& link : links) {
                const glm::vec3 along = points[link.b] - points[link.a];
                const float length = glm::length(along);
                if (length < 1e-9f) continue;
                const glm::vec3 fix = along * (0.5f * link.stiffness * (length - link.length) / length);
                points[link.a] += fix;
                points[link.b] -= fix;
            }
            if (substep % 4 == 0) separate(points, neighbours);
            for (size_t v = 0; v < points.size(); ++v) {
                const glm::vec3 out = points[v] - ball;
                const float length = glm::length(out);
                if (length < cloth_ball_radius) {
                    points[v] = ball + out * (cloth_ball_radius / length);
                    const glm::vec3 slip = points[v] - before[v] - (ball - ball_before);
                    points[v] -= slip * 0.25f;
                    const glm::vec3 again = points[v] - ball;
                    points[v] = ball + again * (cloth_ball_radius / glm::length(again));
                }
                if (points[v].y < thickness) {
                    points[v].y = thickness;
                    const glm::vec3 slip = points[v] - before[v];
                    points[v].x -= slip.x * 0.3f;
                    points[v].z -= slip.z * 0.3f;
                }
            }
        }
        frames.push_back(points);
    }
    return frames;
}

Mesh sheet() {
    Mesh mesh;
    mesh.name = "cloth";
    const glm::vec3 red(0.5f, 0.035f, 0.04f), cream(0.78f, 0.7f, 0.56f), blue(0.05f, 0.08f, 0.3f);
    for (uint32_t r = 0; r < rows; ++r) {
        for (uint32_t c = 0; c < columns; ++c) {
            const float x = (static_cast<float>(c) - 0.5f * (columns - 1)) * spacing;
            const float z = (static_cast<float>(r) - 0.5f * (rows - 1)) * spacing;
            // A little uneven, or the fall would be too symmetric to fold.
            const float y = 0.85f + 0.012f * sine(5 * x + 1) * sine(4 * z + 2) + 0.05f * x;
            mesh.rest_positions.push_back({x + 0.06f, y, z - 0.03f});
            const bool border = r < 2 || c < 2 || r + 2 >= rows || c + 2 >= columns;
            mesh.albedo.push_back(border ? blue : (c / 4 + r / 4) % 2 ? red : cream);
            if (r + 1 == rows || c + 1 == columns) continue;
            const uint32_t a = r * columns + c, b = a + 1, d = a + columns, e = d + 1;
            if ((r + c) % 2) {
                mesh.indices.insert(mesh.indices.end(), {a, d, b, b, d, e});
            } else {
                mesh.indices.insert(mesh.indices.end(), {a, d, e, a, e, b});
            }
        }
    }
    compute_normals(mesh.rest_positions, mesh.indices, mesh.rest_normals);
    return mesh;
}

} // namespace

Scene make_cloth() {
    Scene scene;
    scene.name = "cloth";
    scene.duration = duration;
    scene.view_direction = {-0.45f, -0.6f, -1.0f};
    scene.meshes.push_back(sheet());
    scene.meshes.back().two_sided.assign(scene.meshes.back().rest_positions.size(), 1);
    scene.meshes.push_back(plane(2.4f, 12));
    scene.meshes.back().name = "floor";
    scene.meshes.back().albedo.assign(scene.meshes.back().rest_positions.size(), glm::vec3(0.42f));
    scene.meshes.push_back(sphere(1, ball_radius));
    Mesh& ball = scene.meshes.back();
    ball.name = "ball";
    for (glm::vec3& point : ball.rest_positions)
        point += ball_center(0);

    struct Data {
        std::vector<Mesh> meshes;
        std::vector<std::vector<glm::vec3>> frames;
    };
    const auto data = std::make_shared<Data>();
    data->meshes = scene.meshes;
    data->frames = simulate(scene.meshes[0].rest_positions);
    scene.pose = [data](double time, Pose& pose) {
        const double t = std::clamp(time, 0.0, duration);
        pose.positions.resize(data->meshes.size());
        pose.normals.resize(data->meshes.size());
        const size_t frame = std::min(static_cast<size_t>(t * frame_rate), data->frames.size() - 2);
        const float between = static_cast<float>(t * frame_rate - static_cast<double>(frame));
        const auto &from = data->frames[frame], &to = data->frames[frame + 1];
        pose.positions[0].resize(from.size());
        for (size_t v = 0; v < from.size(); ++v)
            pose.positions[0][v] = glm::mix(from[v], to[v], between);
        compute_normals(pose.positions[0], data->meshes[0].indices, pose.normals[0]);
        for (size_t m = 1; m < data->meshes.size(); ++m) {
            pose.positions[m] = data->meshes[m].rest_positions;
            pose.normals[m] = data->meshes[m].rest_normals;
        }
        const glm::vec3 move = ball_center(static_cast<float>(t)) - ball_center(0);
        for (glm::vec3& point : pose.positions[2])
            point += move;
    };
    return scene;
}

} // namespace nusselt::scenes
