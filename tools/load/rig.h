// What moves a model: immutable once loaded, shared by all scenes made from it.
#pragma once

#include "tools/load/model.h"

#include <glm/gtc/quaternion.hpp>
#include <glm/mat4x4.hpp>
#include <glm/vec2.hpp>
#include <glm/vec3.hpp>

#include <cstdint>
#include <string>
#include <vector>

namespace nusselt::load {

struct RigNode {
    int parent = -1;
    bool has_matrix = false; // then `matrix` counts, until a clip moves the node
    glm::dmat4 matrix{1.0};
    glm::dvec3 translation{0.0};
    glm::dquat rotation{1.0, 0.0, 0.0, 0.0};
    glm::dvec3 scale{1.0};
};

enum class Path : uint8_t { translation, rotation, scale, weights };
enum class Interpolation : uint8_t { step, linear, cubic };

struct Track {
    int node = 0;
    Path path = Path::translation;
    Interpolation interpolation = Interpolation::linear;
    uint32_t width = 0;        // floats of a value
    std::vector<float> times;  // never decreasing
    std::vector<float> values; // a key: the value; cubic: in-tangent, value, out-tangent
};

struct RigClip {
    double duration = 0;
    std::vector<Track> tracks;
};

struct RigSkin {
    std::vector<int> joints;
    std::vector<glm::dmat4> inverse_bind; // as many
};

struct MorphTarget {
    std::vector<glm::vec3> positions, normals; // differences; each one a vertex, or none at all
};

constexpr uint16_t rigid_joint = 0xFFFF; // follows the node, although the mesh is skinned

// A glTF mesh, all primitives together, as stored; drawn by any number of nodes.
struct Source {
    std::vector<glm::vec3> positions;
    std::vector<glm::vec3> normals;      // unit; computed from the rest pose where the file gives none
    std::vector<uint8_t> normal_missing; // one a vertex, or none at all where no normal is missing
    std::vector<uint32_t> weld;          // first vertex at the same position; only where a normal is missing
    std::vector<glm::vec3> albedo;
    std::vector<glm::vec2> metallic_roughness; // empty where the file has no materials
    std::vector<uint8_t> two_sided;            // 1: seen from both sides; one a vertex, or empty as above
    std::vector<uint32_t> indices;
    std::vector<MorphTarget> targets;
    std::vector<float> target_weights;
    uint32_t influences = 0; // a vertex: 0, 4 or 8
    std::vector<uint16_t> joints;
    std::vector<float> weights; // sum to 1
    uint32_t joint_count = 0;   // one more than the largest joint that has a weight
};

struct Draw {
    size_t source = 0;
    int node = 0;
    int skin = -1;
    bool mirrored = false; // as the nodes stand; the faces are then turned over
};

struct Rig {
    std::vector<RigNode> nodes;
    std::vector<int> order;                       // nodes, parents first
    std::vector<std::vector<float>> node_weights; // one a node: of its mesh's morph targets, as it stands
    std::vector<RigSkin> skins;
    std::vector<Source> sources;
    std::vector<Draw> draws; // one for each of the model's meshes
    std::vector<RigClip> clips;
};

// Welds and computes normals where they are missing.
void complete_normals(Source& source);

// Adds a draw of `source` by `node` and its mesh; the node order must be complete.
void add_draw(Model& model, Rig& rig, size_t source, int node, int skin, const std::string& name);

// Hands the rig to the model when all draws are there; fails where there is no triangle or a posed position
// overflows.
void finish_model(Model& model, std::shared_ptr<Rig> rig);

// A model of one mesh that nothing moves.
void finish_static(Model& model, Source&& source, const std::string& name);

} // namespace nusselt::load
