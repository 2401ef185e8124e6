// Every status that the sources hold is provoked here: its text is read from them, so that a new one fails
// the test until it is provoked too. A checked build, for `changed`.
#include "nusselt/c.h"
#include "nusselt/nusselt.h"
#include "tests/heap.h"

#include <gtest/gtest.h>

#include <atomic>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <map>
#include <regex>
#include <sstream>
#include <thread>
#include <vector>

namespace nusselt::test {

namespace {

std::string read(const std::filesystem::path& path) {
    std::ifstream file(path);
    std::stringstream text;
    text << file.rdbuf();
    return text.str();
}

// The string literals that follow a status code in the sources, joined as the compiler joins them.
std::map<std::string, std::string> texts_in_sources() {
    const std::regex status(R"re((?:StatusCode::[a-z_]+,|NUSSELT_[A-Z_]+,|\bbad\()\s*((?:"[^"]*"\s*)+))re");
    const std::regex literal("\"([^\"]*)\"");
    std::map<std::string, std::string> texts; // and where they are
    for (const char* folder : {"runtime/src", "jobs"}) {
        for (const auto& entry :
             std::filesystem::directory_iterator(std::filesystem::path(NUSSELT_SOURCE_DIR) / folder)) {
            const std::string source = read(entry.path());
            for (std::sregex_iterator i(source.begin(), source.end(), status), end; i != end; ++i) {
                const std::string literals = (*i)[1];
                std::string text;
                for (std::sregex_iterator l(literals.begin(), literals.end(), literal); l != end; ++l)
                    text += (*l)[1];
                if (text != "ok") texts[text] = entry.path().filename().string();
            }
        }
    }
    return texts;
}

// Has memory while `left` lasts.
struct Scarce {
    Allocator hook() {
        return {this,
                [](void* user, size_t size, size_t alignment) -> void* {
                    if (static_cast<Scarce*>(user)->left-- <= 0) return nullptr;
                    return std::aligned_alloc(alignment, (size + alignment - 1) / alignment * alignment);
                },
                [](void*, void* memory, size_t, size_t) { std::free(memory); }};
    }
    int64_t left = 1 << 30;
};

struct Statuses : testing::Test {
    Statuses() {
        ContextDesc desc;
        desc.allocator = scarce.hook();
        EXPECT_TRUE(create_context(desc, &context).ok());
        EXPECT_TRUE(add_mesh(context, mesh_desc, &mesh).ok());
        use = {mesh, {positions, 3, 12}, {normals, 3, 12}, {transfer.data(), 3, 100}, {masks.data(), 3, 128}};
    }
    ~Statuses() override { EXPECT_TRUE(destroy_context(context).ok()); }

    void provoke(const Status& status, StatusCode wanted) {
        EXPECT_EQ(status.code, wanted) << status.text;
        seen[status.text] = status.code;
    }
    void provoke(const nusselt_status& status, StatusCode wanted) {
        provoke(Status{static_cast<StatusCode>(status.code), status.text}, wanted);
    }
    template<class Change>
    void refuse_mesh(Change change) {
        MeshDesc desc = mesh_desc;
        change(desc);
        MeshId id{1, 1};
        provoke(add_mesh(context, desc, &id), StatusCode::invalid_argument);
        EXPECT_EQ(id.generation, 0u);
    }
    template<class Change>
    void refuse_frame(Change change, StatusCode wanted = StatusCode::invalid_argument) {
        FrameMesh two[2] = {use, use};
        FrameDesc desc{two, 1};
        change(desc, two[0]);
        FrameId id{1, 1};
        provoke(submit(context, desc, &id), wanted);
        EXPECT_EQ(id.generation, 0u);
    }
    Status submit_use(FrameId* id) { return submit(context, {&use, 1}, id); }

    float positions[9] = {0, 0, 0, 1, 0, 0, 0, 0, -1}, normals[9] = {0, 1, 0, 0, 1, 0, 0, 1, 0};
    uint32_t indices[3] = {0, 1, 2};
    std::vector<float> transfer = std::vector<float>(75);
    std::vector<uint32_t> masks = std::vector<uint32_t>(3 * 128);
    MeshDesc mesh_desc{{positions, 3, 12}, {normals, 3, 12}, indices, 3};
    Scarce scarce;
    Context* context = nullptr;
    MeshId mesh;
    FrameMesh use;
    std::map<std::string, StatusCode> seen;

    void of_contexts();
    void of_executors();
    void of_meshes();
    void of_frames();
    void of_outputs();
    void of_light();
    void of_frames_in_flight();
    void of_histories();
    void of_visible_sets();
    void of_memory();
    void of_cameras();
    void of_lighting();
    void of_c();
};

void Statuses::of_contexts() {
    provoke(check_version(0), StatusCode::unsupported);
    Context* made = nullptr;
    provoke(create_context({}, nullptr), StatusCode::invalid_argument);
    ContextDesc desc;
    desc.allocator.allocate = scarce.hook().allocate;
    provoke(create_context(desc, &made), StatusCode::invalid_argument);
    desc = {};
    desc.executor.enqueue = serial_executor().enqueue;
    provoke(create_context(desc, &made), StatusCode::invalid_argument);
    desc = {};
    desc.profiler.end = [](void*, const char*) {};
    provoke(create_context(desc, &made), StatusCode::invalid_argument);
    desc = {};
    desc.isa = static_cast<Isa>(77);
    provoke(create_context(desc, &made), StatusCode::unsupported);
    setenv("NUSSELT_ISA", "altivec", 1);
    provoke(create_context({}, &made), StatusCode::unsupported);
    unsetenv("NUSSELT_ISA");
    EXPECT_EQ(made, nullptr);
}

void Statuses::of_executors() {
    Executor executor;
    if (!has_feature(Feature::tbb)) {
        provoke(create_tbb_executor(2, &executor), StatusCode::unsupported);
        return;
    }
    provoke(create_tbb_executor(2, nullptr), StatusCode::invalid_argument);
    provoke(create_tbb_executor(1 << 20, &executor), StatusCode::invalid_argument);
    heap_is_empty = true; // TBB's: it has no allocator of the caller's, nor have the shared tables below
    const Status status = create_tbb_executor(2, &executor);
    heap_is_empty = false;
    provoke(status, StatusCode::out_of_memory);
    EXPECT_EQ(executor.enqueue, nullptr);
}

void Statuses::of_meshes() {
    MeshId id;
    MeshInfo info;
    provoke(add_mesh(nullptr, mesh_desc, &id), StatusCode::invalid_argument);
    provoke(add_mesh(context, mesh_desc, nullptr), StatusCode::invalid_argument);
    provoke(mesh_info(context, mesh, nullptr), StatusCode::invalid_argument);
    provoke(mesh_info(context, {}, &info), StatusCode::stale_handle);
    provoke(mesh_memory_bound(context, mesh_desc, nullptr), StatusCode::invalid_argument);
    refuse_mesh([](MeshDesc& d) { d.rest_positions.data = nullptr; });
    refuse_mesh([](MeshDesc& d) { d.rest_positions.count = SIZE_MAX; });
    refuse_mesh([](MeshDesc& d) { d.rest_positions.stride = 8; });
    refuse_mesh([](MeshDesc& d) { d.rest_normals.count = 2; });
    refuse_mesh([](MeshDesc& d) { d.index_count = 2; });
    refuse_mesh([](MeshDesc& d) { d.indices = nullptr; });
    indices[1] = 3;
    refuse_mesh([](MeshDesc&) {});
    indices[1] = 1;
}

void Statuses::of_frames() {
    FrameId id;
    provoke(submit(nullptr, {&use, 1}, &id), StatusCode::invalid_argument);
    provoke(submit(context, {&use, 1}, nullptr), StatusCode::invalid_argument);
    refuse_frame([](FrameDesc& d, FrameMesh&) { d.quality = static_cast<Quality>(9); });
    refuse_frame([](FrameDesc& d, FrameMesh&) { d.mesh_count = 0; });
    refuse_frame([](FrameDesc& d, FrameMesh&) { d.mesh_count = 2; }); // the same one twice
    refuse_frame([](FrameDesc&, FrameMesh& m) { m.positions.data = nullptr; });
    refuse_frame([](FrameDesc&, FrameMesh& m) { m.normals.stride = 10; });
    refuse_frame([](FrameDesc&, FrameMesh& m) { m.transfer.stride = 96; });
    refuse_frame([](FrameDesc&, FrameMesh& m) { m.masks.stride = 124; });
    refuse_frame([](FrameDesc&, FrameMesh& m) { m.transfer.data = nullptr; });
    refuse_frame([](FrameDesc&, FrameMesh& m) { m.positions.count = SIZE_MAX; });
    refuse_frame([](FrameDesc&, FrameMesh& m) { ++m.mesh.generation; }, StatusCode::stale_handle);
}

void Statuses::of_outputs() {
    Output output;
    const auto refuse = [&](const auto& change) {
        output = {};
        output.kind = OutputKind::transfer;
        output.data = transfer.data();
        output.count = 3;
        change(output);
        refuse_frame([&](FrameDesc&, FrameMesh& m) {
            m.outputs = &output;
            m.output_count = 1;
        });
    };
    refuse_frame([](FrameDesc&, FrameMesh& m) { m.output_count = 1; }); // of none
    refuse([](Output& o) { o.kind = static_cast<OutputKind>(99); });
    refuse([](Output& o) { o.data = nullptr; });
    refuse([](Output& o) { o.stride = 102; });
    refuse([](Output& o) { o.stride = 96; });
    refuse([](Output& o) { o.window[1] = 2; });
    refuse([](Output& o) {
        o.kind = OutputKind::direct;
        o.format = OutputFormat::packed8;
    });
    refuse([](Output& o) { o.kind = OutputKind::glossy; });   // without a gloss
    refuse([](Output& o) { o.kind = OutputKind::radiance; }); // without light
    refuse([](Output& o) { o.kind = OutputKind::direct; });   // without an environment
}

void Statuses::of_light() {
    Material material;
    const auto refuse_gloss = [&](const auto& change) {
        Gloss gloss;
        material = {};
        gloss.materials = &material;
        gloss.material_count = 1;
        change(gloss);
        refuse_frame([&](FrameDesc&, FrameMesh& m) { m.gloss = &gloss; });
    };
    refuse_gloss([](Gloss& g) { g.materials = nullptr; });
    refuse_gloss([](Gloss& g) { g.eye[1] = std::nanf(""); });
    refuse_gloss([&](Gloss&) { material.brdf = static_cast<Brdf>(9); });
    refuse_gloss([&](Gloss&) { material.specular[0] = 1.5f; });
    refuse_gloss([&](Gloss&) { material.roughness = 2; });
    refuse_gloss([&](Gloss&) {
        material.brdf = Brdf::phong;
        material.exponent = 20000;
    });

    MeshId id;
    provoke(share_mesh(context, mesh, nullptr), StatusCode::invalid_argument);
    std::vector<MeshId> shared; // as many as it takes for the handles to need memory
    scarce.left = 0;
    Status status;
    while ((status = share_mesh(context, mesh, &id)).ok())
        shared.push_back(id);
    scarce.left = 1 << 30;
    provoke(status, StatusCode::out_of_memory);
    for (const MeshId each : shared)
        EXPECT_TRUE(remove_mesh(context, each).ok());

    refuse_frame([](FrameDesc& d, FrameMesh&) { d.falloff = {2, 1}; });
    refuse_frame([](FrameDesc& d, FrameMesh&) {
        d.watertight = true;
        d.quality = Quality::paper;
    });
    refuse_frame([](FrameDesc& d, FrameMesh&) {
        d.watertight = true;
        d.falloff = {1, 2};
    });
    refuse_frame([](FrameDesc& d, FrameMesh&) {
        d.falloff = {1, 2};
        d.quality = Quality::paper;
    });
    Gloss gloss;
    gloss.materials = &material;
    gloss.material_count = 1;
    material = {};
    Output output;
    output.kind = OutputKind::radiance;
    output.data = transfer.data();
    output.count = 3;
    const float light[75] = {};
    refuse_frame([&](FrameDesc& d, FrameMesh& m) {
        d.falloff = {1, 2};
        d.light = light;
        m.gloss = &gloss;
        m.outputs = &output;
        m.output_count = 1;
    });

    HistoryId history;
    ASSERT_TRUE(create_history(context, &history).ok());
    refuse_frame([&](FrameDesc& d, FrameMesh&) {
        d.history = history;
        d.falloff = {1, 2};
    });
    output.kind = OutputKind::glossy;
    refuse_frame([&](FrameDesc& d, FrameMesh& m) {
        d.history = history;
        m.gloss = &gloss;
        m.outputs = &output;
        m.output_count = 1;
        output.stride = 300;
    });
    EXPECT_TRUE(remove_history(context, history).ok());

    Environment* environment = nullptr;
    const float white[3] = {1, 1, 1};
    EnvironmentDesc desc;
    desc.rgb = white;
    desc.width = desc.height = 1;
    provoke(create_environment(context, desc, nullptr), StatusCode::invalid_argument);
    provoke(create_environment(nullptr, desc, &environment), StatusCode::invalid_argument);
    provoke(create_environment(context, {}, &environment), StatusCode::invalid_argument);
    desc.mask_bits = 7;
    provoke(create_environment(context, desc, &environment), StatusCode::invalid_argument);
    desc.mask_bits = 1024;
    scarce.left = 0;
    provoke(create_environment(context, desc, &environment), StatusCode::out_of_memory);
    scarce.left = 1 << 30;
    provoke(nusselt_create_environment(reinterpret_cast<nusselt_context*>(context), white, 1, 1, 0, nullptr,
                                       nullptr),
            StatusCode::invalid_argument);
}

void Statuses::of_frames_in_flight() {
    FrameId id, second;
    bool done = false;
    provoke(poll(nullptr, {}, &done), StatusCode::invalid_argument);
    provoke(poll(context, {}, nullptr), StatusCode::invalid_argument);
    provoke(poll(context, {}, &done), StatusCode::stale_handle);
    provoke(cancel(nullptr, {}), StatusCode::invalid_argument);
    provoke(cancel(context, {}), StatusCode::stale_handle);
    provoke(wait(nullptr, {}, nullptr), StatusCode::invalid_argument);
    provoke(wait(context, {}, nullptr), StatusCode::stale_handle);

    ASSERT_TRUE(submit_use(&id).ok());
    refuse_frame([](FrameDesc&, FrameMesh&) {}, StatusCode::busy);
    provoke(remove_mesh(context, mesh), StatusCode::busy);
    provoke(destroy_context(context), StatusCode::busy);
    positions[3] = 2; // borrowed
    provoke(wait(context, id, nullptr), StatusCode::changed);
    positions[3] = 1;

    // A thread that waits, held up by its executor until another one has tried.
    struct Held {
        std::atomic<bool> waiting = false, go_on = false;
    } held;
    ContextDesc desc;
    desc.executor = {&held,
                     [](void*, void (*run)(void*), void* argument) -> void* {
                         run(argument);
                         static int ticket;
                         return &ticket;
                     },
                     [](void* user, void*) {
                         static_cast<Held*>(user)->waiting = true;
                         while (!static_cast<Held*>(user)->go_on)
                             std::this_thread::yield();
                     },
                     1};
    Context* other = nullptr;
    ASSERT_TRUE(create_context(desc, &other).ok());
    FrameMesh mine = use;
    ASSERT_TRUE(add_mesh(other, mesh_desc, &mine.mesh).ok());
    ASSERT_TRUE(submit(other, {&mine, 1}, &second).ok());
    std::thread waits([&] { EXPECT_TRUE(wait(other, second, nullptr).ok()); });
    while (!held.waiting)
        std::this_thread::yield();
    provoke(wait(other, second, nullptr), StatusCode::busy);
    provoke(destroy_context(other), StatusCode::busy);
    held.go_on = true;
    waits.join();
    provoke(wait(other, second, nullptr), StatusCode::stale_handle);
    EXPECT_TRUE(destroy_context(other).ok());
}

void Statuses::of_histories() {
    HistoryId history, gone;
    FrameId id;
    provoke(create_history(nullptr, &history), StatusCode::invalid_argument);
    provoke(remove_history(nullptr, {}), StatusCode::invalid_argument);
    provoke(remove_history(context, {}), StatusCode::stale_handle);
    ASSERT_TRUE(create_history(context, &gone).ok());
    ASSERT_TRUE(remove_history(context, gone).ok());
    ASSERT_TRUE(create_history(context, &history).ok());
    const float nowhere[3] = {0, 0, HUGE_VALF};
    refuse_frame([](FrameDesc& d, FrameMesh&) { d.order = 6; });
    refuse_frame([&](FrameDesc& d, FrameMesh&) { d.origin = nowhere; });
    refuse_frame([](FrameDesc& d, FrameMesh&) { d.same_pose = true; });
    refuse_frame([](FrameDesc& d, FrameMesh&) { d.budget_us = -1; });
    refuse_frame([](FrameDesc& d, FrameMesh&) { d.budget_us = 100; });
    refuse_frame([&](FrameDesc& d, FrameMesh&) { d.history = gone; }, StatusCode::stale_handle);
    refuse_frame([&](FrameDesc& d, FrameMesh&) {
        d.history = history;
        d.same_pose = true;
    });
    FrameDesc desc{&use, 1};
    desc.history = history;
    ASSERT_TRUE(submit(context, desc, &id).ok());
    FrameMesh other = use;
    ASSERT_TRUE(add_mesh(context, mesh_desc, &other.mesh).ok());
    refuse_frame(
        [&](FrameDesc& d, FrameMesh& m) {
            d.history = history;
            m = other;
        },
        StatusCode::busy);
    provoke(remove_history(context, history), StatusCode::busy);
    ASSERT_TRUE(wait(context, id, nullptr).ok());
    EXPECT_TRUE(remove_history(context, history).ok());
}

void Statuses::of_visible_sets() {
    const auto bad = StatusCode::invalid_argument;
    VisibleSet *set = nullptr, *none = nullptr;
    VisibleSetInfo info;
    provoke(create_visible_set(context, &mesh, 1, Quality::standard, 1, nullptr), bad);
    provoke(create_visible_set(nullptr, &mesh, 1, Quality::standard, 1, &none), bad);
    provoke(create_visible_set(context, &mesh, 0, Quality::standard, 1, &none), bad);
    provoke(create_visible_set(context, &mesh, 1, Quality::standard, 0, &none), bad);
    provoke(create_visible_set(context, &mesh, 1, Quality::paper, 1, &none), bad);
    const std::vector<MeshId> many(2000, mesh);
    provoke(create_visible_set(context, many.data(), 2000, Quality::standard, most_segments, &none), bad);
    const MeshId gone{7, 7};
    provoke(create_visible_set(context, &gone, 1, Quality::standard, 1, &none), StatusCode::stale_handle);
    scarce.left = 0;
    provoke(create_visible_set(context, &mesh, 1, Quality::standard, 1, &none), StatusCode::out_of_memory);
    scarce.left = 1 << 30;
    EXPECT_EQ(none, nullptr);
    ASSERT_TRUE(create_visible_set(context, &mesh, 1, Quality::standard, 1, &set).ok());
    provoke(visible_set_info(nullptr, &info), bad);
    float parts[3];
    provoke(visible_set_parts(nullptr, set, 0, 0, mesh, parts, 3), bad);
    provoke(visible_set_parts(context, set, 1, 0, mesh, parts, 3), bad);
    provoke(visible_set_parts(context, set, 0, 0, gone, parts, 3), StatusCode::stale_handle);

    // Header of 40 bytes (magic, version, quality, meshes, segments, rows, clusters, recorded, watertight),
    // an identity and whether it has a back for each mesh, bits, checksum.
    std::vector<uint32_t> file(visible_set_bytes(set) / 4);
    provoke(write_visible_set(set, nullptr, 4 * file.size()), bad);
    provoke(write_visible_set(set, file.data(), 4 * file.size() - 4), bad);
    ASSERT_TRUE(write_visible_set(set, file.data(), 4 * file.size()).ok());
    const auto seal = [](std::vector<uint32_t>& words) {
        uint64_t sum = 0xCBF29CE484222325u;
        for (size_t i = 0; i + 2 < words.size(); ++i)
            sum = (sum ^ words[i]) * 0x100000001B3u;
        std::memcpy(&words[words.size() - 2], &sum, 8);
    };
    const auto refuse_file = [&](const auto& change, bool sealed) {
        std::vector<uint32_t> other = file;
        change(other);
        if (sealed) seal(other);
        provoke(read_visible_set(context, &mesh, 1, other.data(), 4 * other.size(), &none), bad);
        EXPECT_EQ(none, nullptr);
    };
    using File = std::vector<uint32_t>;
    refuse_file([](File& f) { f.resize(3); }, false);
    refuse_file([](File& f) { f[0] = 0; }, true);
    refuse_file([](File& f) { f[2] = 99; }, true);
    refuse_file([](File& f) { f[10] ^= 1; }, false);
    refuse_file([](File& f) { f[10] ^= 1; }, true);
    refuse_file([](File& f) { f[9] = 1; }, true);
    refuse_file([](File& f) { f[4] = 2; }, true);
    refuse_file([](File& f) { f[5] = 2; }, true);
    refuse_file([](File& f) { f.erase(f.begin() + 10, f.end() - 2); }, true);
    provoke(read_visible_set(context, &mesh, 1, file.data(), 4 * file.size() - 1, &none), bad);
    provoke(read_visible_set(context, &mesh, 1, file.data(), 4 * file.size(), nullptr), bad);
    provoke(read_visible_set(nullptr, &mesh, 1, file.data(), 4 * file.size(), &none), bad);

    refuse_frame([&](FrameDesc& d, FrameMesh&) { d.visible = d.record = set; });
    refuse_frame([&](FrameDesc& d, FrameMesh&) {
        d.visible = set;
        d.visible_segment = 1;
    });
    refuse_frame([&](FrameDesc& d, FrameMesh&) {
        d.visible = set;
        d.quality = Quality::draft;
    });
    refuse_frame([&](FrameDesc& d, FrameMesh&) {
        d.visible = set;
        d.falloff = {1, 2};
    });
    refuse_frame([&](FrameDesc& d, FrameMesh& m) {
        d.visible = set;
        m.receive_only = 1;
    });
    refuse_frame([&](FrameDesc& d, FrameMesh& m) {
        d.visible = set;
        m.back.transfer = use.transfer;
    });
    refuse_frame([&](FrameDesc& d, FrameMesh&) {
        d.visible = set;
        d.watertight = true;
    });
    file[8] = 1; // recorded
    seal(file);
    VisibleSet* recorded = nullptr;
    ASSERT_TRUE(read_visible_set(context, &mesh, 1, file.data(), 4 * file.size(), &recorded).ok());
    refuse_frame([&](FrameDesc& d, FrameMesh&) {
        d.record = recorded;
        d.watertight = true;
    });
    destroy_visible_set(context, recorded);
    MeshDesc larger = mesh_desc;
    const uint32_t twice[6] = {0, 1, 2, 0, 2, 1};
    larger.indices = twice;
    larger.index_count = 6;
    FrameMesh other = use;
    ASSERT_TRUE(add_mesh(context, larger, &other.mesh).ok());
    refuse_frame([&](FrameDesc& d, FrameMesh& m) {
        d.visible = set;
        m = other;
    });
    destroy_visible_set(context, set);
}

void Statuses::of_memory() {
    Context* made = nullptr;
    Scarce none;
    none.left = 0;
    ContextDesc desc;
    desc.allocator = none.hook();
    provoke(create_context(desc, &made), StatusCode::out_of_memory);
    MeshId id;
    MeshMemory bound;
    FrameId frame;
    scarce.left = 0;
    provoke(add_mesh(context, mesh_desc, &id), StatusCode::out_of_memory);
    provoke(mesh_memory_bound(context, mesh_desc, &bound), StatusCode::out_of_memory);
    scarce.left = 1 << 30;
    // Larger than any frame so far, so that it needs memory.
    std::vector<float> points(3 * 5000), out(25 * 5000);
    for (size_t i = 0; i < points.size(); ++i)
        points[i] = 1 + float(i);
    FrameMesh large = use;
    large.positions = large.normals = {points.data(), 5000, 12};
    large.transfer = {out.data(), 5000, 100};
    large.masks = {};
    ASSERT_TRUE(add_mesh(context, {large.positions, {}, nullptr, 0}, &large.mesh).ok());
    scarce.left = 0;
    provoke(submit(context, {&large, 1}, &frame), StatusCode::out_of_memory);
    HistoryId history;
    Status status = create_history(context, &history);
    while (status.ok()) // until no frame is left that could become one
        status = create_history(context, &history);
    provoke(status, StatusCode::out_of_memory);
    scarce.left = 1 << 30;
    heap_is_empty = true; // no tables of this quality yet
    const Status tables = submit(context, {&large, 1, Quality::paper}, &frame);
    heap_is_empty = false;
    provoke(tables, StatusCode::out_of_memory);
    ASSERT_TRUE(submit(context, {&large, 1, Quality::paper}, &frame).ok());
    EXPECT_TRUE(wait(context, frame, nullptr).ok());
}

void Statuses::of_cameras() {
    uint32_t needed = 0;
    provoke(mark_visible({}, use.positions, indices, 3, nullptr), StatusCode::invalid_argument);
    provoke(mark_visible({}, {positions, 3, 8}, indices, 3, &needed), StatusCode::invalid_argument);
    provoke(mark_visible({}, use.positions, indices, 2, &needed), StatusCode::invalid_argument);
    indices[2] = 3;
    provoke(mark_visible({}, use.positions, indices, 3, &needed), StatusCode::invalid_argument);
    indices[2] = 2;
    EXPECT_EQ(needed, 0u);
}

void Statuses::of_lighting() {
    float light[75], rgb[9];
    provoke(sh_project_latlong(nullptr, 1, 1, light, nullptr), StatusCode::invalid_argument);
    provoke(shade(nullptr, light, use.transfer, {}, rgb), StatusCode::invalid_argument);
    provoke(shade(context, light, {transfer.data(), 3, 10}, {}, rgb), StatusCode::invalid_argument);
    provoke(shade(context, light, use.transfer, {}, rgb, 0), StatusCode::invalid_argument);
}

void Statuses::of_c() {
    nusselt_context* c = reinterpret_cast<nusselt_context*>(context);
    nusselt_mesh_desc desc = {};
    nusselt_mesh id;
    size_t held;
    provoke(nusselt_create_tbb_executor(2, nullptr), StatusCode::invalid_argument);
    provoke(nusselt_create_context(nullptr, nullptr), StatusCode::invalid_argument);
    provoke(nusselt_add_mesh(c, nullptr, &id), StatusCode::invalid_argument);
    provoke(nusselt_add_mesh(c, &desc, &id), StatusCode::invalid_argument); // no size
    desc.size = sizeof desc + 1;
    provoke(nusselt_add_mesh(c, &desc, &id), StatusCode::unsupported);
    provoke(nusselt_get_mesh_info(c, {}, nullptr), StatusCode::invalid_argument);
    provoke(nusselt_mesh_memory_bound(c, &desc, &held, nullptr), StatusCode::invalid_argument);
    provoke(nusselt_submit(nullptr, nullptr, nullptr), StatusCode::invalid_argument);
    provoke(nusselt_mark_visible(nullptr, {}, nullptr, 0, nullptr), StatusCode::invalid_argument);
    // More meshes than fit the stack: they are gathered in memory of the host's.
    const std::vector<nusselt_frame_mesh> many(100);
    nusselt_frame_desc frame = {};
    frame.size = sizeof frame;
    frame.meshes = many.data();
    frame.mesh_size = sizeof many[0];
    frame.mesh_count = static_cast<uint32_t>(many.size());
    nusselt_frame handle;
    scarce.left = 0;
    provoke(nusselt_submit(c, &frame, &handle), StatusCode::out_of_memory);
    scarce.left = 1 << 30;
}

TEST_F(Statuses, EveryOneIsProvoked) {
    of_contexts();
    of_executors();
    of_meshes();
    of_frames();
    of_outputs();
    of_light();
    of_frames_in_flight();
    of_histories();
    of_visible_sets();
    of_memory();
    of_cameras();
    of_lighting();
    of_c();
    const std::map<std::string, std::string> texts = texts_in_sources();
    EXPECT_GT(texts.size(), 50u);
    for (const auto& [text, file] : texts) {
        const bool of_no_tbb = text.find("built without TBB") != std::string::npos;
        const bool of_tbb = file == "tbb_executor.cpp" && !of_no_tbb;
        if (has_feature(Feature::tbb) ? of_no_tbb : of_tbb) continue; // of another build
        EXPECT_EQ(seen.count(text), 1u) << file << ": nothing here provokes \"" << text << '"';
    }
    // What happens, then what to do about it.
    for (const auto& [text, code] : seen) {
        EXPECT_EQ(texts.count(text), 1u) << text;
        EXPECT_NE(text.find(';'), std::string::npos) << "names no cure: " << text;
    }
}

} // namespace

} // namespace nusselt::test
