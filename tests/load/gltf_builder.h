// Small glTF files for the tests, written into a folder of their own.
#pragma once

#include "tools/load/model.h"

#include <nlohmann/json.hpp>

#include <filesystem>
#include <initializer_list>
#include <string>
#include <vector>

namespace nusselt::load::test {

using json = nlohmann::json;
using Data = std::vector<uint8_t>;

constexpr int byte_type = 5120, ubyte_type = 5121, short_type = 5122, ushort_type = 5123, uint_type = 5125,
              float_type = 5126;

// A folder that goes with the test.
struct Folder {
    std::filesystem::path path;
    Folder();
    ~Folder();
    Folder(const Folder&) = delete;
    Folder& operator=(const Folder&) = delete;
    std::string write(const std::string& name, const Data& bytes) const;
    std::string write(const std::string& name, const std::string& text) const;
};

template<class Number>
Data bytes_of(std::initializer_list<Number> numbers) {
    const auto* data = reinterpret_cast<const uint8_t*>(numbers.begin());
    return Data(data, data + numbers.size() * sizeof(Number));
}

template<class Number>
Data bytes_of(const std::vector<Number>& numbers) {
    const auto* data = reinterpret_cast<const uint8_t*>(numbers.data());
    return Data(data, data + numbers.size() * sizeof(Number));
}

std::string base64(const Data& bytes);

// A document that grows; `root` may be edited freely. One buffer, a data URI.
struct Gltf {
    json root = {{"asset", {{"version", "2.0"}}}};
    Data buffer;

    int view(const Data& bytes, int stride = 0);
    int accessor(const Data& bytes, int component_type, const char* type, size_t count,
                 bool normalized = false);
    int floats(std::initializer_list<float> values, const char* type); // counts by itself
    // A right-angled triangle (0,0,0) (1,0,0) (0,1,0) as a mesh of its own; its number.
    int triangle();
    int node(const json& properties);
    // One channel of one new animation.
    void animate(int node, const char* path, const char* interpolation, std::initializer_list<float> times,
                 std::initializer_list<float> values, const char* type);
    json& primitive(int mesh = 0) { return root["meshes"][static_cast<size_t>(mesh)]["primitives"][0]; }
    std::string text();
    Data glb();
    LoadResult load();
};

int push(json& array, json value); // its index

// Position of a vertex of mesh `mesh` in the pose at `time`.
glm::vec3 position(const Model& model, int clip, double time, size_t mesh, size_t vertex);
glm::vec3 normal(const Model& model, int clip, double time, size_t mesh, size_t vertex);

// |a - b| at most `tolerance` in each coordinate.
bool near(const glm::vec3& a, const glm::vec3& b, float tolerance = 1e-5f);

} // namespace nusselt::load::test

namespace glm {
void PrintTo(const vec3& v, std::ostream* out); // for GoogleTest
}
