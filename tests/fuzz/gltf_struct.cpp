#include "tests/fuzz/fuzz.h"
#include "tests/fuzz/model_checks.h"

#include <nlohmann/json.hpp>

#include <cmath>
#include <cstdlib>
#include <vector>

namespace nusselt::fuzz {

namespace {

using json = nlohmann::json;

std::string base64(const std::vector<uint8_t>& bytes) {
    static const char digits[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    std::string out;
    for (size_t i = 0; i + 2 < bytes.size(); i += 3) {
        const uint32_t bits = uint32_t(bytes[i]) << 16 | uint32_t(bytes[i + 1]) << 8 | bytes[i + 2];
        for (uint32_t k = 0; k < 4; ++k)
            out += digits[bits >> (18 - 6 * k) & 63];
    }
    return out;
}

struct Builder {
    json root = {{"asset", {{"version", "2.0"}}}};
    std::vector<uint8_t> buffer;

    template<class T>
    int accessor(const std::vector<T>& values, int component, const char* type, size_t count) {
        while (buffer.size() % 4 != 0)
            buffer.push_back(0);
        const auto* bytes = reinterpret_cast<const uint8_t*>(values.data());
        const size_t offset = buffer.size();
        buffer.insert(buffer.end(), bytes, bytes + values.size() * sizeof(T));
        json& views = root["bufferViews"];
        views.push_back({{"buffer", 0}, {"byteOffset", offset}, {"byteLength", values.size() * sizeof(T)}});
        json& all = root["accessors"];
        all.push_back({{"bufferView", views.size() - 1},
                       {"componentType", component},
                       {"count", count},
                       {"type", type}});
        return int(all.size()) - 1;
    }
};

// A strip of quads with a skin, a morph target, a sparse accessor and two clips, as the input asks for.
Builder scene(Bytes& in) {
    Builder b;
    const uint32_t quads = 1 + in.below(6), vertices = 2 * (quads + 1);
    std::vector<float> positions, normals, deltas;
    for (uint32_t v = 0; v < vertices; ++v) {
        for (const float c : {float(v / 2), float(v % 2), in.small_float()})
            positions.push_back(c);
        for (const float c : {0.0f, 0.0f, 1.0f})
            normals.push_back(c);
        for (int k = 0; k < 3; ++k)
            deltas.push_back(in.small_float());
    }
    std::vector<uint16_t> indices;
    for (uint32_t q = 0; q < quads; ++q) {
        for (const uint32_t i : {0u, 2u, 3u, 0u, 3u, 1u})
            indices.push_back(uint16_t(2 * q + i));
    }
    const uint8_t parts = in.byte();
    json primitive = {{"attributes", {{"POSITION", b.accessor(positions, 5126, "VEC3", vertices)}}},
                      {"indices", b.accessor(indices, 5123, "SCALAR", indices.size())}};
    if (parts & 1) primitive["attributes"]["NORMAL"] = b.accessor(normals, 5126, "VEC3", vertices);
    if (parts & 2) primitive["targets"] = {{{"POSITION", b.accessor(deltas, 5126, "VEC3", vertices)}}};
    b.root["nodes"] = {{{"mesh", 0}}, {{"translation", {0, 1, 0}}}, {{"children", {1}}}};
    b.root["scenes"] = {{{"nodes", {0, 2}}}};
    b.root["scene"] = 0;
    if (parts & 4) {
        std::vector<uint8_t> joints;
        std::vector<float> weights;
        for (uint32_t v = 0; v < vertices; ++v) {
            for (uint32_t k = 0; k < 4; ++k) {
                joints.push_back(uint8_t(k % 2));
                weights.push_back(k < 2 ? 0.5f : 0.0f);
            }
        }
        primitive["attributes"]["JOINTS_0"] = b.accessor(joints, 5121, "VEC4", vertices);
        primitive["attributes"]["WEIGHTS_0"] = b.accessor(weights, 5126, "VEC4", vertices);
        std::vector<float> inverse(32);
        for (size_t i = 0; i < 32; i += 5)
            inverse[i == 20 ? 21 : i > 15 ? i + 1 : i] = 1;
        b.root["skins"] = {
            {{"joints", {2, 1}}, {"inverseBindMatrices", b.accessor(inverse, 5126, "MAT4", 2)}}};
        b.root["nodes"][0]["skin"] = 0;
    }
    b.root["meshes"] = {{{"primitives", {primitive}}}};
    if (parts & 8) {
        const int times = b.accessor(std::vector<float>{0, 1}, 5126, "SCALAR", 2);
        const int values =
            b.accessor(std::vector<float>{0, 0, 0, 1, 0, 0.7071068f, 0, 0.7071068f}, 5126, "VEC4", 2);
        b.root["animations"] = {
            {{"channels", {{{"sampler", 0}, {"target", {{"node", 1}, {"path", "rotation"}}}}}},
             {"samplers", {{{"input", times}, {"output", values}}}}}};
    }
    if (parts & 16) {
        const int at = b.accessor(std::vector<uint16_t>{0, 2}, 5123, "SCALAR", 2);
        const int to = b.accessor(std::vector<float>{0, 0, 1, 1, 0, 1}, 5126, "VEC3", 2);
        const json& accessors = b.root["accessors"];
        b.root["accessors"][0]["sparse"] = {
            {"count", 2},
            {"indices", {{"bufferView", accessors[size_t(at)]["bufferView"]}, {"componentType", 5123}}},
            {"values", {{"bufferView", accessors[size_t(to)]["bufferView"]}}}};
    }
    while (b.buffer.size() % 12 != 0)
        b.buffer.push_back(0);
    return b;
}

// The values in a document, in order.
void collect(json& value, std::vector<json*>& all) {
    if (value.is_structured()) {
        for (json& child : value)
            collect(child, all);
    }
    all.push_back(&value);
}

void break_value(json& value, Bytes& in) {
    static const double odd[] = {-1,
                                 0,
                                 1,
                                 2,
                                 3,
                                 4,
                                 5,
                                 8,
                                 12,
                                 16,
                                 255,
                                 256,
                                 4093,
                                 65535,
                                 65536,
                                 2147483647,
                                 2147483648.0,
                                 4294967295.0,
                                 4294967296.0,
                                 1e18,
                                 4611686018427387904.0,
                                 9223372036854775808.0,
                                 18446744073709551616.0,
                                 0.5,
                                 -0.5,
                                 1e38,
                                 1e300};
    switch (in.below(10)) {
    case 0:
        value = odd[in.below(uint32_t(std::size(odd)))];
        break;
    case 1:
        value = int64_t(odd[in.below(20)]);
        break;
    case 2:
        value = value.is_number_integer() ? json(value.get<int64_t>() + int8_t(in.byte())) : json(in.byte());
        break;
    case 3:
        value = nullptr;
        break;
    case 4:
        value = json::array();
        break;
    case 5:
        value = json::object();
        break;
    case 6:
        value = std::string(in.below(40), char(in.byte()));
        break;
    case 7:
        if (value.is_array() && !value.empty()) {
            value.push_back(value[in.below(uint32_t(value.size()))]);
        } else {
            value = in.byte();
        }
        break;
    case 8:
        if (value.is_structured() && !value.empty()) {
            auto at = value.begin();
            std::advance(at, in.below(uint32_t(value.size())));
            value.erase(at);
        } else {
            value = true;
        }
        break;
    default:
        value = in.word();
        break;
    }
}

#if defined(NUSSELT_PLANT)
// An accessor's range checked in 32 bits, as many a loader has done.
void walk_carelessly(const json& root, const std::vector<uint8_t>& buffer) {
    try {
        const auto count = uint32_t(root.at("accessors").at(0).at("count").get<uint64_t>());
        if (count * 12u > buffer.size() || count == 0) return;
        volatile uint8_t last = buffer.data()[(uint64_t(count) - 1) * 12 + 11];
        (void)last;
    } catch (const json::exception&) {
        return;
    }
}
#endif

} // namespace

int gltf_struct(const uint8_t* data, size_t size) {
    Bytes in{data, size};
    Builder b = scene(in);
    b.root["buffers"] = {{{"byteLength", b.buffer.size()}}};
    for (uint32_t breaks = in.below(6); breaks > 0; --breaks) {
        std::vector<json*> all;
        collect(b.root, all);
        break_value(*all[in.below(uint32_t(all.size()))], in);
    }
    for (uint32_t bytes = in.below(4); bytes > 0 && !b.buffer.empty(); --bytes)
        b.buffer[in.below(uint32_t(b.buffer.size()))] = in.byte();
#if defined(NUSSELT_PLANT)
    walk_carelessly(b.root, b.buffer);
#endif
    if (b.root.is_object() && b.root["buffers"].is_array() && !b.root["buffers"].empty() &&
        b.root["buffers"][0].is_object())
        b.root["buffers"][0]["uri"] = "data:application/octet-stream;base64," + base64(b.buffer);
    const std::string text = b.root.dump(-1, ' ', false, json::error_handler_t::replace);
    load_gltf(reinterpret_cast<const uint8_t*>(text.data()), text.size());
    return 0;
}

} // namespace nusselt::fuzz
