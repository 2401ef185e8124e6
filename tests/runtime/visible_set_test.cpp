// Potentially visible sets: on recorded frames they change nothing, and a file is taken whole or not at all.
#include "tests/runtime/fixture.h"

#include <nusselt/visible_set.h>

#include <cstring>

namespace nusselt::test {

namespace {

struct Set {
    Context* context;
    VisibleSet* set = nullptr;
    Status status;

    Set(Context* c, const std::vector<MeshId>& meshes, Quality quality, uint32_t segments) : context(c) {
        status = create_visible_set(c, meshes.data(), uint32_t(meshes.size()), quality, segments, &set);
        EXPECT_TRUE(status.ok()) << status.text;
    }
    Set(Context* c, const std::vector<MeshId>& meshes, const std::vector<char>& file) : context(c) {
        status = read_visible_set(c, meshes.data(), uint32_t(meshes.size()), file.data(), file.size(), &set);
    }
    ~Set() { destroy_visible_set(context, set); }
    Set(const Set&) = delete;
    Set& operator=(const Set&) = delete;

    std::vector<char> file() const {
        std::vector<char> bytes(visible_set_bytes(set));
        EXPECT_TRUE(write_visible_set(set, bytes.data(), bytes.size()).ok());
        return bytes;
    }
    VisibleSetInfo info() const {
        VisibleSetInfo out;
        EXPECT_TRUE(visible_set_info(set, &out).ok());
        return out;
    }
};

Outputs recorded(Context* context, const std::vector<Posed>& frame, const Set& set, Quality quality,
                 uint32_t segment) {
    FrameDesc settings;
    settings.quality = quality;
    settings.record = set.set;
    settings.visible_segment = segment;
    return run_frame(context, frame, settings);
}

Outputs with(Context* context, const std::vector<Posed>& frame, const Set& set, Quality quality,
             uint32_t segment) {
    FrameDesc settings;
    settings.quality = quality;
    settings.visible = set.set;
    settings.visible_segment = segment;
    return run_frame(context, frame, settings);
}

TEST(VisibleSet, ChangesNothingOnRecordedFrames) {
    Engine engine;
    for (const char* name : {"hand", "chess", "cloth"}) {
        const scenes::Scene scene = scenes::builtin(name);
        const std::vector<MeshId> meshes = add_all(engine.context, scene);
        for (const Quality quality : {Quality::draft, Quality::standard}) {
            const Set made(engine.context, meshes, quality, 2);
            constexpr int frames = 4;
            const auto pose = [&](int k) {
                return posed(scene, meshes, scene.duration * (k + 0.3) / frames);
            };
            for (int k = 0; k < frames; ++k)
                EXPECT_EQ(recorded(engine.context, pose(k), made, quality, uint32_t(k) / 2),
                          run_frame(engine.context, pose(k), quality))
                    << name;
            const Set read(engine.context, meshes, made.file());
            ASSERT_TRUE(read.status.ok()) << read.status.text;
            EXPECT_EQ(read.file(), made.file());
            EXPECT_GT(read.info().kept, 0);
            EXPECT_LT(read.info().kept, 0.5) << name;
            uint64_t all = 0, set = 0;
            for (int k = 0; k < frames; ++k) {
                const Outputs plain = run_frame(engine.context, pose(k), quality),
                              ours = with(engine.context, pose(k), read, quality, uint32_t(k) / 2);
                EXPECT_EQ(ours, plain) << name << " " << k;
                all += plain.stats.triangles_considered;
                set += ours.stats.triangles_considered;
            }
            EXPECT_LT(set, all) << name;
        }
        for (const MeshId id : meshes)
            EXPECT_TRUE(remove_mesh(engine.context, id).ok());
    }
}

// Vertices that nobody needs move the others into other batches; duplicates get normals of their own.
TEST(VisibleSet, HoldsForReceiversNotForBatches) {
    Engine engine;
    scenes::Mesh mesh = scenes::torus(0.5f, 0.2f, 40, 24);
    const size_t half = mesh.rest_positions.size();
    for (size_t v = 0; v < half; ++v) {
        mesh.rest_positions.push_back(mesh.rest_positions[v]);
        mesh.rest_normals.push_back(mesh.rest_normals[v]);
    }
    const std::vector<MeshId> meshes{add(engine.context, mesh)};
    Posed frame = at_rest(meshes[0], mesh);
    Random random(3);
    for (size_t v = half; v < 2 * half; v += 3)
        frame.normals[v] = random.direction();
    const Set set(engine.context, meshes, Quality::standard, 1);
    recorded(engine.context, {frame}, set, Quality::standard, 0);
    EXPECT_EQ(with(engine.context, {frame}, set, Quality::standard, 0), run_frame(engine.context, {frame}));
    frame.needed.assign((frame.positions.size() + 31) / 32, 0);
    for (uint32_t& word : frame.needed)
        word = uint32_t(random.engine());
    EXPECT_EQ(with(engine.context, {frame}, set, Quality::standard, 0), run_frame(engine.context, {frame}));
}

// A mesh's parts, each weighed by its batch, are the set's.
TEST(VisibleSet, TellsWhereItHelps) {
    Engine engine;
    const scenes::Scene scene = scenes::builtin("hand");
    const std::vector<MeshId> meshes = add_all(engine.context, scene);
    const Set set(engine.context, meshes, Quality::draft, 2);
    recorded(engine.context, posed(scene, meshes, 0.5), set, Quality::draft, 1);
    const size_t count = scene.meshes[0].rest_positions.size();
    std::vector<float> parts(count, -1);
    ASSERT_TRUE(visible_set_parts(engine.context, set.set, 0, 0, meshes[0], parts.data(), count).ok());
    EXPECT_EQ(parts, std::vector<float>(count, 0)); // nothing was recorded there
    ASSERT_TRUE(visible_set_parts(engine.context, set.set, 1, 0, meshes[0], parts.data(), count).ok());
    double mean = 0;
    float least = 1, most = 0;
    for (const float part : parts) {
        mean += double(part) / double(count);
        least = std::min(least, part);
        most = std::max(most, part);
    }
    EXPECT_GE(least, 0);
    EXPECT_LT(most, 0.6f);
    EXPECT_GT(most, 2 * least);
    EXPECT_NEAR(mean, 2 * set.info().kept, 0.01); // of the two segments one is empty
    EXPECT_FALSE(visible_set_parts(engine.context, set.set, 2, 0, meshes[0], parts.data(), count).ok());
    EXPECT_FALSE(visible_set_parts(engine.context, set.set, 0, 1, meshes[0], parts.data(), count).ok());
    EXPECT_FALSE(visible_set_parts(engine.context, set.set, 0, 0, meshes[0], parts.data(), 7).ok());
}

// What matters to either side, for frames of both and of one.
TEST(VisibleSet, HoldsForBothSides) {
    Engine engine;
    const scenes::Scene scene = scenes::builtin("cloth");
    const std::vector<MeshId> meshes = add_all(engine.context, scene);
    const auto pose = [&](double part, bool front, bool back) {
        std::vector<Posed> frame = posed(scene, meshes, scene.duration * part);
        frame[0].receives = front;
        frame[0].back_receives = back;
        return frame;
    };
    const Set made(engine.context, meshes, Quality::standard, 1);
    for (const double part : {0.2, 0.7})
        EXPECT_EQ(recorded(engine.context, pose(part, true, true), made, Quality::standard, 0),
                  run_frame(engine.context, pose(part, true, true)));
    const Set read(engine.context, meshes, made.file());
    ASSERT_TRUE(read.status.ok()) << read.status.text;
    EXPECT_EQ(read.info().backs, 1u);
    EXPECT_FALSE(read.info().watertight);
    for (const double part : {0.2, 0.7}) {
        for (const auto& [front, back] : {std::pair{true, true}, {true, false}, {false, true}}) {
            const Outputs plain = run_frame(engine.context, pose(part, front, back)),
                          ours = with(engine.context, pose(part, front, back), read, Quality::standard, 0);
            EXPECT_EQ(ours, plain) << part << front << back;
            EXPECT_LT(ours.stats.triangles_considered, plain.stats.triangles_considered);
        }
    }
}

// All of a set's frames are of one kind, which a file keeps.
TEST(VisibleSet, KnowsWhatWasRecorded) {
    Engine engine;
    const scenes::Mesh ball = scenes::sphere(2);
    const std::vector<MeshId> meshes{add(engine.context, ball)};
    std::vector<Posed> both{at_rest(meshes[0], ball)}, front = both;
    both[0].back_receives = true;
    const auto submitted = [&](const std::vector<Posed>& posed, const Set& set, bool record, bool tight) {
        std::vector<std::array<float, 25>> out(2 * ball.rest_positions.size());
        std::vector<FrameMesh> frame = frame_of(posed);
        frame[0].transfer = {out[0].data(), ball.rest_positions.size(), 100};
        if (posed[0].back_receives)
            frame[0].back.transfer = {out[ball.rest_positions.size()].data(), ball.rest_positions.size(),
                                      100};
        FrameDesc desc;
        desc.meshes = frame.data();
        desc.mesh_count = 1;
        desc.watertight = tight;
        desc.record = record ? set.set : nullptr;
        desc.visible = record ? nullptr : set.set;
        FrameId id;
        const Status status = submit(engine.context, desc, &id);
        return status.ok() ? wait(engine.context, id, nullptr).ok() : false;
    };
    for (const bool tight : {false, true}) {
        const Set set(engine.context, meshes, Quality::standard, 1);
        EXPECT_TRUE(submitted(both, set, true, tight));
        EXPECT_TRUE(submitted(both, set, true, tight));
        EXPECT_FALSE(submitted(front, set, true, tight));
        EXPECT_FALSE(submitted(both, set, true, !tight));
        const Set read(engine.context, meshes, set.file());
        ASSERT_TRUE(read.status.ok());
        EXPECT_EQ(read.file(), set.file());
        EXPECT_EQ(read.info().watertight, tight);
        for (const bool wanted : {false, true}) {
            EXPECT_EQ(submitted(both, read, false, wanted), tight || !wanted);
            EXPECT_EQ(submitted(front, read, false, wanted), tight || !wanted);
        }
        EXPECT_FALSE(submitted(both, read, true, !tight));
    }
    const Set alone(engine.context, meshes, Quality::standard, 1);
    EXPECT_TRUE(submitted(front, alone, true, false));
    EXPECT_FALSE(submitted(both, alone, false, false));
    EXPECT_TRUE(submitted(front, alone, false, false));
}

TEST(VisibleSet, AnEmptyOneHidesWithFansAlone) {
    Engine engine;
    const scenes::Mesh ball = scenes::sphere(2), room = scenes::sphere(3, 4);
    const std::vector<MeshId> meshes{add(engine.context, ball), add(engine.context, room)};
    const Set set(engine.context, meshes, Quality::standard, 1);
    const Outputs out =
        with(engine.context, {at_rest(meshes[0], ball), at_rest(meshes[1], room)}, set, Quality::standard, 0);
    EXPECT_EQ(out.stats.clusters_rasterized, 0u);
    EXPECT_EQ(set.info().kept, 0);
}

void expect_refused(Engine& engine, const std::vector<MeshId>& meshes, const std::vector<char>& file,
                    const char* reason) {
    const Set read(engine.context, meshes, file);
    EXPECT_EQ(read.status.code, StatusCode::invalid_argument);
    EXPECT_EQ(read.set, nullptr);
    EXPECT_NE(std::strstr(read.status.text, reason), nullptr) << read.status.text;
}

TEST(VisibleSet, RefusesWhatIsNone) {
    Engine engine;
    const scenes::Mesh ball = scenes::sphere(2), ring = scenes::torus(0.5f, 0.2f, 12, 8);
    const MeshId a = add(engine.context, ball), b = add(engine.context, ring);
    const Set set(engine.context, {a, b}, Quality::standard, 3);
    recorded(engine.context, {at_rest(a, ball), at_rest(b, ring)}, set, Quality::standard, 1);
    const std::vector<char> good = set.file();
    for (size_t size = 0; size < good.size(); size += 1 + size / 16)
        expect_refused(engine, {a, b}, {good.begin(), good.begin() + std::ptrdiff_t(size)}, "cut short");
    for (size_t at = 0; at < good.size(); at += 1 + at / 16) {
        std::vector<char> bad = good;
        bad[at] = char(bad[at] ^ 0x40);
        expect_refused(engine, {a, b}, bad, "make");
    }
    std::vector<char> longer = good;
    longer.resize(good.size() + 4);
    expect_refused(engine, {a, b}, longer, "checksum");
    expect_refused(engine, {b, a}, good, "other meshes");
    expect_refused(engine, {a}, good, "number of meshes");
    // One triangle less.
    scenes::Mesh cut = ball;
    cut.indices.resize(cut.indices.size() - 3);
    expect_refused(engine, {add(engine.context, cut), b}, good, "other meshes");
    // The same mesh again is as good.
    EXPECT_TRUE(Set(engine.context, {add(engine.context, ball), b}, good).status.ok());
    ASSERT_TRUE(remove_mesh(engine.context, b).ok());
    EXPECT_EQ(Set(engine.context, {a, b}, good).status.code, StatusCode::stale_handle);

    VisibleSet* none = nullptr;
    EXPECT_FALSE(create_visible_set(engine.context, &a, 1, Quality::paper, 1, &none).ok());
    EXPECT_FALSE(create_visible_set(engine.context, &a, 1, Quality::draft, 0, &none).ok());
    EXPECT_FALSE(create_visible_set(engine.context, &a, 1, Quality::draft, most_segments + 1, &none).ok());
    EXPECT_FALSE(create_visible_set(engine.context, &a, 0, Quality::draft, 1, &none).ok());
    EXPECT_FALSE(create_visible_set(engine.context, nullptr, 1, Quality::draft, 1, &none).ok());
    EXPECT_EQ(none, nullptr);
    std::vector<char> bytes(good.size() - 1);
    EXPECT_FALSE(write_visible_set(set.set, bytes.data(), bytes.size()).ok());
}

// Whole, of these meshes, with the right checksum, and still of no frames that there could have been.
TEST(VisibleSet, RefusesWhatContradictsItself) {
    Engine engine;
    const scenes::Mesh ball = scenes::sphere(2), ring = scenes::torus(0.5f, 0.2f, 12, 8);
    const std::vector<MeshId> meshes{add(engine.context, ball), add(engine.context, ring)};
    const auto set_to = [](std::vector<char>& file, size_t at, uint32_t value) {
        std::memcpy(&file[at], &value, 4);
        uint64_t sum = 0xCBF29CE484222325u;
        for (size_t i = 0; i + 8 < file.size(); i += 4) {
            uint32_t word;
            std::memcpy(&word, &file[i], 4);
            sum = (sum ^ word) * 0x100000001B3u;
        }
        std::memcpy(&file[file.size() - 8], &sum, 8);
    };
    constexpr size_t quality_at = 12, recorded_at = 32, watertight_at = 36, back_at = 40 + 8, next_mesh = 16;
    const Set empty(engine.context, meshes, Quality::standard, 1),
        full(engine.context, meshes, Quality::standard, 1);
    recorded(engine.context, {at_rest(meshes[0], ball), at_rest(meshes[1], ring)}, full, Quality::standard,
             0);
    std::vector<char> file = full.file();
    set_to(file, recorded_at, 1); // as it is
    EXPECT_TRUE(Set(engine.context, meshes, file).status.ok());
    // What another quality looks at, with other samples or only with levels taken to another angle.
    for (const Quality other : {Quality::draft, Quality::fine}) {
        std::vector<char> wrong = file;
        set_to(wrong, quality_at, static_cast<uint32_t>(other));
        expect_refused(engine, meshes, wrong, "other levels of detail");
    }
    // A cluster past the last.
    uint32_t clusters;
    std::memcpy(&clusters, &file[28], 4);
    ASSERT_NE(clusters % 32, 0u);
    std::vector<char> more = full.file();
    const size_t word = 40 + 2 * next_mesh + 4 * ((clusters + 31) / 32 - 1);
    uint32_t bits;
    std::memcpy(&bits, &more[word], 4);
    set_to(more, word, bits | 1u << clusters % 32);
    expect_refused(engine, meshes, more, "contradicts itself");
    struct Lie {
        bool recorded;
        size_t at;
        uint32_t value;
    };
    for (const Lie& lie : {Lie{true, recorded_at, 2}, Lie{true, watertight_at, 2}, Lie{true, back_at, 2},
                           Lie{true, back_at + next_mesh, 7}, Lie{false, watertight_at, 1},
                           Lie{false, back_at, 1}, Lie{false, back_at + next_mesh, 1}}) {
        std::vector<char> bad = lie.recorded ? full.file() : empty.file();
        set_to(bad, lie.at, lie.value);
        SCOPED_TRACE(lie.at);
        expect_refused(engine, meshes, bad, "contradicts itself");
    }
}

TEST(VisibleSet, RefusesFramesOfOtherMeshes) {
    Engine engine;
    const scenes::Mesh ball = scenes::sphere(2), ring = scenes::torus(0.5f, 0.2f, 12, 8);
    const MeshId a = add(engine.context, ball), b = add(engine.context, ring);
    const Set set(engine.context, {a, b}, Quality::standard, 2);
    HistoryId history;
    ASSERT_TRUE(create_history(engine.context, &history).ok());
    const auto refuse = [&](const auto& spoil, const char* reason) {
        std::vector<std::array<float, 25>> out(ball.rest_positions.size());
        FrameMesh meshes[2];
        const scenes::Mesh* shapes[2] = {&ball, &ring};
        for (int m = 0; m < 2; ++m) {
            meshes[m].mesh = m ? b : a;
            meshes[m].positions = {&shapes[m]->rest_positions[0].x, shapes[m]->rest_positions.size(), 12};
            meshes[m].normals = {&shapes[m]->rest_normals[0].x, shapes[m]->rest_normals.size(), 12};
        }
        meshes[0].transfer = {out[0].data(), out.size(), 100};
        FrameDesc desc;
        desc.meshes = meshes;
        desc.mesh_count = 2;
        desc.visible = set.set;
        spoil(desc, meshes);
        FrameId id;
        const Status status = submit(engine.context, desc, &id);
        EXPECT_EQ(status.code, StatusCode::invalid_argument);
        EXPECT_NE(std::strstr(status.text, reason), nullptr) << status.text;
    };
    refuse([](FrameDesc& d, FrameMesh*) { d.visible_segment = 2; }, "fewer segments");
    refuse([](FrameDesc& d, FrameMesh*) { d.quality = Quality::draft; }, "another quality");
    refuse([](FrameDesc& d, FrameMesh*) { d.mesh_count = 1; }, "other meshes");
    refuse([](FrameDesc&, FrameMesh* m) { std::swap(m[0], m[1]); }, "other meshes");
    refuse([](FrameDesc&, FrameMesh* m) { m[1].object = 1; }, "one object");
    refuse([](FrameDesc&, FrameMesh* m) { m[1].receive_only = 1; }, "all block");
    refuse([](FrameDesc&, FrameMesh* m) { m[0].back.transfer = m[0].transfer; }, "without a mesh's back");
    refuse([](FrameDesc& d, FrameMesh*) { d.watertight = true; }, "watertight");
    refuse([&](FrameDesc& d, FrameMesh*) { d.history = history; }, "history");
    refuse([](FrameDesc& d, FrameMesh*) { d.falloff = {1, 2}; }, "falloff");
    refuse([&](FrameDesc& d, FrameMesh*) { d.record = set.set; }, "one of the two");
}

} // namespace

} // namespace nusselt::test
