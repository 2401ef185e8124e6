#include "nusselt/nusselt.h"
#include "tests/fuzz/fuzz.h"
#include "tests/fuzz/model_checks.h"
#include "tools/load/formats.h"
#include "tools/report/base64.h"

#include <nlohmann/json.hpp>

#include <cmath>
#include <vector>

namespace nusselt::fuzz {

namespace {

using json = nlohmann::json;

constexpr uint32_t vertices = 6;

// A frame of one mesh in a pose, whatever the pose.
void light(Context* context, const scenes::Mesh& mesh, const std::vector<glm::vec3>& positions,
           const std::vector<glm::vec3>& normals) {
    MeshId id;
    const size_t count = positions.size();
    expect(add_mesh(context,
                    {{&mesh.rest_positions[0].x, count, sizeof(glm::vec3)},
                     {},
                     mesh.indices.data(),
                     mesh.indices.size()},
                    &id)
               .ok(),
           "a mesh that was loaded is added");
    std::vector<float> transfer(25 * count);
    const FrameMesh use{id,
                        {&positions[0].x, count, sizeof(glm::vec3)},
                        {&normals[0].x, count, sizeof(glm::vec3)},
                        {transfer.data(), count, 100},
                        {}};
    FrameId frame;
    expect(submit(context, {&use, 1, Quality::draft}, &frame).ok(), "a pose is submitted");
    expect(wait(context, frame, nullptr).ok(), "a pose is waited for");
    for (size_t v = 0; v < count; ++v) {
        const glm::vec3& p = positions[v];
        const bool finite = std::isfinite(p.x) && std::isfinite(p.y) && std::isfinite(p.z);
        for (size_t i = 0; i < 25; ++i) {
            const float t = transfer[25 * v + i];
            expect(std::isfinite(t), "transfer is finite");
            expect(finite || t == 0, "a vertex that went nowhere has none");
        }
    }
    expect(remove_mesh(context, id).ok(), "a mesh is removed");
}

} // namespace

// A strip with weights, joints, inverse binds and transforms of any bits: refused, or posed and lit.
int skin(const uint8_t* data, size_t size) {
    static Context* const context = [] {
        Context* made = nullptr;
        expect(create_context({}, &made).ok(), "a context is made");
        return made;
    }();
    Bytes in{data, size};
    const uint8_t kind = in.byte();
    std::string buffer;
    json root = {{"asset", {{"version", "2.0"}}}, {"scene", 0}};
    const auto accessor = [&](const void* values, size_t bytes, int component, const char* type,
                              size_t count) {
        buffer.resize((buffer.size() + 3) / 4 * 4);
        json& views = root["bufferViews"];
        views.push_back({{"buffer", 0}, {"byteOffset", buffer.size()}, {"byteLength", bytes}});
        buffer.append(static_cast<const char*>(values), bytes);
        root["accessors"].push_back({{"bufferView", views.size() - 1},
                                     {"componentType", component},
                                     {"count", count},
                                     {"type", type}});
        return root["accessors"].size() - 1;
    };
    float positions[3 * vertices], weights[4 * vertices], inverse[32];
    uint8_t joints[4 * vertices];
    const uint16_t indices[12] = {0, 1, 2, 1, 3, 2, 2, 3, 4, 3, 5, 4};
    for (uint32_t v = 0; v < vertices; ++v) {
        positions[3 * v] = float(v / 2);
        positions[3 * v + 1] = float(v % 2);
        positions[3 * v + 2] = in.small_float();
    }
    for (uint32_t i = 0; i < 4 * vertices; ++i) {
        weights[i] = kind & 1 ? in.raw_float() : i % 4 < 2 ? in.small_float() : 0;
        joints[i] = uint8_t(kind & 2 ? in.byte() : in.byte() % 2);
    }
    for (uint32_t i = 0; i < 32; ++i)
        inverse[i] = kind & 4 ? in.raw_float() : i % 16 % 5 == 0 ? 1 : kind & 8 ? in.small_float() : 0;
    const auto vector = [&](int count, double otherwise) {
        json values = json::array();
        for (int i = 0; i < count; ++i) {
            const float value = kind & 16 ? in.raw_float() : in.small_float();
            values.push_back(std::isfinite(value) ? double(value) : otherwise);
        }
        return values;
    };
    root["nodes"] = {
        {{"mesh", 0}, {"skin", 0}},
        {{"children", {2}}, {"scale", vector(3, 0)}},
        {{"translation", vector(3, 1)}, {"rotation", kind & 32 ? vector(4, 0) : json{0, 0, 0, 1}}}};
    root["scenes"] = {{{"nodes", {0, 1}}}};
    root["skins"] = {
        {{"joints", {1, 2}}, {"inverseBindMatrices", accessor(inverse, sizeof(inverse), 5126, "MAT4", 2)}}};
    root["meshes"] = {{{"primitives",
                        {{{"attributes",
                           {{"POSITION", accessor(positions, sizeof(positions), 5126, "VEC3", vertices)},
                            {"JOINTS_0", accessor(joints, sizeof(joints), 5121, "VEC4", vertices)},
                            {"WEIGHTS_0", accessor(weights, sizeof(weights), 5126, "VEC4", vertices)}}},
                          {"indices", accessor(indices, sizeof(indices), 5123, "SCALAR", 12)}}}}}};
    root["buffers"] = {{{"byteLength", buffer.size()},
                        {"uri", "data:application/octet-stream;base64," + tools::base64(buffer)}}};
#if defined(NUSSELT_PLANT)
    // A joint's number one too large.
    const std::vector<float> matrices(2 * 16);
    for (uint32_t i = 0; i < 4 * vertices; ++i) {
        if (joints[i] > 2 || !(weights[i] > 0)) continue;
        volatile float x = matrices.data()[16 * joints[i]];
        (void)x;
    }
#endif
    const std::string text = root.dump();
    try {
        const load::Model model =
            load::read_gltf("/nonexistent/model.gltf", load::Bytes(text.begin(), text.end()), small_limits());
        check_model(model);
        scenes::Pose pose;
        const scenes::Scene scene = load::make_scene(model, -1);
        scene.pose(0, pose);
        for (size_t m = 0; m < model.meshes.size(); ++m)
            light(context, model.meshes[m], pose.positions[m], pose.normals[m]);
    } catch (const load::LoadError& error) {
        check_error(error);
    }
    return 0;
}

} // namespace nusselt::fuzz
