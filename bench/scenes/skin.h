// Skeletons and skinning by dual quaternions (no collapse at bent joints).
#pragma once

#include <glm/gtc/quaternion.hpp>
#include <glm/vec3.hpp>

#include <array>
#include <cstdint>
#include <vector>

namespace nusselt::scenes {

struct Bone {
    int parent;      // before its children; -1: the root
    glm::vec3 pivot; // rest pose; all rest rotations are the identity
};

struct Rigid {
    glm::quat rotation{1, 0, 0, 0};
    glm::vec3 translation{0};
};

// Turns about `axis` (unit) by `angle` radians; and the least turn from one unit direction to another, not
// opposite.
glm::quat turn(const glm::vec3& axis, float angle);
glm::quat aim(const glm::vec3& from, const glm::vec3& to);

// Rest pose to posed, one a bone. `local` turns about the pivot in the parent's frame.
void world_transforms(const std::vector<Bone>& bones, const std::vector<glm::quat>& local,
                      const glm::vec3& root_offset, std::vector<Rigid>& world);

// Bones in a row: bone i runs from points[i] to points[i + 1] with those radii. What lies before points[0]
// follows `base`. `bend[i]` is half the length over which the surface bends at points[i].
struct Chain {
    int base;
    std::vector<int> bones;
    std::vector<glm::vec3> points;
    std::vector<float> radii;
    std::vector<float> bend;
};

// At most four bones a vertex; weights sum to 1.
struct Influence {
    std::array<uint8_t, 4> bone{};
    std::array<float, 4> weight{};
};

// A vertex follows the chains whose surface is at most `falloff` farther than the nearest one's, fading
// smoothly; so limbs apart by more than that don't pull at each other.
std::vector<Influence> chain_weights(const std::vector<glm::vec3>& positions,
                                     const std::vector<Chain>& chains, float falloff);

void skin(const std::vector<glm::vec3>& rest, const std::vector<Influence>& influences,
          const std::vector<Rigid>& world, std::vector<glm::vec3>& posed);

} // namespace nusselt::scenes
