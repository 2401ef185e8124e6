#include "tools/commands/roles.h"

#include "tools/report/failure.h"
#include "tools/trace/assembly.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <utility>

namespace nusselt::tools {

namespace {

size_t find_mesh(const scenes::Scene& scene, const std::string& wanted, const std::string& option) {
    std::string list, namesakes;
    size_t named = 0, last = 0;
    for (size_t m = 0; m < scene.meshes.size(); ++m) {
        // A number wins over a name, so that there is always one to use.
        if (wanted == std::to_string(m)) return m;
        if (wanted == scene.meshes[m].name) {
            if (named < 20) namesakes += (named ? ", " : "") + std::to_string(m);
            ++named;
            last = m;
        }
        if (m < 20) list += (m ? ", " : "") + std::to_string(m) + " " + scene.meshes[m].name;
    }
    if (named == 1) return last;
    if (named > 20) namesakes += ", ...";
    if (named > 1)
        throw Failure(option,
                      std::to_string(named) + " meshes are named '" + wanted +
                          "'; choose one by its number: " + namesakes,
                      exit_usage);
    if (scene.meshes.size() > 20) list += ", ...";
    throw Failure(option, "there is no mesh '" + wanted + "'; choose one by name or number of: " + list,
                  exit_usage);
}

} // namespace

void assign_roles(scenes::Scene& scene, const Roles& roles) {
    for (const std::string& name : roles.receive_only)
        scene.meshes[find_mesh(scene, name, "--receive-only")].hides = false;
    for (const std::string& name : roles.block_only) {
        scenes::Mesh& mesh = scene.meshes[find_mesh(scene, name, "--block-only")];
        if (!mesh.hides)
            throw Failure("--block-only", "mesh '" + name + "' is to receive only; choose one of the two",
                          exit_usage);
        mesh.receives = false;
    }
    const auto is_drawn = [](const scenes::Mesh& mesh) { return mesh.receives; };
    if (!roles.ground && !std::any_of(scene.meshes.begin(), scene.meshes.end(), is_drawn))
        throw Failure("--block-only", "no mesh is left to be drawn; leave one out, or add --ground",
                      exit_usage);
}

std::vector<float> add_ground(scenes::Scene& scene, const std::vector<double>& times) {
    Bounds bounds;
    scenes::Pose pose;
    for (const double time : times) {
        scene.pose(time, pose);
        for (const std::vector<glm::vec3>& positions : pose.positions)
            grow(bounds, positions);
    }
    // Fine where the scene stands, and wide enough for a low view.
    constexpr uint32_t side = 97;
    const float reach = 2 * diagonal(bounds);
    const glm::vec3 middle = 0.5f * (bounds.low + bounds.high);
    const auto along = [&](uint32_t k) {
        const float t = 2 * static_cast<float>(k) / (side - 1) - 1;
        return reach * t * (0.3f + 0.7f * t * t);
    };
    std::vector<float> opacity;
    scenes::Mesh ground;
    ground.name = "ground";
    ground.hides = false;
    for (uint32_t k = 0; k < side * side; ++k) {
        ground.rest_positions.emplace_back(middle.x + along(k % side), bounds.low.y,
                                           middle.z + along(k / side));
        ground.rest_normals.emplace_back(0, 1, 0);
        // From 1 half-way out to 0 on the circle within the square.
        const float away = std::hypot(along(k % side), along(k / side)) / reach;
        const float left = std::clamp(2 - 2 * away, 0.0f, 1.0f);
        opacity.push_back(left * left * (3 - 2 * left));
        ground.albedo.emplace_back(0.6f);
        if (k % side + 1 == side || k / side + 1 == side) continue;
        for (const uint32_t corner : {k, k + side, k + side + 1, k, k + side + 1, k + 1})
            ground.indices.push_back(corner);
    }
    scene.pose = [pose_scene = std::move(scene.pose), positions = ground.rest_positions,
                  normals = ground.rest_normals](double time, scenes::Pose& out) {
        // Its memory is reused too.
        if (!out.positions.empty()) out.positions.pop_back();
        if (!out.normals.empty()) out.normals.pop_back();
        pose_scene(time, out);
        out.positions.push_back(positions);
        out.normals.push_back(normals);
    };
    scene.meshes.push_back(std::move(ground));
    return opacity;
}

} // namespace nusselt::tools
