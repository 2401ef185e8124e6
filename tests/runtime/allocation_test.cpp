// A thousand frames in steady state allocate nothing, by whatever way to the heap: operator new comes to
// malloc.
#include "tests/heap.h"
#include "tests/runtime/fixture.h"

#include <algorithm>
#include <thread>

namespace nusselt::test {

namespace {

// Two small meshes in two poses by turns, so that no frame is the one before it; memory of their own, so that
// running a frame asks for none.
struct Ready {
    explicit Ready(Context* c) : context(c) {
        for (const scenes::Mesh& mesh : {scenes::torus(1, 0.4f, 24, 12), scenes::plane(3, 12)}) {
            const MeshId id = add(c, mesh);
            Posed pose = at_rest(id, mesh);
            const size_t count = pose.positions.size();
            transfer.emplace_back(25 * count);
            behind.resize(25 * count); // of the last, the sheet
            for (Moment& moment : moments) {
                moment.posed.push_back(pose);
                for (glm::vec3& p : pose.positions)
                    p.y += 0.3f * p.x * p.x; // the next moment's
            }
        }
        for (Moment& moment : moments) {
            for (size_t m = 0; m < moment.posed.size(); ++m) {
                const Posed& p = moment.posed[m];
                const size_t count = p.positions.size();
                moment.meshes.push_back({p.mesh,
                                         {&p.positions[0].x, count, 12},
                                         {&p.normals[0].x, count, 12},
                                         {transfer[m].data(), count, 100},
                                         {}});
            }
            // The sheet is seen from behind too.
            moment.meshes[1].back.transfer = {behind.data(), behind.size() / 25, 100};
        }
    }

    // Until one allocates.
    uint64_t allocations_in(int frames, bool plant = false, const Falloff& falloff = {}) {
        heap_allocations = 0;
        heap_is_counted = true;
        for (int i = 0; i < frames && heap_allocations == 0; ++i) {
            FrameId id;
            FrameStats stats;
            const std::vector<FrameMesh>& meshes = moments[i % 2].meshes;
            FrameDesc desc{meshes.data(), uint32_t(meshes.size()), Quality::standard};
            desc.falloff = falloff;
            (void)submit(context, desc, &id);
            (void)wait(context, id, &stats);
            receivers += stats.receivers_written;
            most_threads = std::max(most_threads, stats.threads);
            if (plant) planted = new int(1);
        }
        heap_is_counted = false;
        delete planted;
        planted = nullptr;
        return heap_allocations;
    }

    struct Moment {
        std::vector<Posed> posed;
        std::vector<FrameMesh> meshes;
    };
    Context* context;
    Moment moments[2];
    std::vector<std::vector<float>> transfer;
    std::vector<float> behind;
    uint32_t most_threads = 0;
    uint64_t receivers = 0;
    int* volatile planted = nullptr;
};

TEST(Allocation, SeesOneThatIsPlanted) {
    Engine engine;
    Ready ready(engine.context);
    ready.allocations_in(2);
    EXPECT_EQ(ready.allocations_in(1, true), 1u);
}

TEST(Allocation, NoneWithTheSerialExecutor) {
    Engine engine;
    Ready ready(engine.context);
    EXPECT_GT(ready.allocations_in(1), 10u);
    ready.receivers = 0;
    EXPECT_EQ(ready.allocations_in(1000), 0u);
    EXPECT_GT(ready.receivers, 400000u);
    EXPECT_GT(ready.allocations_in(2, false, {0.2f, 1}), 0u);
    ready.allocations_in(2, false, {0.2f, 1});
    EXPECT_EQ(ready.allocations_in(500, false, {0.2f, 1}), 0u);
}

TEST(Allocation, NoneWithTbb) {
    Executor executor;
    const Status status = create_tbb_executor(2, &executor);
    if (status.code == StatusCode::unsupported) GTEST_SKIP() << status.text;
    ASSERT_TRUE(status.ok()) << status.text;
    {
        ContextDesc desc;
        desc.executor = executor;
        Engine engine(desc);
        Ready ready(engine.context);
        // TBB's own pools grow to the most tasks that were ever in flight: quiet soon, not at once.
        const uint32_t wanted = std::min(2u, std::thread::hardware_concurrency());
        bool quiet = false;
        for (int attempt = 0; attempt < 60 && !quiet; ++attempt) {
            ready.most_threads = 0;
            quiet = ready.allocations_in(1000) == 0 && ready.most_threads >= wanted;
        }
        EXPECT_TRUE(quiet) << heap_allocations << " allocations, " << ready.most_threads << " threads";
    }
    destroy_executor(&executor);
}

} // namespace

} // namespace nusselt::test
