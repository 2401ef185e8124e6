#include "tools/commands/further.h"

#include "tools/commands/arguments.h"
#include "tools/commands/choice.h"
#include "tools/report/failure.h"
#include "tools/trace/assembly.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <functional>
#include <iterator>
#include <utility>

namespace nusselt::tools {

namespace {

glm::vec3 parse_place(const std::string& text) {
    const std::vector<std::string> parts = split_at_colons(text);
    glm::vec3 place(NAN);
    for (size_t k = 0; k < parts.size() && parts.size() == 3; ++k) {
        char* end = nullptr;
        place[static_cast<int>(k)] = std::strtof(parts[k].c_str(), &end);
        if (parts[k].empty() || *end) place.x = NAN;
    }
    constexpr float most = 1e6f;
    // What is not a number is not within it either.
    if (!(std::fabs(place.x) <= most && std::fabs(place.y) <= most && std::fabs(place.z) <= most))
        throw Failure("--at", "'" + text + "' is no place; write X:Y:Z like 1.5:0:-2, up to 1e6", exit_usage);
    return place;
}

Bounds bounds_at(const scenes::Scene& scene, double time) {
    scenes::Pose pose;
    scene.pose(time, pose);
    Bounds bounds;
    for (const std::vector<glm::vec3>& positions : pose.positions)
        grow(bounds, positions);
    return bounds;
}

// A row's places: floors and middles as the first one's.
std::vector<glm::vec3> in_a_row(const std::vector<Bounds>& all) {
    float widest = 0;
    for (const Bounds& b : all)
        widest = std::max(widest, b.high.x - b.low.x);
    std::vector<glm::vec3> places{glm::vec3(0)};
    float end = all[0].high.x;
    for (size_t k = 1; k < all.size(); ++k) {
        const glm::vec3 place(end + 0.1f * widest - all[k].low.x, all[0].low.y - all[k].low.y,
                              0.5f * (all[0].low.z + all[0].high.z - all[k].low.z - all[k].high.z));
        end = all[k].high.x + place.x;
        places.push_back(place);
    }
    return places;
}

void append(scenes::Pose&& from, scenes::Pose& to) {
    for (auto& positions : from.positions)
        to.positions.push_back(std::move(positions));
    for (auto& normals : from.normals)
        to.normals.push_back(std::move(normals));
}

} // namespace

void check_places(const FurtherModels& further) {
    for (const std::string& place : further.places)
        (void)parse_place(place);
    if (further.places.empty() || further.places.size() == further.paths.size()) return;
    throw Failure("--at",
                  "there are " + std::to_string(further.places.size()) + " places for " +
                      std::to_string(further.paths.size()) +
                      " models of --with; give one each, or none for a row",
                  exit_usage);
}

std::vector<uint32_t> add_models(scenes::Scene& scene, const FurtherModels& further, bool moving,
                                 double time) {
    std::vector<uint32_t> objects(scene.meshes.size(), 0);
    std::vector<std::function<void(double, scenes::Pose&)>> poses{scene.pose};
    std::vector<Bounds> bounds{bounds_at(scene, time)};
    for (const std::string& path : further.paths) {
        scenes::Scene other = choose(path, "", moving).scene;
        bounds.push_back(bounds_at(other, time));
        objects.insert(objects.end(), other.meshes.size(), static_cast<uint32_t>(poses.size()));
        std::move(other.meshes.begin(), other.meshes.end(), std::back_inserter(scene.meshes));
        poses.push_back(std::move(other.pose));
    }
    std::vector<glm::vec3> places = in_a_row(bounds);
    for (size_t k = 0; k < further.places.size(); ++k)
        places[k + 1] = parse_place(further.places[k]);
    scene.pose = [poses = std::move(poses), places = std::move(places)](double at, scenes::Pose& out) {
        out.positions.clear();
        out.normals.clear();
        for (size_t k = 0; k < poses.size(); ++k) {
            scenes::Pose own;
            poses[k](at, own);
            for (std::vector<glm::vec3>& positions : own.positions) {
                for (glm::vec3& p : positions)
                    p += places[k];
            }
            append(std::move(own), out);
        }
    };
    return objects;
}

} // namespace nusselt::tools
