// A frame in steady state allocates nothing, by whatever way to the heap.
#include "tests/runtime/fixture.h"

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <cstdlib>
#include <thread>

namespace {
std::atomic<bool> counting = false;
std::atomic<uint64_t> allocations = 0;

void count() {
    if (counting.load(std::memory_order_relaxed)) allocations.fetch_add(1, std::memory_order_relaxed);
}
} // namespace

extern "C" {
void* __libc_malloc(size_t size);
void* __libc_calloc(size_t count, size_t size);
void* __libc_realloc(void* memory, size_t size);
void* __libc_memalign(size_t alignment, size_t size);

void* malloc(size_t size) {
    count();
    return __libc_malloc(size);
}
void* calloc(size_t number, size_t size) {
    count();
    return __libc_calloc(number, size);
}
void* realloc(void* memory, size_t size) {
    count();
    return __libc_realloc(memory, size);
}
void* memalign(size_t alignment, size_t size) {
    count();
    return __libc_memalign(alignment, size);
}
void* aligned_alloc(size_t alignment, size_t size) {
    count();
    return __libc_memalign(alignment, size);
}
int posix_memalign(void** memory, size_t alignment, size_t size) {
    count();
    *memory = __libc_memalign(alignment, size);
    return *memory ? 0 : ENOMEM;
}
}

namespace nusselt::test {

namespace {

// A scene's frame with memory of its own, so that running it asks for none.
struct Ready {
    Ready(Context* c, const scenes::Scene& scene) : context(c), frame(posed(scene, add_all(c, scene), 0.3)) {
        transfer.resize(frame.size());
        for (size_t m = 0; m < frame.size(); ++m) {
            const size_t size = frame[m].positions.size();
            transfer[m].resize(25 * size);
            meshes.push_back({frame[m].mesh,
                              {&frame[m].positions[0].x, size, 12},
                              {&frame[m].normals[0].x, size, 12},
                              {transfer[m].data(), size, 100},
                              {}});
        }
    }

    uint64_t allocations_in(int frames, bool plant = false) {
        allocations = 0;
        counting = true;
        for (int i = 0; i < frames; ++i) {
            FrameId id;
            FrameStats stats;
            (void)submit(context, {meshes.data(), uint32_t(meshes.size()), Quality::standard}, &id);
            (void)wait(context, id, &stats);
            most_threads = std::max(most_threads, stats.threads);
            if (plant) planted = new int(1);
        }
        counting = false;
        delete planted;
        planted = nullptr;
        return allocations;
    }

    Context* context;
    std::vector<Posed> frame;
    std::vector<std::vector<float>> transfer;
    std::vector<FrameMesh> meshes;
    uint32_t most_threads = 0;
    int* volatile planted = nullptr;
};

TEST(Allocation, SeesOneThatIsPlanted) {
    Engine engine;
    Ready ready(engine.context, scenes::builtin("cloth"));
    ready.allocations_in(1);
    EXPECT_EQ(ready.allocations_in(1, true), 1u);
}

TEST(Allocation, NoneWithTheSerialExecutor) {
    Engine engine;
    Ready ready(engine.context, scenes::builtin("fight"));
    EXPECT_GT(ready.allocations_in(1), 10u);
    EXPECT_EQ(ready.allocations_in(30), 0u);
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
        Ready ready(engine.context, scenes::builtin("cloth"));
        // TBB's own pools grow to the most tasks that were ever in flight: quiet soon, not at once.
        const uint32_t wanted = std::min(2u, std::thread::hardware_concurrency());
        bool quiet = false;
        for (int attempt = 0; attempt < 60 && !quiet; ++attempt) {
            ready.most_threads = 0;
            quiet = ready.allocations_in(50) == 0 && ready.most_threads >= wanted;
        }
        EXPECT_TRUE(quiet) << allocations << " allocations, " << ready.most_threads << " threads";
    }
    destroy_executor(&executor);
}

} // namespace

} // namespace nusselt::test
