#include "tests/fuzz/model_checks.h"

#include "tests/fuzz/fuzz.h"
#include "tools/load/formats.h"

#include <algorithm>
#include <cmath>

namespace nusselt::fuzz {

load::LoadLimits small_limits() {
    load::LoadLimits limits;
    limits.json_bytes = 1 << 20;
    limits.json_tokens = 1 << 16;
    limits.data_uri_bytes = 1 << 20;
    limits.buffer_bytes = 4 << 20;
    limits.elements = 4096;
    limits.vertices = 1 << 16;
    limits.triangles = 1 << 16;
    limits.joints = 1024;
    return limits;
}

namespace {

void check_printable(const std::string& text, size_t longest) {
    expect(text.size() <= longest, "a message is short");
    for (const char c : text)
        expect(c >= 0x20 && c < 0x7F, "a message is printable ASCII on one line");
}

} // namespace

void check_error(const load::LoadError& error) {
    expect(!error.code.empty() && !error.what.empty() && !error.cure.empty(),
           "an error says what and what to do");
    for (const char c : error.code)
        expect((c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '_', "a code is upper case");
    check_printable(load::describe("model.gltf", error), 1000);
}

void check_model(const load::Model& model) {
    expect(!model.meshes.empty(), "a model draws something");
    for (const scenes::Mesh& mesh : model.meshes) {
        expect(mesh.indices.size() % 3 == 0 && !mesh.indices.empty(), "three indices a triangle");
        expect(mesh.rest_normals.size() == mesh.rest_positions.size(), "as many normals as positions");
        expect(mesh.albedo.size() == mesh.rest_positions.size(), "as many colours as positions");
        for (const uint32_t i : mesh.indices)
            expect(i < mesh.rest_positions.size(), "an index is below the number of vertices");
        for (const glm::vec3& p : mesh.rest_positions)
            expect(std::isfinite(p.x) && std::isfinite(p.y) && std::isfinite(p.z), "a position is finite");
    }
    for (const std::string& warning : model.warnings)
        check_printable(warning, 1000);
    const int clips = std::min<int>(int(model.clips.size()), 4);
    for (int clip = -1; clip < clips; ++clip) {
        const scenes::Scene scene = load::make_scene(model, clip);
        expect(scene.duration >= 0, "a clip's length is not negative");
        for (const double part : {0.0, 0.37, 1.0}) {
            scenes::Pose pose;
            scene.pose(part * scene.duration, pose);
            expect(pose.positions.size() == model.meshes.size(), "a pose has all meshes");
            for (size_t m = 0; m < pose.positions.size(); ++m) {
                expect(pose.positions[m].size() == model.meshes[m].rest_positions.size() &&
                           pose.normals[m].size() == pose.positions[m].size(),
                       "a pose has all vertices");
            }
        }
    }
}

void load_gltf(const uint8_t* data, size_t size) {
    try {
        // In a folder that does not exist: nothing that it names can be read.
        check_model(
            load::read_gltf("/nonexistent/model.gltf", load::Bytes(data, data + size), small_limits()));
    } catch (const load::LoadError& error) {
        check_error(error);
    }
}

} // namespace nusselt::fuzz
