// Meshes that only receive, and meshes that share their levels of detail.
#include "tests/runtime/fixture.h"

#include <nusselt/c.h>

#include <algorithm>

namespace nusselt::test {

namespace {

using Transfers = std::vector<std::array<float, 25>>;

// All meshes receive; those of `receive_only` hide nothing.
std::vector<Transfers> run(Context* context, const std::vector<Posed>& meshes,
                           const std::vector<uint32_t>& receive_only, Quality quality = Quality::standard) {
    std::vector<Transfers> out(meshes.size());
    std::vector<FrameMesh> frame = frame_of(meshes);
    for (size_t m = 0; m < meshes.size(); ++m) {
        out[m].resize(meshes[m].positions.size());
        frame[m].transfer = {out[m][0].data(), out[m].size(), 100};
        frame[m].receive_only = receive_only[m];
    }
    FrameDesc desc;
    desc.meshes = frame.data();
    desc.mesh_count = uint32_t(frame.size());
    desc.quality = quality;
    FrameId id;
    const Status started = submit(context, desc, &id);
    EXPECT_TRUE(started.ok()) << started.text;
    if (started.ok()) {
        EXPECT_TRUE(wait(context, id, nullptr).ok());
    }
    return out;
}

scenes::Mesh without_triangles(scenes::Mesh mesh) {
    mesh.indices.clear();
    return mesh;
}

// What only receives gets what its bare vertices would, and leaves the others as if it were not there.
TEST(Roles, ReceiveOnlyHidesNothing) {
    const scenes::Scene scene = scenes::builtin("chess");
    for (const Quality quality : {Quality::standard, Quality::paper}) {
        Engine engine;
        std::vector<Posed> meshes = posed(scene, add_all(engine.context, scene), 0.4);
        ASSERT_GE(meshes.size(), 2u);
        std::vector<uint32_t> roles(meshes.size(), 0);
        roles[0] = 1;
        const std::vector<Transfers> ours = run(engine.context, meshes, roles, quality);
        Posed bare = meshes[0];
        bare.mesh = add(engine.context, without_triangles(scene.meshes[0]));
        std::vector<Posed> instead = meshes;
        instead[0] = bare;
        const std::vector<Transfers> theirs =
            run(engine.context, instead, std::vector<uint32_t>(meshes.size(), 0), quality);
        for (size_t m = 0; m < meshes.size(); ++m)
            EXPECT_EQ(ours[m], theirs[m]) << quality_name(quality) << " " << m;
        EXPECT_NE(ours, run(engine.context, meshes, std::vector<uint32_t>(meshes.size(), 0), quality));
    }
}

TEST(Roles, NoBlockersAtAll) {
    Engine engine;
    const scenes::Scene scene = scenes::builtin("fight");
    const std::vector<Posed> meshes = posed(scene, add_all(engine.context, scene), 0);
    const std::vector<Transfers> open = run(engine.context, meshes, std::vector<uint32_t>(meshes.size(), 1));
    for (const auto& t : open[0])
        EXPECT_NEAR(t[0], 0.28209479f, 1e-4f); // all of the sky
}

TEST(Roles, SharedMeshesAreMeshesOfTheirOwn) {
    Engine engine;
    scenes::Scene scene = scenes::builtin("fight");
    const MeshId first = add(engine.context, scene.meshes[0]), copy = add(engine.context, scene.meshes[0]);
    MeshId shared;
    ASSERT_TRUE(share_mesh(engine.context, first, &shared).ok());
    scenes::Pose pose, later;
    scene.pose(0.2, pose);
    scene.pose(0.9, later);
    for (glm::vec3& p : later.positions[0])
        p.x += 0.8f;
    const auto frame = [&](MeshId other) {
        return run(
            engine.context,
            {{first, pose.positions[0], pose.normals[0]}, {other, later.positions[0], later.normals[0]}},
            {0, 0});
    };
    const std::vector<Transfers> ours = frame(shared), theirs = frame(copy);
    EXPECT_EQ(ours, theirs);
    MeshInfo a, b;
    ASSERT_TRUE(mesh_info(engine.context, first, &a).ok());
    ASSERT_TRUE(mesh_info(engine.context, shared, &b).ok());
    EXPECT_EQ(a.clusters, b.clusters);
    // The first handle goes, the data stays.
    ASSERT_TRUE(remove_mesh(engine.context, first).ok());
    EXPECT_EQ(mesh_info(engine.context, first, &a).code, StatusCode::stale_handle);
    MeshId again;
    EXPECT_EQ(share_mesh(engine.context, first, &again).code, StatusCode::stale_handle);
    ASSERT_TRUE(share_mesh(engine.context, shared, &again).ok());
    const auto after =
        run(engine.context,
            {{again, pose.positions[0], pose.normals[0]}, {shared, later.positions[0], later.normals[0]}},
            {0, 0});
    EXPECT_EQ(after, theirs);
    ASSERT_TRUE(remove_mesh(engine.context, shared).ok());
    ASSERT_TRUE(remove_mesh(engine.context, again).ok());
    nusselt_mesh c;
    EXPECT_EQ(nusselt_share_mesh(reinterpret_cast<nusselt_context*>(engine.context),
                                 {copy.slot, copy.generation}, &c)
                  .code,
              uint32_t(NUSSELT_OK)); // left to the context
}

} // namespace

} // namespace nusselt::test
