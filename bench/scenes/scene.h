// An animated scene as plain data: what the built-in scenes and the model loader both produce, and what the
// program, the benchmarks and the tests consume.
#pragma once

#include <glm/vec2.hpp>
#include <glm/vec3.hpp>

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

namespace nusselt::scenes {

// One mesh as drawn (a node's mesh, all its primitives together). Topology never changes.
struct Mesh {
    std::string name;
    std::vector<glm::vec3> rest_positions; // bind pose, mesh space
    std::vector<glm::vec3> rest_normals;   // unit, same count
    std::vector<uint32_t> indices;         // 3 a triangle, counter-clockwise outside
    std::vector<glm::vec3> albedo;         // linear RGB in [0, 1], per vertex
    // glTF's metallic-roughness model, per vertex: (metallic, roughness), with albedo as the base colour.
    // Empty: neither is known.
    std::vector<glm::vec2> metallic_roughness;
    // 1: a sheet that is seen from both sides, per vertex (glTF's doubleSided). Empty: none is known to be.
    std::vector<uint8_t> two_sided = {};
    // What it does in a frame: hides light from itself and others; is shadowed.
    bool hides = true, receives = true;
};

// The scene at one moment, in world space: positions[mesh][vertex], normals[mesh][vertex] (unit length).
struct Pose {
    std::vector<std::vector<glm::vec3>> positions;
    std::vector<std::vector<glm::vec3>> normals;
};

struct Scene {
    std::string name;
    std::vector<Mesh> meshes;
    double duration = 0; // seconds of the clip; 0: static
    // Fills `pose` for a time in seconds (clamped to [0, duration]). Reuses the pose's memory. Thread-safe.
    std::function<void(double time, Pose& pose)> pose;
    glm::vec3 view_direction{-0.4f, -0.35f, -1.0f}; // for the default camera, which frames the posed bounds
};

// Area-weighted unit normals of a posed mesh, by index: vertices that merely lie at one place don't share
// theirs (surface.h has that). Vertices without area get (0, 1, 0).
void compute_normals(const std::vector<glm::vec3>& positions, const std::vector<uint32_t>& indices,
                     std::vector<glm::vec3>& normals);

// The built-in scenes, sized as Table 1 of the paper within 5 %: "cloth" (1378 vertices, 2560 triangles),
// "fight" (2978, 4806), "chess" (1897, 3704), "hand" (8636, 15854).
std::vector<std::string> builtin_names();
// The scene of that name; a scene without meshes if there is none.
Scene builtin(const std::string& name);

} // namespace nusselt::scenes
