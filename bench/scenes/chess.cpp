// Chess: eight closed pieces, each a stack of rings, glide and hop over six by six squares.
#include "builtin.h"
#include "portable_math.h"
#include "surface.h"

#include <glm/common.hpp>
#include <glm/vec2.hpp>

#include <algorithm>
#include <memory>

namespace nusselt::scenes {

namespace {

constexpr int board_size = 6;
constexpr float base_gap = 2e-3f; // pieces stand a hair above the board: no coplanar contact

// Heights and radii in squares. `forward` and `lean` (degrees, towards +z) bend the stack, `notch` lowers the
// ring at every second group of `notch_width` corners.
struct Ring {
    float height, side, depth;
    float forward = 0, lean = 0;
    float notch = 0;
    int notch_width = 1;
};

Ring round(float height, float radius) {
    return {height, radius, radius};
}
Ring notched(float height, float radius, float notch, int width) {
    return {height, radius, radius, 0, 0, notch, width};
}

Mesh stack(const char* name, const std::vector<Ring>& rings, int corners, const glm::vec3& albedo) {
    Mesh mesh;
    mesh.name = name;
    const uint32_t n = static_cast<uint32_t>(corners);
    mesh.rest_positions.push_back({0, rings.front().height, rings.front().forward});
    for (const Ring& ring : rings) {
        const float cos_lean = cosine(radians(ring.lean)), sin_lean = sine(radians(ring.lean));
        for (int corner = 0; corner < corners; ++corner) {
            const double angle = 2 * pi * (corner + 0.5) / corners;
            const float x = ring.side * static_cast<float>(cosine(angle));
            const float z = ring.depth * static_cast<float>(sine(angle));
            const float drop = corner / ring.notch_width % 2 ? ring.notch : 0;
            mesh.rest_positions.push_back(
                {x, ring.height - z * sin_lean - drop, ring.forward + z * cos_lean});
        }
    }
    const uint32_t tip = static_cast<uint32_t>(mesh.rest_positions.size());
    const uint32_t last = tip - n;
    glm::vec3 middle(0);
    for (uint32_t k = 0; k < n; ++k)
        middle += mesh.rest_positions[last + k] / static_cast<float>(n);
    mesh.rest_positions.push_back(middle);

    for (uint32_t k = 0; k < n; ++k) {
        const uint32_t next = (k + 1) % n;
        mesh.indices.insert(mesh.indices.end(), {0, 1 + k, 1 + next});
        for (uint32_t ring = 1; ring + n < tip; ring += n) {
            const uint32_t a = ring + k, b = ring + next, c = b + n, d = a + n;
            mesh.indices.insert(mesh.indices.end(), {a, d, c, a, c, b});
        }
        mesh.indices.insert(mesh.indices.end(), {last + k, tip, last + next});
    }
    for (glm::vec3& point : mesh.rest_positions)
        point.y += base_gap;
    compute_normals(mesh.rest_positions, mesh.indices, mesh.rest_normals);
    mesh.albedo.assign(mesh.rest_positions.size(), albedo);
    return mesh;
}

std::vector<Ring> pawn() {
    return {round(0, .29f),    round(.06f, .31f), round(.14f, .27f), round(.2f, .17f),
            round(.46f, .1f),  round(.54f, .17f), round(.6f, .1f),   round(.7f, .165f),
            round(.79f, .18f), round(.89f, .14f), round(.95f, .06f)};
}

std::vector<Ring> rook() {
    return {round(0, .34f),
            round(.07f, .36f),
            round(.17f, .31f),
            round(.24f, .22f),
            round(.62f, .185f),
            round(.8f, .2f),
            round(.88f, .27f),
            notched(1.17f, .28f, .14f, 2),
            notched(1.19f, .26f, .14f, 2),
            notched(1.19f, .185f, .14f, 2),
            notched(1.16f, .17f, .12f, 2),
            round(1.0f, .15f)};
}

std::vector<Ring> bishop() {
    return {round(0, .33f),     round(.07f, .35f),  round(.16f, .3f),   round(.24f, .19f),
            round(.5f, .13f),   round(.78f, .115f), round(.84f, .2f),   round(.89f, .2f),
            round(.93f, .13f),  round(1.04f, .19f), round(1.16f, .18f), round(1.3f, .11f),
            round(1.38f, .05f), round(1.43f, .07f), round(1.49f, .04f)};
}

std::vector<Ring> knight() {
    return {round(0, .33f),
            round(.07f, .35f),
            round(.17f, .3f),
            round(.23f, .24f),
            {.4f, .17f, .25f, -.02f, -6},
            {.58f, .15f, .24f, -.06f, -8},
            {.76f, .135f, .23f, -.09f, 0},
            {.94f, .13f, .22f, -.08f, 16},
            {1.08f, .125f, .21f, -.01f, 42},
            {1.14f, .12f, .2f, .08f, 68},
            {1.12f, .11f, .165f, .17f, 90},
            {1.06f, .09f, .13f, .27f, 105},
            {1.01f, .08f, .105f, .34f, 108},
            {.99f, .05f, .065f, .375f, 108}};
}

std::vector<Ring> queen() {
    return {round(0, .36f),
            round(.07f, .38f),
            round(.18f, .32f),
            round(.27f, .2f),
            round(.6f, .13f),
            round(1.0f, .12f),
            round(1.06f, .22f),
            round(1.12f, .22f),
            round(1.16f, .15f),
            notched(1.52f, .27f, .12f, 1),
            notched(1.53f, .24f, .12f, 1),
            round(1.38f, .16f),
            round(1.45f, .1f),
            round(1.53f, .07f),
            round(1.6f, .03f)};
}

std::vector<Ring> king() {
    return {round(0, .37f),      round(.07f, .39f),   round(.18f, .33f),    round(.28f, .21f),
            round(.65f, .14f),   round(1.1f, .13f),   round(1.17f, .23f),   round(1.23f, .23f),
            round(1.27f, .16f),  round(1.5f, .23f),   round(1.56f, .21f),   round(1.6f, .09f),
            {1.68f, .04f, .04f}, {1.7f, .13f, .045f}, {1.79f, .13f, .045f}, {1.81f, .04f, .04f},
            {1.9f, .045f, .04f}};
}

Mesh board() {
    Mesh mesh;
    mesh.name = "board";
    const glm::vec3 light(0.62f, 0.5f, 0.33f), dark(0.22f, 0.12f, 0.07f);
    for (int row = 0; row < board_size; ++row) {
        for (int column = 0; column < board_size; ++column) {
            const uint32_t first = static_cast<uint32_t>(mesh.rest_positions.size());
            for (int v = 0; v < 3; ++v) {
                for (int u = 0; u < 3; ++u) {
                    const float half = 0.5f * static_cast<float>(board_size);
                    mesh.rest_positions.push_back({static_cast<float>(2 * column + u) * 0.5f - half, 0,
                                                   static_cast<float>(2 * row + v) * 0.5f - half});
                    mesh.albedo.push_back((row + column) % 2 ? light : dark);
                }
            }
            for (uint32_t v = 0; v < 2; ++v) {
                for (uint32_t u = 0; u < 2; ++u) {
                    const uint32_t a = first + 3 * v + u, b = a + 1, c = a + 3, d = a + 4;
                    mesh.indices.insert(mesh.indices.end(), {a, c, d, a, d, b});
                }
            }
        }
    }
    mesh.rest_normals.assign(mesh.rest_positions.size(), glm::vec3(0, 1, 0));
    return mesh;
}

// Squares are (column, row) from the corner at -x, -z.
struct Move {
    float begin, end; // seconds
    glm::vec2 to;
    float hop = 0; // height in squares
};

struct Piece {
    glm::vec2 start;
    std::vector<Move> moves;
};

constexpr double duration = 4;

glm::vec3 place(const Piece& piece, float time) {
    glm::vec2 square = piece.start;
    float height = 0;
    for (const Move& move : piece.moves) {
        const float along = smooth_step(move.begin, move.end, time);
        height += 4 * move.hop * along * (1 - along);
        square = glm::mix(square, move.to, along);
    }
    const float centre = 0.5f * static_cast<float>(board_size - 1);
    return {square.x - centre, height, square.y - centre};
}

} // namespace

Scene make_chess() {
    const glm::vec3 ivory(0.72f, 0.62f, 0.44f), walnut(0.16f, 0.075f, 0.04f);
    Scene scene;
    scene.name = "chess";
    scene.duration = duration;
    scene.view_direction = {-0.55f, -0.75f, -0.8f};

    auto pieces = std::make_shared<std::vector<Piece>>();
    const auto add = [&](const char* name, const std::vector<Ring>& rings, int corners,
                         const glm::vec3& albedo, Piece piece) {
        scene.meshes.push_back(stack(name, rings, corners, albedo));
        pieces->push_back(std::move(piece));
    };
    scene.meshes.push_back(board());
    add("white king", king(), 16, ivory, {{3, 5}, {{3.0f, 3.9f, {2, 5}}}});
    add("white rook", rook(), 16, ivory, {{0, 5}, {{0.1f, 1.5f, {0, 1}}, {2.4f, 3.4f, {1, 1}}}});
    add("white bishop", bishop(), 16, ivory, {{5, 4}, {{0.6f, 1.7f, {3, 2}}, {3.0f, 3.8f, {4, 3}}}});
    add("white pawn", pawn(), 14, ivory, {{2, 4}, {{0.2f, 0.9f, {2, 3}}}});
    add("white pawn", pawn(), 14, ivory, {{4, 5}, {{1.6f, 2.3f, {4, 4}}}});
    add("black queen", queen(), 16, walnut, {{3, 0}, {{0.9f, 2.2f, {5, 2}}, {2.5f, 3.6f, {5, 5}}}});
    add("black knight", knight(), 16, walnut, {{1, 0}, {{1.2f, 2.1f, {2, 2}, 1.6f}}});
    add("black pawn", pawn(), 14, walnut, {{1, 2}, {{0.8f, 1.6f, {1, 3}}}});

    const auto rest = std::make_shared<std::vector<Mesh>>(scene.meshes);
    scene.pose = [pieces, rest](double time, Pose& pose) {
        const float t = static_cast<float>(std::clamp(time, 0.0, duration));
        pose.positions.resize(rest->size());
        pose.normals.resize(rest->size());
        for (size_t m = 0; m < rest->size(); ++m) {
            const Mesh& mesh = (*rest)[m];
            pose.positions[m] = mesh.rest_positions;
            pose.normals[m] = mesh.rest_normals;
            if (m == 0) continue;
            const glm::vec3 offset = place((*pieces)[m - 1], t);
            for (glm::vec3& point : pose.positions[m])
                point += offset;
        }
    };
    return scene;
}

} // namespace nusselt::scenes
