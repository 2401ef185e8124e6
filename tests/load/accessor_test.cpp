// Every way in which a glTF file may store its numbers, and every way in which the ranges may be wrong.
#include "gltf_builder.h"

#include <meshoptimizer.h>

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

namespace nusselt::load::test {
namespace {

std::string code(Gltf& gltf) {
    const LoadResult r = gltf.load();
    return r.ok ? "ok" : r.error.code;
}

TEST(Accessors, Sparse) {
    Gltf gltf;
    const int mesh = gltf.triangle();
    gltf.node({{"mesh", mesh}});
    const int indices = gltf.view(bytes_of<uint16_t>({0, 2}));
    const int values = gltf.view(bytes_of<float>({7, 8, 9, 1, 2, 3}));
    json& accessor = gltf.root["accessors"][0];
    accessor["sparse"] = {{"count", 2},
                          {"indices", {{"bufferView", indices}, {"componentType", ushort_type}}},
                          {"values", {{"bufferView", values}}}};
    LoadResult r = gltf.load();
    ASSERT_TRUE(r.ok) << r.error.what;
    EXPECT_EQ(r.model.meshes[0].rest_positions, (std::vector<glm::vec3>{{7, 8, 9}, {1, 0, 0}, {1, 2, 3}}));
    accessor.erase("bufferView"); // then the rest is zeros
    r = gltf.load();
    ASSERT_TRUE(r.ok) << r.error.what;
    EXPECT_EQ(r.model.meshes[0].rest_positions, (std::vector<glm::vec3>{{7, 8, 9}, {0, 0, 0}, {1, 2, 3}}));
    accessor["sparse"]["count"] = 4;
    EXPECT_EQ(code(gltf), "SPARSE_COUNT");
    accessor["sparse"]["count"] = 3;
    EXPECT_EQ(code(gltf), "ACCESSOR_TOO_LONG");
    accessor["sparse"]["count"] = 2;
    accessor["sparse"]["indices"]["bufferView"] = gltf.view(bytes_of<uint16_t>({2, 0}));
    EXPECT_EQ(code(gltf), "SPARSE_INDICES");
    accessor["sparse"]["indices"]["bufferView"] = gltf.view(bytes_of<uint16_t>({0, 3}));
    EXPECT_EQ(code(gltf), "SPARSE_INDICES");
}

TEST(Accessors, SparseIndicesWithoutView) {
    Gltf gltf;
    gltf.node({{"mesh", gltf.triangle()}});
    const int at = gltf.view(bytes_of<uint8_t>({1, 2}));
    const int values = gltf.view(bytes_of<uint16_t>({1, 2}));
    gltf.primitive()["indices"] =
        push(gltf.root["accessors"], {{"componentType", ushort_type},
                                      {"type", "SCALAR"},
                                      {"count", 3},
                                      {"sparse",
                                       {{"count", 2},
                                        {"indices", {{"bufferView", at}, {"componentType", ubyte_type}}},
                                        {"values", {{"bufferView", values}}}}}});
    const LoadResult r = gltf.load();
    ASSERT_TRUE(r.ok) << r.error.what;
    EXPECT_EQ(r.model.meshes[0].indices, (std::vector<uint32_t>{0, 1, 2}));
}

TEST(Accessors, StridedAndOffset) {
    Gltf gltf;
    // Position and normal in one record of 28 bytes, 4 of them unused.
    std::vector<float> records;
    for (int v = 0; v < 3; ++v) {
        const auto f = static_cast<float>(v);
        records.insert(records.end(), {f, 2 * f * f, 3, -77, 0, 0, 1});
    }
    records.resize(records.size()); // the last record is whole
    const int view = gltf.view(bytes_of(records), 28);
    const auto accessor = [&](int offset) {
        return push(gltf.root["accessors"], {{"bufferView", view},
                                             {"byteOffset", offset},
                                             {"componentType", float_type},
                                             {"type", "VEC3"},
                                             {"count", 3}});
    };
    const int positions = accessor(0), normals = accessor(16);
    push(gltf.root["meshes"],
         {{"primitives", {{{"attributes", {{"POSITION", positions}, {"NORMAL", normals}}}}}}});
    gltf.node({{"mesh", 0}});
    const LoadResult r = gltf.load();
    ASSERT_TRUE(r.ok) << r.error.what;
    EXPECT_EQ(r.model.meshes[0].rest_positions, (std::vector<glm::vec3>{{0, 0, 3}, {1, 2, 3}, {2, 8, 3}}));
    EXPECT_EQ(r.model.meshes[0].rest_normals[2], glm::vec3(0, 0, 1));
    gltf.root["accessors"][1]["byteOffset"] = 20; // the last element would end 4 bytes behind
    EXPECT_EQ(code(gltf), "ACCESSOR_TOO_LONG");
    gltf.root["bufferViews"][0]["byteStride"] = 8;
    EXPECT_EQ(code(gltf), "ACCESSOR_SMALL_BYTESTRIDE");
    gltf.root["bufferViews"][0]["byteStride"] = 30;
    EXPECT_EQ(code(gltf), "VALUE_NOT_IN_RANGE");
}

TEST(Accessors, Quantized) {
    Gltf gltf;
    gltf.root["extensionsUsed"] = gltf.root["extensionsRequired"] = {"KHR_mesh_quantization"};
    // Rows of 8 bytes: three shorts and padding.
    const int view = gltf.view(bytes_of<int16_t>({0, 0, 0, 0, 32767, -32768, 0, 0, 0, 16384, 5, 0}), 8);
    const int normals = gltf.view(bytes_of<int8_t>({0, 0, 127, 0, 0, 0, 127, 0, 0, -128, 0, 0}), 4);
    const auto accessor = [&](int of, int type, bool normalized) {
        return push(gltf.root["accessors"], {{"bufferView", of},
                                             {"componentType", type},
                                             {"type", "VEC3"},
                                             {"count", 3},
                                             {"normalized", normalized}});
    };
    const int positions = accessor(view, short_type, true);
    push(gltf.root["meshes"],
         {{"primitives",
           {{{"attributes", {{"POSITION", positions}, {"NORMAL", accessor(normals, byte_type, true)}}}}}}});
    gltf.node({{"mesh", 0}, {"scale", {4, 4, 4}}});
    LoadResult r = gltf.load();
    ASSERT_TRUE(r.ok) << r.error.what;
    EXPECT_TRUE(near(position(r.model, -1, 0, 0, 1), {4, -4, 0}));
    EXPECT_TRUE(near(position(r.model, -1, 0, 0, 2), {0, 4 * 16384 / 32767.0f, 4 * 5 / 32767.0f}));
    EXPECT_EQ(r.model.meshes[0].rest_normals[2], glm::vec3(0, -1, 0));
    EXPECT_TRUE(r.model.warnings.empty());
    gltf.root["accessors"][0]["normalized"] = false;
    r = gltf.load();
    ASSERT_TRUE(r.ok) << r.error.what;
    EXPECT_EQ(position(r.model, -1, 0, 0, 1), glm::vec3(4 * 32767.0f, 4 * -32768.0f, 0));
    gltf.root["accessors"][0]["componentType"] = ushort_type;
    r = gltf.load();
    ASSERT_TRUE(r.ok) << r.error.what;
    EXPECT_EQ(position(r.model, -1, 0, 0, 1), glm::vec3(4 * 32767.0f, 4 * 32768.0f, 0));
}

// A grid of n by n squares: positions, and indices in list order.
struct Grid {
    std::vector<float> positions;
    std::vector<uint32_t> indices;
};

Grid grid(uint32_t n) {
    Grid out;
    for (uint32_t y = 0; y <= n; ++y) {
        for (uint32_t x = 0; x <= n; ++x) {
            out.positions.insert(out.positions.end(), {static_cast<float>(x), static_cast<float>(y),
                                                       0.25f * static_cast<float>(x % 3)});
        }
    }
    for (uint32_t y = 0; y < n; ++y) {
        for (uint32_t x = 0; x < n; ++x) {
            const uint32_t a = y * (n + 1) + x, b = a + 1, c = a + n + 1, d = c + 1;
            out.indices.insert(out.indices.end(), {a, b, d, a, d, c});
        }
    }
    return out;
}

// A compressed view; its plain copy is in a buffer without data.
int compressed(Gltf& gltf, const Data& bytes, size_t stride, size_t count, const char* mode,
               const char* filter) {
    const int source = gltf.view(bytes);
    json& view = gltf.root["bufferViews"][static_cast<size_t>(source)];
    json extension = {{"buffer", 0},
                      {"byteOffset", view["byteOffset"]},
                      {"byteLength", bytes.size()},
                      {"byteStride", stride},
                      {"count", count},
                      {"mode", mode},
                      {"filter", filter}};
    view["buffer"] = 1;
    view["byteOffset"] = 0;
    view["byteLength"] = stride * count;
    if (std::string(mode) == "ATTRIBUTES") view["byteStride"] = stride;
    view["extensions"]["EXT_meshopt_compression"] = extension;
    gltf.root["buffers"] = json::array(
        {json(),
         {{"byteLength", 1 << 20}, {"extensions", {{"EXT_meshopt_compression", {{"fallback", true}}}}}}});
    gltf.root["extensionsUsed"] =
        gltf.root["extensionsRequired"] = {"EXT_meshopt_compression", "KHR_mesh_quantization"};
    return source;
}

Data encode_vertices(const Data& raw, size_t count, size_t stride) {
    Data out(meshopt_encodeVertexBufferBound(count, stride));
    out.resize(meshopt_encodeVertexBuffer(out.data(), out.size(), raw.data(), count, stride));
    return out;
}

TEST(Accessors, MeshoptVerticesAndTriangles) {
    const Grid g = grid(20);
    const size_t vertices = g.positions.size() / 3;
    Gltf gltf;
    const int positions = compressed(gltf, encode_vertices(bytes_of(g.positions), vertices, 12), 12, vertices,
                                     "ATTRIBUTES", "NONE");
    Data encoded(meshopt_encodeIndexBufferBound(g.indices.size(), vertices));
    encoded.resize(
        meshopt_encodeIndexBuffer(encoded.data(), encoded.size(), g.indices.data(), g.indices.size()));
    const int indices = compressed(gltf, encoded, 2, g.indices.size(), "TRIANGLES", "NONE");
    push(gltf.root["accessors"],
         {{"bufferView", positions}, {"componentType", float_type}, {"type", "VEC3"}, {"count", vertices}});
    push(gltf.root["accessors"], {{"bufferView", indices},
                                  {"componentType", ushort_type},
                                  {"type", "SCALAR"},
                                  {"count", g.indices.size()}});
    push(gltf.root["meshes"], {{"primitives", {{{"attributes", {{"POSITION", 0}}}, {"indices", 1}}}}});
    gltf.node({{"mesh", 0}});
    const LoadResult r = gltf.load();
    ASSERT_TRUE(r.ok) << r.error.what;
    ASSERT_EQ(r.model.meshes[0].rest_positions.size(), vertices);
    for (size_t v = 0; v < vertices; ++v) {
        EXPECT_EQ(r.model.meshes[0].rest_positions[v],
                  glm::vec3(g.positions[3 * v], g.positions[3 * v + 1], g.positions[3 * v + 2]));
    }
    // The codec may turn a triangle's corners round, never over.
    ASSERT_EQ(r.model.meshes[0].indices.size(), g.indices.size());
    for (size_t t = 0; t < g.indices.size(); t += 3) {
        const uint32_t* want = g.indices.data() + t;
        const uint32_t* got = r.model.meshes[0].indices.data() + t;
        bool same = false;
        for (size_t k = 0; k < 3; ++k) {
            same = same || (got[0] == want[k] && got[1] == want[(k + 1) % 3] && got[2] == want[(k + 2) % 3]);
        }
        EXPECT_TRUE(same) << t;
    }
    for (const uint64_t count : {uint64_t{3} << 29, uint64_t{3} * 1000000}) {
        Gltf bomb = gltf;
        bomb.root["bufferViews"][1]["extensions"]["EXT_meshopt_compression"]["count"] = count;
        EXPECT_EQ(code(bomb), count > 1u << 30 ? "LIMIT_BUFFERS" : "MESHOPT");
    }
    gltf.buffer[gltf.root["bufferViews"][0]["extensions"]["EXT_meshopt_compression"]["byteOffset"]
                    .get<size_t>()] = 0;
    EXPECT_EQ(code(gltf), "MESHOPT"); // the codec's own mark is gone
}

TEST(Accessors, MeshoptSequenceAndFilters) {
    const Grid g = grid(4);
    const size_t vertices = g.positions.size() / 3;
    Gltf gltf;
    Data encoded(meshopt_encodeIndexSequenceBound(g.indices.size(), vertices));
    encoded.resize(
        meshopt_encodeIndexSequence(encoded.data(), encoded.size(), g.indices.data(), g.indices.size()));
    const int indices = compressed(gltf, encoded, 4, g.indices.size(), "INDICES", "NONE");
    // Positions by the exponential filter, 24 bits: exact for these.
    Data raw(vertices * 12);
    meshopt_encodeFilterExp(raw.data(), vertices, 12, 24, g.positions.data());
    const int positions =
        compressed(gltf, encode_vertices(raw, vertices, 12), 12, vertices, "ATTRIBUTES", "EXPONENTIAL");
    // Normals by the octahedral filter in bytes.
    const float normal_of[3] = {0.6f, 0.0f, -0.8f};
    std::vector<float> wide;
    for (size_t v = 0; v < vertices; ++v) {
        wide.insert(wide.end(), {normal_of[0], normal_of[1], normal_of[2], 0});
    }
    Data octahedral(vertices * 4);
    meshopt_encodeFilterOct(octahedral.data(), vertices, 4, 8, wide.data());
    const int normals =
        compressed(gltf, encode_vertices(octahedral, vertices, 4), 4, vertices, "ATTRIBUTES", "OCTAHEDRAL");
    push(gltf.root["accessors"],
         {{"bufferView", positions}, {"componentType", float_type}, {"type", "VEC3"}, {"count", vertices}});
    push(gltf.root["accessors"], {{"bufferView", indices},
                                  {"componentType", uint_type},
                                  {"type", "SCALAR"},
                                  {"count", g.indices.size()}});
    push(gltf.root["accessors"], {{"bufferView", normals},
                                  {"componentType", byte_type},
                                  {"type", "VEC3"},
                                  {"count", vertices},
                                  {"normalized", true}});
    push(gltf.root["meshes"],
         {{"primitives", {{{"attributes", {{"POSITION", 0}, {"NORMAL", 2}}}, {"indices", 1}}}}});
    gltf.node({{"mesh", 0}});
    // A turn by the quaternion filter: 90 degrees about z.
    const float s = std::sqrt(0.5f);
    const std::vector<float> turn = {0, 0, 0, 1, 0, 0, s, s};
    Data packed(16);
    meshopt_encodeFilterQuat(packed.data(), 2, 8, 16, turn.data());
    const int rotations = compressed(gltf, encode_vertices(packed, 2, 8), 8, 2, "ATTRIBUTES", "QUATERNION");
    const int output = push(gltf.root["accessors"], {{"bufferView", rotations},
                                                     {"componentType", short_type},
                                                     {"type", "VEC4"},
                                                     {"count", 2},
                                                     {"normalized", true}});
    const int input = gltf.floats({0, 1}, "SCALAR");
    push(gltf.root["animations"],
         {{"samplers", {{{"input", input}, {"output", output}}}},
          {"channels", {{{"sampler", 0}, {"target", {{"node", 0}, {"path", "rotation"}}}}}}});
    const LoadResult r = gltf.load();
    ASSERT_TRUE(r.ok) << r.error.what;
    EXPECT_EQ(r.model.meshes[0].indices, g.indices);
    for (size_t v = 0; v < vertices; ++v) {
        EXPECT_TRUE(near(r.model.meshes[0].rest_positions[v],
                         {g.positions[3 * v], g.positions[3 * v + 1], g.positions[3 * v + 2]}));
        EXPECT_TRUE(
            near(r.model.meshes[0].rest_normals[v], {normal_of[0], normal_of[1], normal_of[2]}, 0.02f));
    }
    EXPECT_TRUE(near(position(r.model, 0, 1, 0, 1), {0, 1, 0.25f}, 1e-3f)); // (1, 0, 0.25) turned
}

TEST(Accessors, RangesWithoutOverflow) {
    const auto with = [](const char* array, const char* name, const json& value) {
        Gltf gltf;
        gltf.node({{"mesh", gltf.triangle()}});
        gltf.root[array][0][name] = value;
        return code(gltf);
    };
    EXPECT_EQ(with("accessors", "count", 4), "ACCESSOR_TOO_LONG");
    EXPECT_EQ(with("accessors", "count", 0), "VALUE_NOT_IN_RANGE");
    EXPECT_EQ(with("accessors", "count", 1ull << 53), "ACCESSOR_TOO_LONG");
    EXPECT_EQ(with("accessors", "count", 1ull << 62), "VALUE_NOT_IN_RANGE");
    EXPECT_EQ(with("accessors", "count", -3), "VALUE_NOT_IN_RANGE");
    EXPECT_EQ(with("accessors", "count", 2.5), "VALUE_NOT_IN_RANGE");
    EXPECT_EQ(with("accessors", "count", 3.0), "ok");
    EXPECT_EQ(with("accessors", "count", "3"), "TYPE_MISMATCH");
    EXPECT_EQ(with("accessors", "byteOffset", 4), "ACCESSOR_TOO_LONG");
    EXPECT_EQ(with("accessors", "byteOffset", (1ull << 53) - 1), "ACCESSOR_TOO_LONG");
    EXPECT_EQ(with("accessors", "bufferView", 1), "UNRESOLVED_REFERENCE");
    EXPECT_EQ(with("accessors", "componentType", 5127), "VALUE_NOT_IN_LIST");
    EXPECT_EQ(with("accessors", "componentType", uint_type), "ACCESSOR_FORMAT");
    EXPECT_EQ(with("accessors", "type", "VEC5"), "VALUE_NOT_IN_LIST");
    EXPECT_EQ(with("accessors", "type", "VEC2"), "ACCESSOR_FORMAT");
    EXPECT_EQ(with("bufferViews", "byteLength", 37), "BUFFER_VIEW_TOO_LONG");
    EXPECT_EQ(with("bufferViews", "byteOffset", (1ull << 53) - 1), "BUFFER_VIEW_TOO_LONG");
    EXPECT_EQ(with("bufferViews", "buffer", 1), "UNRESOLVED_REFERENCE");
    EXPECT_EQ(with("nodes", "mesh", 1), "UNRESOLVED_REFERENCE");
    EXPECT_EQ(with("nodes", "children", {0}), "NODE_LOOP");
    EXPECT_EQ(with("nodes", "matrix", {1, 2, 3}), "TYPE_MISMATCH");
}

TEST(Accessors, ZerosAreNotFree) {
    Gltf gltf;
    gltf.node({{"mesh", gltf.triangle()}});
    gltf.root["accessors"][0].erase("bufferView");
    gltf.root["accessors"][0]["count"] = 1 << 21;
    EXPECT_EQ(code(gltf), "LIMIT_ZEROS");
}

TEST(Accessors, NotFinite) {
    for (const float bad :
         {std::numeric_limits<float>::quiet_NaN(), std::numeric_limits<float>::infinity()}) {
        Gltf gltf;
        const int positions = gltf.floats({0, 0, 0, 1, bad, 0, 0, 1, 0}, "VEC3");
        push(gltf.root["meshes"], {{"primitives", {{{"attributes", {{"POSITION", positions}}}}}}});
        gltf.node({{"mesh", 0}});
        const LoadResult r = gltf.load();
        ASSERT_FALSE(r.ok);
        EXPECT_EQ(r.error.code, "POSITION_NOT_FINITE");
        EXPECT_NE(r.error.what.find("vertex 1 "), std::string::npos) << r.error.what;
    }
}

TEST(Accessors, IndexOutOfRange) {
    Gltf gltf;
    gltf.node({{"mesh", gltf.triangle()}});
    gltf.primitive()["indices"] = gltf.accessor(bytes_of<uint8_t>({0, 1, 3}), ubyte_type, "SCALAR", 3);
    EXPECT_EQ(code(gltf), "ACCESSOR_INDEX_OOB");
    gltf.primitive()["indices"] = gltf.accessor(bytes_of<uint8_t>({2, 1, 0}), ubyte_type, "SCALAR", 3);
    EXPECT_EQ(code(gltf), "ok");
}

} // namespace
} // namespace nusselt::load::test
