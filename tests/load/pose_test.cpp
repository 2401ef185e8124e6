// Clips, skins and morph targets against poses worked out by hand (glTF 2.0, appendix C).
#include "gltf_builder.h"

#include <glm/geometric.hpp>
#include <gtest/gtest.h>

#include <cmath>
#include <thread>

namespace nusselt::load::test {
namespace {

const float half = std::sqrt(0.5f);

// A node with the triangle, moved; vertex 1 is at (1, 0, 0), vertex 2 at (0, 1, 0).
LoadResult moved(const char* path, const char* interpolation, std::initializer_list<float> times,
                 std::initializer_list<float> values, const char* type) {
    Gltf gltf;
    const int node = gltf.node({{"mesh", gltf.triangle()}});
    gltf.animate(node, path, interpolation, times, values, type);
    return gltf.load();
}

TEST(Clips, TranslationStep) {
    const LoadResult r = moved("translation", "STEP", {1, 2, 4}, {1, 2, 3, 5, 6, 7, 9, 9, 9}, "VEC3");
    ASSERT_TRUE(r.ok) << r.error.what;
    EXPECT_EQ(r.model.clips[0].duration, 4.0);
    EXPECT_EQ(r.model.clips[0].paths, std::vector<std::string>{"translation"});
    EXPECT_EQ(position(r.model, 0, 0.0, 0, 0), glm::vec3(1, 2, 3)); // before the first key
    EXPECT_EQ(position(r.model, 0, 1.99, 0, 0), glm::vec3(1, 2, 3));
    EXPECT_EQ(position(r.model, 0, 2.0, 0, 0), glm::vec3(5, 6, 7));
    EXPECT_EQ(position(r.model, 0, 3.9, 0, 0), glm::vec3(5, 6, 7));
    EXPECT_EQ(position(r.model, 0, 4.0, 0, 0), glm::vec3(9, 9, 9));
    EXPECT_EQ(position(r.model, 0, 99.0, 0, 0), glm::vec3(9, 9, 9)); // clamped to the clip
    EXPECT_EQ(position(r.model, -1, 3.0, 0, 0), glm::vec3(0, 0, 0)); // as the nodes stand
}

TEST(Clips, TranslationLinear) {
    const LoadResult r = moved("translation", "LINEAR", {0, 2, 4}, {0, 0, 0, 4, -2, 1, 4, 0, 1}, "VEC3");
    ASSERT_TRUE(r.ok) << r.error.what;
    EXPECT_TRUE(near(position(r.model, 0, 0.5, 0, 0), {1, -0.5f, 0.25f}));
    EXPECT_TRUE(near(position(r.model, 0, 3.0, 0, 1), {5, -1, 1}));
}

TEST(Clips, TranslationCubicScalesTangentsByTheInterval) {
    // Keys at 0 and 2 s. At u = 1/2: h00 = h01 = 1/2, h10 = 1/8, h11 = -1/8, tangents times 2 s.
    const LoadResult r = moved("translation", "CUBICSPLINE", {0, 2},
                               {9, 9, 9, 1, 0, 0, 0, 8, 0, /**/ 0, 0, 16, 3, 0, 0, 9, 9, 9}, "VEC3");
    ASSERT_TRUE(r.ok) << r.error.what;
    EXPECT_TRUE(near(position(r.model, 0, 1.0, 0, 0), {2, 2, -4}));
    EXPECT_TRUE(near(position(r.model, 0, 0.0, 0, 0), {1, 0, 0}));
    EXPECT_TRUE(near(position(r.model, 0, 2.0, 0, 0), {3, 0, 0}));
    // u = 1/4: h00 = 27/32, h10 = 9/64, h01 = 5/32, h11 = -3/64.
    EXPECT_TRUE(near(position(r.model, 0, 0.5, 0, 0),
                     {27.0f / 32 + 15.0f / 32, 2 * 8 * 9.0f / 64, -2 * 16 * 3.0f / 64}));
}

TEST(Clips, RotationStepAndLinear) {
    // 0 and 90 degrees about z.
    const std::initializer_list<float> turn = {0, 0, 0, 1, 0, 0, half, half};
    const LoadResult step = moved("rotation", "STEP", {0, 1}, turn, "VEC4");
    ASSERT_TRUE(step.ok) << step.error.what;
    EXPECT_TRUE(near(position(step.model, 0, 0.9, 0, 1), {1, 0, 0}));
    EXPECT_TRUE(near(position(step.model, 0, 1.0, 0, 1), {0, 1, 0}));
    const LoadResult linear = moved("rotation", "LINEAR", {0, 1}, turn, "VEC4");
    ASSERT_TRUE(linear.ok) << linear.error.what;
    // Spherical: a third of the time is 30 degrees exactly.
    EXPECT_TRUE(near(position(linear.model, 0, 1.0 / 3, 0, 1), {std::sqrt(3.0f) / 2, 0.5f, 0}));
    EXPECT_TRUE(near(normal(linear.model, 0, 0.5, 0, 1), {0, 0, 1}));
}

TEST(Clips, RotationTakesTheShorterWay) {
    // -q is the same turn; the way from 0 to 90 degrees must not become 270.
    const LoadResult r = moved("rotation", "LINEAR", {0, 1}, {0, 0, 0, 1, 0, 0, -half, -half}, "VEC4");
    ASSERT_TRUE(r.ok) << r.error.what;
    EXPECT_TRUE(near(position(r.model, 0, 0.5, 0, 1), {half, half, 0}));
}

TEST(Clips, RotationCubicIsNormalised) {
    // No tangents, u = 1/2: the mean of the two quaternions, (0, 0, s, (1 + s)/2) normalised: 45 degrees.
    const LoadResult r =
        moved("rotation", "CUBICSPLINE", {0, 1},
              {0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, half, half, 0, 0, 0, 0}, "VEC4");
    ASSERT_TRUE(r.ok) << r.error.what;
    EXPECT_TRUE(near(position(r.model, 0, 0.5, 0, 1), {half, half, 0}));
}

TEST(Clips, ScaleStepLinearCubic) {
    const LoadResult step = moved("scale", "STEP", {0, 1}, {1, 1, 1, 2, 3, 4}, "VEC3");
    const LoadResult linear = moved("scale", "LINEAR", {0, 1}, {1, 1, 1, 2, 3, 4}, "VEC3");
    const LoadResult cubic =
        moved("scale", "CUBICSPLINE", {0, 1}, {0, 0, 0, 1, 1, 1, 8, 0, 0, 0, 0, 0, 2, 3, 4, 0, 0, 0}, "VEC3");
    ASSERT_TRUE(step.ok && linear.ok && cubic.ok);
    EXPECT_TRUE(near(position(step.model, 0, 0.5, 0, 2), {0, 1, 0}));
    EXPECT_TRUE(near(position(linear.model, 0, 0.5, 0, 2), {0, 2, 0}));
    EXPECT_TRUE(near(position(cubic.model, 0, 0.5, 0, 1), {2.5f, 0, 0}));
    EXPECT_TRUE(near(position(cubic.model, 0, 0.5, 0, 2), {0, 2, 0}));
}

TEST(Clips, NormalizedRotations) {
    Gltf gltf;
    const int node = gltf.node({{"mesh", gltf.triangle()}});
    const int input = gltf.floats({0, 1}, "SCALAR");
    const int output =
        gltf.accessor(bytes_of<int8_t>({0, 0, 0, 127, 0, 0, 127, 0}), byte_type, "VEC4", 2, true);
    push(gltf.root["animations"],
         {{"samplers", {{{"input", input}, {"output", output}}}},
          {"channels", {{{"sampler", 0}, {"target", {{"node", node}, {"path", "rotation"}}}}}}});
    const LoadResult r = gltf.load();
    ASSERT_TRUE(r.ok) << r.error.what;
    EXPECT_TRUE(near(position(r.model, 0, 1.0, 0, 1), {-1, 0, 0}));
    EXPECT_TRUE(near(position(r.model, 0, 0.5, 0, 1), {0, 1, 0}));
}

TEST(Clips, HierarchyAndMatrices) {
    Gltf gltf;
    const int mesh = gltf.triangle();
    gltf.node({{"children", {1}}, {"translation", {10, 0, 0}}, {"scale", {2, 2, 2}}});
    // Columns: x to y, y to -x, moved by (0, 0, 1).
    gltf.node({{"children", {2}}, {"matrix", {0, 1, 0, 0, -1, 0, 0, 0, 0, 0, 1, 0, 0, 0, 1, 1}}});
    gltf.node({{"mesh", mesh}, {"translation", {3, 0, 0}}});
    // A clip that moves the node with a matrix keeps its turn.
    gltf.animate(1, "translation", "STEP", {0}, {0, 0, 5}, "VEC3");
    const LoadResult r = gltf.load();
    ASSERT_TRUE(r.ok) << r.error.what;
    EXPECT_TRUE(near(position(r.model, -1, 0, 0, 0), {10, 6, 2}));
    EXPECT_TRUE(near(position(r.model, -1, 0, 0, 1), {10, 8, 2}));
    EXPECT_TRUE(near(position(r.model, 0, 0, 0, 1), {10, 8, 10}));
}

TEST(Clips, NonUniformScaleTurnsNormalsByTheInverseTranspose) {
    Gltf gltf;
    const int mesh = gltf.triangle();
    gltf.primitive(mesh)["attributes"]["NORMAL"] =
        gltf.floats({half, half, 0, half, half, 0, half, half, 0}, "VEC3");
    gltf.node({{"mesh", mesh}, {"scale", {2, 1, 1}}});
    const LoadResult r = gltf.load();
    ASSERT_TRUE(r.ok) << r.error.what;
    const float length = std::sqrt(0.25f + 1.0f);
    EXPECT_TRUE(near(normal(r.model, -1, 0, 0, 0), {0.5f / length, 1 / length, 0}));
}

TEST(Clips, NegativeScaleKeepsFacesOutside) {
    for (const bool with_normals : {false, true}) {
        Gltf gltf;
        const int mesh = gltf.triangle();
        if (with_normals)
            gltf.primitive(mesh)["attributes"]["NORMAL"] = gltf.floats({0, 0, 1, 0, 0, 1, 0, 0, 1}, "VEC3");
        gltf.node({{"mesh", mesh}, {"scale", {-1, 1, 1}}});
        gltf.node({{"mesh", mesh}, {"scale", {-1, -1, 1}}}); // twice mirrored is turned
        const LoadResult r = gltf.load();
        ASSERT_TRUE(r.ok) << r.error.what;
        EXPECT_EQ(r.model.meshes[0].indices, (std::vector<uint32_t>{0, 2, 1}));
        EXPECT_EQ(r.model.meshes[1].indices, (std::vector<uint32_t>{0, 1, 2}));
        scenes::Pose pose;
        make_scene(r.model, -1).pose(0, pose);
        for (size_t m = 0; m < 2; ++m) {
            const auto& p = pose.positions[m];
            const auto& i = r.model.meshes[m].indices;
            const glm::vec3 face = glm::cross(p[i[1]] - p[i[0]], p[i[2]] - p[i[0]]);
            EXPECT_GT(face.z, 0.0f);
            EXPECT_TRUE(near(pose.normals[m][0], {0, 0, 1})) << with_normals;
            // The stored rest pose is outside out as well.
            const scenes::Mesh& mesh_at_rest = r.model.meshes[m];
            const auto& q = mesh_at_rest.rest_positions;
            EXPECT_GT(
                glm::dot(glm::cross(q[i[1]] - q[i[0]], q[i[2]] - q[i[0]]), mesh_at_rest.rest_normals[0]),
                0.0f);
        }
    }
}

// A strip of four vertices along x; two joints, the second at x = 1.
Gltf two_joints(int weights_accessor_of(Gltf&) = nullptr) {
    Gltf gltf;
    const int positions = gltf.floats({0, 0, 0, 1, 0, 0, 2, 0, 0, 0, 1, 0}, "VEC3");
    const int joints = gltf.accessor(bytes_of<uint8_t>({0, 0, 0, 0, 0, 1, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0}),
                                     ubyte_type, "VEC4", 4);
    const int weights = weights_accessor_of
                            ? weights_accessor_of(gltf)
                            : gltf.floats({1, 0, 0, 0, 0.5f, 0.5f, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0}, "VEC4");
    const int normals = gltf.floats({0, 1, 0, 0, 1, 0, 0, 1, 0, 0, 1, 0}, "VEC3");
    const int indices = gltf.accessor(bytes_of<uint16_t>({0, 1, 3, 1, 2, 3}), ushort_type, "SCALAR", 6);
    push(gltf.root["meshes"],
         {{"primitives",
           {{{"attributes",
              {{"POSITION", positions}, {"NORMAL", normals}, {"JOINTS_0", joints}, {"WEIGHTS_0", weights}}},
             {"indices", indices}}}}});
    const int inverse = gltf.floats({1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0,  0, 0, 1, //
                                     1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, -1, 0, 0, 1},
                                    "MAT4");
    gltf.node(
        {{"mesh", 0}, {"skin", 0}, {"translation", {100, 100, 100}}}); // its own transform must not matter
    gltf.node({{"children", {2}}});
    gltf.node({{"translation", {1, 0, 0}}});
    push(gltf.root["skins"], {{"joints", {1, 2}}, {"inverseBindMatrices", inverse}});
    gltf.animate(2, "rotation", "LINEAR", {0, 1}, {0, 0, 0, 1, 0, 0, half, half}, "VEC4");
    return gltf;
}

TEST(Skins, TwoJointsBent) {
    const LoadResult r = two_joints().load();
    ASSERT_TRUE(r.ok) << r.error.what;
    for (size_t v = 0; v < 4; ++v) {
        EXPECT_TRUE(near(position(r.model, 0, 0, 0, v), r.model.meshes[0].rest_positions[v]));
    }
    // The second joint turned by 90 degrees about z at (1, 0, 0).
    EXPECT_TRUE(near(position(r.model, 0, 1, 0, 0), {0, 0, 0}));
    EXPECT_TRUE(near(position(r.model, 0, 1, 0, 1), {1, 0, 0}));
    EXPECT_TRUE(near(position(r.model, 0, 1, 0, 2), {1, 1, 0}));
    EXPECT_TRUE(near(normal(r.model, 0, 1, 0, 2), {-1, 0, 0}));
    EXPECT_TRUE(near(normal(r.model, 0, 1, 0, 1), {-half, half, 0}));
    EXPECT_EQ(r.model.joints, 2u);
}

TEST(Skins, WeightsAreNormalised) {
    // Three and one in quarters of what they should be; bytes.
    const LoadResult r =
        two_joints([](Gltf& gltf) {
            return gltf.accessor(bytes_of<uint8_t>({51, 0, 0, 0, 30, 30, 0, 0, 7, 0, 0, 0, 255, 0, 0, 0}),
                                 ubyte_type, "VEC4", 4, true);
        }).load();
    ASSERT_TRUE(r.ok) << r.error.what;
    EXPECT_TRUE(near(position(r.model, 0, 1, 0, 2), {1, 1, 0}));
    EXPECT_TRUE(near(position(r.model, 0, 1, 0, 1), {1, 0, 0}));
}

TEST(Skins, EightInfluences) {
    Gltf gltf = two_joints();
    json& attributes = gltf.primitive()["attributes"];
    // Vertex 2 hangs on joint 1 by a fifth influence; the first four say joint 0 for half of it.
    attributes["WEIGHTS_0"] = gltf.floats({1, 0, 0, 0, 1, 0, 0, 0, 0, 0.5f, 0, 0, 1, 0, 0, 0}, "VEC4");
    attributes["JOINTS_1"] = gltf.accessor(
        bytes_of<uint16_t>({0, 0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0}), ushort_type, "VEC4", 4);
    attributes["WEIGHTS_1"] = gltf.floats({0, 0, 0, 0, 0, 0, 0, 0, 0.5f, 0, 0, 0, 0, 0, 0, 0}, "VEC4");
    const LoadResult r = gltf.load();
    ASSERT_TRUE(r.ok) << r.error.what;
    EXPECT_TRUE(near(position(r.model, 0, 1, 0, 2), {1.5f, 0.5f, 0}));
}

TEST(Skins, MirroredByTheRootJoint) {
    Gltf gltf = two_joints();
    gltf.root["nodes"][1]["scale"] = {-1, 1, 1};
    const LoadResult r = gltf.load();
    ASSERT_TRUE(r.ok) << r.error.what;
    EXPECT_EQ(r.model.meshes[0].indices, (std::vector<uint32_t>{0, 3, 1, 1, 3, 2}));
    EXPECT_TRUE(near(position(r.model, -1, 0, 0, 2), {-2, 0, 0}));
    EXPECT_TRUE(near(normal(r.model, -1, 0, 0, 2), {0, 1, 0}));
}

TEST(Skins, JointOutOfRange) {
    Gltf gltf = two_joints();
    gltf.root["skins"][0]["joints"] = {1};
    const LoadResult r = gltf.load();
    ASSERT_FALSE(r.ok);
    EXPECT_EQ(r.error.code, "JOINT_OOB");
}

// Two targets: up by 1, and out by (0, 0, 2) with a normal that leans.
Gltf morphs() {
    Gltf gltf;
    const int mesh = gltf.triangle();
    json& primitive = gltf.primitive(mesh);
    primitive["attributes"]["NORMAL"] = gltf.floats({0, 0, 1, 0, 0, 1, 0, 0, 1}, "VEC3");
    const int up = gltf.floats({0, 1, 0, 0, 1, 0, 0, 1, 0}, "VEC3");
    const int out = gltf.floats({0, 0, 2, 0, 0, 2, 0, 0, 2}, "VEC3");
    const int lean = gltf.floats({1, 0, 0, 1, 0, 0, 1, 0, 0}, "VEC3");
    primitive["targets"] = {{{"POSITION", up}}, {{"POSITION", out}, {"NORMAL", lean}}};
    gltf.node({{"mesh", mesh}});
    return gltf;
}

TEST(Morphs, WeightsOfMeshAndNode) {
    Gltf gltf = morphs();
    gltf.root["meshes"][0]["weights"] = {0.5, 0};
    gltf.node({{"mesh", 0}, {"weights", {0, 1}}});
    const LoadResult r = gltf.load();
    ASSERT_TRUE(r.ok) << r.error.what;
    EXPECT_TRUE(near(position(r.model, -1, 0, 0, 0), {0, 0.5f, 0}));
    EXPECT_TRUE(near(position(r.model, -1, 0, 1, 0), {0, 0, 2}));
    EXPECT_TRUE(near(normal(r.model, -1, 0, 1, 0), {half, 0, half}));
    EXPECT_EQ(r.model.meshes[1].rest_positions[0], glm::vec3(0, 0, 0)); // no target applied
}

TEST(Morphs, AnimatedStepLinearCubic) {
    Gltf gltf = morphs();
    gltf.animate(0, "weights", "STEP", {0, 1}, {0.25f, 0, 0, 1}, "SCALAR");
    gltf.animate(0, "weights", "LINEAR", {0, 2}, {0, 0, 1, 0.5f}, "SCALAR");
    // A key: in-tangents of both weights, both values, out-tangents of both.
    gltf.animate(0, "weights", "CUBICSPLINE", {0, 2}, {0, 0, 0, 0, 4, 0, /**/ 0, 0, 1, 0, 0, 0}, "SCALAR");
    const LoadResult r = gltf.load();
    ASSERT_TRUE(r.ok) << r.error.what;
    EXPECT_TRUE(near(position(r.model, 0, 0.5, 0, 0), {0, 0.25f, 0}));
    EXPECT_TRUE(near(position(r.model, 0, 1, 0, 0), {0, 0, 2}));
    EXPECT_TRUE(near(position(r.model, 1, 1, 0, 0), {0, 0.5f, 0.5f}));
    EXPECT_TRUE(near(position(r.model, 2, 1, 0, 0), {0, 0.5f + 2 * 4.0f / 8, 0}));
}

TEST(Normals, MissingOnesFollowThePoseAcrossSeams) {
    // Two triangles that share an edge by position only, folded along it by a morph target.
    Gltf gltf;
    const int positions = gltf.floats({0, 0, 0, 1, 0, 0, 0, 1, 0, /**/ 0, 0, 0, 0, 1, 0, -1, 0, 0}, "VEC3");
    const int fold = gltf.floats({0, 0, 0, 0, 0, 0, 0, 0, 0, /**/ 0, 0, 0, 0, 0, 0, 1, 0, -1}, "VEC3");
    push(
        gltf.root["meshes"],
        {{"primitives", {{{"attributes", {{"POSITION", positions}}}, {"targets", {{{"POSITION", fold}}}}}}}});
    gltf.node({{"mesh", 0}});
    gltf.animate(0, "weights", "LINEAR", {0, 1}, {0, 1}, "SCALAR");
    const LoadResult r = gltf.load();
    ASSERT_TRUE(r.ok) << r.error.what;
    EXPECT_EQ(r.model.meshes_without_normals, 1u);
    for (size_t v = 0; v < 6; ++v) {
        EXPECT_TRUE(near(normal(r.model, 0, 0, 0, v), {0, 0, 1}));
    }
    EXPECT_TRUE(near(normal(r.model, 0, 1, 0, 0), {-half, 0, half})); // both faces, equal areas
    EXPECT_TRUE(near(normal(r.model, 0, 1, 0, 3), {-half, 0, half}));
    EXPECT_TRUE(near(normal(r.model, 0, 1, 0, 1), {0, 0, 1}));
    EXPECT_TRUE(near(normal(r.model, 0, 1, 0, 5), {-1, 0, 0}));
}

TEST(Scenes, PosesAreThreadSafe) {
    const LoadResult r = two_joints().load();
    ASSERT_TRUE(r.ok) << r.error.what;
    const scenes::Scene scene = make_scene(r.model, 0);
    const auto work = [&](std::vector<glm::vec3>& out) {
        scenes::Pose pose;
        for (int i = 0; i <= 200; ++i) {
            scene.pose(i / 200.0, pose);
            out.push_back(pose.positions[0][2]);
        }
    };
    std::vector<glm::vec3> a, b;
    std::thread other(work, std::ref(a));
    work(b);
    other.join();
    EXPECT_EQ(a, b);
}

TEST(Scenes, OutliveTheModel) {
    scenes::Scene scene;
    {
        const LoadResult r = two_joints().load();
        ASSERT_TRUE(r.ok) << r.error.what;
        scene = make_scene(r.model, 0);
    }
    scenes::Pose pose;
    scene.pose(1, pose);
    EXPECT_TRUE(near(pose.positions[0][2], {1, 1, 0}));
    EXPECT_EQ(scene.duration, 1.0);
}

} // namespace
} // namespace nusselt::load::test
