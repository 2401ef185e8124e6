// Hand: one closed skin over palm, forearm stump, four fingers and a thumb of three bones each; fingers
// ripple, close to a fist, show a V and spread again. A right hand, fingers along +y, palm towards +z;
// centimetres.
#include "builtin.h"
#include "implicit.h"
#include "keys.h"
#include "skin.h"
#include "surface.h"

#include <glm/common.hpp>
#include <glm/geometric.hpp>

#include <algorithm>
#include <memory>

namespace nusselt::scenes {

namespace {

constexpr double duration = 4;
constexpr size_t finger_count = 4, thumb = 4, digit_count = 5;

struct Digit {
    std::array<glm::vec3, 4> joints; // three bones, then the tip
    std::array<float, 4> radii;
    glm::vec3 palmar; // unit, across the digit: the side that bends inwards
};

Digit finger(const glm::vec3& knuckle, float degrees, const std::array<float, 3>& lengths,
             const std::array<float, 4>& radii) {
    const glm::vec3 along(sine(radians(degrees)), cosine(radians(degrees)), 0);
    Digit digit;
    digit.joints[0] = knuckle;
    for (size_t i = 0; i < 3; ++i)
        digit.joints[i + 1] = digit.joints[i] + along * lengths[i];
    digit.radii = radii;
    digit.palmar = {0, 0, 1};
    return digit;
}

std::array<Digit, digit_count> make_digits() {
    Digit opposed;
    opposed.joints = {
        glm::vec3(2.1f, 2.2f, 0.7f), {4.9f, 4.9f, 1.35f}, {6.95f, 7.5f, 1.6f}, {8.1f, 9.5f, 1.65f}};
    opposed.radii = {1.3f, 1.02f, 0.92f, 0.7f};
    const glm::vec3 along = glm::normalize(opposed.joints[3] - opposed.joints[1]);
    const glm::vec3 inwards(-0.6f, 0.3f, 0.8f);
    opposed.palmar = glm::normalize(inwards - along * glm::dot(along, inwards));
    return {finger({2.95f, 8.9f, 0}, 13, {4.5f, 2.7f, 2.1f}, {0.98f, 0.86f, 0.76f, 0.6f}),
            finger({0.95f, 9.4f, 0}, 2, {5, 3.1f, 2.2f}, {1, 0.88f, 0.78f, 0.62f}),
            finger({-1.1f, 9, 0}, -8.5f, {4.6f, 2.9f, 2.2f}, {0.95f, 0.83f, 0.74f, 0.59f}),
            finger({-2.95f, 7.9f, 0}, -21, {3.6f, 2.2f, 1.9f}, {0.83f, 0.72f, 0.64f, 0.51f}), opposed};
}

// 1 at 0, falling smoothly to 0 at 1.
float bump(float x) {
    const float rest = 1 - x * x;
    return rest > 0 ? rest * rest : 0;
}

// 1 in the middle of the nail, 0 outside, by the position relative to the last bone.
float nail(const Digit& digit, const glm::vec3& point) {
    const glm::vec3 bone = digit.joints[3] - digit.joints[2];
    const float length = glm::length(bone);
    const glm::vec3 along = bone / length;
    const glm::vec3 offset = point - digit.joints[2];
    const float radius = digit.radii[3];
    const float up = -glm::dot(offset, digit.palmar) / radius;
    const float side = glm::dot(offset, glm::cross(along, digit.palmar)) / (0.85f * radius);
    const float out = (glm::dot(offset, along) / length - 0.8f) / 0.5f;
    return up > 0.35f ? 1 - std::max(side * side * side * side, out * out * out * out) : 0;
}

float crease(const Digit& digit, const glm::vec3& point) {
    float depth = 0;
    for (size_t joint = 1; joint < 3; ++joint) {
        const glm::vec3 offset = point - digit.joints[joint];
        const float radius = digit.radii[joint];
        if (glm::dot(offset, offset) > 4 * radius * radius) continue;
        const float along = glm::dot(offset, glm::normalize(digit.joints[joint + 1] - digit.joints[joint]));
        const float side = glm::dot(offset, digit.palmar) / radius;
        depth += 0.12f * bump(along / 0.34f) * smooth_step(-0.1f, 0.6f, side);
        // Wrinkles over the knuckle.
        for (int line = -1; line <= 1; ++line)
            depth += 0.05f * bump((along - 0.42f * static_cast<float>(line)) / 0.3f) *
                     smooth_step(0.2f, 0.7f, -side);
    }
    return depth;
}

float segment_distance(const glm::vec3& a, const glm::vec3& b, const glm::vec3& point) {
    const glm::vec3 axis = b - a;
    const float along = glm::clamp(glm::dot(point - a, axis) / glm::dot(axis, axis), 0.0f, 1.0f);
    const glm::vec3 offset = point - a - axis * along;
    return std::sqrt(offset.x * offset.x + offset.y * offset.y);
}

float palm_lines(const glm::vec3& point) {
    static const std::array<std::array<glm::vec3, 4>, 3> lines{{
        {{{-3.4f, 6.6f, 0}, {-1.4f, 6.9f, 0}, {0.6f, 7.4f, 0}, {1.6f, 8.2f, 0}}},
        {{{3.4f, 6.6f, 0}, {1.4f, 6.2f, 0}, {-0.6f, 5.4f, 0}, {-2.2f, 4.4f, 0}}},
        {{{3.3f, 6.3f, 0}, {1.5f, 5.4f, 0}, {0.5f, 3.6f, 0}, {0.4f, 1.2f, 0}}},
    }};
    float depth = 0;
    for (const auto& line : lines) {
        float nearest = 1e9f;
        for (size_t i = 0; i < 3; ++i)
            nearest = std::min(nearest, segment_distance(line[i], line[i + 1], point));
        depth = std::max(depth, 0.14f * bump(nearest / 0.42f));
    }
    return depth * smooth_step(0.3f, 0.8f, point.z);
}

float hand_field(const std::array<Digit, digit_count>& digits, const glm::vec3& point) {
    float d = distance(Limb{{0, -3.6f, -0.1f}, {0, 0, 0}, 2.75f, 2.55f, 0.72f}, point);
    for (size_t f = 0; f < finger_count; ++f) {
        const glm::vec3& knuckle = digits[f].joints[0];
        const Limb metacarpal{{knuckle.x * 0.5f, 0.8f, 0}, knuckle, 1.25f, digits[f].radii[0] * 1.08f};
        d = smooth_min(d, distance(metacarpal, point), 1.1f);
        // The knuckle on the back.
        d = smooth_min(d, ellipsoid_distance(knuckle - glm::vec3(0, 0, 0.62f), {0.55f, 0.7f, 0.55f}, point),
                       0.5f);
    }
    d = smooth_min(d, ellipsoid_distance({2.3f, 3.5f, 0.85f}, {1.5f, 2.6f, 1.25f}, point), 0.8f);
    d = smooth_min(d, ellipsoid_distance({-2.35f, 3.3f, 0.6f}, {1.3f, 2.8f, 1.15f}, point), 0.8f);
    d = smooth_min(d, ellipsoid_distance({0, 8, 0.65f}, {3.4f, 0.9f, 0.75f}, point), 0.6f);
    d += palm_lines(point);
    for (size_t f = 0; f < digit_count; ++f) {
        const Digit& digit = digits[f];
        const float blend = f == thumb ? 1.3f : 0.75f;
        // Too far to matter: a ball around the digit, generous by its pads and blends.
        const glm::vec3 middle_of_all = 0.5f * (digit.joints[0] + digit.joints[3]);
        const float reach = 0.5f * glm::distance(digit.joints[0], digit.joints[3]) + digit.radii[0] + 1;
        if (glm::distance(point, middle_of_all) - reach > d + blend) continue;
        float own = 1e9f;
        for (size_t bone = 0; bone < 3; ++bone) {
            const Limb limb{digit.joints[bone], digit.joints[bone + 1], digit.radii[bone],
                            digit.radii[bone + 1]};
            own = bone ? smooth_min(own, distance(limb, point), 0.3f) : distance(limb, point);
        }
        // Pads between the creases.
        for (size_t bone = 0; bone < 3; ++bone) {
            const glm::vec3 middle = 0.5f * (digit.joints[bone] + digit.joints[bone + 1]);
            const float radius = 0.5f * (digit.radii[bone] + digit.radii[bone + 1]);
            const float half = 0.42f * glm::distance(digit.joints[bone], digit.joints[bone + 1]);
            const Limb pad{
                middle - half * 0.5f * glm::normalize(digit.joints[bone + 1] - digit.joints[bone]) +
                    digit.palmar * (0.3f * radius),
                middle + half * 0.5f * glm::normalize(digit.joints[bone + 1] - digit.joints[bone]) +
                    digit.palmar * (0.3f * radius),
                radius * 0.8f, radius * 0.8f};
            own = smooth_min(own, distance(pad, point), 0.4f);
        }
        own += crease(digit, point) - 0.05f * smooth_step(0, 0.4f, nail(digit, point));
        d = smooth_min(d, own, blend);
    }
    return d;
}

// Bones: forearm, palm, then three a digit.
constexpr size_t bone_count = 2 + 3 * digit_count;

// A key pose: bend of each finger's joints and its spread (degrees), the thumb's three directions, and how
// the wrist bends and turns.
constexpr size_t spread_at = 12, thumb_at = 16, wrist_at = 25, row_width = 27;
using Row = std::array<float, row_width>;

const std::array<Key<Row>, 9> keys{{
    {0.0f, {0, 0, 0,    0,    0,    0,    0,    0,    0,   0,    0, 0, 0, 0,
            0, 0, .67f, .66f, .16f, .62f, .78f, .08f, .5f, .87f, 0, 0, 0}},
    {0.45f, {45, 40, 25,   18,   20,  10,  2,    5,   2,   -8,   0,    0, -2, 0,
             0,  4,  .62f, .66f, .3f, .5f, .78f, .2f, .3f, .87f, .15f, 4, 12}},
    {0.85f, {8, 15, 8,   42,   42,   25,  50,  48,  30,  20,  22,  10, -3, 0,
             1, 6,  .6f, .66f, .35f, .4f, .8f, .3f, .2f, .9f, .2f, -4, 20}},
    {1.25f, {0, 8,  5,   8,    15,   8,    25,  35,  20,  55,  50,  35, -3, 0,
             2, 10, .6f, .62f, .45f, .35f, .8f, .4f, .1f, .9f, .3f, -6, 8}},
    {1.9f, {84, 101, 62,  84,  104, 62,    84,   102, 60,    84,   97,   56,  -10, -2,
            7,  17,  .3f, .5f, .9f, -.32f, .62f, .6f, -.85f, .45f, .05f, -12, 0}},
    {2.4f, {84, 101, 62,  84,  104, 62,    84,   102, 60,    84,   97,   56, -10, -2,
            7,  17,  .3f, .5f, .9f, -.32f, .62f, .6f, -.85f, .45f, .05f, 8,  -14}},
    {3.0f, {2, 3,  2,   2,    3,    2,    84,  102,  60,    84,  97,  56, 2,  -5,
            6, 16, .1f, .55f, .85f, -.6f, .6f, .45f, -.85f, .4f, .0f, -6, -18}},
    {3.5f, {25, 30, 18,   28,   32,  20,   32,   36,  22,  34,  38,  22, -4, 0,
            3,  8,  .55f, .66f, .4f, .35f, .85f, .3f, .2f, .9f, .2f, -4, -6}},
    {4.0f, {0, 0, 0,    0,    0,    0,    0,    0,    0,   0,    0, 0, 0, 0,
            0, 0, .67f, .66f, .16f, .62f, .78f, .08f, .5f, .87f, 0, 0, 0}},
}};

struct Hand {
    std::array<Digit, digit_count> digits;
    std::vector<glm::vec3> rest;
    std::vector<uint32_t> indices, weld;
    std::vector<Influence> influences;
    std::vector<Bone> bones;
};

void pose_bones(const Hand& hand, float time, std::vector<Rigid>& world) {
    const Row row = sample_keys(keys, time);
    std::vector<glm::quat> local(bone_count, glm::quat(1, 0, 0, 0));
    local[1] = turn({0, 1, 0}, radians(row[wrist_at + 1])) * turn({1, 0, 0}, radians(row[wrist_at]));
    for (size_t f = 0; f < finger_count; ++f) {
        const Digit& digit = hand.digits[f];
        const glm::vec3 along = glm::normalize(digit.joints[1] - digit.joints[0]);
        const glm::vec3 axis = glm::cross(along, digit.palmar);
        const glm::quat spread = turn({0, 0, 1}, -radians(row[spread_at + f]));
        for (size_t bone = 0; bone < 3; ++bone)
            local[2 + 3 * f + bone] = turn(axis, radians(row[3 * f + bone]));
        local[2 + 3 * f] = spread * local[2 + 3 * f];
    }
    const Digit& digit = hand.digits[thumb];
    glm::quat before(1, 0, 0, 0);
    for (size_t bone = 0; bone < 3; ++bone) {
        const float* direction = &row[thumb_at + 3 * bone];
        const glm::vec3 target = glm::normalize(glm::vec3(direction[0], direction[1], direction[2]));
        const glm::vec3 along = before * glm::normalize(digit.joints[bone + 1] - digit.joints[bone]);
        const glm::quat now = aim(along, target) * before;
        local[2 + 3 * thumb + bone] = glm::conjugate(before) * now;
        before = now;
    }
    world_transforms(hand.bones, local, glm::vec3(0), world);
}

} // namespace

Scene make_hand(float cell) {
    const auto hand = std::make_shared<Hand>();
    hand->digits = make_digits();
    const auto& digits = hand->digits;
    Surface surface = mesh_field([&](const glm::vec3& point) { return hand_field(digits, point); },
                                 {-7.5f, -6.7f, -2.6f}, {9.3f, 20.8f, 3.2f}, cell);

    // Charts: palm side, back, and a nail each.
    std::vector<uint32_t> triangle_chart, chart_of;
    for (size_t i = 0; i < surface.indices.size(); i += 3) {
        const auto& p = surface.positions;
        const glm::vec3 middle =
            (p[surface.indices[i]] + p[surface.indices[i + 1]] + p[surface.indices[i + 2]]) / 3.0f;
        uint32_t chart = middle.z > 0 ? 0 : 1;
        const Digit& opposed = digits[thumb];
        if (middle.x > 3.8f && middle.y < 11)
            chart = glm::dot(middle - opposed.joints[1], opposed.palmar) > 0 ? 0 : 1;
        for (uint32_t f = 0; f < digit_count; ++f)
            if (nail(digits[f], middle) > 0) chart = 2 + f;
        triangle_chart.push_back(chart);
    }
    split_charts(surface.positions, surface.indices, triangle_chart, chart_of);

    hand->rest = std::move(surface.positions);
    hand->indices = std::move(surface.indices);
    hand->weld = weld_map(hand->rest);
    hand->bones = {{-1, {0, -6, 0}}, {0, {0, 0, 0}}};
    std::vector<Chain> chains;
    for (size_t f = 0; f < digit_count; ++f) {
        const Digit& digit = digits[f];
        Chain chain;
        chain.base = 0;
        chain.bones = {1};
        chain.points = {f == thumb ? glm::vec3(1.4f, 0, 0.2f) : glm::vec3(digit.joints[0].x * 0.4f, 0, 0)};
        chain.radii = {1.2f};
        chain.bend = {1.6f};
        for (size_t bone = 0; bone < 3; ++bone) {
            const int index = static_cast<int>(2 + 3 * f + bone);
            hand->bones.push_back({bone ? index - 1 : 1, digit.joints[bone]});
            chain.bones.push_back(index);
            chain.bend.push_back(digit.radii[bone] * (bone ? 1.0f : 1.1f));
        }
        for (size_t joint = 0; joint < 4; ++joint) {
            chain.points.push_back(digit.joints[joint]);
            chain.radii.push_back(digit.radii[joint]);
        }
        chains.push_back(std::move(chain));
    }
    hand->influences = chain_weights(hand->rest, chains, 0.5f);

    Scene scene;
    scene.name = "hand";
    scene.duration = duration;
    scene.view_direction = {-0.45f, -0.15f, -1.0f};
    Mesh mesh;
    mesh.name = "hand";
    mesh.rest_positions = hand->rest;
    mesh.indices = hand->indices;
    compute_normals(hand->rest, hand->indices, hand->weld, mesh.rest_normals);
    for (size_t v = 0; v < hand->rest.size(); ++v) {
        const glm::vec3 back(0.58f, 0.33f, 0.22f), palm(0.68f, 0.42f, 0.31f), nails(0.74f, 0.47f, 0.4f);
        const float palmar = smooth_step(-0.6f, 0.6f, mesh.rest_normals[v].z);
        mesh.albedo.push_back(chart_of[v] > 1 ? nails : glm::mix(back, palm, palmar));
    }
    scene.meshes.push_back(std::move(mesh));
    scene.pose = [hand](double time, Pose& pose) {
        std::vector<Rigid> world;
        pose_bones(*hand, static_cast<float>(std::clamp(time, 0.0, duration)), world);
        pose.positions.resize(1);
        pose.normals.resize(1);
        skin(hand->rest, hand->influences, world, pose.positions[0]);
        compute_normals(pose.positions[0], hand->indices, hand->weld, pose.normals[0]);
    };
    return scene;
}

} // namespace nusselt::scenes
