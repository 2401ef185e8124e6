// What an engine asks for beyond submit and wait: poll, cancel, zones, memory told in advance, versions.
#include "bench/scenes/shapes.h"
#include "tests/embed/fixture.h"

#include <atomic>
#include <chrono>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <map>
#include <mutex>
#include <random>
#include <thread>

namespace nusselt::test {

namespace {

// Tasks start in `finish` only.
struct LateExecutor {
    struct Task {
        void (*run)(void*);
        void* argument;
    };
    Executor hook() {
        return {this,
                [](void* user, void (*run)(void*), void* argument) -> void* {
                    static_cast<LateExecutor*>(user)->enqueued++;
                    return new Task{run, argument};
                },
                [](void*, void* ticket) {
                    Task* task = static_cast<Task*>(ticket);
                    task->run(task->argument);
                    delete task;
                },
                1};
    }
    uint32_t enqueued = 0;
};

TEST(Poll, SaysWhenAFrameIsDone) {
    Host host("cloth"); // serial: done when submit returns
    FrameId id;
    bool done = false;
    ASSERT_TRUE(submit(host.context, host.frame(), &id).ok());
    EXPECT_TRUE(poll(host.context, id, &done).ok());
    EXPECT_TRUE(done);
    EXPECT_EQ(host.written(), 1420u);
    EXPECT_TRUE(wait(host.context, id, nullptr).ok());
    EXPECT_EQ(poll(host.context, id, &done).code, StatusCode::stale_handle);
    EXPECT_FALSE(done);
}

TEST(Poll, NeverBeforeWaitWhereTasksStartInFinish) {
    LateExecutor executor;
    ContextDesc desc;
    desc.executor = executor.hook();
    Host host("cloth", desc);
    FrameId id;
    bool done = true;
    ASSERT_TRUE(submit(host.context, host.frame(), &id).ok());
    EXPECT_TRUE(poll(host.context, id, &done).ok());
    EXPECT_FALSE(done);
    EXPECT_TRUE(wait(host.context, id, nullptr).ok());
    EXPECT_GT(executor.enqueued, 0u);
}

TEST(Poll, TurnsTrueWithoutAWaitingThread) {
    ContextDesc desc;
    desc.executor = ThreadExecutor::hook(2);
    Host host("cloth", desc);
    FrameId id;
    bool done = false;
    ASSERT_TRUE(submit(host.context, host.frame(), &id).ok());
    const auto end = std::chrono::steady_clock::now() + std::chrono::seconds(60);
    while (!done && std::chrono::steady_clock::now() < end) {
        ASSERT_TRUE(poll(host.context, id, &done).ok());
        std::this_thread::yield();
    }
    EXPECT_TRUE(done);
    EXPECT_EQ(host.written(), 1420u); // readable before wait
    EXPECT_TRUE(wait(host.context, id, nullptr).ok());
}

TEST(Poll, Arguments) {
    Host host("cloth");
    bool done = true;
    EXPECT_EQ(poll(nullptr, {}, &done).code, StatusCode::invalid_argument);
    EXPECT_EQ(poll(host.context, {}, nullptr).code, StatusCode::invalid_argument);
    EXPECT_EQ(poll(host.context, {}, &done).code, StatusCode::stale_handle);
    EXPECT_EQ(poll(host.context, {77, 1}, &done).code, StatusCode::stale_handle);
    EXPECT_EQ(cancel(nullptr, {}).code, StatusCode::invalid_argument);
    EXPECT_EQ(cancel(host.context, {}).code, StatusCode::stale_handle);
}

TEST(Cancel, BeforeAnythingRanNothingIsWritten) {
    LateExecutor executor;
    ContextDesc desc;
    desc.executor = executor.hook();
    Host host("fight", desc);
    FrameId id;
    FrameStats stats;
    ASSERT_TRUE(submit(host.context, host.frame(), &id).ok());
    EXPECT_TRUE(cancel(host.context, id).ok());
    EXPECT_TRUE(cancel(host.context, id).ok());
    EXPECT_TRUE(wait(host.context, id, &stats).ok());
    EXPECT_EQ(stats.receivers_written, 0u);
    EXPECT_EQ(host.written(), 0u);
    EXPECT_EQ(cancel(host.context, id).code, StatusCode::stale_handle);
    // The next frame is whole.
    ASSERT_TRUE(submit(host.context, host.frame(), &id).ok());
    EXPECT_TRUE(wait(host.context, id, &stats).ok());
    EXPECT_EQ(stats.receivers_written, stats.receivers);
    EXPECT_EQ(host.written(), stats.receivers);
}

// Cancels from inside the n-th piece of the receivers' stage, by the profiler's hook.
struct Canceller {
    static void begin(void* user, const char* zone) {
        Canceller& self = *static_cast<Canceller*>(user);
        if (std::strcmp(zone, self.zone) != 0 || ++self.seen != self.at) return;
        self.stop = true;
        while (self.stop)
            std::this_thread::yield();
    }
    static void end(void*, const char*) {}
    const char* zone = "nusselt receivers";
    std::atomic<int> at = 1;
    std::atomic<int> seen = 0;
    std::atomic<bool> stop = false;
};

TEST(Cancel, MidwayEveryReceiverIsWholeOrUntouched) {
    for (const char* name : {"fight", "chess", "cloth"}) {
        std::vector<std::vector<float>> whole;
        {
            Host host(name);
            FrameId id;
            ASSERT_TRUE(submit(host.context, host.frame(), &id).ok());
            ASSERT_TRUE(wait(host.context, id, nullptr).ok());
            whole = host.transfer;
        }
        for (const char* zone : {"nusselt points", "nusselt bands", "nusselt receivers"}) {
            for (const int at : {1, 2, 5}) {
                Canceller canceller;
                canceller.zone = zone;
                canceller.at = at;
                ContextDesc desc;
                desc.executor = ThreadExecutor::hook(2);
                desc.profiler = {&canceller, Canceller::begin, Canceller::end};
                Host host(name, desc);
                FrameId id;
                FrameStats stats;
                ASSERT_TRUE(submit(host.context, host.frame(), &id).ok());
                bool done = false;
                while (!done && !canceller.stop) {
                    ASSERT_TRUE(poll(host.context, id, &done).ok());
                    std::this_thread::yield();
                }
                EXPECT_TRUE(cancel(host.context, id).ok());
                canceller.at = 0;
                canceller.stop = false;
                EXPECT_TRUE(wait(host.context, id, &stats).ok());
                EXPECT_EQ(host.written(), stats.receivers_written) << name << " " << zone << " " << at;
                EXPECT_LE(stats.receivers_written, stats.receivers);
                if (!done && std::strcmp(zone, "nusselt points") == 0) {
                    EXPECT_EQ(stats.receivers_written, 0u);
                }
                for (size_t m = 0; m < whole.size(); ++m) {
                    for (size_t i = 0; i < whole[m].size(); ++i) {
                        if (host.transfer[m][i] != Host::unset) {
                            ASSERT_EQ(host.transfer[m][i], whole[m][i]) << name << " " << m << " " << i;
                        }
                    }
                }
            }
        }
    }
}

TEST(Cancel, FromAnotherThreadWhileOneWaits) {
    for (int round = 0; round < 20; ++round) {
        ContextDesc desc;
        desc.executor = ThreadExecutor::hook(2);
        Host host("cloth", desc);
        FrameId id;
        FrameStats stats;
        ASSERT_TRUE(submit(host.context, host.frame(), &id).ok());
        std::thread other([&] {
            std::this_thread::sleep_for(std::chrono::microseconds(50 * round));
            const Status status = cancel(host.context, id);
            EXPECT_TRUE(status.ok() || status.code == StatusCode::stale_handle);
        });
        EXPECT_TRUE(wait(host.context, id, &stats).ok());
        other.join();
        EXPECT_EQ(host.written(), stats.receivers_written);
    }
}

struct Zones {
    static void begin(void* user, const char* zone) {
        Zones& self = *static_cast<Zones*>(user);
        const std::lock_guard lock(self.guard);
        self.open[std::this_thread::get_id()].push_back(zone);
        ++self.count[zone];
    }
    static void end(void* user, const char* zone) {
        Zones& self = *static_cast<Zones*>(user);
        const std::lock_guard lock(self.guard);
        std::vector<const char*>& stack = self.open[std::this_thread::get_id()];
        ASSERT_FALSE(stack.empty());
        EXPECT_EQ(stack.back(), zone);
        stack.pop_back();
    }
    std::mutex guard;
    std::map<std::thread::id, std::vector<const char*>> open;
    std::map<std::string, int> count;
};

TEST(Profiler, ZonesComeInPairsAndNameEveryStage) {
    Zones zones;
    ContextDesc desc;
    desc.executor = ThreadExecutor::hook(3);
    desc.profiler = {&zones, Zones::begin, Zones::end};
    Host host("cloth", desc);
    FrameId id;
    ASSERT_TRUE(submit(host.context, host.frame(), &id).ok());
    ASSERT_TRUE(wait(host.context, id, nullptr).ok());
    for (const auto& [thread, stack] : zones.open)
        EXPECT_TRUE(stack.empty());
    EXPECT_EQ(zones.count["nusselt add_mesh"], 3);
    EXPECT_EQ(zones.count["nusselt submit"], 1);
    EXPECT_EQ(zones.count["nusselt wait"], 1);
    for (const char* stage : {"extents", "scale", "points", "clusters", "bands", "receivers"})
        EXPECT_GE(zones.count[std::string("nusselt ") + stage], 1) << stage;
    EXPECT_GE(zones.count["nusselt receivers"], 1420 / 128);
}

TEST(Profiler, BothFunctionsOrNone) {
    Context* context = nullptr;
    ContextDesc desc;
    desc.profiler.begin = [](void*, const char*) {};
    EXPECT_EQ(create_context(desc, &context).code, StatusCode::invalid_argument);
    desc.profiler.begin = nullptr;
    desc.profiler.end = [](void*, const char*) {};
    EXPECT_EQ(create_context(desc, &context).code, StatusCode::invalid_argument);
    EXPECT_EQ(context, nullptr);
}

// Counts what is held, and refuses from the n-th request on.
struct CountingAllocator {
    Allocator hook() {
        return {this,
                [](void* user, size_t size, size_t alignment) -> void* {
                    CountingAllocator& self = *static_cast<CountingAllocator*>(user);
                    if (self.requests++ >= self.refuse_from) return nullptr;
                    self.held += size;
                    self.peak = std::max(self.peak, self.held);
                    return std::aligned_alloc(alignment, (size + alignment - 1) / alignment * alignment);
                },
                [](void* user, void* memory, size_t size, size_t) {
                    static_cast<CountingAllocator*>(user)->held -= size;
                    std::free(memory);
                }};
    }
    size_t held = 0, peak = 0;
    uint64_t requests = 0, refuse_from = ~0ull;
};

struct MemoryTest : testing::Test {
    MemoryTest() {
        ContextDesc desc;
        desc.allocator = allocator.hook();
        EXPECT_TRUE(create_context(desc, &context).ok());
    }
    ~MemoryTest() override { EXPECT_TRUE(destroy_context(context).ok()); }

    // `loose`: how much farther off the bound may be where triangles are there many times, which it cannot
    // know.
    void check(const std::string& name, const std::vector<glm::vec3>& positions,
               const std::vector<uint32_t>& indices, size_t loose = 1) {
        SCOPED_TRACE(name + ", " + std::to_string(positions.size()) + " vertices");
        const MeshDesc desc{
            {&positions[0].x, positions.size(), sizeof(glm::vec3)}, {}, indices.data(), indices.size()};
        MeshMemory bound;
        ASSERT_TRUE(mesh_memory_bound(context, desc, &bound).ok());
        const size_t before = allocator.held;
        allocator.peak = before;
        MeshId id;
        MeshInfo info;
        ASSERT_TRUE(add_mesh(context, desc, &id).ok());
        ASSERT_TRUE(mesh_info(context, id, &info).ok());
        EXPECT_LE(info.bytes, bound.held);
        EXPECT_LE(allocator.held - before, bound.held);
        EXPECT_LE(allocator.peak - before, bound.peak);
        // Not so far off that it is of no use.
        EXPECT_LE(bound.held, 5 * loose * info.bytes + 20000);
        EXPECT_LE(bound.peak, 10 * loose * (allocator.peak - before) + 20000);
        ASSERT_TRUE(remove_mesh(context, id).ok());
    }

    float number() { return float(random() % 20001) / 10000 - 1; }
    std::vector<glm::vec3> cloud(size_t count) {
        std::vector<glm::vec3> points(count);
        for (glm::vec3& p : points)
            p = {number(), number(), number()};
        return points;
    }

    CountingAllocator allocator;
    Context* context = nullptr;
    std::minstd_rand random{7};
};

TEST_F(MemoryTest, BoundHoldsForTheScenes) {
    for (const std::string& name : scenes::builtin_names()) {
        for (const scenes::Mesh& mesh : scene_of(name).meshes)
            check(name, mesh.rest_positions, mesh.indices);
    }
}

TEST_F(MemoryTest, BoundHoldsForWhatNobodyModels) {
    const auto numbered = [](size_t count) {
        std::vector<uint32_t> indices(count);
        for (size_t i = 0; i < count; ++i)
            indices[i] = static_cast<uint32_t>(i);
        return indices;
    };
    for (const size_t count : {1u, 7u, 1000u, 5000u}) {
        check("soup", cloud(3 * count), numbered(3 * count));
        check("points", cloud(count), {});
        check("one place", std::vector<glm::vec3>(count, glm::vec3(1)), {});
        std::vector<uint32_t> mix(12 * count);
        for (uint32_t& index : mix)
            index = static_cast<uint32_t>(random() % count);
        check("random", cloud(count), mix);
        std::vector<uint32_t> same;
        for (size_t i = 0; i < count; ++i)
            same.insert(same.end(), {0, 1, 2});
        check("one triangle many times", cloud(3), same);
        std::vector<glm::vec3> rim{{0, 0, 1}};
        std::vector<uint32_t> fan;
        for (uint32_t i = 0; i < count; ++i) {
            const float angle = 6.28f * float(i) / float(count);
            rim.push_back({std::cos(angle), std::sin(angle), 0});
            fan.insert(fan.end(), {0, 1 + i, 1 + (i + 1) % static_cast<uint32_t>(count)});
        }
        check("fan", rim, fan);
    }
    for (const uint32_t n : {1u, 6u, 90u}) {
        std::vector<glm::vec3> points;
        std::vector<uint32_t> indices;
        for (uint32_t i = 0; i < (n + 1) * (n + 1); ++i)
            points.push_back({float(i % (n + 1)), float(i / (n + 1)), 0.2f * number()});
        for (uint32_t i = 0; i < n * n; ++i) {
            const uint32_t a = i / n * (n + 1) + i % n, b = a + n + 1;
            indices.insert(indices.end(), {a, a + 1, b, a + 1, b + 1, b});
        }
        check("grid", points, indices);
    }
    std::vector<glm::vec3> points;
    std::vector<uint32_t> indices;
    for (uint32_t hub = 0; hub < 20; ++hub) {
        const uint32_t first = static_cast<uint32_t>(points.size());
        for (const glm::vec3& p : cloud(251))
            points.push_back(p + glm::vec3(3.0f * float(hub), 0, 0));
        for (uint32_t i = 0; i < 250; ++i)
            indices.insert(indices.end(), {first, first + 1 + i, first + 1 + (i + 1) % 250});
    }
    check("hubs", points, indices);
}

// What the bound is made of grows apart: triangles without vertices, rings without triangles, levels that
// close holes, triangles that are each there many times.
TEST_F(MemoryTest, BoundHoldsWhereVerticesTrianglesAndRingsPart) {
    random.seed(8);
    for (const uint32_t vertices : {4u, 30u, 200u, 400u, 8000u}) {
        std::vector<uint32_t> indices(3 * 12000);
        for (uint32_t& index : indices)
            index = static_cast<uint32_t>(random() % vertices);
        check("few vertices, many triangles", cloud(vertices), indices, vertices < 20 ? 2 : 1);
    }
    for (const uint32_t vertices : {10u, 30u}) { // every triangle that there can be
        std::vector<uint32_t> indices;
        for (uint32_t a = 0; a < vertices; ++a) {
            for (uint32_t b = a + 1; b < vertices; ++b) {
                for (uint32_t c = b + 1; c < vertices; ++c)
                    indices.insert(indices.end(), {a, b, c});
            }
        }
        check("all triangles", cloud(vertices), indices);
    }
    // Triangles that share a vertex and nothing else: the rings are as long as the bound allows. Growing, a
    // list holds up to three times what it ends with.
    for (const uint32_t valence : {16u, 100u, 256u}) {
        for (const uint32_t hubs : {1u, 3u, 5u, 9u, 17u}) {
            std::vector<glm::vec3> points;
            std::vector<uint32_t> indices;
            for (uint32_t hub = 0; hub < hubs; ++hub) {
                const uint32_t first = static_cast<uint32_t>(points.size());
                for (const glm::vec3& p : cloud(2 * valence + 1))
                    points.push_back(p + glm::vec3(3.0f * float(hub), 0, 0));
                for (uint32_t i = 0; i < valence; ++i)
                    indices.insert(indices.end(), {first, first + 1 + 2 * i, first + 2 + 2 * i});
            }
            check("bow-ties of " + std::to_string(valence), points, indices);
        }
    }
    for (const uint32_t n : {20u, 50u}) {
        for (const uint32_t copies : {1u, 12u}) {
            for (const uint32_t keep :
                 {2u, 3u, 9u}) { // one quad in so many is a hole; or, with 2, half of them
                std::vector<glm::vec3> layer, points;
                std::vector<uint32_t> indices;
                for (uint32_t i = 0; i < (n + 1) * (n + 1); ++i)
                    layer.push_back({float(i % (n + 1)), float(i / (n + 1)), 0.2f * number()});
                for (uint32_t copy = 0; copy < copies; ++copy) {
                    const uint32_t first = static_cast<uint32_t>(points.size());
                    points.insert(points.end(), layer.begin(), layer.end());
                    for (uint32_t i = 0; i < n * n; ++i) {
                        if (random() % keep == 0) continue;
                        const uint32_t a = first + i / n * (n + 1) + i % n, b = a + n + 1;
                        indices.insert(indices.end(), {a, a + 1, b, a + 1, b + 1, b});
                    }
                }
                check("sieve of " + std::to_string(copies), points, indices, copies > 1 ? 4 : 1);
            }
        }
    }
    for (const uint32_t times : {2u, 50u}) { // a closed part, each triangle many times, and turned
        const scenes::Mesh ball = scenes::sphere(3);
        std::vector<uint32_t> indices;
        for (uint32_t k = 0; k < times; ++k) {
            for (size_t i = 0; i < ball.indices.size(); i += 3) {
                const uint32_t a = ball.indices[i], b = ball.indices[i + 1], c = ball.indices[i + 2];
                indices.insert(indices.end(), {a, k % 3 == 2 ? c : b, k % 3 == 2 ? b : c});
            }
        }
        check("the same ball again and again", ball.rest_positions, indices, times > 10 ? 4 : 1);
    }
}

TEST_F(MemoryTest, Arguments) {
    const float positions[9] = {};
    const uint32_t indices[3] = {0, 1, 5};
    MeshDesc desc{{positions, 3, 12}, {}, indices, 3};
    MeshMemory bound{5, 5};
    EXPECT_EQ(mesh_memory_bound(context, desc, &bound).code, StatusCode::invalid_argument); // index range
    EXPECT_EQ(bound.held, 0u);
    desc.index_count = 0;
    EXPECT_EQ(mesh_memory_bound(nullptr, desc, &bound).code, StatusCode::invalid_argument);
    EXPECT_EQ(mesh_memory_bound(context, desc, nullptr).code, StatusCode::invalid_argument);
    EXPECT_TRUE(mesh_memory_bound(context, desc, &bound).ok());
    const size_t before = allocator.held;
    for (uint64_t n = 0; n < 3; ++n) {
        allocator.refuse_from = allocator.requests + n;
        EXPECT_EQ(mesh_memory_bound(context, desc, &bound).code, StatusCode::out_of_memory) << n;
        EXPECT_EQ(allocator.held, before);
    }
    allocator.refuse_from = ~0ull;
}

TEST(Version, HeaderAndBinary) {
    EXPECT_TRUE(check_version().ok());
    EXPECT_TRUE(check_version(NUSSELT_VERSION).ok());
    EXPECT_EQ(check_version(NUSSELT_VERSION + 1).code, StatusCode::unsupported);     // a later patch
    EXPECT_EQ(check_version(NUSSELT_VERSION + 100).code, StatusCode::unsupported);   // another minor
    EXPECT_EQ(check_version(NUSSELT_VERSION + 10000).code, StatusCode::unsupported); // another major
    EXPECT_EQ(check_version(0).code, StatusCode::unsupported);
}

TEST(Version, Features) {
    Executor executor;
    const Status status = create_tbb_executor(1, &executor);
    EXPECT_EQ(has_feature(Feature::tbb), status.ok());
    destroy_executor(&executor);
    bool simd = false;
    for (const Isa isa : {Isa::sse4, Isa::avx2, Isa::avx512, Isa::neon})
        simd = simd || isa_available(isa);
    EXPECT_TRUE(has_feature(Feature::simd) || !simd);
    EXPECT_FALSE(has_feature(static_cast<Feature>(99)));
}

} // namespace

} // namespace nusselt::test
