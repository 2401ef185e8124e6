#include "skin.h"

#include "portable_math.h"

#include <glm/common.hpp>
#include <glm/geometric.hpp>

#include <algorithm>

namespace nusselt::scenes {

glm::quat turn(const glm::vec3& axis, float angle) {
    return glm::quat(cosine(0.5f * angle), axis * sine(0.5f * angle));
}

glm::quat aim(const glm::vec3& from, const glm::vec3& to) {
    return glm::normalize(glm::quat(1 + glm::dot(from, to), glm::cross(from, to)));
}

void world_transforms(const std::vector<Bone>& bones, const std::vector<glm::quat>& local,
                      const glm::vec3& root_offset, std::vector<Rigid>& world) {
    world.resize(bones.size());
    for (size_t b = 0; b < bones.size(); ++b) {
        const Rigid parent = bones[b].parent < 0 ? Rigid{{1, 0, 0, 0}, root_offset}
                                                 : world[static_cast<size_t>(bones[b].parent)];
        world[b].rotation = parent.rotation * local[b];
        const glm::vec3 pivot = parent.rotation * bones[b].pivot + parent.translation;
        world[b].translation = pivot - world[b].rotation * bones[b].pivot;
    }
}

namespace {

float chain_distance(const Chain& chain, const glm::vec3& point) {
    float nearest = 1e30f;
    for (size_t i = 0; i + 1 < chain.points.size(); ++i) {
        const glm::vec3 axis = chain.points[i + 1] - chain.points[i];
        const float along =
            glm::clamp(glm::dot(point - chain.points[i], axis) / glm::dot(axis, axis), 0.0f, 1.0f);
        const float radius = glm::mix(chain.radii[i], chain.radii[i + 1], along);
        nearest = std::min(nearest, glm::length(point - chain.points[i] - axis * along) - radius);
    }
    return nearest;
}

} // namespace

std::vector<Influence> chain_weights(const std::vector<glm::vec3>& positions,
                                     const std::vector<Chain>& chains, float falloff) {
    size_t bone_count = 0;
    for (const Chain& chain : chains) {
        bone_count = std::max(bone_count, static_cast<size_t>(chain.base) + 1);
        for (int bone : chain.bones)
            bone_count = std::max(bone_count, static_cast<size_t>(bone) + 1);
    }
    std::vector<Influence> influences(positions.size());
    std::vector<float> distances(chains.size()), weights(bone_count);
    std::vector<uint8_t> order(bone_count);
    for (size_t v = 0; v < positions.size(); ++v) {
        const glm::vec3& point = positions[v];
        std::fill(weights.begin(), weights.end(), 0.0f);
        for (size_t c = 0; c < chains.size(); ++c)
            distances[c] = chain_distance(chains[c], point);
        const float nearest = *std::min_element(distances.begin(), distances.end());
        for (size_t c = 0; c < chains.size(); ++c) {
            const Chain& chain = chains[c];
            const float share = 1 - smooth_step(0, falloff, distances[c] - nearest);
            if (share <= 0) continue;
            float reach = share;
            int holder = chain.base;
            for (size_t i = 0; i < chain.bones.size(); ++i) {
                // Each joint cuts along the plane that halves its angle.
                const glm::vec3 out = glm::normalize(chain.points[i + 1] - chain.points[i]);
                const glm::vec3 in = i ? glm::normalize(chain.points[i] - chain.points[i - 1]) : out;
                const float beyond = glm::dot(point - chain.points[i], glm::normalize(in + out));
                const float next = reach * smooth_step(-chain.bend[i], chain.bend[i], beyond);
                weights[static_cast<size_t>(holder)] += reach - next;
                reach = next;
                holder = chain.bones[i];
            }
            weights[static_cast<size_t>(holder)] += reach;
        }
        for (size_t b = 0; b < bone_count; ++b)
            order[b] = static_cast<uint8_t>(b);
        std::stable_sort(order.begin(), order.end(),
                         [&](uint8_t a, uint8_t b) { return weights[a] > weights[b]; });
        float sum = 0;
        for (size_t k = 0; k < std::min<size_t>(4, bone_count); ++k)
            sum += weights[order[k]];
        for (size_t k = 0; k < std::min<size_t>(4, bone_count); ++k) {
            influences[v].bone[k] = order[k];
            influences[v].weight[k] = weights[order[k]] / sum;
        }
    }
    return influences;
}

void skin(const std::vector<glm::vec3>& rest, const std::vector<Influence>& influences,
          const std::vector<Rigid>& world, std::vector<glm::vec3>& posed) {
    std::array<glm::quat, 256> dual;
    for (size_t b = 0; b < world.size(); ++b)
        dual[b] = glm::quat(0, world[b].translation) * world[b].rotation * 0.5f;
    posed.resize(rest.size());
    for (size_t v = 0; v < rest.size(); ++v) {
        const Influence& influence = influences[v];
        const glm::quat& lead = world[influence.bone[0]].rotation;
        glm::quat real(0, 0, 0, 0), shift(0, 0, 0, 0);
        for (size_t k = 0; k < 4; ++k) {
            const size_t bone = influence.bone[k];
            float weight = influence.weight[k];
            if (weight == 0) continue;
            if (glm::dot(lead, world[bone].rotation) < 0) weight = -weight;
            real += world[bone].rotation * weight;
            shift += dual[bone] * weight;
        }
        const float scale = 1 / glm::length(real);
        real *= scale;
        shift *= scale;
        const glm::quat move = shift * glm::conjugate(real) * 2.0f;
        posed[v] = real * rest[v] + glm::vec3(move.x, move.y, move.z);
    }
}

} // namespace nusselt::scenes
