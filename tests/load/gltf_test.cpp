// Containers, references, scenes, primitives, limits, and the text of errors.
#include "gltf_builder.h"

#include <gtest/gtest.h>

#include <sys/stat.h>

namespace nusselt::load::test {
namespace {

Gltf one_triangle() {
    Gltf gltf;
    gltf.node({{"mesh", gltf.triangle()}});
    return gltf;
}

std::string code(const LoadResult& r) {
    return r.ok ? "ok" : r.error.code;
}

TEST(Glb, ReadsItsChunk) {
    const Folder folder;
    const LoadResult r = load_model(folder.write("a.glb", one_triangle().glb()));
    ASSERT_TRUE(r.ok) << r.error.what;
    EXPECT_EQ(r.model.format, "GLB");
    EXPECT_EQ(r.model.name, "a.glb");
    EXPECT_EQ(r.model.meshes[0].rest_positions[1], glm::vec3(1, 0, 0));
    EXPECT_EQ(r.model.meshes[0].indices, (std::vector<uint32_t>{0, 1, 2}));
}

TEST(Glb, EveryCutIsAnError) {
    const Folder folder;
    const Data whole = one_triangle().glb();
    for (size_t size = 0; size < whole.size(); ++size) {
        const LoadResult r = load_model(folder.write("cut.glb", Data(whole.begin(), whole.begin() + size)));
        EXPECT_FALSE(r.ok) << size;
    }
}

TEST(Glb, WrongLengths) {
    const Folder folder;
    const auto with = [&](size_t at, uint32_t value) {
        Data bytes = one_triangle().glb();
        for (size_t i = 0; i < 4; ++i) {
            bytes[at + i] = static_cast<uint8_t>(value >> (8 * i));
        }
        return code(load_model(folder.write("wrong.glb", bytes)));
    };
    EXPECT_EQ(with(4, 1), "GLB_VERSION");
    EXPECT_EQ(with(8, 0xFFFFFFFF), "GLB_TRUNCATED");
    EXPECT_EQ(with(12, 0xFFFFFFF8), "GLB_TRUNCATED"); // 32-bit sums would wrap
    EXPECT_EQ(with(12, 0x7FFFFFF0), "GLB_TRUNCATED");
    EXPECT_EQ(with(16, 0x004E4942), "GLB_CHUNK");
}

TEST(Uris, FileBesideTheModel) {
    const Folder folder;
    Gltf gltf = one_triangle();
    std::filesystem::create_directory(folder.path / "a b");
    folder.write("a b/data.bin", gltf.buffer);
    folder.write("secret.bin", gltf.buffer);
    std::filesystem::create_directory(folder.path / "model");
    folder.write("model/data.bin", gltf.buffer);
    std::filesystem::create_symlink(folder.path / "secret.bin", folder.path / "model" / "link.bin");
    mkfifo((folder.path / "model" / "fifo.bin").c_str(), 0600);
    const auto from = [&](const char* where, const std::string& uri) {
        gltf.root["buffers"] = json::array({{{"byteLength", gltf.buffer.size()}, {"uri", uri}}});
        return code(load_model(folder.write(where, gltf.root.dump())));
    };
    EXPECT_EQ(from("t.gltf", "a%20b/data.bin"), "ok");
    EXPECT_EQ(from("t.gltf", "./a b//data.bin"), "ok");
    EXPECT_EQ(from("model/t.gltf", "data.bin"), "ok");
    EXPECT_EQ(from("model/t.gltf", "../secret.bin"), "UNSAFE_URI");
    EXPECT_EQ(from("model/t.gltf", "%2e%2e/secret.bin"), "UNSAFE_URI");
    EXPECT_EQ(from("model/t.gltf", "%2e%2e%2fsecret.bin"), "UNSAFE_URI");
    EXPECT_EQ(from("model/t.gltf", "%252e%252e%252fsecret.bin"), "FILE_MISSING"); // decoded once
    EXPECT_EQ(from("model/t.gltf", "..\\secret.bin"), "UNSAFE_URI");
    EXPECT_EQ(from("model/t.gltf", (folder.path / "secret.bin").string()), "UNSAFE_URI");
    EXPECT_EQ(from("model/t.gltf", "%2Fetc/passwd"), "UNSAFE_URI");
    EXPECT_EQ(from("model/t.gltf", "file:///etc/passwd"), "UNSAFE_URI");
    EXPECT_EQ(from("model/t.gltf", "http://example.org/a.bin"), "UNSAFE_URI");
    EXPECT_EQ(from("model/t.gltf", "data.bin%00.png"), "UNSAFE_URI");
    EXPECT_EQ(from("model/t.gltf", "link.bin"), "UNSAFE_URI");
    EXPECT_EQ(from("model/t.gltf", "fifo.bin"), "NOT_A_FILE"); // and doesn't wait for a writer
    EXPECT_EQ(from("model/t.gltf", "."), "NOT_A_FILE");
    EXPECT_EQ(from("model/t.gltf", ""), "URI_EMPTY");
    EXPECT_EQ(from("model/t.gltf", "gone.bin"), "FILE_MISSING");
    EXPECT_EQ(code(load_model(folder.path.string())), "NOT_A_FILE");
    EXPECT_EQ(code(load_model((folder.path / "model" / "fifo.bin").string())), "NOT_A_FILE");
    EXPECT_EQ(code(load_model((folder.path / "none.gltf").string())), "FILE_MISSING");
}

TEST(Uris, Data) {
    Gltf gltf = one_triangle();
    gltf.text();
    const std::string good = gltf.root["buffers"][0]["uri"];
    const Folder folder;
    const auto with = [&](const std::string& uri) {
        gltf.root["buffers"][0]["uri"] = uri;
        return code(load_model(folder.write("t.gltf", gltf.root.dump())));
    };
    EXPECT_EQ(with(good), "ok");
    EXPECT_EQ(with("data:;base64," + good.substr(good.find(',') + 1)), "ok");
    EXPECT_EQ(with(good.substr(0, good.size() - 8)), "BUFFER_TOO_SHORT");
    EXPECT_EQ(with("data:application/octet-stream;base64,AAA*"), "DATA_URI");
    EXPECT_EQ(with("data:application/octet-stream;base64"), "DATA_URI");
    std::string escaped = "data:,";
    for (const uint8_t byte : gltf.buffer) {
        const char digits[] = "0123456789abcdef";
        escaped += {'%', digits[byte >> 4], digits[byte & 15]};
    }
    EXPECT_EQ(with(escaped), "ok");
}

TEST(Scenes, WhatIsDrawn) {
    Gltf gltf;
    const int mesh = gltf.triangle();
    for (int i = 0; i < 3; ++i) {
        gltf.node({{"mesh", mesh}, {"name", "n" + std::to_string(i)}});
    }
    const auto drawn = [&] {
        const LoadResult r = gltf.load();
        std::string names;
        for (const scenes::Mesh& m : r.model.meshes) {
            names += m.name;
        }
        return r.ok ? names : r.error.code;
    };
    EXPECT_EQ(drawn(), "n0n1n2"); // no scenes: all
    gltf.root["scenes"] = {{{"nodes", {2}}}, {{"nodes", {0, 1}}}};
    EXPECT_EQ(drawn(), "n2"); // no default: the first
    gltf.root["scene"] = 1;
    EXPECT_EQ(drawn(), "n0n1");
    gltf.root["scene"] = 2;
    EXPECT_EQ(drawn(), "UNRESOLVED_REFERENCE");
    gltf.root["scenes"] = json::array({json::object()});
    gltf.root["scene"] = 0;
    EXPECT_EQ(drawn(), "NO_TRIANGLES");
    gltf.root.erase("nodes");
    gltf.root.erase("scene");
    gltf.root.erase("scenes");
    EXPECT_EQ(drawn(), "mesh 0");
}

TEST(Scenes, NodeGraphIsATree) {
    Gltf gltf = one_triangle();
    gltf.node({{"children", {0}}});
    gltf.node({{"children", {0}}});
    EXPECT_EQ(code(gltf.load()), "NODE_PARENT_OVERRIDE");
    gltf.root["nodes"][2]["children"] = {1};
    EXPECT_EQ(code(gltf.load()), "ok");
    gltf.root["nodes"][0]["children"] = {2};
    EXPECT_EQ(code(gltf.load()), "NODE_LOOP");
}

TEST(Scenes, DeepChains) {
    for (const int depth : {1024, 1025}) {
        Gltf gltf = one_triangle();
        for (int i = 1; i < depth; ++i) {
            gltf.node({{"children", {i - 1}}});
        }
        EXPECT_EQ(code(gltf.load()), depth <= 1024 ? "ok" : "LIMIT_NODE_DEPTH");
    }
}

TEST(Primitives, StripsAndFans) {
    const auto indices = [](int mode, std::initializer_list<uint8_t> given) {
        Gltf gltf;
        const int positions = gltf.floats({0, 0, 0, 1, 0, 0, 0, 1, 0, 1, 1, 0, 2, 2, 0}, "VEC3");
        json primitive = {{"attributes", {{"POSITION", positions}}}, {"mode", mode}};
        if (given.size() > 0)
            primitive["indices"] = gltf.accessor(bytes_of(given), ubyte_type, "SCALAR", given.size());
        push(gltf.root["meshes"], {{"primitives", {primitive}}});
        gltf.node({{"mesh", 0}});
        const LoadResult r = gltf.load();
        return r.ok ? r.model.meshes[0].indices : std::vector<uint32_t>();
    };
    using List = std::vector<uint32_t>;
    EXPECT_EQ(indices(5, {}), (List{0, 1, 2, 1, 3, 2, 2, 3, 4}));
    EXPECT_EQ(indices(6, {}), (List{0, 1, 2, 0, 2, 3, 0, 3, 4}));
    EXPECT_EQ(indices(5, {0, 1, 2, 2, 3, 3, 4, 0}),
              (List{0, 1, 2, 3, 0, 4}));                  // joined strips; the fifth runs backwards
    EXPECT_EQ(indices(4, {0, 1, 2, 3}), (List{0, 1, 2})); // incomplete
    EXPECT_EQ(indices(0, {}), List());
    EXPECT_EQ(indices(3, {}), List());
    EXPECT_EQ(indices(7, {}), List());
}

TEST(Primitives, ColoursAndSharedVertices) {
    Gltf gltf;
    const int positions = gltf.floats({0, 0, 0, 1, 0, 0, 0, 1, 0, 1, 1, 0}, "VEC3");
    const int colours = gltf.accessor(
        bytes_of<uint8_t>({255, 255, 255, 0, 255, 255, 255, 0, 0, 255, 255, 0, 255, 255, 255, 0}), ubyte_type,
        "VEC4", 4, true);
    const int first = gltf.accessor(bytes_of<uint8_t>({0, 1, 2}), ubyte_type, "SCALAR", 3);
    const int second = gltf.accessor(bytes_of<uint8_t>({1, 3, 2}), ubyte_type, "SCALAR", 3);
    gltf.root["materials"] = {{{"pbrMetallicRoughness", {{"baseColorFactor", {0.5, 0.25, 1, 1}}}}},
                              {{"pbrMetallicRoughness", {{"baseColorFactor", {0, 1, 0, 1}}}}}};
    const json attributes = {{"POSITION", positions}, {"COLOR_0", colours}};
    push(gltf.root["meshes"], {{"primitives",
                                {{{"attributes", attributes}, {"indices", first}, {"material", 0}},
                                 {{"attributes", attributes}, {"indices", second}, {"material", 0}}}}});
    gltf.node({{"mesh", 0}});
    LoadResult r = gltf.load();
    ASSERT_TRUE(r.ok) << r.error.what;
    EXPECT_EQ(r.model.meshes[0].indices, (std::vector<uint32_t>{0, 1, 2, 1, 3, 2})); // one set of vertices
    EXPECT_EQ(r.model.meshes[0].albedo,
              (std::vector<glm::vec3>{{0.5f, 0.25f, 1}, {0.5f, 0.25f, 1}, {0, 0.25f, 1}, {0.5f, 0.25f, 1}}));
    gltf.root["meshes"][0]["primitives"][1]["material"] = 1;
    r = gltf.load();
    ASSERT_TRUE(r.ok) << r.error.what;
    const scenes::Mesh& mesh = r.model.meshes[0];
    EXPECT_EQ(mesh.indices, (std::vector<uint32_t>{0, 1, 2, 4, 3, 5})); // 1 and 2 in the other colour
    EXPECT_EQ(mesh.rest_positions[4], mesh.rest_positions[1]);
    EXPECT_EQ(mesh.albedo[3], glm::vec3(0, 1, 0));
    EXPECT_EQ(mesh.albedo[5], glm::vec3(0, 1, 0));
    EXPECT_EQ(mesh.albedo[2], glm::vec3(0, 0.25f, 1));
    EXPECT_EQ(r.model.stored_vertices, 4u);
    EXPECT_EQ(r.model.stored_triangles, 2u);
}

TEST(Primitives, Materials) {
    Gltf gltf;
    const int positions = gltf.floats({0, 0, 0, 1, 0, 0, 0, 1, 0, 1, 1, 0}, "VEC3");
    const int first = gltf.accessor(bytes_of<uint8_t>({0, 1, 2}), ubyte_type, "SCALAR", 3);
    const int second = gltf.accessor(bytes_of<uint8_t>({1, 3, 2}), ubyte_type, "SCALAR", 3);
    gltf.root["materials"] = {
        {{"pbrMetallicRoughness", {{"metallicFactor", 0.25}, {"roughnessFactor", 0.5}}}},
        {{"pbrMetallicRoughness", {{"metallicFactor", 0.25}, {"roughnessFactor", 0.5}}},
         {"doubleSided", true}}};
    const json attributes = {{"POSITION", positions}};
    push(gltf.root["meshes"], {{"primitives",
                                {{{"attributes", attributes}, {"indices", first}, {"material", 0}},
                                 {{"attributes", attributes}, {"indices", second}, {"material", 1}}}}});
    gltf.node({{"mesh", 0}});
    LoadResult r = gltf.load();
    ASSERT_TRUE(r.ok) << r.error.what;
    const scenes::Mesh& mesh = r.model.meshes[0];
    EXPECT_EQ(mesh.indices, (std::vector<uint32_t>{0, 1, 2, 4, 3, 5})); // a sheet beside what is none
    EXPECT_EQ(mesh.two_sided, (std::vector<uint8_t>{0, 0, 0, 1, 1, 1}));
    EXPECT_EQ(mesh.metallic_roughness, std::vector<glm::vec2>(6, {0.25f, 0.5f}));
    gltf.root["materials"][1].erase("pbrMetallicRoughness"); // glTF's defaults
    r = gltf.load();
    ASSERT_TRUE(r.ok) << r.error.what;
    EXPECT_EQ(r.model.meshes[0].metallic_roughness[3], glm::vec2(1));
    gltf.root["materials"][1]["doubleSided"] = 1;
    EXPECT_EQ(gltf.load().error.code, "TYPE_MISMATCH");
    gltf.root["materials"][1]["doubleSided"] = false;
    gltf.root["materials"][0]["pbrMetallicRoughness"]["roughnessFactor"] = "rough";
    EXPECT_EQ(gltf.load().error.code, "TYPE_MISMATCH");
}

TEST(Extensions, Required) {
    Gltf gltf = one_triangle();
    gltf.root["extensionsUsed"] = {"KHR_draco_mesh_compression", "KHR_materials_sheen"};
    EXPECT_EQ(code(gltf.load()), "ok");
    gltf.root["extensionsRequired"] = {"KHR_texture_transform", "KHR_materials_sheen"};
    EXPECT_EQ(code(gltf.load()), "ok");
    gltf.root["extensionsRequired"] = {"KHR_draco_mesh_compression"};
    EXPECT_EQ(code(gltf.load()), "UNSUPPORTED_EXTENSION");
}

TEST(Limits, JustUnderAndJustOver) {
    Gltf gltf = one_triangle();
    const std::string text = gltf.text();
    const Folder folder;
    const std::string path = folder.write("t.gltf", text);
    const auto with = [&](auto set) {
        LoadLimits limits;
        set(limits);
        return code(load_model(path, limits));
    };
    EXPECT_EQ(with([](LoadLimits& l) { l.vertices = l.triangles = l.elements = 3; }), "ok");
    EXPECT_EQ(with([](LoadLimits& l) { l.vertices = 2; }), "LIMIT_VERTICES");
    EXPECT_EQ(with([](LoadLimits& l) { l.triangles = 0; }), "LIMIT_TRIANGLES");
    EXPECT_EQ(with([](LoadLimits& l) { l.elements = 0; }), "LIMIT_ELEMENTS");
    EXPECT_EQ(with([](LoadLimits& l) { l.buffer_bytes = 36; }), "ok");
    EXPECT_EQ(with([](LoadLimits& l) { l.buffer_bytes = 35; }), "LIMIT_BUFFERS");
    const size_t uri = gltf.root["buffers"][0]["uri"].get<std::string>().size();
    EXPECT_EQ(with([&](LoadLimits& l) { l.data_uri_bytes = uri; }), "ok");
    EXPECT_EQ(with([&](LoadLimits& l) { l.data_uri_bytes = uri - 1; }), "LIMIT_JSON");
    EXPECT_EQ(with([&](LoadLimits& l) { l.json_bytes = text.size() - uri; }), "ok");
    EXPECT_EQ(with([&](LoadLimits& l) { l.json_bytes = text.size() - uri - 1; }), "LIMIT_JSON");
    EXPECT_EQ(with([&](LoadLimits& l) { l.json_tokens = 10; }), "LIMIT_JSON");
    EXPECT_EQ(with([&](LoadLimits& l) { l.json_depth = 6; }), "ok");
    EXPECT_EQ(with([&](LoadLimits& l) { l.json_depth = 5; }), "LIMIT_JSON");
}

TEST(Limits, NestingDoesNotExhaustTheStack) {
    Gltf gltf = one_triangle();
    std::string text = gltf.text();
    text.pop_back();
    text += ",\"extras\":" + std::string(1'000'000, '[') + std::string(1'000'000, ']') + "}";
    const Folder folder;
    EXPECT_EQ(code(load_model(folder.write("deep.gltf", text))), "LIMIT_JSON");
}

TEST(Limits, ManyEmptyNodesAreQuick) {
    Gltf gltf = one_triangle();
    std::string text = gltf.text();
    text.pop_back();
    text.replace(text.find("\"nodes\":["), 9, "\"nodes\":[{},");
    std::string nodes;
    for (int i = 0; i < 200'000; ++i) {
        nodes += "{},";
    }
    text.replace(text.find("\"nodes\":["), 9, "\"nodes\":[" + nodes);
    const Folder folder;
    EXPECT_EQ(code(load_model(folder.write("many.gltf", text + "}"))), "ok");
}

TEST(Errors, TextIsOneShortPrintableLine) {
    Gltf gltf = one_triangle();
    gltf.root["buffers"] =
        json::array({{{"byteLength", 36}, {"uri", "\x1b[31m\n\xc3\xa4" + std::string(1000, 'x')}}});
    const Folder folder;
    const std::string path = folder.write("t.gltf", gltf.root.dump());
    const LoadResult r = load_model(path);
    ASSERT_FALSE(r.ok);
    const std::string text = describe("dir\n\x1b/file.gltf", r.error);
    for (const char c : text) {
        EXPECT_TRUE(c >= 0x20 && c < 0x7F) << static_cast<int>(c);
    }
    EXPECT_LE(text.size(), 200u) << text;
    EXPECT_TRUE(text.starts_with("dir\\x0a\\x1b/file.gltf: ")) << text;
    EXPECT_NE(text.find("(/buffers/0/uri)"), std::string::npos) << text;
}

TEST(Errors, NamesLoseControlCharactersOnly) {
    Gltf gltf = one_triangle();
    gltf.root["nodes"][0]["name"] = "a\n\x1b[1m\xc2\x9b\xc3\xa9";
    const LoadResult r = gltf.load();
    ASSERT_TRUE(r.ok) << r.error.what;
    EXPECT_EQ(r.model.meshes[0].name, "a[1m\xc3\xa9");
}

TEST(Errors, PoseOutOfRange) {
    Gltf gltf = one_triangle();
    gltf.root["nodes"][0]["scale"] = {1e38, 1, 1};
    gltf.node({{"children", {0}}, {"scale", {1e38, 1, 1}}});
    EXPECT_EQ(code(gltf.load()), "POSE_NOT_FINITE");
}

} // namespace
} // namespace nusselt::load::test
