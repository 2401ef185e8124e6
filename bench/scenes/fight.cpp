// Fight: a boxer, one closed skin over sixteen bones; jab, cross, hook and a kick out of the guard. Metres;
// faces +z, feet at y = 0. Rest pose: arms and legs apart.
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

constexpr float cell = 0.0356f; // sets the triangle count
constexpr double duration = 3.6;

enum BoneIndex {
    pelvis,
    spine,
    chest,
    neck,
    head,
    arm_left,
    arm_right = 8,
    leg_left = 11,
    leg_right = 14,
    bone_count = 17
};

constexpr float ankle_height = 0.075f;
const std::array<glm::vec3, 4> arm_joints{
    {{0.185f, 1.435f, -0.01f}, {0.425f, 1.268f, -0.01f}, {0.638f, 1.119f, -0.01f}, {0.745f, 1.044f, -0.01f}}};
const std::array<glm::vec3, 4> leg_joints{
    {{0.098f, 0.93f, 0}, {0.18f, 0.5f, 0.01f}, {0.255f, ankle_height, -0.01f}, {0.27f, 0.04f, 0.16f}}};

glm::vec3 mirrored(const glm::vec3& point, bool right) {
    return right ? glm::vec3(-point.x, point.y, point.z) : point;
}

float boxer_field(const glm::vec3& any_side) {
    const glm::vec3 point(std::abs(any_side.x), any_side.y, any_side.z);
    const auto& a = arm_joints;
    const auto& l = leg_joints;
    float d = distance(Limb{{0, 1.16f, 0}, {0, 1.37f, 0}, 0.128f, 0.165f, 0.66f}, point);
    d = smooth_min(d, distance(Limb{{0, 0.98f, 0}, {0, 1.16f, 0}, 0.135f, 0.125f, 0.76f}, point), 0.06f);
    d = smooth_min(d, distance(Limb{{0, 0.945f, -0.01f}, {0.085f, 0.945f, -0.015f}, 0.105f, 0.1f}, point),
                   0.06f);
    d = smooth_min(d, ellipsoid_distance({0.075f, 1.35f, 0.075f}, {0.085f, 0.065f, 0.05f}, point), 0.04f);
    d = smooth_min(d, ellipsoid_distance({0.08f, 0.92f, -0.075f}, {0.08f, 0.085f, 0.06f}, point), 0.04f);
    d = smooth_min(d, distance(Limb{{0, 1.47f, -0.02f}, {0.17f, 1.44f, -0.015f}, 0.06f, 0.062f}, point),
                   0.06f);
    float face = ellipsoid_distance({0, 1.69f, 0.005f}, {0.08f, 0.115f, 0.1f}, point);
    face = smooth_min(face, ellipsoid_distance({0, 1.61f, 0.045f}, {0.05f, 0.045f, 0.05f}, point), 0.04f);
    face =
        smooth_min(face, distance(Limb{{0, 1.69f, 0.1f}, {0, 1.655f, 0.122f}, 0.012f, 0.016f}, point), 0.03f);
    d = smooth_min(d, distance(Limb{{0, 1.44f, -0.02f}, {0, 1.6f, 0}, 0.062f, 0.056f}, point), 0.06f);
    d = smooth_min(d, face, 0.03f);
    d = smooth_min(d, ellipsoid_distance(a[0] + glm::vec3(0.02f, 0, 0), {0.075f, 0.07f, 0.068f}, point),
                   0.05f);
    d = smooth_min(d, distance(Limb{a[0], a[1], 0.056f, 0.045f}, point), 0.05f);
    d = smooth_min(d, distance(Limb{a[1], a[2], 0.05f, 0.036f}, point), 0.03f);
    // Glove and its cuff.
    d = smooth_min(d, distance(Limb{glm::mix(a[1], a[2], 0.8f), a[2], 0.052f, 0.05f}, point), 0.015f);
    d = smooth_min(d, distance(Limb{glm::mix(a[2], a[3], 0.2f), a[3], 0.06f, 0.072f}, point), 0.02f);
    d = smooth_min(d,
                   distance(Limb{glm::mix(a[2], a[3], 0.2f) + glm::vec3(0, -0.01f, 0.05f),
                                 glm::mix(a[2], a[3], 0.8f) + glm::vec3(0, -0.02f, 0.07f), 0.025f, 0.028f},
                            point),
                   0.02f);
    // Shorts flare a little over the thigh.
    d = smooth_min(d, distance(Limb{l[0], l[1], 0.088f, 0.058f}, point), 0.05f);
    d = smooth_min(d, distance(Limb{l[0], glm::mix(l[0], l[1], 0.45f), 0.095f, 0.092f}, point), 0.02f);
    d = smooth_min(d, distance(Limb{l[1], l[2], 0.056f, 0.04f}, point), 0.04f);
    d = smooth_min(d,
                   ellipsoid_distance(glm::mix(l[1], l[2], 0.3f) + glm::vec3(0, 0, -0.025f),
                                      {0.045f, 0.11f, 0.045f}, point),
                   0.04f);
    d = smooth_min(d, distance(Limb{glm::mix(l[1], l[2], 0.75f), l[2], 0.05f, 0.05f}, point), 0.015f);
    d = smooth_min(d, distance(Limb{l[2] + glm::vec3(0, -0.03f, -0.02f), l[3], 0.045f, 0.04f}, point), 0.02f);
    return d;
}

constexpr float shoe_top = 0.19f, hem_low = 0.66f, hem_high = 1.03f, cuff = -0.045f;

// What a triangle belongs to: a material, and one of two texture charts (front or back) as an artist would
// cut it.
enum Material : uint32_t { skin_tone, shorts, gloves, shoes, hair, material_count };

Material material_at(const glm::vec3& any_side) {
    const glm::vec3 point(std::abs(any_side.x), any_side.y, any_side.z);
    const glm::vec3 forearm = glm::normalize(arm_joints[2] - arm_joints[1]);
    if (glm::dot(point - arm_joints[2], forearm) > cuff && point.x > 0.4f) return gloves;
    if (point.y > std::clamp(1.735f + 0.9f * point.z, 1.62f, 1.755f)) return hair;
    if (point.y < shoe_top) return shoes;
    if (point.y < hem_high && point.y > hem_low && point.x < 0.35f) return shorts;
    return skin_tone;
}

// Moves what lies within half a cell of a hem onto it, so that hems are straight.
glm::vec3 snap_to_hems(const glm::vec3& any_side) {
    glm::vec3 point = any_side;
    for (float hem : {shoe_top, hem_low, hem_high})
        if (std::abs(point.y - hem) < 0.5f * cell && std::abs(point.x) < 0.35f) point.y = hem;
    for (bool right : {false, true}) {
        const glm::vec3 along = glm::normalize(mirrored(arm_joints[2] - arm_joints[1], right));
        const float beyond = glm::dot(point - mirrored(arm_joints[2], right), along) - cuff;
        if (std::abs(beyond) < 0.5f * cell && point.x * (right ? -1.0f : 1.0f) > 0.4f)
            point -= along * beyond;
    }
    return point;
}

// A key pose: turns of pelvis, spine, chest and head about y, lean of the spine (degrees), then directions in
// the chest's frame (upper arm, forearm, left then right) and the pelvis's (thigh, shin, foot's pitch in
// degrees).
constexpr size_t arms_at = 5, legs_at = 17, row_width = 31;
using Row = std::array<float, row_width>;

constexpr Row guard{-38,   6,     6,     22,    9,     .34f, -.8f, .55f,  -.28f, .85f, .55f,
                    -.32f, -.85f, .4f,   .28f,  .85f,  .6f,  .34f, -.88f, .42f,  .12f, -1,
                    -.1f,  0,     -.22f, -.95f, -.05f, -.3f, -.9f, -.42f, 25};

constexpr Row with(Row row, size_t at, std::initializer_list<float> values) {
    for (float value : values)
        row[at++] = value;
    return row;
}

constexpr Row jab = with(with(guard, 0, {-46, -4, -8, 40, 12}), arms_at, {.2f, .3f, 1, .22f, .36f, 1});
constexpr Row cross =
    with(with(with(guard, 0, {-6, 16, 20, -22, 14}), arms_at + 6, {.02f, .34f, 1, 0, .4f, 1}), legs_at + 7,
         {-.2f, -.97f, .1f, -.3f, -.8f, -.62f, 42});
constexpr Row wind_up =
    with(with(guard, 0, {-20, 12, 14, -4, 12}), arms_at, {.85f, -.45f, .1f, .25f, .45f, .9f});
constexpr Row hook =
    with(with(guard, 0, {-62, -10, -16, 62, 10}), arms_at, {.8f, -.08f, .7f, -.85f, .12f, .5f});
constexpr Row knee_up = with(with(guard, 0, {-10, 4, 4, 0, -4}), legs_at,
                             {.12f, -1, .12f, .05f, -1, -.1f, 0, -.12f, .05f, 1, -.1f, -.98f, -.1f, 20});
constexpr Row kick = with(with(with(guard, 0, {4, 0, 4, -8, -14}), legs_at,
                               {.1f, -1, .06f, .02f, -1, -.08f, 0, -.08f, .12f, 1, -.03f, .16f, 1, -20}),
                          arms_at + 6, {-.5f, -.85f, -.1f, -.05f, .5f, .85f});

const std::array<Key<Row>, 14> keys{{{0.0f, guard},
                                     {0.25f, guard},
                                     {0.45f, jab},
                                     {0.7f, guard},
                                     {0.95f, cross},
                                     {1.25f, guard},
                                     {1.45f, wind_up},
                                     {1.7f, hook},
                                     {2.05f, guard},
                                     {2.35f, knee_up},
                                     {2.6f, kick},
                                     {2.9f, knee_up},
                                     {3.25f, guard},
                                     {3.6f, guard}}};

struct Boxer {
    std::vector<glm::vec3> rest;
    std::vector<uint32_t> indices, weld;
    std::vector<Influence> influences;
    std::vector<Bone> bones;
};

// Turns two bones and their end towards directions given in the frame of the limb's parent.
void aim_limb(const std::array<glm::vec3, 4>& joints, bool right, const float* directions,
              const glm::quat& end, glm::quat* local) {
    glm::quat before(1, 0, 0, 0);
    for (size_t bone = 0; bone < 2; ++bone) {
        const glm::vec3 target = glm::normalize(
            glm::vec3(directions[3 * bone], directions[3 * bone + 1], directions[3 * bone + 2]));
        const glm::vec3 along =
            before * glm::normalize(mirrored(joints[bone + 1], right) - mirrored(joints[bone], right));
        const glm::quat now = aim(along, target) * before;
        local[bone] = glm::conjugate(before) * now;
        before = now;
    }
    local[2] = end;
}

void pose_bones(const Boxer& boxer, float time, std::vector<Rigid>& world) {
    const Row row = sample_keys(keys, time);
    std::vector<glm::quat> local(bone_count, glm::quat(1, 0, 0, 0));
    const glm::vec3 up(0, 1, 0), side(1, 0, 0);
    local[pelvis] = turn(up, radians(row[0]));
    local[spine] = turn(up, radians(row[1])) * turn(side, radians(row[4]));
    local[chest] = turn(up, radians(row[2])) * turn(side, radians(0.6f * row[4]));
    local[neck] = turn(up, radians(0.4f * row[3]));
    local[head] = turn(up, radians(0.6f * row[3])) * turn(side, radians(10 - row[4]));
    for (size_t limb = 0; limb < 2; ++limb) {
        aim_limb(arm_joints, limb == 1, &row[arms_at + 6 * limb], glm::quat(1, 0, 0, 0),
                 &local[limb ? arm_right : arm_left]);
        const float* leg = &row[legs_at + 7 * limb];
        glm::quat* bones = &local[limb ? leg_right : leg_left];
        aim_limb(leg_joints, limb == 1, leg, glm::quat(1, 0, 0, 0), bones);
        // Feet stay level in the pelvis's frame but for their pitch.
        bones[2] = glm::conjugate(bones[0] * bones[1]) * turn(side, radians(leg[6]));
    }
    world_transforms(boxer.bones, local, glm::vec3(0), world);
    // Stands on the lower ankle.
    float lowest = 1e9f;
    for (size_t foot : {static_cast<size_t>(leg_left + 2), static_cast<size_t>(leg_right + 2)})
        lowest =
            std::min(lowest, (world[foot].rotation * boxer.bones[foot].pivot + world[foot].translation).y);
    for (Rigid& bone : world)
        bone.translation.y += ankle_height - lowest;
}

} // namespace

Scene make_fight() {
    const auto boxer = std::make_shared<Boxer>();
    Surface surface = mesh_field(boxer_field, {-0.87f, -0.06f, -0.24f}, {0.87f, 1.86f, 0.28f}, cell);

    for (glm::vec3& point : surface.positions)
        point = snap_to_hems(point);
    std::vector<uint32_t> triangle_chart, chart_of;
    for (size_t i = 0; i < surface.indices.size(); i += 3) {
        const auto& p = surface.positions;
        const glm::vec3 middle =
            (p[surface.indices[i]] + p[surface.indices[i + 1]] + p[surface.indices[i + 2]]) / 3.0f;
        const uint32_t side = middle.z > -0.01f ? 1 : 0;
        triangle_chart.push_back(material_at(middle) + material_count * side);
    }
    split_charts(surface.positions, surface.indices, triangle_chart, chart_of);

    boxer->rest = std::move(surface.positions);
    boxer->indices = std::move(surface.indices);
    boxer->weld = weld_map(boxer->rest);
    boxer->bones = {{-1, {0, 0.98f, 0}},
                    {pelvis, {0, 1.08f, 0}},
                    {spine, {0, 1.26f, 0}},
                    {chest, {0, 1.5f, -0.01f}},
                    {neck, {0, 1.58f, 0}}};
    std::vector<Chain> chains{
        {pelvis,
         {spine, chest, neck, head},
         {{0, 1.08f, 0}, {0, 1.26f, 0}, {0, 1.5f, -0.01f}, {0, 1.58f, 0}, {0, 1.75f, 0}},
         {0.13f, 0.15f, 0.07f, 0.07f, 0.09f},
         {0.08f, 0.09f, 0.04f, 0.03f}}};
    const auto add_limb = [&](int parent, const std::array<glm::vec3, 4>& joints, bool right,
                              std::vector<float> radii, std::vector<float> bend) {
        Chain chain;
        chain.base = parent;
        chain.radii = std::move(radii);
        chain.bend = std::move(bend);
        for (size_t joint = 0; joint < 4; ++joint) {
            chain.points.push_back(mirrored(joints[joint], right));
            if (joint == 3) break;
            const int bone = static_cast<int>(boxer->bones.size());
            boxer->bones.push_back({joint ? bone - 1 : parent, chain.points.back()});
            chain.bones.push_back(bone);
        }
        chains.push_back(std::move(chain));
    };
    for (bool right : {false, true})
        add_limb(chest, arm_joints, right, {0.06f, 0.048f, 0.05f, 0.07f}, {0.065f, 0.05f, 0.03f});
    for (bool right : {false, true})
        add_limb(pelvis, leg_joints, right, {0.095f, 0.06f, 0.045f, 0.04f}, {0.09f, 0.06f, 0.035f});
    boxer->influences = chain_weights(boxer->rest, chains, 0.05f);

    Scene scene;
    scene.name = "fight";
    scene.duration = duration;
    scene.view_direction = {0.5f, -0.2f, -1.0f};
    Mesh mesh;
    mesh.name = "boxer";
    mesh.rest_positions = boxer->rest;
    mesh.indices = boxer->indices;
    compute_normals(boxer->rest, boxer->indices, boxer->weld, mesh.rest_normals);
    static const std::array<glm::vec3, material_count> albedo{{{0.56f, 0.33f, 0.23f},
                                                               {0.06f, 0.12f, 0.36f},
                                                               {0.55f, 0.04f, 0.035f},
                                                               {0.65f, 0.62f, 0.56f},
                                                               {0.07f, 0.045f, 0.03f}}};
    for (uint32_t chart : chart_of)
        mesh.albedo.push_back(albedo[chart % material_count]);
    scene.meshes.push_back(std::move(mesh));
    scene.pose = [boxer](double time, Pose& pose) {
        std::vector<Rigid> world;
        pose_bones(*boxer, static_cast<float>(std::clamp(time, 0.0, duration)), world);
        pose.positions.resize(1);
        pose.normals.resize(1);
        skin(boxer->rest, boxer->influences, world, pose.positions[0]);
        compute_normals(pose.positions[0], boxer->indices, boxer->weld, pose.normals[0]);
    };
    return scene;
}

} // namespace nusselt::scenes
