// The TBB executor inside all that a host may be doing with TBB itself.
#include "tests/jobs/graph_fixture.h"

#include <oneapi/tbb/flow_graph.h>
#include <oneapi/tbb/global_control.h>
#include <oneapi/tbb/parallel_for.h>
#include <oneapi/tbb/task_arena.h>
#include <oneapi/tbb/task_group.h>

#include <algorithm>
#include <chrono>
#include <csignal>
#include <mutex>
#include <set>
#include <sys/wait.h>
#include <thread>
#include <unistd.h>

namespace nusselt::test {

namespace {

class Tbb : public testing::Test {
protected:
    // The machine may have fewer cores than a test wants threads; TBB would then silently make fewer.
    tbb::global_control allow{tbb::global_control::max_allowed_parallelism, 8};
    Executor executor;

    void SetUp() override { make(4); }
    void TearDown() override { destroy_executor(&executor); }
    void make(uint32_t threads) {
        destroy_executor(&executor);
        const Status status = create_tbb_executor(threads, &executor);
        ASSERT_TRUE(status.ok()) << status.text;
    }
    static void run_frames(const Executor& on, int count, uint32_t seed = 1) {
        CheckedGraph graph(random_nodes(14, seed), random_edges(14, 24, seed), 8);
        for (int i = 0; i < count; ++i) {
            graph.run(on);
        }
    }
};

TEST_F(Tbb, RunsGraphs) {
    for (const uint32_t threads : {1u, 2u, 3u, 8u, 64u, 0u}) {
        make(threads);
        if (threads > 0) {
            EXPECT_EQ(executor.concurrency, std::max(std::min(threads, 8u), 2u) - 1);
        }
        for (uint32_t seed = 1; seed < 20; ++seed) {
            run_frames(executor, 5, seed);
        }
    }
}

TEST_F(Tbb, StartedAgainTenThousandTimes) {
    run_frames(executor, 10000);
}

TEST_F(Tbb, RefusesWhatCannotBeMeant) {
    EXPECT_EQ(create_tbb_executor(4, nullptr).code, StatusCode::invalid_argument);
    Executor other;
    EXPECT_EQ(create_tbb_executor(100000, &other).code, StatusCode::invalid_argument);
    EXPECT_EQ(other.enqueue, nullptr);
    destroy_executor(nullptr);
    destroy_executor(&other);
    destroy_executor(&executor);
    EXPECT_EQ(executor.enqueue, nullptr);
    destroy_executor(&executor);
}

TEST_F(Tbb, OneThreadIsTheCallers) {
    make(1);
    CheckedGraph graph(random_nodes(14, 3), random_edges(14, 24, 3), 8);
    graph.run(executor);
    EXPECT_EQ(jobs::threads(*graph), 1u);
}

TEST_F(Tbb, UsesTheThreadsItWasAskedFor) {
    struct Meeting {
        std::mutex mutex;
        std::set<std::thread::id> ids;
        size_t wanted = 8;
    } meeting;
    make(8);
    const jobs::GraphLimits limits{1, 0, 8, 0};
    AlignedMemory memory(jobs::graph_bytes(limits));
    jobs::Graph* graph = jobs::create_graph(memory.data, memory.bytes, limits);
    const auto work = [](void* context, uint32_t, uint32_t, uint32_t) {
        Meeting& here = *static_cast<Meeting*>(context);
        const auto end = std::chrono::steady_clock::now() + std::chrono::seconds(20);
        for (;;) {
            {
                const std::lock_guard lock(here.mutex);
                here.ids.insert(std::this_thread::get_id());
                if (here.ids.size() >= here.wanted) return;
            }
            if (std::chrono::steady_clock::now() > end) return;
            std::this_thread::yield();
        }
    };
    jobs::add_node(*graph, {"meet", work, &meeting, 8, 1});
    ASSERT_TRUE(jobs::start(*graph, executor));
    jobs::wait(*graph);
    EXPECT_EQ(meeting.ids.size(), 8u);
    EXPECT_EQ(jobs::threads(*graph), 8u);
    EXPECT_TRUE(meeting.ids.count(std::this_thread::get_id()));
}

TEST_F(Tbb, InsideHostTasks) {
    tbb::parallel_for(0, 200, [&](int i) { run_frames(executor, 3, static_cast<uint32_t>(i) + 1); });
}

// A thread that waits for us must not take up another task of the host's: the host may hold a lock, or
// scratch memory.
TEST_F(Tbb, WaitingRunsNothingOfTheHosts) {
    std::atomic<int> entered_again = 0;
    tbb::parallel_for(0, 2000, [&](int i) {
        thread_local int depth = 0;
        if (depth++ > 0) ++entered_again;
        run_frames(executor, 1, static_cast<uint32_t>(i % 7) + 1);
        --depth;
    });
    EXPECT_EQ(entered_again.load(), 0);
}

TEST_F(Tbb, InsideACancelledHostGroup) {
    tbb::task_group_context context;
    int frames = 0;
    tbb::parallel_for(
        0, 1,
        [&](int) {
            context.cancel_group_execution();
            run_frames(executor, 50);
            // Made in here too: nothing of it may be bound to the host's context.
            Executor inner;
            ASSERT_TRUE(create_tbb_executor(4, &inner).ok());
            run_frames(inner, 50);
            destroy_executor(&inner);
            ++frames;
        },
        context);
    EXPECT_EQ(frames, 1);
    run_frames(executor, 5);
}

TEST_F(Tbb, InsideFlowGraphNodes) {
    tbb::flow::graph host;
    std::atomic<int> ran = 0;
    tbb::flow::function_node<int> node(host, tbb::flow::unlimited, [&](int i) {
        run_frames(executor, 2, static_cast<uint32_t>(i) + 1);
        ++ran;
    });
    for (int i = 0; i < 100; ++i) {
        node.try_put(i);
    }
    host.wait_for_all();
    EXPECT_EQ(ran.load(), 100);
}

TEST_F(Tbb, InsideTheHostsOwnArenaOfOne) {
    tbb::task_arena host(1);
    host.execute([&] {
        run_frames(executor, 100);
        tbb::this_task_arena::isolate([&] { run_frames(executor, 100); });
    });
}

TEST_F(Tbb, WhereTheHostAllowsOneThread) {
    const tbb::global_control one(tbb::global_control::max_allowed_parallelism, 1);
    run_frames(executor, 200); // made when there were more
    make(4);
    EXPECT_EQ(executor.concurrency, 1u);
    run_frames(executor, 200);
    destroy_executor(&executor);
}

TEST_F(Tbb, WhereTheHostHoldsEveryWorker) {
    std::atomic<bool> stop = false;
    tbb::task_group hogs;
    for (int i = 0; i < 16; ++i) {
        hogs.run([&] {
            while (!stop) {
                std::this_thread::yield();
            }
        });
    }
    run_frames(executor, 200);
    destroy_executor(&executor);
    stop = true;
    hogs.wait();
}

TEST_F(Tbb, SeveralHostThreadsSeveralGraphs) {
    std::vector<std::thread> threads;
    for (uint32_t caller = 0; caller < 6; ++caller) {
        threads.emplace_back([&, caller] {
            CheckedGraph first(random_nodes(12, caller + 1), random_edges(12, 20, caller + 1), 4);
            CheckedGraph second(random_nodes(9, caller + 7), random_edges(9, 12, caller + 7), 4);
            for (int i = 0; i < 500; ++i) {
                first.begin();
                second.begin();
                EXPECT_TRUE(jobs::start(*first, executor));
                EXPECT_TRUE(jobs::start(*second, executor));
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
}

// More tickets in flight than the executor has: the rest runs inline.
TEST_F(Tbb, MoreFramesInFlightThanTickets) {
    make(8);
    std::vector<std::unique_ptr<CheckedGraph>> graphs;
    for (uint32_t i = 0; i < 400; ++i) {
        graphs.push_back(
            std::make_unique<CheckedGraph>(random_nodes(30, i + 1), random_edges(30, 40, i + 1), 7u));
    }
    for (int again = 0; again < 3; ++again) {
        for (auto& graph : graphs) {
            graph->begin();
            ASSERT_TRUE(jobs::start(**graph, executor));
        }
        for (auto& graph : graphs) {
            jobs::wait(**graph);
            graph->check();
        }
    }
}

TEST_F(Tbb, MadeAndDestroyedOften) {
    for (uint32_t i = 0; i < 300; ++i) {
        make(2 + i % 4);
        run_frames(executor, 2);
    }
}

#if !defined(NUSSELT_SANITIZED)
// A forked child has no TBB workers; the thread that waits does all.
TEST_F(Tbb, AfterFork) {
    run_frames(executor, 20);
    const pid_t child = fork();
    if (child == 0) {
        alarm(20);
        CheckedGraph graph(random_nodes(14, 1), random_edges(14, 24, 1), 8);
        graph.begin();
        const bool started = jobs::start(*graph, executor);
        jobs::wait(*graph);
        _exit(started && jobs::done(*graph) ? 0 : 1);
    }
    int status = 0;
    ASSERT_EQ(waitpid(child, &status, 0), child);
    EXPECT_TRUE(WIFEXITED(status) && WEXITSTATUS(status) == 0);
}
#endif

} // namespace

} // namespace nusselt::test
