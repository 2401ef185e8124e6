// Both sides of a sheet in one frame: each gets what it would get alone.
#include "tests/runtime/fixture.h"

#include <nusselt/c.h>

#include <cmath>
#include <cstring>

namespace nusselt::test {

namespace {

using Stream = nusselt::Output;

std::vector<Posed> turned_over(std::vector<Posed> meshes) {
    for (Posed& mesh : meshes) {
        for (glm::vec3& n : mesh.normals)
            n = -n;
    }
    return meshes;
}

std::vector<Posed> from_both_sides(std::vector<Posed> meshes) {
    for (Posed& mesh : meshes)
        mesh.back_receives = true;
    return meshes;
}

// Against runs of one side each, the other one's normals turned over by the caller. Returns the clusters that
// were drawn, over those of the two.
double expect_as_alone(Context* context, const std::vector<Posed>& meshes, const FrameDesc& settings) {
    const char* const quality = quality_name(settings.quality);
    const Outputs both = run_frame(context, from_both_sides(meshes), settings);
    const Outputs front = run_frame(context, meshes, settings),
                  behind = run_frame(context, turned_over(meshes), settings);
    EXPECT_EQ(both.meshes, front.meshes) << quality;
    EXPECT_EQ(both.backs, behind.meshes) << quality;
    EXPECT_EQ(both.stats.receivers, front.stats.receivers + behind.stats.receivers);
    EXPECT_EQ(both.stats.receivers_computed,
              front.stats.receivers_computed + behind.stats.receivers_computed);
    EXPECT_EQ(both.stats.receivers_written, both.stats.receivers);
    EXPECT_EQ(both.stats.receivers_inside, front.stats.receivers_inside + behind.stats.receivers_inside);
    EXPECT_EQ(both.stats.receivers_invalid, front.stats.receivers_invalid + behind.stats.receivers_invalid);
    EXPECT_EQ(both.stats.triangles_invalid, front.stats.triangles_invalid);
    return double(both.stats.clusters_rasterized) /
           double(front.stats.clusters_rasterized + behind.stats.clusters_rasterized);
}
double expect_as_alone(Context* context, const std::vector<Posed>& meshes, Quality quality) {
    FrameDesc settings;
    settings.quality = quality;
    return expect_as_alone(context, meshes, settings);
}
constexpr double one_pass = 0.7; // less than that of the clusters of two frames is one pass for most

// A rough sheet, at a height.
scenes::Mesh rough_sheet(float size, uint32_t cells, float height = 0) {
    scenes::Mesh sheet = scenes::plane(size, cells);
    for (glm::vec3& p : sheet.rest_positions)
        p.y = height + 0.1f * size * std::sin(8 / size * p.x) * std::cos(6 / size * p.z);
    scenes::compute_normals(sheet.rest_positions, sheet.indices, sheet.rest_normals);
    return sheet;
}

TEST(Back, AsAloneWithTurnedNormals) {
    for (const char* name : {"cloth", "chess"}) {
        const scenes::Scene scene = scenes::builtin(name);
        for (const Isa isa : available_isas()) {
            if (isa == Isa::scalar) continue; // below, on less
            Engine engine(with_isa(isa));
            const std::vector<Posed> meshes =
                posed(scene, add_all(engine.context, scene), 0.6 * scene.duration);
            for (const Quality quality : {Quality::paper, Quality::draft, Quality::standard})
                expect_as_alone(engine.context, meshes, quality);
        }
    }
    Engine engine(with_isa(Isa::scalar));
    scenes::Mesh sheet = rough_sheet(2, 12);
    sheet.rest_normals[7] = {0, 1, 0}; // the tangent frame's pole
    sheet.rest_normals[8] = {0, 0, 1};
    sheet.rest_normals[9] = {0, 0, -1};
    const std::vector<Posed> meshes = {at_rest(add(engine.context, sheet), sheet)};
    for (const Quality quality : {Quality::standard, Quality::fine})
        expect_as_alone(engine.context, meshes, quality);
}

// Blockers are looked at once for both sides, but for receivers whose sides differ in who needs them.
TEST(Back, OnePassOverTheBlockers) {
    Engine engine;
    const scenes::Scene scene = scenes::builtin("cloth");
    std::vector<Posed> one = posed(scene, add_all(engine.context, scene), 0.6 * scene.duration);
    one.resize(1); // the sheet
    const auto looks = [](const Outputs& out) { return double(out.stats.clusters_rasterized); };
    const double front = looks(run_frame(engine.context, one)),
                 behind = looks(run_frame(engine.context, turned_over(one)));
    std::vector<Posed> both = from_both_sides(one);
    const double together = looks(run_frame(engine.context, both));
    EXPECT_GT(together, 0.5 * (front + behind));
    EXPECT_LT(together, 0.6 * (front + behind));
    both[0].back_needed.assign((one[0].positions.size() + 31) / 32, 0x7FFFFFFF);
    EXPECT_GT(looks(run_frame(engine.context, both)), 0.9 * (front + behind));
}

TEST(Back, OnePassOfWatertightFrames) {
    Engine engine;
    // A shell whose fronts look inward, and a sheet in it: nearly all of their masks is covered.
    scenes::Mesh shell = scenes::sphere(4);
    for (size_t i = 0; i < shell.indices.size(); i += 3)
        std::swap(shell.indices[i], shell.indices[i + 1]);
    const scenes::Mesh sheet = rough_sheet(1, 30);
    const std::vector<Posed> meshes = {at_rest(add(engine.context, sheet), sheet),
                                       at_rest(add(engine.context, shell), shell)};
    for (const Quality quality : {Quality::draft, Quality::standard, Quality::fine}) {
        FrameDesc settings;
        settings.quality = quality;
        settings.watertight = true;
        EXPECT_LT(expect_as_alone(engine.context, meshes, settings), one_pass) << quality_name(quality);
    }
    FrameDesc settings;
    settings.watertight = true;
    const Outputs both = run_frame(engine.context, from_both_sides(meshes), settings);
    for (size_t v = 0; v < sheet.rest_positions.size(); ++v) {
        EXPECT_EQ(blocked_bits(both.meshes[0], v), 1024u) << v;
        EXPECT_EQ(blocked_bits(both.backs[0], v), 1024u) << v;
    }
}

// A sheet through a ball, on it and within it: whoever is inside is dark, on either side.
TEST(Back, OnePassThroughTheInsideOfAnother) {
    Engine engine;
    const scenes::Mesh ball = scenes::sphere(3);
    const MeshId ball_id = add(engine.context, ball);
    for (const float height : {0.0f, 0.5f, 0.9999f, 1.0f, 1.0001f, 1.02f}) {
        const scenes::Mesh sheet = scenes::plane(3, 24);
        Posed upper = at_rest(add(engine.context, sheet), sheet), below = at_rest(ball_id, ball);
        for (glm::vec3& p : upper.positions)
            p.y += height;
        below.receives = false;
        const std::vector<Posed> meshes = {upper, below};
        const Outputs front = run_frame(engine.context, meshes);
        // The ball, which does not receive, has no back either.
        std::vector<Posed> both = meshes, behind = turned_over(meshes);
        both[0].back_receives = true;
        const Outputs together = run_frame(engine.context, both), back = run_frame(engine.context, behind);
        EXPECT_EQ(together.meshes[0], front.meshes[0]) << height;
        EXPECT_EQ(together.backs[0], back.meshes[0]) << height;
        EXPECT_EQ(together.stats.receivers_inside,
                  front.stats.receivers_inside + back.stats.receivers_inside);
        if (height == 0) {
            EXPECT_GT(front.stats.receivers_inside, 100u);
        }
        EXPECT_TRUE(remove_mesh(engine.context, upper.mesh).ok());
    }
}

// Vertices at one place: with one normal (computed once), with two (twice), of which some are not needed.
TEST(Back, OnePassOfDuplicates) {
    Engine engine;
    scenes::Mesh sheet = rough_sheet(1, 20);
    const size_t count = sheet.rest_positions.size();
    for (size_t v = 0; v < count; ++v) {
        sheet.rest_positions.push_back(sheet.rest_positions[v]);
        const glm::vec3 n = sheet.rest_normals[v];
        sheet.rest_normals.push_back(v % 3 ? n : glm::vec3(n.x + 0.3f, n.y, n.z));
    }
    for (size_t i = 0; i < sheet.indices.size(); i += 6) // every other square hangs at the copies
        for (size_t k = i; k < i + 3; ++k)
            sheet.indices[k] += uint32_t(count);
    std::vector<Posed> meshes = {at_rest(add(engine.context, sheet), sheet)};
    EXPECT_LT(expect_as_alone(engine.context, meshes, Quality::standard), one_pass);
    meshes[0].needed.assign((2 * count + 31) / 32, 0x5BF7DDEF);
    const Outputs both = run_frame(engine.context, from_both_sides(meshes)),
                  front = run_frame(engine.context, meshes),
                  behind = run_frame(engine.context, turned_over(meshes));
    EXPECT_EQ(both.meshes, front.meshes);
    EXPECT_EQ(both.backs, behind.meshes);
    EXPECT_GT(both.stats.receivers_copied, 0u);
}

TEST(Back, OnePassOfWhatIsNotFinite) {
    Engine engine;
    const scenes::Mesh sheet = rough_sheet(1, 24);
    std::vector<Posed> meshes = {at_rest(add(engine.context, sheet), sheet)};
    Random random(9);
    const float bad[] = {NAN, INFINITY, -INFINITY, 3e38f};
    for (uint32_t step = 0; step < 24; ++step) {
        Posed& mesh = meshes[0];
        const uint32_t v = random.below(uint32_t(mesh.positions.size())), k = random.below(3);
        if (step % 3 == 0) mesh.positions[v][int(k)] = bad[step / 3 % 4];
        if (step % 3 == 1) mesh.normals[v][int(k)] = bad[step / 3 % 4];
        if (step % 3 == 2) mesh.normals[v] = glm::vec3(0);
        if (step % 4 == 3) expect_as_alone(engine.context, meshes, Quality::standard);
    }
    // A whole batch of receivers that are none.
    for (glm::vec3& n : meshes[0].normals)
        n = glm::vec3(NAN);
    expect_as_alone(engine.context, meshes, Quality::standard);
}

// Two half-planes that meet at right angles along z, with receivers in the crease, which look along the
// bisector. Inside, each half hides what lies below 45 degrees on its side: (1 - cos 45) / 2 each. Outside,
// nothing is hidden.
TEST(Back, CreaseHidesInItsValleyOnly) {
    Engine engine;
    scenes::Mesh sheet;
    constexpr uint32_t rows = 9;
    for (uint32_t i = 0; i < rows; ++i) {
        const float z = i == 0 ? -1000.0f : i + 1 == rows ? 1000.0f : float(i) - 4;
        for (const float side : {-1.0f, 0.0f, 1.0f})
            sheet.rest_positions.emplace_back(side * 1000, std::fabs(side) * 1000, z);
    }
    sheet.rest_normals.assign(sheet.rest_positions.size(), {0, 1, 0});
    for (uint32_t i = 0; i + 1 < rows; ++i) {
        for (uint32_t half = 0; half < 2; ++half) {
            const uint32_t a = 3 * i + half, b = a + 1, c = a + 3, d = a + 4;
            sheet.indices.insert(sheet.indices.end(), {a, c, b, b, c, d});
        }
    }
    Posed posed = at_rest(add(engine.context, sheet), sheet);
    posed.back_receives = true;
    const double exact = 1024 * (1 - std::sqrt(0.5));
    const Outputs out = run_frame(engine.context, {posed});
    for (uint32_t i = 2; i + 2 < rows; ++i) {
        const size_t crease = 3 * i + 1;
        EXPECT_NEAR(blocked_bits(out.meshes[0], crease), exact, 24) << i;
        EXPECT_EQ(blocked_bits(out.backs[0], crease), 0u) << i;
    }
}

TEST(Back, SheetOverAWall) {
    Engine engine;
    const scenes::Mesh sheet = scenes::plane(1, 8);
    scenes::Mesh floor = scenes::plane(2000, 2), wall;
    wall.rest_positions = {{0, -1000, -1000}, {0, 1000, -1000}, {0, 1000, 1000}, {0, -1000, 1000}};
    wall.indices = {0, 1, 2, 0, 2, 3};
    wall.rest_normals.assign(4, {1, 0, 0});
    for (glm::vec3& p : floor.rest_positions)
        p.y -= 0.02f;
    for (glm::vec3& p : wall.rest_positions)
        p.x = 0.6f;
    Posed upper = at_rest(add(engine.context, sheet), sheet);
    upper.back_receives = true;
    Posed below = at_rest(add(engine.context, floor), floor);
    below.receives = false;
    Posed beside = at_rest(add(engine.context, wall), wall);
    beside.receives = false;
    // A floor under it: the upper side sees all of the sky, the lower one nothing.
    Outputs out = run_frame(engine.context, {upper, below});
    for (size_t v = 0; v < sheet.rest_positions.size(); ++v) {
        EXPECT_EQ(blocked_bits(out.meshes[0], v), 0u) << v;
        EXPECT_GE(blocked_bits(out.backs[0], v), 1022u) << v;
        EXPECT_NEAR(out.meshes[0].transfer[v][0], 0.28209479f, 1e-4f);
        EXPECT_NEAR(out.backs[0].transfer[v][0], 0, 1e-3f);
    }
    // A tangent wall beside it hides half of either.
    out = run_frame(engine.context, {upper, beside});
    for (size_t v = 0; v < sheet.rest_positions.size(); ++v) {
        EXPECT_NEAR(blocked_bits(out.meshes[0], v), 512, 16) << v;
        EXPECT_NEAR(blocked_bits(out.backs[0], v), 512, 16) << v;
    }
}

TEST(Back, NeedsOfItsOwn) {
    Engine engine;
    const scenes::Scene scene = scenes::builtin("cloth");
    const std::vector<Posed> plain = posed(scene, add_all(engine.context, scene), 0.5 * scene.duration);
    const Outputs all = run_frame(engine.context, from_both_sides(plain));
    std::vector<Posed> some = from_both_sides(plain);
    const size_t count = some[0].positions.size();
    some[0].needed.assign((count + 31) / 32, 0x0F0F0F0F);
    Outputs out = run_frame(engine.context, some);
    const auto expect_only = [&](const Output& got, const Output& whole, uint32_t word) {
        for (size_t v = 0; v < count; ++v) {
            if (word >> v % 32 & 1) {
                EXPECT_TRUE(same_result(got, whole, v)) << v;
            } else {
                EXPECT_TRUE(is_unwritten(got, v)) << v;
            }
        }
    };
    expect_only(out.meshes[0], all.meshes[0], 0x0F0F0F0F);
    expect_only(out.backs[0], all.backs[0], 0x0F0F0F0F); // as the front
    some[0].back_needed.assign((count + 31) / 32, 0x000000FF);
    out = run_frame(engine.context, some);
    expect_only(out.meshes[0], all.meshes[0], 0x0F0F0F0F);
    expect_only(out.backs[0], all.backs[0], 0x000000FF);
    some[0].receives = false; // the back alone
    out = run_frame(engine.context, some);
    expect_only(out.backs[0], all.backs[0], 0x000000FF);
}

TEST(Back, HistoriesKeepBothSides) {
    Engine engine;
    const scenes::Scene scene = scenes::builtin("cloth");
    const std::vector<MeshId> ids = add_all(engine.context, scene);
    FrameDesc settings;
    ASSERT_TRUE(create_history(engine.context, &settings.history).ok());
    std::vector<Posed> frame = from_both_sides(posed(scene, ids, 0.5 * scene.duration));
    EXPECT_EQ(run_frame(engine.context, frame, settings), run_frame(engine.context, frame));
    const Outputs still = run_frame(engine.context, frame, settings);
    EXPECT_EQ(still, run_frame(engine.context, frame));
    EXPECT_EQ(still.stats.receivers_computed, 0u);
    settings.same_pose = true;
    EXPECT_EQ(run_frame(engine.context, frame, settings), still);
    settings.same_pose = false;
    Random random(5);
    for (int step = 0; step < 12; ++step) {
        Posed& mesh = frame[random.below(uint32_t(frame.size()))];
        const uint32_t v = random.below(uint32_t(mesh.positions.size()));
        if (step % 3 == 0) mesh.normals[v] = random.direction();
        if (step % 3 == 1) mesh.positions[v] += 0.02f * random.direction();
        if (step % 3 == 2) mesh.back_receives = !mesh.back_receives; // begins anew
        EXPECT_EQ(run_frame(engine.context, frame, settings), run_frame(engine.context, frame)) << step;
    }
    EXPECT_TRUE(remove_history(engine.context, settings.history).ok());
}

// A frame with these streams on the back of a mesh, or on the front.
Status run_streams(Context* context, const Posed& mesh, std::vector<Stream> streams, bool back,
                   const Gloss* gloss, const FrameDesc& settings = {}) {
    FrameMesh m;
    m.mesh = mesh.mesh;
    m.positions = view(mesh.positions);
    m.normals = view(mesh.normals);
    m.gloss = gloss;
    (back ? m.back.outputs : m.outputs) = streams.data();
    (back ? m.back.output_count : m.output_count) = uint32_t(streams.size());
    FrameDesc desc = settings;
    desc.meshes = &m;
    desc.mesh_count = 1;
    FrameId id;
    const Status started = submit(context, desc, &id);
    streams.assign(streams.size(), {}); // copied
    return started.ok() ? wait(context, id, nullptr) : started;
}

TEST(Back, StreamsAndMaterials) {
    Engine engine;
    const scenes::Scene scene = scenes::builtin("cloth");
    const std::vector<Posed> plain = posed(scene, add_all(engine.context, scene), 0.5 * scene.duration);
    const Posed mesh = plain[0], behind = turned_over(plain)[0];
    const float grey[3] = {0.5f, 0.5f, 0.5f};
    const Material material = metallic_roughness(grey, 1, 0.5f);
    Gloss gloss;
    gloss.eye[1] = -5;
    gloss.materials = &material;
    gloss.material_count = 1;
    const size_t count = mesh.positions.size();
    std::vector<float> here(75 * count), there(75 * count);
    for (const OutputKind kind :
         {OutputKind::ambient_occlusion, OutputKind::bent_normal, OutputKind::glossy}) {
        Stream s;
        s.kind = kind;
        s.count = count;
        s.data = here.data();
        ASSERT_TRUE(run_streams(engine.context, mesh, {s}, true, &gloss).ok());
        s.data = there.data();
        ASSERT_TRUE(run_streams(engine.context, behind, {s}, false, &gloss).ok());
        EXPECT_EQ(std::memcmp(here.data(), there.data(), 4 * here.size()), 0) << int(kind);
    }
}

// Every kind of stream of both sides in one frame, beside frames of one side each.
TEST(Back, StreamsOfBothSidesInOnePass) {
    Engine engine;
    const scenes::Scene scene = scenes::builtin("cloth");
    std::vector<Posed> plain = posed(scene, add_all(engine.context, scene), 0.5 * scene.duration);
    plain.resize(1);
    const size_t count = plain[0].positions.size();
    const float colour[3] = {0.9f, 0.5f, 0.2f};
    const Material materials[] = {metallic_roughness(colour, 1, 0.5f), metallic_roughness(colour, 0, 0.8f)};
    std::vector<uint16_t> material_of(count);
    for (size_t v = 0; v < count; ++v)
        material_of[v] = v % 5 == 0;
    Gloss gloss;
    gloss.eye[1] = 5;
    gloss.materials = materials;
    gloss.material_count = 2;
    gloss.material_of = material_of.data();
    std::vector<float> light(75, 0.1f), pixels(3 * 32 * 16, 0.5f);
    pixels[40] = 30;
    EnvironmentDesc surroundings;
    surroundings.rgb = pixels.data();
    surroundings.width = 32;
    surroundings.height = 16;
    surroundings.mask_bits = 1024;
    FrameDesc settings;
    settings.light = light.data();
    Environment* environment = nullptr;
    ASSERT_TRUE(create_environment(engine.context, surroundings, &environment).ok());
    settings.environment = environment;
    struct Kind {
        OutputKind kind;
        OutputFormat format;
    };
    const Kind kinds[] = {{OutputKind::transfer, OutputFormat::float16},
                          {OutputKind::transfer, OutputFormat::packed8},
                          {OutputKind::ambient_occlusion, OutputFormat::float32},
                          {OutputKind::bent_normal, OutputFormat::packed8},
                          {OutputKind::glossy, OutputFormat::float32},
                          {OutputKind::radiance, OutputFormat::float32},
                          {OutputKind::direct, OutputFormat::float16}};
    using Memory = std::vector<std::vector<uint8_t>>;
    const auto describe = [&](Memory& memory) {
        std::vector<Stream> streams;
        for (const Kind& k : kinds) {
            memory.emplace_back(count * output_bytes(k.kind, k.format), uint8_t(0xAB));
            streams.push_back({k.kind, k.format, memory.back().data(), count});
        }
        return streams;
    };
    FrameStats stats;
    const auto frame = [&](const Posed& mesh, Memory* front, Memory* back) {
        FrameMesh m;
        m.mesh = mesh.mesh;
        m.positions = view(mesh.positions);
        m.normals = view(mesh.normals);
        m.gloss = &gloss;
        std::vector<Stream> here, behind;
        if (front) here = describe(*front);
        if (back) behind = describe(*back);
        m.outputs = here.data();
        m.output_count = uint32_t(here.size());
        m.back.outputs = behind.data();
        m.back.output_count = uint32_t(behind.size());
        FrameDesc desc = settings;
        desc.meshes = &m;
        desc.mesh_count = 1;
        FrameId id;
        ASSERT_TRUE(submit(engine.context, desc, &id).ok());
        ASSERT_TRUE(wait(engine.context, id, &stats).ok());
    };
    Memory front, back, front_alone, back_alone;
    frame(plain[0], &front_alone, nullptr);
    uint64_t apart = stats.clusters_rasterized;
    frame(turned_over(plain)[0], &back_alone, nullptr);
    apart += stats.clusters_rasterized;
    frame(plain[0], &front, &back);
    EXPECT_LT(double(stats.clusters_rasterized), one_pass * double(apart));
    EXPECT_EQ(front, front_alone);
    EXPECT_EQ(back, back_alone);
    EXPECT_NE(front, back);
    destroy_environment(engine.context, environment);
}

TEST(Back, WhatDoesNotFitIsRefused) {
    Engine engine;
    const scenes::Mesh sheet = scenes::plane(1, 4);
    const Posed posed = at_rest(add(engine.context, sheet), sheet);
    const size_t count = posed.positions.size();
    std::vector<float> transfer(25 * count);
    std::vector<uint32_t> masks(32 * count);
    FrameMesh good;
    good.mesh = posed.mesh;
    good.positions = view(posed.positions);
    good.normals = view(posed.normals);
    good.back.transfer = {transfer.data(), count, 100};
    good.back.masks = {masks.data(), count, 128};
    FrameDesc desc;
    desc.mesh_count = 1;
    FrameId id;
    const auto refused = [&](const FrameMesh& m) {
        desc.meshes = &m;
        const Status status = submit(engine.context, desc, &id);
        if (status.ok()) {
            EXPECT_TRUE(wait(engine.context, id, nullptr).ok());
        }
        return status.code == StatusCode::invalid_argument;
    };
    EXPECT_FALSE(refused(good));
    FrameMesh bad = good;
    bad.back.transfer.count = count - 1;
    EXPECT_TRUE(refused(bad));
    bad = good;
    bad.back.masks.count = count + 1;
    EXPECT_TRUE(refused(bad));
    bad = good;
    bad.back.transfer.stride = 96;
    EXPECT_TRUE(refused(bad));
    bad = good;
    bad.back.masks.stride = 64;
    EXPECT_TRUE(refused(bad));
    bad = good;
    bad.back.transfer.data = nullptr; // masks alone
    EXPECT_TRUE(refused(bad));
    bad = good;
    bad.back.output_count = 1; // of none
    EXPECT_TRUE(refused(bad));
    Stream stream;
    stream.kind = OutputKind::glossy;
    stream.data = transfer.data();
    stream.count = count;
    bad = good;
    bad.back.outputs = &stream;
    bad.back.output_count = 1; // without a gloss
    EXPECT_TRUE(refused(bad));
    stream.kind = OutputKind::ambient_occlusion;
    EXPECT_FALSE(refused(bad));
    stream.count = count - 1;
    EXPECT_TRUE(refused(bad));
    // Direct light has no falloff, on either side.
    stream.count = count;
    stream.kind = OutputKind::direct;
    desc.falloff = {0, 1};
    EXPECT_TRUE(refused(bad));
}

TEST(Back, InC) {
    Engine engine;
    const scenes::Scene scene = scenes::builtin("cloth");
    const Posed mesh = posed(scene, add_all(engine.context, scene), 0.5 * scene.duration)[0];
    const Outputs wanted = run_frame(engine.context, from_both_sides({mesh}));
    const size_t count = mesh.positions.size();
    std::vector<std::array<float, 25>> transfer(count);
    std::vector<uint32_t> masks(32 * count);
    std::vector<float> occlusion(count);
    nusselt_output output{};
    output.kind = NUSSELT_OUTPUT_AMBIENT_OCCLUSION;
    output.data = occlusion.data();
    output.count = count;
    nusselt_frame_mesh m{};
    m.mesh = {mesh.mesh.slot, mesh.mesh.generation};
    m.positions = {&mesh.positions[0].x, count, 0};
    m.normals = {&mesh.normals[0].x, count, 0};
    m.back_transfer = {transfer[0].data(), count, 0};
    m.back_masks = {masks.data(), count, 0};
    m.back_outputs = &output;
    m.back_output_count = 1;
    m.output_size = sizeof(output);
    nusselt_frame_desc desc{};
    desc.size = sizeof(desc);
    desc.meshes = &m;
    desc.mesh_size = sizeof(m);
    desc.mesh_count = 1;
    nusselt_frame frame;
    auto* const context = reinterpret_cast<nusselt_context*>(engine.context);
    ASSERT_EQ(nusselt_submit(context, &desc, &frame).code, uint32_t(NUSSELT_OK));
    ASSERT_EQ(nusselt_wait(context, frame, nullptr).code, uint32_t(NUSSELT_OK));
    EXPECT_EQ(transfer, wanted.backs[0].transfer);
    EXPECT_EQ(masks, wanted.backs[0].masks);
    for (size_t v = 0; v < count; ++v)
        EXPECT_NEAR(occlusion[v], 1 - blocked_bits(wanted.backs[0], v) / 1024.0, 0.02) << v;
    m.output_size = 0;
    EXPECT_EQ(nusselt_submit(context, &desc, &frame).code, uint32_t(NUSSELT_INVALID_ARGUMENT));
}

} // namespace

} // namespace nusselt::test
