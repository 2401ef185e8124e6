#include "gltf_builder.h"

#include <cmath>
#include <fstream>
#include <ostream>
#include <unistd.h>

namespace nusselt::load::test {

Folder::Folder() {
    std::string pattern = (std::filesystem::temp_directory_path() / "nusselt-load-XXXXXX").string();
    path = mkdtemp(pattern.data());
}

Folder::~Folder() {
    std::error_code ignored;
    std::filesystem::remove_all(path, ignored);
}

std::string Folder::write(const std::string& name, const Data& bytes) const {
    const std::filesystem::path file = path / name;
    std::ofstream(file, std::ios::binary)
        .write(reinterpret_cast<const char*>(bytes.data()), static_cast<std::streamsize>(bytes.size()));
    return file.string();
}

std::string Folder::write(const std::string& name, const std::string& text) const {
    return write(name, Data(text.begin(), text.end()));
}

std::string base64(const Data& bytes) {
    static const char digits[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    std::string out;
    for (size_t i = 0; i < bytes.size(); i += 3) {
        const auto at = [&](size_t k) { return k < bytes.size() ? static_cast<uint32_t>(bytes[k]) : 0u; };
        const uint32_t bits = at(i) << 16 | at(i + 1) << 8 | at(i + 2);
        for (size_t k = 0; k < 4; ++k) {
            out += i + k <= bytes.size() ? digits[bits >> (18 - 6 * k) & 63] : '=';
        }
    }
    return out;
}

int push(json& array, json value) {
    array.push_back(std::move(value));
    return static_cast<int>(array.size()) - 1;
}

int Gltf::view(const Data& bytes, int stride) {
    while (buffer.size() % 4 != 0) {
        buffer.push_back(0);
    }
    json v = {{"buffer", 0}, {"byteOffset", buffer.size()}, {"byteLength", bytes.size()}};
    if (stride != 0) v["byteStride"] = stride;
    buffer.insert(buffer.end(), bytes.begin(), bytes.end());
    return push(root["bufferViews"], v);
}

int Gltf::accessor(const Data& bytes, int component_type, const char* type, size_t count, bool normalized) {
    json a = {
        {"bufferView", view(bytes)}, {"componentType", component_type}, {"type", type}, {"count", count}};
    if (normalized) a["normalized"] = true;
    return push(root["accessors"], a);
}

int Gltf::floats(std::initializer_list<float> values, const char* type) {
    const std::string name = type;
    const size_t width = name == "SCALAR" ? 1 : name == "VEC3" ? 3 : name == "VEC4" ? 4 : 16;
    return accessor(bytes_of(values), float_type, type, values.size() / width);
}

int Gltf::triangle() {
    const int positions = floats({0, 0, 0, 1, 0, 0, 0, 1, 0}, "VEC3");
    return push(root["meshes"], {{"primitives", {{{"attributes", {{"POSITION", positions}}}}}}});
}

int Gltf::node(const json& properties) {
    return push(root["nodes"], properties);
}

void Gltf::animate(int node, const char* path, const char* interpolation, std::initializer_list<float> times,
                   std::initializer_list<float> values, const char* type) {
    const int input = floats(times, "SCALAR");
    const int output = floats(values, type);
    push(root["animations"],
         {{"name", path},
          {"samplers", {{{"input", input}, {"output", output}, {"interpolation", interpolation}}}},
          {"channels", {{{"sampler", 0}, {"target", {{"node", node}, {"path", path}}}}}}});
}

std::string Gltf::text() {
    if (!buffer.empty()) {
        json whole = {{"byteLength", buffer.size()},
                      {"uri", "data:application/octet-stream;base64," + base64(buffer)}};
        if (root.contains("buffers")) {
            root["buffers"][0] = whole;
        } else {
            root["buffers"] = json::array({whole});
        }
    }
    return root.dump();
}

Data Gltf::glb() {
    root["buffers"] = json::array({{{"byteLength", buffer.size()}}});
    std::string document = root.dump();
    document.resize((document.size() + 3) / 4 * 4, ' ');
    Data chunk = buffer;
    chunk.resize((chunk.size() + 3) / 4 * 4, 0);
    Data out;
    const auto word = [&](size_t value) {
        for (int i = 0; i < 4; ++i) {
            out.push_back(static_cast<uint8_t>(value >> (8 * i)));
        }
    };
    word(0x46546C67);
    word(2);
    word(12 + 8 + document.size() + 8 + chunk.size());
    word(document.size());
    word(0x4E4F534A);
    out.insert(out.end(), document.begin(), document.end());
    word(chunk.size());
    word(0x004E4942);
    out.insert(out.end(), chunk.begin(), chunk.end());
    return out;
}

LoadResult Gltf::load() {
    const Folder folder;
    return load_model(folder.write("test.gltf", text()));
}

glm::vec3 position(const Model& model, int clip, double time, size_t mesh, size_t vertex) {
    scenes::Pose pose;
    make_scene(model, clip).pose(time, pose);
    return pose.positions.at(mesh).at(vertex);
}

glm::vec3 normal(const Model& model, int clip, double time, size_t mesh, size_t vertex) {
    scenes::Pose pose;
    make_scene(model, clip).pose(time, pose);
    return pose.normals.at(mesh).at(vertex);
}

bool near(const glm::vec3& a, const glm::vec3& b, float tolerance) {
    return std::abs(a.x - b.x) <= tolerance && std::abs(a.y - b.y) <= tolerance &&
           std::abs(a.z - b.z) <= tolerance;
}

} // namespace nusselt::load::test

namespace glm {
void PrintTo(const vec3& v, std::ostream* out) {
    *out << '(' << v.x << ", " << v.y << ", " << v.z << ')';
}
} // namespace glm
