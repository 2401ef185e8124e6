// A frame in steady state allocates nothing. Every way to the heap of glibc is counted, TBB's included: it
// comes here where its own allocator library is absent.
#include "tests/heap.h"
#include "tests/jobs/graph_fixture.h"

#include "nusselt/executor.h"

#include <algorithm>
#include <atomic>
#include <cstdlib>
#include <thread>

namespace nusselt::test {

namespace {

struct Frame {
    explicit Frame(uint32_t workers) : limits{6, 6, workers, 0}, memory(jobs::graph_bytes(limits)) {
        graph = jobs::create_graph(memory.data, memory.bytes, limits);
        const auto work = [](void* context, uint32_t begin, uint32_t end, uint32_t) {
            Frame& frame = *static_cast<Frame*>(context);
            for (uint32_t i = begin; i < end; ++i) {
                for (int spin = 0; spin < 300; ++spin) { // long enough for workers to wake up
                    frame.sink.store(spin, std::memory_order_relaxed);
                }
                if (frame.plant && i == 7) frame.planted = new int(1);
            }
        };
        for (uint32_t i = 0; i < limits.nodes; ++i) {
            jobs::add_node(*graph, {"node", work, this, 50, 3});
            if (i > 0) jobs::add_edge(*graph, i - 1, i);
        }
    }
    ~Frame() { delete planted; }
    Frame(const Frame&) = delete;
    Frame& operator=(const Frame&) = delete;

    jobs::GraphLimits limits;
    AlignedMemory memory;
    jobs::Graph* graph = nullptr;
    uint32_t most_threads = 0;
    std::atomic<int> sink = 0;
    bool plant = false;
    int* volatile planted = nullptr;
};

uint64_t allocations_in(Frame& frame, const Executor& executor, int runs) {
    heap_allocations = 0;
    heap_is_counted = true;
    for (int i = 0; i < runs; ++i) {
        (void)jobs::start(*frame.graph, executor);
        jobs::wait(*frame.graph);
        frame.most_threads = std::max(frame.most_threads, jobs::threads(*frame.graph));
    }
    heap_is_counted = false;
    return heap_allocations;
}

TEST(Allocation, SeesOneThatIsPlanted) {
    Frame frame(1);
    frame.plant = true;
    EXPECT_GE(allocations_in(frame, serial_executor(), 1), 1u);
    heap_is_counted = true;
    const uint64_t before = heap_allocations;
    void* volatile kept; // a pair of malloc and free that nobody looks at may be left out
    kept = std::malloc(10);
    std::free(kept);
    kept = std::calloc(3, 10);
    std::free(kept);
    kept = std::aligned_alloc(64, 64);
    std::free(kept);
    heap_is_counted = false;
    EXPECT_EQ(heap_allocations - before, 3u);
}

TEST(Allocation, NoneWithTheSerialExecutor) {
    Frame frame(1);
    EXPECT_EQ(allocations_in(frame, serial_executor(), 1000), 0u);
}

TEST(Allocation, NoneWithTbbInSteadyState) {
    for (const uint32_t threads : {1u, 2u, 4u}) {
        Executor executor;
        const Status status = create_tbb_executor(threads, &executor);
        if (status.code == StatusCode::unsupported) GTEST_SKIP() << status.text;
        ASSERT_TRUE(status.ok()) << status.text;
        Frame frame(4);
        // TBB's pools grow to the most tasks that were ever in flight, which is a matter of luck on a busy
        // machine: so a thousand quiet frames with more than one thread must come soon, not at once.
        const uint32_t wanted = std::min({threads, 2u, std::thread::hardware_concurrency()});
        bool quiet = false;
        for (int attempt = 0; attempt < 300 && !quiet; ++attempt) {
            frame.most_threads = 0;
            quiet = allocations_in(frame, executor, 1000) == 0 && frame.most_threads >= wanted;
        }
        EXPECT_TRUE(quiet) << threads << " threads; last: " << heap_allocations << " allocations, "
                           << frame.most_threads << " threads";
        destroy_executor(&executor);
    }
}

} // namespace

} // namespace nusselt::test
