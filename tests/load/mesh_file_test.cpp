// OBJ and PLY.
#include "gltf_builder.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstring>

namespace nusselt::load::test {
namespace {

LoadResult load_text(const char* name, const std::string& text) {
    const Folder folder;
    return load_model(folder.write(name, text));
}

std::string code(const LoadResult& r) {
    return r.ok ? "ok" : r.error.code;
}

const std::string square = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n";

TEST(Obj, PolygonsBecomeFans) {
    const LoadResult r =
        load_text("a.obj", "# a comment\r\n" + square + "vt 0 0\nf 1/1 2/1 3/1 \\\n 4/1\nl 1 2\ns off\n");
    ASSERT_TRUE(r.ok) << r.error.what;
    EXPECT_EQ(r.model.format, "OBJ");
    EXPECT_EQ(r.model.meshes[0].indices, (std::vector<uint32_t>{0, 1, 2, 0, 2, 3}));
    EXPECT_EQ(r.model.meshes[0].rest_positions.size(), 4u);
    EXPECT_TRUE(near(normal(r.model, -1, 0, 0, 2), {0, 0, 1}));
}

TEST(Obj, NegativeIndicesAndNormals) {
    const LoadResult r =
        load_text("a.obj", square + "vn 0 0 2\nvn 1 0 0\nf -4//1 -3//-2 -2//1\nf 1//1 3//2 4//2\n");
    ASSERT_TRUE(r.ok) << r.error.what;
    const scenes::Mesh& mesh = r.model.meshes[0];
    EXPECT_EQ(mesh.indices, (std::vector<uint32_t>{0, 1, 2, 0, 4, 3})); // vertex 2 with another normal
    EXPECT_EQ(mesh.rest_normals[2], glm::vec3(0, 0, 1));
    EXPECT_EQ(mesh.rest_normals[4], glm::vec3(1, 0, 0));
    EXPECT_EQ(mesh.rest_positions[4], mesh.rest_positions[2]);
    EXPECT_EQ(r.model.stored_vertices, 4u);
}

TEST(Obj, MaterialsAndColours) {
    const Folder folder;
    folder.write("m.mtl", "newmtl red one\nKd 1 0 0\nnewmtl grey\nKd 0.5 0.5 0.5\n");
    const LoadResult r =
        load_model(folder.write("a.obj", "mtllib m.mtl\nv 0 0 0 0.5 1 1\nv 1 0 0\nv 1 1 0\nv 0 1 0\nusemtl "
                                         "red one\nf 1 2 3\nusemtl grey\nf 1 3 4\n"));
    ASSERT_TRUE(r.ok) << r.error.what;
    const scenes::Mesh& mesh = r.model.meshes[0];
    EXPECT_EQ(mesh.albedo[0], glm::vec3(0.5f, 0, 0));
    EXPECT_EQ(mesh.albedo[3], glm::vec3(0.5f, 0.5f, 0.5f));
    EXPECT_EQ(mesh.albedo[4], glm::vec3(0.25f, 0.5f, 0.5f)); // vertex 0 in grey
    const LoadResult gone = load_text("a.obj", "mtllib ../m.mtl\n" + square + "f 1 2 3\n");
    ASSERT_TRUE(gone.ok);
    EXPECT_EQ(gone.model.warnings.size(), 1u);
}

TEST(Obj, Wrong) {
    EXPECT_EQ(code(load_text("a.obj", square)), "NO_TRIANGLES");
    EXPECT_EQ(code(load_text("a.obj", square + "f 1 2 5\n")), "OBJ_INDEX");
    EXPECT_EQ(code(load_text("a.obj", square + "f 0 1 2\n")), "OBJ_INDEX");
    EXPECT_EQ(code(load_text("a.obj", square + "f 1 2 -9223372036854775808\n")), "OBJ_INDEX");
    EXPECT_EQ(code(load_text("a.obj", square + "f 1 2 99999999999999999999\n")), "OBJ_INDEX");
    EXPECT_EQ(code(load_text("a.obj", square + "f 1//1 2//1 3//1\n")), "OBJ_INDEX");
    EXPECT_EQ(code(load_text("a.obj", square + "f a b c\n")), "OBJ_INDEX");
    EXPECT_EQ(code(load_text("a.obj", "v 1 2\n")), "OBJ_NUMBER");
    EXPECT_EQ(code(load_text("a.obj", "v 1 2 x\n")), "OBJ_NUMBER");
    EXPECT_EQ(code(load_text("a.obj", "v 1 nan 2\n")), "POSITION_NOT_FINITE");
    EXPECT_EQ(code(load_text("a.obj", "v 1 1e300 2\n")), "POSITION_NOT_FINITE");
    EXPECT_EQ(load_text("a.obj", square + "f 1 2 9\n").error.where, "line 5");
    EXPECT_EQ(code(load_text("a.obj", "v 0 0 1e-46\nv +1 0 0\nv 0 1 0\nf 1 2 3")), "ok");
}

std::string ply_header(const char* format, size_t vertices, size_t faces) {
    return std::string("ply\nformat ") + format + " 1.0\ncomment x\nelement vertex " +
           std::to_string(vertices) +
           "\nproperty float x\nproperty list uchar short extra\nproperty double y\nproperty float "
           "z\nproperty uchar red\n"
           "property uchar green\nproperty uchar blue\nelement other 1\nproperty int a\nelement face " +
           std::to_string(faces) +
           "\nproperty uchar flags\nproperty list uchar uint vertex_indices\nend_header\n";
}

const std::string ply_ascii = ply_header("ascii", 4, 2) +
                              "0 0 0 0 255 0 0\n1 2 7 7 0 0 255 0 0\n1 0 1 0 255 0 0\n0 0 1 0 0 0 255\n"
                              "99\n0 4 0 1 2 3\n0 2 0 1\n";

template<class Number>
void put(std::string& out, Number value, bool big) {
    char bytes[sizeof value];
    std::memcpy(bytes, &value, sizeof value);
    if (big) std::reverse(bytes, bytes + sizeof value);
    out.append(bytes, sizeof value);
}

std::string ply_binary(bool big) {
    std::string out = ply_header(big ? "binary_big_endian" : "binary_little_endian", 4, 2);
    const float xs[] = {0, 1, 1, 0}, ys[] = {0, 0, 1, 1};
    for (int v = 0; v < 4; ++v) {
        put(out, xs[v], big);
        put(out, static_cast<uint8_t>(v == 1 ? 2 : 0), big);
        if (v == 1) {
            put(out, int16_t{7}, big);
            put(out, int16_t{7}, big);
        }
        put(out, static_cast<double>(ys[v]), big);
        put(out, 0.0f, big);
        for (int c = 0; c < 3; ++c) {
            put(out, static_cast<uint8_t>((v < 3 && c == 0) || (v == 3 && c == 2) ? 255 : 0), big);
        }
    }
    put(out, int32_t{99}, big);
    put(out, uint8_t{0}, big);
    put(out, uint8_t{4}, big);
    for (uint32_t i = 0; i < 4; ++i) {
        put(out, i, big);
    }
    put(out, uint8_t{0}, big);
    put(out, uint8_t{2}, big);
    put(out, 0u, big);
    put(out, 1u, big);
    return out;
}

TEST(Ply, AllEncodingsAgree) {
    for (const std::string& text : {ply_ascii, ply_binary(false), ply_binary(true)}) {
        const LoadResult r = load_text("a.ply", text);
        ASSERT_TRUE(r.ok) << r.error.what;
        const scenes::Mesh& mesh = r.model.meshes[0];
        EXPECT_EQ(mesh.rest_positions, (std::vector<glm::vec3>{{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}}));
        EXPECT_EQ(mesh.indices, (std::vector<uint32_t>{0, 1, 2, 0, 2, 3}));
        EXPECT_EQ(mesh.albedo[0], glm::vec3(1, 0, 0));
        EXPECT_EQ(mesh.albedo[3], glm::vec3(0, 0, 1));
        EXPECT_EQ(r.model.warnings.size(), 1u); // the face with two corners
    }
}

TEST(Ply, Strips) {
    const LoadResult r = load_text(
        "a.ply",
        "ply\nformat ascii 1.0\nelement vertex 5\nproperty float x\nproperty float y\nproperty float z\n"
        "property float nx\nproperty float ny\nproperty float nz\nelement tristrips 1\n"
        "property list int int vertex_indices\nend_header\n"
        "0 0 0 0 0 3\n1 0 0 0 0 3\n0 1 0 0 0 3\n1 1 0 0 0 3\n2 2 0 0 0 0\n8 0 1 2 3 -1 2 3 4\n");
    ASSERT_TRUE(r.ok) << r.error.what;
    EXPECT_EQ(r.model.meshes[0].indices, (std::vector<uint32_t>{0, 1, 2, 2, 1, 3, 2, 3, 4}));
    EXPECT_EQ(r.model.meshes[0].rest_normals[0], glm::vec3(0, 0, 1));
    EXPECT_EQ(r.model.meshes_without_normals, 1u); // the last vertex's is zero
}

TEST(Ply, EveryCutIsAnError) {
    const Folder folder;
    for (const std::string& text : {ply_ascii, ply_binary(false), ply_binary(true)}) {
        for (size_t size = 0; size < text.size(); ++size) {
            const LoadResult r = load_model(folder.write("a.ply", text.substr(0, size)));
            EXPECT_TRUE(!r.ok || size + 1 == text.size()) << size; // but for the last line's end
        }
    }
}

TEST(Ply, Wrong) {
    const auto with = [](const std::string& from, const std::string& to) {
        std::string text = ply_ascii;
        text.replace(text.find(from), from.size(), to);
        return code(load_text("a.ply", text));
    };
    EXPECT_EQ(with("vertex 4", "vertex 4000000000"), "PLY_TRUNCATED");
    EXPECT_EQ(with("vertex 4", "vertex -4"), "PLY_HEADER");
    EXPECT_EQ(with("vertex 4", "vertex 99999999999999999999"), "PLY_HEADER");
    EXPECT_EQ(with("0 4 0 1 2 3", "0 4 0 1 2 4"), "PLY_INDEX");
    EXPECT_EQ(with("0 4 0 1 2 3", "0 4 0 1 2 -1"), "PLY_INDEX");
    EXPECT_EQ(with("0 4 0 1 2 3", "0 400000000 0 1 2 3"), "PLY_LIST");
    EXPECT_EQ(with("1 0 1 0 255", "1 0 nan 0 255"), "POSITION_NOT_FINITE");
    EXPECT_EQ(with("1 0 1 0 255", "1 0 1e300 0 255"), "POSITION_NOT_FINITE");
    EXPECT_EQ(with("1 0 1 0 255", "1 0 q 0 255"), "PLY_NUMBER");
    EXPECT_EQ(with("property float x", "property float q"), "PLY_HEADER");
    EXPECT_EQ(with("property float x", "property half x"), "PLY_HEADER");
    EXPECT_EQ(with("format ascii", "format morse"), "PLY_HEADER");
    EXPECT_EQ(with("end_header", "end_of"), "PLY_HEADER");
    EXPECT_EQ(with("\nproperty int a", ""), "PLY_TRUNCATED"); // an element without properties
    EXPECT_EQ(code(load_text("a.off", "OFF\n3 1 0\n")), "UNKNOWN_FORMAT");
    EXPECT_EQ(code(load_text("a.ply", "")), "EMPTY_FILE");
}

} // namespace
} // namespace nusselt::load::test
