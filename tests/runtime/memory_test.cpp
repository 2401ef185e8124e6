// The caller's allocator: every byte comes back, and no failure breaks anything.
#include "tests/runtime/crowd.h"

#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <map>
#include <mutex>

namespace nusselt::test {

namespace {

// Knows what is out, and fails the k-th request.
struct Ledger {
    std::map<void*, std::pair<size_t, size_t>> out;
    uint64_t requests = 0, fail_at = UINT64_MAX;
    std::string wrong;

    size_t bytes() const {
        size_t sum = 0;
        for (const auto& [memory, block] : out)
            sum += block.first;
        return sum;
    }

    Allocator hook() {
        Allocator a;
        a.user = this;
        a.allocate = [](void* user, size_t size, size_t alignment) -> void* {
            Ledger& ledger = *static_cast<Ledger*>(user);
            if (alignment == 0 || alignment > 128 || (alignment & (alignment - 1)))
                ledger.wrong += "alignment; ";
            if (ledger.requests++ == ledger.fail_at) return nullptr;
            void* memory =
                std::aligned_alloc(alignment, (size + alignment - 1) / alignment * alignment + alignment);
            ledger.out[memory] = {size, alignment};
            return memory;
        };
        a.release = [](void* user, void* memory, size_t size, size_t alignment) {
            Ledger& ledger = *static_cast<Ledger*>(user);
            const auto found = ledger.out.find(memory);
            if (found == ledger.out.end()) {
                ledger.wrong += "released what isn't out; ";
                return;
            }
            if (found->second != std::pair(size, alignment)) ledger.wrong += "size or alignment differs; ";
            ledger.out.erase(found);
            std::free(memory);
        };
        return a;
    }
};

TEST(Memory, EverythingComesFromTheAllocatorAndGoesBack) {
    Ledger ledger;
    ContextDesc desc;
    desc.allocator = ledger.hook();
    Context* context = nullptr;
    ASSERT_TRUE(create_context(desc, &context).ok());
    const scenes::Scene scene = scenes::builtin("chess");
    const std::vector<MeshId> ids = add_all(context, scene);
    run_frame(context, posed(scene, ids, 0.2));
    const size_t held = ledger.out.size();
    EXPECT_GT(held, 50u);
    EXPECT_TRUE(remove_mesh(context, ids[0]).ok());
    EXPECT_LT(ledger.out.size(), held); // at once
    EXPECT_TRUE(destroy_context(context).ok());
    EXPECT_TRUE(ledger.out.empty());
    EXPECT_EQ(ledger.wrong, "");
}

TEST(Memory, NoRequestsInSteadyState) {
    Ledger ledger;
    ContextDesc desc;
    desc.allocator = ledger.hook();
    {
        Engine engine(desc);
        const scenes::Scene scene = scenes::builtin("fight");
        const std::vector<MeshId> ids = add_all(engine.context, scene);
        run_frame(engine.context, posed(scene, ids, 0));
        const uint64_t before = ledger.requests;
        for (int i = 1; i < 6; ++i)
            run_frame(engine.context, posed(scene, ids, 0.2 * i));
        EXPECT_EQ(ledger.requests, before);
        FrameDesc fading;
        fading.falloff = {0.05f, 0.3f};
        run_frame(engine.context, posed(scene, ids, 0), fading);
        const uint64_t faded = ledger.requests;
        for (int i = 1; i < 6; ++i) {
            fading.falloff.to *= 1.7f;
            run_frame(engine.context, posed(scene, ids, 0.2 * i), fading);
            run_frame(engine.context, posed(scene, ids, 0.2 * i));
        }
        EXPECT_EQ(ledger.requests, faded);
    }
    EXPECT_EQ(ledger.wrong, "");
}

// The bounds of runtime/README.md, "Memory". One context a scene, one thread.
TEST(Memory, FramesAndHistoriesKeepToTheirBounds) {
    for (const char* name : {"hand", "cloth", "fight", "chess"}) {
        const scenes::Scene scene = scenes::builtin(name);
        for (const Quality quality : {Quality::standard, Quality::fine}) {
            Ledger ledger;
            ContextDesc desc;
            desc.allocator = ledger.hook();
            Engine engine(desc);
            const std::vector<MeshId> ids = add_all(engine.context, scene);
            size_t vertices = 0, triangles = 0;
            for (const scenes::Mesh& mesh : scene.meshes) {
                vertices += mesh.rest_positions.size();
                triangles += mesh.indices.size() / 3;
            }
            const size_t meshes = ledger.bytes();
            run_frame(engine.context, posed(scene, ids, 0), quality);
            const size_t frame = ledger.bytes() - meshes;
            FrameDesc fading;
            fading.quality = quality;
            fading.falloff = {0.1f, 0.2f};
            run_frame(engine.context, posed(scene, ids, 0), fading);
            const size_t faded = ledger.bytes() - meshes - frame;
            EXPECT_LE(faded,
                      12 * quality_mask_bits(quality) + 2 * ((quality == Quality::fine ? 230 : 100) << 10));
            FrameDesc settings;
            settings.quality = quality;
            ASSERT_TRUE(create_history(engine.context, &settings.history).ok());
            ASSERT_TRUE(
                create_history(engine.context, &settings.history).ok()); // one with a frame of its own
            run_frame(engine.context, posed(scene, ids, 0), settings);
            const size_t history = ledger.bytes() - meshes - frame - faded;
            // The same with backs, in a context of its own: other workers.
            Ledger of_both;
            ContextDesc both_desc;
            both_desc.allocator = of_both.hook();
            Engine both(both_desc);
            std::vector<Posed> turned = posed(scene, add_all(both.context, scene), 0);
            for (Posed& mesh : turned)
                mesh.back_receives = true;
            const size_t meshes_of_both = of_both.bytes();
            run_frame(both.context, turned, quality);
            const size_t backs = of_both.bytes() - meshes_of_both;
            EXPECT_LE(backs, frame + 2 * ((quality == Quality::fine ? 78 : 40) << 10));
            const size_t mask = quality_mask_bits(quality) / 8;
            EXPECT_LE(frame, 24 * vertices + 128 * triangles + 2 * (96 << 10));
            EXPECT_LE(history, (160 + mask) * vertices + 192 * triangles + 2 * (32 << 10));
            std::printf(
                "%s %s: frame %.1f B a triangle, history %.1f B a vertex without masks, %zu and %zu; with "
                "backs %td more\n",
                name, quality_name(quality), double(frame) / double(triangles),
                double(history) / double(vertices) - double(mask), frame, history,
                ptrdiff_t(backs) - ptrdiff_t(frame));
        }
    }
}

// Two thousand closed parts of twenty triangles, half of them with a corner pulled out, so that its triangles
// are large beside the others: clusters of few triangles.
TEST(Memory, AFrameOfManySmallPartsKeepsToItsBound) {
    scenes::Mesh balls;
    for (uint32_t i = 0; i < 2000; ++i) {
        const scenes::Mesh ball = scenes::sphere(0);
        const uint32_t first = static_cast<uint32_t>(balls.rest_positions.size());
        for (glm::vec3 p : ball.rest_positions) {
            if (i % 2 && p.x > 0.8f) p.x = 12;
            balls.rest_positions.push_back(0.3f * p + glm::vec3(i % 20, i / 20 % 10, i / 200));
        }
        balls.rest_normals.insert(balls.rest_normals.end(), ball.rest_normals.begin(),
                                  ball.rest_normals.end());
        for (const uint32_t v : ball.indices)
            balls.indices.push_back(first + v);
    }
    Ledger ledger;
    ContextDesc desc;
    desc.allocator = ledger.hook();
    Engine engine(desc);
    const MeshId id = add(engine.context, balls);
    const size_t mesh = ledger.bytes(), triangles = balls.indices.size() / 3;
    run_frame(engine.context, {at_rest(id, balls)}, Quality::standard);
    const size_t frame = ledger.bytes() - mesh;
    EXPECT_LE(frame, 24 * balls.rest_positions.size() + 128 * triangles + 2 * (96 << 10));
    std::printf("small parts: mesh %.1f B a triangle, frame %.1f\n", double(mesh) / double(triangles),
                double(frame) / double(triangles));
}

// Frames of several objects have their clusters twice, and a view of what is far a mesh.
TEST(Memory, FramesOfManyObjectsKeepToTheirBound) {
    for (const uint32_t count : {2u, 6u}) {
        for (const Quality quality : {Quality::standard, Quality::fine}) {
            if (quality == Quality::fine && count > 2) continue;
            Ledger ledger;
            ContextDesc desc;
            desc.allocator = ledger.hook();
            Engine engine(desc);
            const std::vector<Posed> meshes = crowd(engine.context, count, 1.2f);
            const scenes::Scene scene = scenes::builtin("fight");
            size_t vertices = 0, triangles = 0;
            for (const scenes::Mesh& mesh : scene.meshes) {
                vertices += count * mesh.rest_positions.size();
                triangles += count * mesh.indices.size() / 3;
            }
            const size_t held = ledger.bytes();
            FrameDesc settings;
            settings.quality = quality;
            run_far(engine.context, meshes, settings);
            const size_t frame = ledger.bytes() - held;
            const size_t table = quality == Quality::fine ? 2100000 : 530000;
            EXPECT_LE(frame, 24 * vertices + 138 * triangles + 6100 * meshes.size() + table + 2 * (96 << 10))
                << count << " " << quality_name(quality);
            std::printf("%u fighters %s: frame %zu\n", count, quality_name(quality), frame);
            const uint64_t before = ledger.requests;
            std::vector<Posed> next = meshes;
            for (int i = 0; i < 4; ++i) {
                for (Posed& mesh : next) {
                    mesh.positions[0].y += 0.1f;
                    mesh.object = (mesh.object + uint32_t(i)) % (count + 1);
                }
                run_far(engine.context, next, settings);
            }
            EXPECT_EQ(ledger.requests, before);
        }
    }
}

// A history takes its memory with its first frame; none of what happens to it later takes more.
TEST(Memory, NoRequestsInSteadyStateWithAHistory) {
    Ledger ledger;
    ContextDesc desc;
    desc.allocator = ledger.hook();
    {
        Engine engine(desc);
        const scenes::Scene scene = scenes::builtin("fight");
        const std::vector<MeshId> ids = add_all(engine.context, scene);
        FrameDesc settings;
        ASSERT_TRUE(create_history(engine.context, &settings.history).ok());
        run_frame(engine.context, posed(scene, ids, 0), settings);
        const uint64_t before = ledger.requests;
        for (int i = 1; i < 8; ++i) {
            settings.budget_us = i % 3 == 2 ? 1.0f : 0.0f;
            run_frame(engine.context, posed(scene, ids, 0.2 * (i / 2)), settings);
        }
        EXPECT_EQ(ledger.requests, before);
        const size_t held = ledger.out.size();
        EXPECT_TRUE(remove_history(engine.context, settings.history).ok());
        EXPECT_LT(ledger.out.size(), held - 20); // at once
    }
    EXPECT_EQ(ledger.wrong, "");
}

// Context, two meshes and a frame, with the k-th request refused, for every k; tried again each time.
TEST(Memory, EveryFailureIsAnAnswerAndNothingMore) {
    const scenes::Mesh torus = scenes::torus(1, 0.4f, 10, 6), floor = scenes::plane(3, 2);
    Engine other; // holds the tables, which else would be built for every k
    const Outputs expected = run_at_rest(other.context, {torus, floor});
    uint64_t failures = 0;
    bool reached_the_end = false;
    for (uint64_t k = 0; !reached_the_end && k < 20000; ++k) {
        Ledger ledger;
        ledger.fail_at = k;
        uint64_t refused = 0;
        // Once more where there was no memory; nothing else may go wrong.
        const auto twice = [&](auto&& call) {
            Status status = call();
            if (!status.ok()) {
                EXPECT_EQ(status.code, StatusCode::out_of_memory) << k;
                ++refused;
                status = call();
            }
            EXPECT_TRUE(status.ok()) << k << " " << status.text;
        };
        ContextDesc desc;
        desc.allocator = ledger.hook();
        Context* context = nullptr;
        twice([&] {
            const Status s = create_context(desc, &context);
            EXPECT_EQ(context != nullptr, s.ok());
            return s;
        });
        ASSERT_NE(context, nullptr);
        std::vector<MeshId> ids;
        for (const scenes::Mesh* mesh : {&torus, &floor}) {
            const size_t count = mesh->rest_positions.size();
            MeshId id;
            twice([&] {
                const size_t out = ledger.out.size();
                const Status s = add_mesh(context,
                                          {{&mesh->rest_positions[0].x, count, 12},
                                           {&mesh->rest_normals[0].x, count, 12},
                                           mesh->indices.data(),
                                           mesh->indices.size()},
                                          &id);
                if (!s.ok()) {
                    EXPECT_LE(ledger.out.size(), out + 1) << k; // no more than the table of meshes
                    EXPECT_EQ(id.generation, 0u);
                }
                return s;
            });
            ids.push_back(id);
        }
        std::vector<std::vector<float>> transfer;
        std::vector<FrameMesh> frame;
        for (const scenes::Mesh* mesh : {&torus, &floor}) {
            const size_t count = mesh->rest_positions.size();
            transfer.emplace_back(25 * count);
            frame.push_back({ids[frame.size()],
                             {&mesh->rest_positions[0].x, count, 12},
                             {&mesh->rest_normals[0].x, count, 12},
                             {transfer.back().data(), count, 100},
                             {}});
        }
        // Without a history and with one; then another group, with the first one's failures in between.
        HistoryId history;
        twice([&] { return create_history(context, &history); });
        for (const uint32_t run : {0u, 1u, 2u, 3u}) {
            const uint64_t refused_before = refused;
            FrameDesc with{frame.data(), run == 2 ? 1u : 2u, Quality::standard};
            with.history = run > 0 ? history : HistoryId{};
            FrameId id;
            twice([&] { return submit(context, with, &id); });
            EXPECT_TRUE(wait(context, id, nullptr).ok()) << k;
            if (run == 2) continue;
            for (size_t m = 0; m < 2; ++m)
                ASSERT_EQ(std::memcmp(transfer[m].data(), expected.meshes[m].transfer.data(),
                                      4 * transfer[m].size()),
                          0)
                    << k;
            if (refused > 0 && refused == refused_before) break; // the frame after the failure was whole
        }
        ASSERT_TRUE(destroy_context(context).ok());
        ASSERT_TRUE(ledger.out.empty()) << k;
        ASSERT_EQ(ledger.wrong, "") << k;
        reached_the_end = ledger.requests <= k;
        // None where the memory was a luxury (giving back what a vector holds too much).
        ASSERT_LE(refused, reached_the_end ? 0u : 1u) << k;
        failures += refused;
    }
    EXPECT_TRUE(reached_the_end);
    EXPECT_GT(failures, 100u);
}

} // namespace

} // namespace nusselt::test
