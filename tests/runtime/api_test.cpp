// Every status of every public function.
#include "tests/runtime/fixture.h"

#include <cstdlib>
#include <cstring>
#include <limits>

namespace nusselt::test {

namespace {

#define EXPECT_CODE(call, wanted)                                                                            \
    do {                                                                                                     \
        const Status status_ = (call);                                                                       \
        EXPECT_EQ(status_.code, StatusCode::wanted) << status_.text;                                         \
        ASSERT_NE(status_.text, nullptr);                                                                    \
        EXPECT_GT(std::strlen(status_.text), status_.ok() ? 1u : 20u);                                       \
    } while (false)

// One triangle, everything set right; tests break one thing at a time.
struct Triangle {
    std::vector<float> positions{0, 0, 0, 1, 0, 0, 0, 0, -1}, normals{0, 1, 0, 0, 1, 0, 0, 1, 0};
    std::vector<uint32_t> indices{0, 1, 2};
    std::vector<float> transfer = std::vector<float>(75);
    std::vector<uint32_t> masks = std::vector<uint32_t>(3 * 128);
    MeshDesc desc{{positions.data(), 3, 12}, {normals.data(), 3, 12}, indices.data(), 3};

    FrameMesh use(MeshId mesh) {
        return {mesh,
                {positions.data(), 3, 12},
                {normals.data(), 3, 12},
                {transfer.data(), 3, 100},
                {masks.data(), 3, 128}};
    }
};

Status submit_one(Context* context, const FrameMesh& mesh, FrameId* id, Quality quality = Quality::standard) {
    return submit(context, {&mesh, 1, quality}, id);
}

TEST(ContextApi, ArgumentsAndIsas) {
    EXPECT_CODE(create_context({}, nullptr), invalid_argument);
    Context* context = reinterpret_cast<Context*>(1);
    ContextDesc desc;
    desc.allocator.allocate = [](void*, size_t, size_t) -> void* { return nullptr; };
    EXPECT_CODE(create_context(desc, &context), invalid_argument);
    EXPECT_EQ(context, nullptr);
    desc.allocator.release = [](void*, void*, size_t, size_t) {};
    EXPECT_CODE(create_context(desc, &context), out_of_memory);
    desc = {};
    desc.executor.enqueue = [](void*, void (*)(void*), void*) -> void* { return nullptr; };
    EXPECT_CODE(create_context(desc, &context), invalid_argument);
    EXPECT_CODE(create_context(with_isa(static_cast<Isa>(77)), &context), unsupported);
    EXPECT_EQ(context, nullptr);
    EXPECT_CODE(destroy_context(nullptr), ok);
    EXPECT_EQ(context_isa(nullptr), Isa::scalar);
    for (const Isa isa : {Isa::scalar, Isa::sse4, Isa::avx2, Isa::avx512}) {
        if (isa_available(isa)) {
            Engine engine(with_isa(isa));
            EXPECT_EQ(context_isa(engine.context), isa);
        } else {
            EXPECT_CODE(create_context(with_isa(isa), &context), unsupported);
        }
    }
}

struct Environment {
    explicit Environment(const char* value) { setenv("NUSSELT_ISA", value, 1); }
    ~Environment() { unsetenv("NUSSELT_ISA"); }
};

TEST(ContextApi, EnvironmentForcesTheIsaThatBestMeans) {
    for (const Isa isa : available_isas()) {
        const Environment forced(isa_name(isa));
        EXPECT_EQ(context_isa(Engine().context), isa);
        EXPECT_EQ(context_isa(Engine(with_isa(Isa::scalar)).context), Isa::scalar); // told otherwise
    }
    for (const char* best : {"best", ""}) {
        const Environment forced(best);
        EXPECT_EQ(context_isa(Engine().context), available_isas().back());
    }
    const Environment bogus("avx9000");
    Context* context = nullptr;
    EXPECT_CODE(create_context({}, &context), unsupported);
    EXPECT_EQ(context, nullptr);
}

TEST(ContextApi, IsaNames) {
    for (const Isa isa : {Isa::scalar, Isa::sse4, Isa::avx2, Isa::avx512, Isa::best}) {
        Isa back{};
        EXPECT_TRUE(isa_from_name(isa_name(isa), &back));
        EXPECT_EQ(back, isa);
    }
    Isa untouched = Isa::avx2;
    for (const char* name : {"", "SSE4", "avx", "avx5120", "unknown"})
        EXPECT_FALSE(isa_from_name(name, &untouched)) << name;
    EXPECT_FALSE(isa_from_name(nullptr, &untouched));
    EXPECT_FALSE(isa_from_name("avx2", nullptr));
    EXPECT_EQ(untouched, Isa::avx2);
    EXPECT_STREQ(isa_name(static_cast<Isa>(9)), "unknown");
    EXPECT_TRUE(isa_available(Isa::scalar));
    EXPECT_TRUE(isa_available(Isa::best));
    EXPECT_FALSE(isa_available(static_cast<Isa>(5)));
}

TEST(QualityApi, NamesAndBits) {
    for (const Quality quality : {Quality::paper, Quality::draft, Quality::standard, Quality::fine}) {
        Quality back{};
        EXPECT_TRUE(quality_from_name(quality_name(quality), &back));
        EXPECT_EQ(back, quality);
        EXPECT_EQ(quality_mask_bits(quality), quality == Quality::fine ? 4096u : 1024u);
    }
    Quality untouched = Quality::fine;
    EXPECT_FALSE(quality_from_name("best", &untouched));
    EXPECT_FALSE(quality_from_name(nullptr, &untouched));
    EXPECT_FALSE(quality_from_name("paper", nullptr));
    EXPECT_EQ(untouched, Quality::fine);
    EXPECT_STREQ(quality_name(static_cast<Quality>(4)), "unknown");
    EXPECT_EQ(quality_mask_bits(static_cast<Quality>(4)), 0u);
}

TEST(ExecutorApi, Arguments) {
    EXPECT_NE(serial_executor().enqueue, nullptr);
    EXPECT_NE(serial_executor().finish, nullptr);
    const Status status = create_tbb_executor(1, nullptr);
    EXPECT_TRUE(status.code == StatusCode::invalid_argument || status.code == StatusCode::unsupported);
    destroy_executor(nullptr);
    Executor serial = serial_executor();
    destroy_executor(&serial);
}

TEST(MeshApi, Arguments) {
    Engine engine;
    Triangle t;
    MeshId id{3, 3};
    EXPECT_CODE(add_mesh(nullptr, t.desc, &id), invalid_argument);
    EXPECT_CODE(add_mesh(engine.context, t.desc, nullptr), invalid_argument);
    const auto refused = [&](auto&& change) {
        MeshDesc desc = t.desc;
        change(desc);
        id = {3, 3};
        EXPECT_CODE(add_mesh(engine.context, desc, &id), invalid_argument);
        EXPECT_EQ(id.generation, 0u);
    };
    refused([](MeshDesc& d) { d.rest_positions.data = nullptr; });
    refused([](MeshDesc& d) { d.rest_positions.count = 0; });
    refused([](MeshDesc& d) { d.rest_positions.count = (size_t(1) << 27) + 1; });
    refused([](MeshDesc& d) { d.rest_positions.count = 2; }); // an index is out of range
    refused([](MeshDesc& d) { d.rest_positions.stride = 8; });
    refused([](MeshDesc& d) { d.rest_positions.stride = 14; });
    refused([](MeshDesc& d) { d.rest_normals.count = 2; });
    refused([](MeshDesc& d) { d.rest_normals.stride = 0; });
    refused([](MeshDesc& d) { d.rest_normals.stride = 13; });
    refused([](MeshDesc& d) { d.index_count = 2; });
    refused([](MeshDesc& d) { d.indices = nullptr; });
    refused([](MeshDesc& d) { d.index_count = (size_t(1) << 27) * 3 + 3; });
    t.indices[1] = 3;
    refused([](MeshDesc&) {});
    t.indices[1] = 0xFFFFFFFF;
    refused([](MeshDesc&) {});
    t.indices[1] = 1;
    EXPECT_CODE(add_mesh(engine.context, t.desc, &id), ok);
    MeshDesc bare = t.desc; // a mesh that only receives, without normals
    bare.rest_normals = {};
    bare.indices = nullptr;
    bare.index_count = 0;
    EXPECT_CODE(add_mesh(engine.context, bare, &id), ok);
}

TEST(MeshApi, Info) {
    Engine engine;
    Triangle t;
    MeshId id;
    ASSERT_TRUE(add_mesh(engine.context, t.desc, &id).ok());
    MeshInfo info;
    EXPECT_CODE(mesh_info(nullptr, id, &info), invalid_argument);
    EXPECT_CODE(mesh_info(engine.context, id, nullptr), invalid_argument);
    EXPECT_CODE(mesh_info(engine.context, {}, &info), stale_handle);
    EXPECT_CODE(mesh_info(engine.context, {99, 1}, &info), stale_handle);
    EXPECT_CODE(mesh_info(engine.context, id, &info), ok);
    EXPECT_EQ(info.vertices, 3u);
    EXPECT_EQ(info.triangles, 1u);
    EXPECT_EQ(info.welded_vertices, 3u);
    EXPECT_EQ(info.components, 1u);
    EXPECT_EQ(info.closed_components, 0u);
    EXPECT_EQ(info.boundary_edges, 3u);
    EXPECT_GE(info.levels, 1u);
    EXPECT_EQ(info.level_triangles[0], 1u);
    EXPECT_GT(info.bytes, 100u);
}

TEST(MeshApi, HandlesAreGenerational) {
    Engine engine;
    Triangle t;
    MeshId first, second;
    ASSERT_TRUE(add_mesh(engine.context, t.desc, &first).ok());
    EXPECT_CODE(remove_mesh(nullptr, first), invalid_argument);
    EXPECT_CODE(remove_mesh(engine.context, {}), stale_handle);
    EXPECT_CODE(remove_mesh(engine.context, {first.slot, first.generation + 1}), stale_handle);
    EXPECT_CODE(remove_mesh(engine.context, first), ok);
    EXPECT_CODE(remove_mesh(engine.context, first), stale_handle);
    ASSERT_TRUE(add_mesh(engine.context, t.desc, &second).ok());
    EXPECT_EQ(first.slot, second.slot); // taken again
    EXPECT_NE(first.generation, second.generation);
    MeshInfo info;
    FrameId frame;
    EXPECT_CODE(mesh_info(engine.context, first, &info), stale_handle);
    EXPECT_CODE(submit_one(engine.context, t.use(first), &frame), stale_handle);
    EXPECT_CODE(remove_mesh(engine.context, first), stale_handle);
    EXPECT_CODE(mesh_info(engine.context, second, &info), ok);
}

TEST(MeshApi, HandlesOfAnotherContextAreTold) {
    Engine a, b;
    Triangle t;
    MeshId of_a, of_b;
    ASSERT_TRUE(add_mesh(a.context, t.desc, &of_a).ok());
    ASSERT_TRUE(add_mesh(b.context, t.desc, &of_b).ok());
    MeshInfo info;
    FrameId frame;
    EXPECT_CODE(mesh_info(b.context, of_a, &info), stale_handle);
    EXPECT_CODE(remove_mesh(a.context, of_b), stale_handle);
    EXPECT_CODE(submit_one(b.context, t.use(of_a), &frame), stale_handle);
    ASSERT_TRUE(submit_one(a.context, t.use(of_a), &frame).ok());
    EXPECT_CODE(wait(b.context, frame, nullptr), stale_handle);
    Triangle other;
    FrameId frame_b;
    ASSERT_TRUE(submit_one(b.context, other.use(of_b), &frame_b).ok());
    EXPECT_CODE(wait(b.context, frame, nullptr), stale_handle);
    EXPECT_CODE(wait(a.context, frame, nullptr), ok);
    EXPECT_CODE(wait(b.context, frame_b, nullptr), ok);
}

TEST(FrameApi, Arguments) {
    Engine engine;
    Triangle t;
    MeshId id;
    ASSERT_TRUE(add_mesh(engine.context, t.desc, &id).ok());
    FrameId frame{5, 5};
    const FrameMesh good = t.use(id);
    EXPECT_CODE(submit_one(nullptr, good, &frame), invalid_argument);
    EXPECT_CODE(submit_one(engine.context, good, nullptr), invalid_argument);
    EXPECT_CODE(submit(engine.context, {nullptr, 1, Quality::standard}, &frame), invalid_argument);
    EXPECT_CODE(submit(engine.context, {&good, 0, Quality::standard}, &frame), invalid_argument);
    EXPECT_CODE(submit_one(engine.context, good, &frame, static_cast<Quality>(4)), invalid_argument);
    const FrameMesh twice[] = {good, good};
    EXPECT_CODE(submit(engine.context, {twice, 2, Quality::standard}, &frame), invalid_argument);
    const auto refused = [&](auto&& change, Quality quality = Quality::standard) {
        FrameMesh mesh = good;
        change(mesh);
        frame = {5, 5};
        EXPECT_CODE(submit_one(engine.context, mesh, &frame, quality), invalid_argument);
        EXPECT_EQ(frame.generation, 0u);
    };
    refused([](FrameMesh& m) { m.positions.data = nullptr; });
    refused([](FrameMesh& m) { m.normals.data = nullptr; });
    refused([](FrameMesh& m) { m.positions.count = 2; });
    refused([](FrameMesh& m) { m.normals.count = 4; });
    refused([](FrameMesh& m) { m.transfer.count = 0; });
    refused([](FrameMesh& m) { m.masks.count = 2; });
    refused([](FrameMesh& m) { m.positions.stride = 11; });
    refused([](FrameMesh& m) { m.positions.stride = 18; });
    refused([](FrameMesh& m) { m.normals.stride = 4; });
    refused([](FrameMesh& m) { m.transfer.stride = 96; });
    refused([](FrameMesh& m) { m.transfer.stride = 102; });
    refused([](FrameMesh& m) { m.masks.stride = 124; });
    refused([](FrameMesh& m) { m.masks.stride = 130; });
    refused([](FrameMesh& m) { m.masks.stride = 128; }, Quality::fine);
    refused([](FrameMesh& m) { m.transfer = {}; }); // masks without transfer
    FrameMesh null = good;
    null.mesh = {};
    EXPECT_CODE(submit_one(engine.context, null, &frame), stale_handle);
    FrameMesh fine = good;
    fine.masks.stride = 512;
    EXPECT_CODE(submit_one(engine.context, fine, &frame, Quality::fine), ok);
    EXPECT_CODE(wait(engine.context, frame, nullptr), ok);
}

TEST(FrameApi, HandlesAreSpentByWait) {
    Engine engine;
    Triangle t;
    MeshId id;
    ASSERT_TRUE(add_mesh(engine.context, t.desc, &id).ok());
    FrameId first, second;
    FrameStats stats;
    EXPECT_CODE(wait(nullptr, {}, &stats), invalid_argument);
    EXPECT_CODE(wait(engine.context, {}, &stats), stale_handle);
    EXPECT_CODE(submit_one(engine.context, t.use(id), &first), ok);
    EXPECT_CODE(wait(engine.context, {first.slot, first.generation + 1}, &stats), stale_handle);
    EXPECT_CODE(wait(engine.context, {first.slot + 1, first.generation}, &stats), stale_handle);
    EXPECT_CODE(wait(engine.context, first, nullptr), ok);
    EXPECT_CODE(wait(engine.context, first, &stats), stale_handle);
    EXPECT_CODE(submit_one(engine.context, t.use(id), &second), ok);
    EXPECT_CODE(wait(engine.context, first, &stats), stale_handle);
    EXPECT_CODE(wait(engine.context, second, &stats), ok);
    EXPECT_EQ(stats.receivers, 3u);
}

TEST(FrameApi, BusyUntilWaited) {
    Context* context = nullptr;
    ASSERT_TRUE(create_context({}, &context).ok());
    Triangle t, other;
    MeshId id, other_id;
    ASSERT_TRUE(add_mesh(context, t.desc, &id).ok());
    ASSERT_TRUE(add_mesh(context, other.desc, &other_id).ok());
    FrameId frame, second;
    ASSERT_TRUE(submit_one(context, t.use(id), &frame).ok());
    EXPECT_CODE(submit_one(context, t.use(id), &second), busy);
    EXPECT_CODE(remove_mesh(context, id), busy);
    EXPECT_CODE(destroy_context(context), busy);
    // Another mesh is free, and several frames may be in flight.
    EXPECT_CODE(submit_one(context, other.use(other_id), &second), ok);
    MeshId late; // meshes come and go meanwhile
    EXPECT_CODE(add_mesh(context, t.desc, &late), ok);
    EXPECT_CODE(remove_mesh(context, late), ok);
    EXPECT_CODE(wait(context, frame, nullptr), ok);
    EXPECT_CODE(remove_mesh(context, id), ok);
    EXPECT_CODE(destroy_context(context), busy);
    EXPECT_CODE(wait(context, second, nullptr), ok);
    EXPECT_CODE(destroy_context(context), ok);
}

TEST(FrameApi, AnExecutorThatPromisesTooManyThreads) {
    ContextDesc desc;
    desc.executor = serial_executor();
    desc.executor.concurrency = std::numeric_limits<uint32_t>::max();
    Engine engine(desc);
    Triangle t;
    MeshId id;
    ASSERT_TRUE(add_mesh(engine.context, t.desc, &id).ok());
    FrameId frame;
    EXPECT_CODE(submit_one(engine.context, t.use(id), &frame), ok);
    EXPECT_CODE(wait(engine.context, frame, nullptr), ok);
}

TEST(LightingApi, Arguments) {
    Engine engine;
    float light[75] = {}, pixel[3] = {1, 1, 1}, transfer[50] = {}, rgb[6], albedo[6] = {};
    uint64_t bad = 5;
    EXPECT_CODE(sh_project_latlong(nullptr, 1, 1, light, &bad), invalid_argument);
    EXPECT_CODE(sh_project_latlong(pixel, 0, 1, light, &bad), invalid_argument);
    EXPECT_CODE(sh_project_latlong(pixel, 1, 0, light, &bad), invalid_argument);
    EXPECT_CODE(sh_project_latlong(pixel, 1, 1, nullptr, &bad), invalid_argument);
    EXPECT_CODE(sh_project_latlong(pixel, 1, 1, light, nullptr), ok);
    const TransferView view{transfer, 2, 100};
    EXPECT_CODE(shade(nullptr, light, view, {}, rgb), invalid_argument);
    EXPECT_CODE(shade(engine.context, nullptr, view, {}, rgb), invalid_argument);
    EXPECT_CODE(shade(engine.context, light, {nullptr, 2, 100}, {}, rgb), invalid_argument);
    EXPECT_CODE(shade(engine.context, light, view, {}, nullptr), invalid_argument);
    EXPECT_CODE(shade(engine.context, light, {transfer, 2, 99}, {}, rgb), invalid_argument);
    EXPECT_CODE(shade(engine.context, light, {transfer, 2, 102}, {}, rgb), invalid_argument);
    EXPECT_CODE(shade(engine.context, light, view, {albedo, 1, 12}, rgb), invalid_argument);
    EXPECT_CODE(shade(engine.context, light, view, {albedo, 2, 8}, rgb), invalid_argument);
    EXPECT_CODE(shade(engine.context, light, view, {albedo, 2, 14}, rgb), invalid_argument);
    EXPECT_CODE(shade(engine.context, light, view, {albedo, 2, 12}, rgb), ok);
    EXPECT_CODE(shade(engine.context, light, {nullptr, 0, 100}, {}, rgb), ok);
}

TEST(VersionApi, Says) {
    EXPECT_EQ(version(), uint32_t(NUSSELT_VERSION));
    ASSERT_NE(configuration(), nullptr);
    EXPECT_EQ(std::strchr(configuration(), '\n'), nullptr);
    EXPECT_GT(std::strlen(configuration()), 10u);
}

} // namespace

} // namespace nusselt::test
