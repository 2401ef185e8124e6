#include "tests/jobs/executors.h"
#include "tests/jobs/graph_fixture.h"

#include <filesystem>
#include <set>
#include <stdexcept>
#include <thread>

namespace nusselt::test {

namespace {

class Hostile : public testing::TestWithParam<ExecutorOptions> {
protected:
    TestExecutor executor{GetParam()};
    uint32_t workers = GetParam().concurrency;
    bool slow = GetParam().delays;
};

TEST_P(Hostile, RandomGraphs) {
    for (uint32_t seed = 1; seed <= (slow ? 10u : 60u); ++seed) {
        const uint32_t nodes = 1 + seed % 23;
        CheckedGraph graph(random_nodes(nodes, seed), random_edges(nodes, seed % 50, seed), workers);
        for (int again = 0; again < 3; ++again) {
            graph.run(executor.hook());
            EXPECT_EQ(executor.broken(), "");
        }
        if (HasFailure()) return;
    }
}

TEST_P(Hostile, WideNode) {
    CheckedGraph graph({{100000, 7}}, {}, workers);
    graph.run(executor.hook());
    EXPECT_EQ(executor.broken(), "");
}

TEST_P(Hostile, WideGraph) {
    const uint32_t width = slow ? 100 : 500;
    std::vector<NodeSpec> specs(width + 2, {3, 1});
    std::vector<EdgeSpec> edges;
    for (uint32_t i = 1; i <= width; ++i) {
        edges.emplace_back(0, i);
        edges.emplace_back(i, width + 1);
    }
    CheckedGraph graph(specs, edges, workers);
    graph.run(executor.hook());
    EXPECT_EQ(executor.broken(), "");
}

TEST_P(Hostile, DeepGraphWithEmptyNodes) {
    const uint32_t depth = slow ? 200 : 3000;
    std::vector<NodeSpec> specs;
    std::vector<EdgeSpec> edges;
    for (uint32_t i = 0; i < depth; ++i) {
        specs.push_back({i % 3 == 0 ? 0 : i % 5, 1});
        if (i > 0) edges.emplace_back(i - 1, i);
    }
    CheckedGraph graph(specs, edges, workers);
    graph.run(executor.hook());
    EXPECT_EQ(executor.broken(), "");
}

// Long enough nodes for threads to meet in them, two side by side, then joined: a thread sanitizer sees here
// whether what one thread wrote is ordered before what another reads.
TEST_P(Hostile, WideBranchesThatJoin) {
    const uint32_t layers = slow ? 4 : 12;
    std::vector<NodeSpec> specs{{300, 4}};
    std::vector<EdgeSpec> edges;
    for (uint32_t layer = 0; layer < layers; ++layer) {
        const auto last = static_cast<uint32_t>(specs.size()) - 1;
        specs.insert(specs.end(), {{300, 3}, {300, 5}, {300, 4}});
        edges.insert(edges.end(),
                     {{last, last + 1}, {last, last + 2}, {last + 1, last + 3}, {last + 2, last + 3}});
    }
    CheckedGraph graph(specs, edges, workers);
    for (int again = 0; again < (slow ? 2 : 20); ++again) {
        graph.run(executor.hook());
    }
    EXPECT_EQ(executor.broken(), "");
}

TEST_P(Hostile, OnlyEmptyNodes) {
    CheckedGraph graph({{0, 1}, {0, 0}, {0, 3}}, {{0, 1}, {0, 2}}, workers);
    graph.run(executor.hook());
    EXPECT_EQ(executor.broken(), "");
}

TEST_P(Hostile, StartedAgainTenThousandTimes) {
    CheckedGraph graph({{1, 1}, {9, 2}, {0, 1}, {5, 1}, {4, 4}}, {{0, 1}, {0, 2}, {1, 3}, {2, 3}, {3, 4}},
                       workers);
    for (int i = 0; i < (slow ? 300 : 10000); ++i) {
        graph.run(executor.hook());
        ASSERT_EQ(executor.broken(), "") << "run " << i;
        if (HasFailure()) return;
    }
}

TEST_P(Hostile, FewTickets) {
    for (const uint32_t tickets : {1u, 2u, 3u}) {
        const uint32_t nodes = 30;
        CheckedGraph graph(random_nodes(nodes, 5), random_edges(nodes, 40, 6), workers, tickets);
        for (int i = 0; i < 20; ++i) {
            executor.enqueued = 0;
            graph.run(executor.hook());
            EXPECT_LE(executor.enqueued.load(), tickets);
            EXPECT_EQ(executor.broken(), "");
        }
    }
}

TEST_P(Hostile, FewerWorkersThanTheExecutorOffers) {
    CheckedGraph graph(random_nodes(20, 3), random_edges(20, 30, 4), 1);
    graph.run(executor.hook());
    EXPECT_EQ(executor.broken(), "");
}

TEST_P(Hostile, SeveralGraphsFromSeveralThreads) {
    // A queue without threads of its own is for one waiting thread alone.
    const uint32_t callers = GetParam().threads > 0 || GetParam().order == Order::at_once ? 4 : 1;
    std::vector<std::thread> threads;
    for (uint32_t caller = 0; caller < callers; ++caller) {
        threads.emplace_back([&, caller] {
            CheckedGraph first(random_nodes(12, caller + 1), random_edges(12, 20, caller + 1), workers);
            CheckedGraph second(random_nodes(9, caller + 7), random_edges(9, 12, caller + 7), workers);
            for (int i = 0; i < (slow ? 10 : 300); ++i) {
                first.begin();
                second.begin();
                EXPECT_TRUE(jobs::start(*first, executor.hook()));
                EXPECT_TRUE(jobs::start(*second, executor.hook()));
                jobs::wait(*second);
                second.check();
                jobs::wait(*first);
                first.check();
            }
        });
    }
    for (std::thread& thread : threads) {
        thread.join();
    }
    // With several graphs the bound on queued tasks is a graph's, not the executor's.
    const std::string broken = executor.broken();
    EXPECT_EQ(broken.find("ticket"), std::string::npos) << broken;
    EXPECT_EQ(broken.find("never"), std::string::npos) << broken;
}

TEST_P(Hostile, WaitedForByAnotherThread) {
    CheckedGraph graph(random_nodes(15, 9), random_edges(15, 20, 9), workers);
    for (int i = 0; i < 20; ++i) {
        graph.begin();
        ASSERT_TRUE(jobs::start(*graph, executor.hook()));
        std::thread([&] { jobs::wait(*graph); }).join();
        graph.check();
        EXPECT_EQ(executor.broken(), "");
    }
}

INSTANTIATE_TEST_SUITE_P(Executors, Hostile, testing::ValuesIn(hostile_executors()),
                         [](const auto& named) { return named.param.name; });

TEST(Graph, WithoutNodesIsDone) {
    CheckedGraph graph({}, {}, 1);
    EXPECT_TRUE(jobs::done(*graph));
    EXPECT_TRUE(jobs::start(*graph, serial_executor()));
    EXPECT_TRUE(jobs::done(*graph));
    EXPECT_TRUE(jobs::start(*graph, serial_executor()));
    jobs::wait(*graph);
    EXPECT_EQ(jobs::threads(*graph), 0u);
}

TEST(Graph, ProgressesWithoutWaitAndAnswersPolls) {
    TestExecutor executor({"pool", Order::fifo, 2, 2});
    CheckedGraph graph({{200, 3}, {200, 3}, {200, 3}}, {{0, 1}, {1, 2}}, 2);
    for (int again = 0; again < 100; ++again) {
        graph.begin();
        ASSERT_TRUE(jobs::start(*graph, executor.hook()));
        while (!jobs::done(*graph)) {
        }
        graph.check();
        EXPECT_FALSE(jobs::start(*graph, executor.hook())) << "not waited for yet";
        jobs::wait(*graph);
        jobs::wait(*graph);
        EXPECT_EQ(executor.broken(), "");
    }
}

TEST(Graph, NeedsNoExecutorFunctions) {
    CheckedGraph graph(random_nodes(12, 2), random_edges(12, 20, 2), 3);
    graph.run(Executor());
    EXPECT_EQ(jobs::threads(*graph), 1u);
}

TEST(Graph, SurvivesAnExecutorThatThrows) {
    Executor executor;
    executor.enqueue = [](void*, void (*)(void*), void*) -> void* { throw std::runtime_error("full"); };
    executor.finish = [](void*, void*) { throw std::runtime_error("empty"); };
    executor.concurrency = 4;
    CheckedGraph graph(random_nodes(12, 2), random_edges(12, 20, 2), 4);
    graph.run(executor);
    executor.enqueue = [](void*, void (*run)(void*), void* argument) -> void* {
        run(argument);
        static int ticket;
        return &ticket;
    };
    graph.run(executor);
}

// One after another on one thread: the order itself can be seen.
TEST(Graph, ClaimsInOrder) {
    static std::vector<std::pair<uint32_t, uint32_t>> calls;
    calls.clear();
    const jobs::GraphLimits limits{2, 1, 1, 0};
    AlignedMemory memory(jobs::graph_bytes(limits));
    jobs::Graph* graph = jobs::create_graph(memory.data, memory.bytes, limits);
    ASSERT_NE(graph, nullptr);
    const auto work = [](void*, uint32_t begin, uint32_t end, uint32_t) { calls.emplace_back(begin, end); };
    EXPECT_EQ(jobs::add_node(*graph, {"first", work, nullptr, 10, 4}), 0u);
    EXPECT_EQ(jobs::add_node(*graph, {"second", work, nullptr, 2, 0}), 1u);
    EXPECT_STREQ(jobs::node_name(*graph, 1), "second");
    EXPECT_TRUE(jobs::add_edge(*graph, 0, 1));
    ASSERT_TRUE(jobs::start(*graph, serial_executor()));
    jobs::wait(*graph);
    const std::vector<std::pair<uint32_t, uint32_t>> expected{{0, 4}, {4, 8}, {8, 10}, {0, 1}, {1, 2}};
    EXPECT_EQ(calls, expected);

    calls.clear();
    jobs::set_items(*graph, 0, 0);
    jobs::set_items(*graph, 1, 1);
    ASSERT_TRUE(jobs::start(*graph, serial_executor()));
    jobs::wait(*graph);
    EXPECT_EQ(calls, (std::vector<std::pair<uint32_t, uint32_t>>{{0, 1}}));
}

TEST(Graph, RangesReachTheLastItemThatFits) {
    static std::atomic<uint64_t> items;
    items = 0;
    const jobs::GraphLimits limits{1, 0, 1, 0};
    AlignedMemory memory(jobs::graph_bytes(limits));
    jobs::Graph* graph = jobs::create_graph(memory.data, memory.bytes, limits);
    const auto work = [](void*, uint32_t begin, uint32_t end, uint32_t) { items += end - begin; };
    jobs::add_node(*graph, {"all", work, nullptr, 0xffffffffu, 0x7fffffffu});
    ASSERT_TRUE(jobs::start(*graph, serial_executor()));
    jobs::wait(*graph);
    EXPECT_EQ(items.load(), 0xffffffffu);
}

TEST(Graph, RefusesWhatDoesNotFit) {
    const jobs::GraphLimits limits{2, 1, 1, 0};
    const size_t bytes = jobs::graph_bytes(limits);
    AlignedMemory memory(bytes + 64);
    EXPECT_EQ(jobs::create_graph(memory.data, bytes - 1, limits), nullptr);
    EXPECT_EQ(jobs::create_graph(static_cast<char*>(memory.data) + 8, bytes, limits), nullptr);
    EXPECT_EQ(jobs::create_graph(nullptr, bytes, limits), nullptr);
    EXPECT_EQ(jobs::graph_bytes({2, 1, 0, 0}), 0u);
    jobs::Graph* graph = jobs::create_graph(memory.data, bytes, limits);
    ASSERT_NE(graph, nullptr);
    EXPECT_EQ(jobs::slot_count(*graph), 2u);
    EXPECT_EQ(jobs::add_node(*graph, {}), 0u);
    EXPECT_FALSE(jobs::add_edge(*graph, 0, 1));
    EXPECT_EQ(jobs::add_node(*graph, {}), 1u);
    EXPECT_EQ(jobs::add_node(*graph, {}), jobs::no_node);
    EXPECT_FALSE(jobs::add_edge(*graph, 1, 0));
    EXPECT_FALSE(jobs::add_edge(*graph, 1, 1));
    EXPECT_TRUE(jobs::add_edge(*graph, 0, 1));
    EXPECT_FALSE(jobs::add_edge(*graph, 0, 1)) << "no room";
    jobs::clear(*graph);
    EXPECT_EQ(jobs::add_node(*graph, {}), 0u);
}

// Four threads that meet inside one node: they must all have been summoned for it.
TEST(Graph, WideNodeAfterNarrowOneGetsAllWorkers) {
    static std::atomic<uint32_t> met;
    TestExecutor executor({"pool", Order::fifo, 3, 3});
    const jobs::GraphLimits limits{3, 2, 3, 0};
    AlignedMemory memory(jobs::graph_bytes(limits));
    jobs::Graph* graph = jobs::create_graph(memory.data, memory.bytes, limits);
    const auto narrow = [](void*, uint32_t, uint32_t, uint32_t) {
        std::this_thread::sleep_for(std::chrono::milliseconds(2));
    };
    const auto wide = [](void*, uint32_t, uint32_t, uint32_t) {
        ++met;
        const auto end = std::chrono::steady_clock::now() + std::chrono::seconds(20);
        while (met < 4 && std::chrono::steady_clock::now() < end) {
            std::this_thread::yield();
        }
    };
    jobs::add_node(*graph, {"narrow", narrow, nullptr, 1, 1});
    jobs::add_node(*graph, {"wide", wide, nullptr, 4, 1});
    jobs::add_edge(*graph, 0, 1);
    for (int i = 0; i < 50; ++i) {
        met = 0;
        ASSERT_TRUE(jobs::start(*graph, executor.hook()));
        jobs::wait(*graph);
        ASSERT_EQ(met.load(), 4u);
        ASSERT_EQ(jobs::threads(*graph), 4u);
    }
}

TEST(SerialExecutor, CreatesNoThread) {
    const auto count = [] {
        const std::filesystem::path folder = "/proc/self/task";
        if (!std::filesystem::exists(folder)) return std::ptrdiff_t{-1};
        return std::distance(std::filesystem::directory_iterator(folder),
                             std::filesystem::directory_iterator());
    };
    const std::ptrdiff_t before = count();
    CheckedGraph graph(random_nodes(30, 2), random_edges(30, 40, 2), 4);
    graph.begin();
    const Executor executor = serial_executor();
    ASSERT_TRUE(jobs::start(*graph, executor));
    EXPECT_TRUE(jobs::done(*graph)) << "everything runs inside start";
    jobs::wait(*graph);
    graph.check();
    EXPECT_EQ(jobs::threads(*graph), 1u);
    EXPECT_EQ(count(), before);
    Executor copy = executor;
    destroy_executor(&copy);
    EXPECT_EQ(copy.enqueue, executor.enqueue) << "not one of TBB's: left alone";
}

} // namespace

} // namespace nusselt::test
