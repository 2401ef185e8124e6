// Every code that the loaders know is provoked by a test of this folder.
#include "gltf_builder.h"

#include <gtest/gtest.h>

#include <fstream>
#include <iterator>
#include <limits>
#include <regex>
#include <set>
#include <sys/resource.h>

namespace nusselt::load::test {
namespace {

constexpr float nan_value = std::numeric_limits<float>::quiet_NaN();

std::string contents(const std::filesystem::path& path) {
    std::ifstream file(path, std::ios::binary);
    return {std::istreambuf_iterator<char>(file), {}};
}

std::string code(const LoadResult& result) {
    return result.ok ? "ok" : result.error.code;
}

// A triangle with a skin of two joints; its arrays may be broken afterwards.
Gltf skinned(std::initializer_list<float> weights, std::initializer_list<float> inverse) {
    Gltf gltf;
    const int mesh = gltf.triangle();
    json& attributes = gltf.primitive(mesh)["attributes"];
    attributes["JOINTS_0"] =
        gltf.accessor(bytes_of<uint8_t>({0, 1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0}), ubyte_type, "VEC4", 3);
    attributes["WEIGHTS_0"] = gltf.floats(weights, "VEC4");
    gltf.node({{"mesh", mesh}, {"skin", 0}});
    gltf.node({{"children", {2}}});
    gltf.node(json::object());
    push(gltf.root["skins"], {{"joints", {1, 2}}, {"inverseBindMatrices", gltf.floats(inverse, "MAT4")}});
    return gltf;
}

constexpr std::initializer_list<float> even = {0.5f, 0.5f, 0, 0, 0.5f, 0.5f, 0, 0, 0.5f, 0.5f, 0, 0};
constexpr std::initializer_list<float> two_identities = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1,
                                                         1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1};

TEST(Codes, Skins) {
    EXPECT_EQ(code(skinned(even, two_identities).load()), "ok");
    EXPECT_EQ(code(skinned(even, {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1}).load()), "SKIN_MATRICES");
    EXPECT_EQ(code(skinned({0.5f, nan_value, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0}, two_identities).load()),
              "WEIGHT_NOT_FINITE");
    Gltf gltf = skinned(even, two_identities);
    const Folder folder;
    LoadLimits limits;
    limits.joints = 1;
    EXPECT_EQ(code(load_model(folder.write("t.gltf", gltf.text()), limits)), "LIMIT_JOINTS");
    limits.joints = 2;
    EXPECT_EQ(code(load_model((folder.path / "t.gltf").string(), limits)), "ok");
}

// G12. Weights that sum to nothing, to little, to much, below nothing; bones of no size or turned inside out:
// loaded, and finite in every pose.
TEST(Codes, OddWeightsAndBonesStayFinite) {
    const std::initializer_list<float> weights[] = {
        {0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0},
        {0.25f, 0.25f, 0, 0, 0.25f, 0.25f, 0, 0, 1e-30f, 0, 0, 0},
        {2, 2, 0, 0, 1e30f, 1e30f, 0, 0, 3e38f, 3e38f, 0, 0},
        {-1, 1, 0, 0, -0.5f, 0.5f, 0, 0, 2, -1, 0, 0},
    };
    for (const auto& w : weights) {
        for (const json& scale : {json{0, 0, 0}, json{1, 0, 1}, json{-1, 1, 1}, json{1e-30, 1e-30, 1e-30}}) {
            Gltf gltf = skinned(w, two_identities);
            gltf.root["nodes"][1]["scale"] = scale;
            const LoadResult r = gltf.load();
            if (!r.ok) continue; // refused is an answer as well
            for (size_t v = 0; v < 3; ++v) {
                const glm::vec3 p = position(r.model, -1, 0, 0, v), n = normal(r.model, -1, 0, 0, v);
                for (int k = 0; k < 3; ++k)
                    EXPECT_TRUE(std::isfinite(p[k]) && std::isfinite(n[k]))
                        << scale.dump() << " vertex " << v;
            }
        }
    }
}

TEST(Codes, Animations) {
    const auto moved = [](std::initializer_list<float> times, std::initializer_list<float> values) {
        Gltf gltf;
        gltf.node({{"mesh", gltf.triangle()}});
        gltf.animate(0, "translation", "LINEAR", times, values, "VEC3");
        return code(gltf.load());
    };
    EXPECT_EQ(moved({0, 1}, {0, 0, 0, 1, 1, 1}), "ok");
    EXPECT_EQ(moved({1, 0}, {0, 0, 0, 1, 1, 1}), "ANIMATION_TIMES");
    EXPECT_EQ(moved({-1, 0}, {0, 0, 0, 1, 1, 1}), "ANIMATION_TIMES");
    EXPECT_EQ(moved({0, nan_value}, {0, 0, 0, 1, 1, 1}), "ANIMATION_TIMES");
    EXPECT_EQ(moved({0, 1}, {0, 0, 0, 1, nan_value, 1}), "ANIMATION_NOT_FINITE");
}

TEST(Codes, SparseIndicesAreUnsignedIntegers) {
    Gltf gltf;
    gltf.node({{"mesh", gltf.triangle()}});
    const int at = gltf.view(bytes_of<float>({0, 1})),
              values = gltf.view(bytes_of<float>({0, 0, 0, 1, 1, 1}));
    gltf.root["accessors"][0]["sparse"] = {{"count", 2},
                                           {"indices", {{"bufferView", at}, {"componentType", float_type}}},
                                           {"values", {{"bufferView", values}}}};
    EXPECT_EQ(code(gltf.load()), "SPARSE_INDICES_FORMAT");
}

TEST(Codes, Files) {
    const Folder folder;
    const std::string path = folder.write("t.obj", std::string("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"));
    // A file may hold its text and its data as text, a third longer.
    LoadLimits limits;
    limits.json_bytes = 0;
    limits.buffer_bytes = std::filesystem::file_size(path);
    EXPECT_EQ(code(load_model(path, limits)), "ok");
    limits.buffer_bytes = limits.buffer_bytes / 4 * 3 - 3;
    EXPECT_EQ(code(load_model(path, limits)), "LIMIT_FILE_SIZE");
}

#if !defined(NUSSELT_SANITIZED)
TEST(Codes, NoMemory) {
    const Folder folder;
    std::string text;
    for (int v = 0; v < 300000; ++v)
        text += "v " + std::to_string(v) + " 0 0\n";
    for (int v = 1; v + 2 < 300000; ++v)
        text += "f " + std::to_string(v) + " " + std::to_string(v + 1) + " " + std::to_string(v + 2) + "\n";
    const std::string path = folder.write("large.obj", text);
    const auto with_little = [&] {
        long pages = 0;
        std::ifstream("/proc/self/statm") >> pages;
        const rlim_t little = rlim_t(pages) * 4096 + (rlim_t(24) << 20);
        const rlimit limit{little, little};
        if (setrlimit(RLIMIT_AS, &limit) != 0) std::_Exit(2);
        std::_Exit(code(load_model(path)) == "OUT_OF_MEMORY" ? 0 : 1);
    };
    testing::FLAGS_gtest_death_test_style = "threadsafe";
    EXPECT_EXIT(with_little(), testing::ExitedWithCode(0), "");
}
#endif

TEST(Codes, TheLineHasThePlaceAndTheCode) {
    Gltf gltf;
    gltf.node({{"mesh", gltf.triangle()}});
    gltf.root["accessors"][0]["count"] = 1000;
    const LoadResult r = gltf.load();
    ASSERT_FALSE(r.ok);
    const std::string line = describe("scene.gltf", r.error);
    EXPECT_TRUE(line.starts_with("scene.gltf: ")) << line;
    EXPECT_NE(line.find("(/accessors/0"), std::string::npos) << line;
    EXPECT_TRUE(line.ends_with("[" + r.error.code + "]")) << line;
}

// Flaws that can be lived with: each names itself, where it is, and its code. The ones of real files are in
// bad_policy.tsv.
TEST(Codes, Warnings) {
    const auto told = [](const LoadResult& result) {
        std::string all = result.ok ? "" : "refused: " + result.error.code;
        for (const std::string& line : result.model.warnings)
            all += line + "\n";
        return all;
    };
    const auto expect = [&](const char* what, Gltf gltf) {
        const std::string all = told(gltf.load());
        EXPECT_NE(all.find("[" + std::string(what) + "]\n"), std::string::npos) << what << ": " << all;
    };
    const auto plain = [] {
        Gltf gltf;
        gltf.node({{"mesh", gltf.triangle()}});
        return gltf;
    };
    EXPECT_EQ(told(plain().load()), "");
    EXPECT_EQ(told(skinned(even, two_identities).load()), "");

    Gltf gltf = plain();
    gltf.root["nodes"][0]["rotation"] = {0, 0, 0, 2};
    expect("ROTATION_NON_UNIT", gltf);
    gltf = plain();
    gltf.primitive()["attributes"]["COLOR_0"] = gltf.floats({1, 1, 1}, "SCALAR");
    expect("COLOR_FORMAT", gltf);
    gltf = plain();
    gltf.primitive()["extensions"]["KHR_draco_mesh_compression"] = json::object();
    expect("DRACO_IGNORED", gltf);
    expect("NEGATIVE_WEIGHTS", skinned({-1, 1, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0}, two_identities));
    gltf = plain();
    json second = gltf.primitive();
    second["mode"] = 0;
    gltf.root["meshes"][0]["primitives"].push_back(second);
    expect("POINTS_OR_LINES", gltf);
    gltf.root["meshes"][0]["primitives"][1] = {{"attributes", json::object()}};
    expect("NO_POSITIONS", gltf);
    gltf = plain();
    gltf.primitive()["targets"] = {{{"NORMAL", 0}}};
    expect("TARGET_WITHOUT_BASE", gltf);
    gltf = plain();
    gltf.primitive()["attributes"]["COLOUR"] = 0;
    expect("INVALID_ATTRIBUTE", gltf);
    gltf = plain();
    gltf.root["extensionsUsed"] = {"KHR_mesh_quantization"};
    expect("NON_REQUIRED_EXTENSION", gltf);
    gltf.root["accessors"][0]["extensions"]["KHR_mesh_quantization"] = json::object();
    expect("UNEXPECTED_EXTENSION_OBJECT", gltf);

    gltf = plain();
    gltf.animate(0, "translation", "LINEAR", {0, 0}, {0, 0, 0, 1, 1, 1}, "VEC3");
    expect("REPEATED_KEY", gltf);
    gltf = plain();
    gltf.animate(0, "translation", "LINEAR", {0, 1}, {0, 0, 0, 1, 1, 1}, "VEC3");
    json& channels = gltf.root["animations"][0]["channels"];
    channels.push_back(json(channels[0]));
    expect("REPEATED_CHANNEL", gltf);
    channels[1]["target"] = {{"path", "pointer"}};
    expect("ANIMATION_POINTER", gltf);
    gltf = plain();
    gltf.animate(0, "weights", "LINEAR", {0, 1}, {0, 1}, "SCALAR");
    expect("NO_TARGETS", gltf);

    // Joints of another scene, and of two trees.
    gltf = skinned(even, two_identities);
    gltf.root["scenes"] = {{{"nodes", {0}}}};
    expect("NODE_SKIN_NO_SCENE", gltf);
    gltf = skinned(even, two_identities);
    gltf.root["nodes"][1].erase("children");
    expect("SKIN_NO_COMMON_ROOT", gltf);

    // Bounds that are not the data's, and ones that are.
    gltf = plain();
    gltf.root["accessors"][0]["min"] = {0, 0, 0};
    gltf.root["accessors"][0]["max"] = {1, 1, 0};
    EXPECT_EQ(told(gltf.load()), "");
    for (const char* bound : {"min", "max"}) {
        for (const double wrong : {0.5, -1e300, 1e300}) {
            Gltf off = gltf;
            off.root["accessors"][0][bound][0] = wrong;
            expect("ACCESSOR_BOUNDS", off);
        }
    }
    gltf = plain();
    gltf.primitive()["attributes"]["NORMAL"] =
        push(gltf.root["accessors"],
             {{"byteOffset", 0}, {"componentType", float_type}, {"type", "VEC3"}, {"count", 3}});
    expect("UNSATISFIED_DEPENDENCY", gltf);

    // Textures are not read, and lead nowhere.
    const std::pair<const char*, json> textures[] = {{"INVALID_INDEX", {{"index", -1}}},
                                                     {"INVALID_INDEX", {{"index", 1}}},
                                                     {"INVALID_INDEX", json::object()},
                                                     {"TYPE_MISMATCH", {{"index", 0}, {"scale", "1"}}},
                                                     {"TYPE_MISMATCH", 0}};
    for (const auto& [what, texture] : textures) {
        gltf = plain();
        gltf.root["textures"] = {json::object()};
        gltf.root["materials"] = {{{"normalTexture", texture}}};
        expect(what, gltf);
        gltf.root["materials"] = {{{"pbrMetallicRoughness", {{"baseColorTexture", texture}}}}};
        expect(what, gltf);
    }
    gltf.root["materials"] = {{{"normalTexture", {{"index", 0}, {"scale", 1.5}}}}};
    EXPECT_EQ(told(gltf.load()), "");

    const Folder folder;
    Data glb = plain().glb();
    glb.resize(glb.size() + 4);
    EXPECT_NE(told(load_model(folder.write("t.glb", glb))).find("[GLB_TRAILING_DATA]"), std::string::npos);

    // A flaw in every part is told some times only.
    gltf = plain();
    for (int i = 0; i < 1000; ++i)
        gltf.primitive()["attributes"]["A" + std::to_string(i)] = 0;
    EXPECT_LE(gltf.load().model.warnings.size(), 40u);
}

TEST(Codes, EachIsInATest) {
    const std::filesystem::path here = NUSSELT_LOAD_TESTS, source = here / ".." / ".." / "tools" / "load";
    std::set<std::string> codes;
    const std::regex call("(?:fail|warn|warning)\\(\\s*\"([A-Z][A-Z0-9_]+)\"");
    for (const auto& entry : std::filesystem::directory_iterator(source)) {
        if (entry.path().extension() != ".cpp") continue;
        const std::string text = contents(entry.path());
        for (auto it = std::sregex_iterator(text.begin(), text.end(), call); it != std::sregex_iterator();
             ++it)
            codes.insert((*it)[1]);
    }
    EXPECT_GE(codes.size(), 80u);
    codes.erase("UNREADABLE"); // what a library finds behind all of our checks
    std::string tests;
    for (const auto& entry : std::filesystem::directory_iterator(here))
        tests += contents(entry.path());
    for (const std::string& name : codes)
        EXPECT_NE(tests.find(name), std::string::npos) << name << " is provoked by no test";
}

} // namespace
} // namespace nusselt::load::test
