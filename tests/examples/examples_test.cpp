// The example engine runs, allocates nothing and writes a trace; the adapters give the serial executor's
// bits.
#include "examples/adapters/callback_pair.h"
#include "examples/engine/job_system.h"
#include "tests/embed/fixture.h"

#include <nlohmann/json.hpp>

#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <map>
#include <set>
#include <sstream>

namespace nusselt::test {

namespace {

std::string read(const std::string& path) {
    std::ifstream file(path);
    std::stringstream text;
    text << file.rdbuf();
    return text.str();
}

#if defined(NUSSELT_ENGINE)
TEST(Engine, RunsWithoutAllocationsAndWritesATrace) {
    const std::string trace = testing::TempDir() + "nusselt_engine_trace.json";
    std::remove(trace.c_str());
    for (const char* threads : {"1", "3"}) {
        const std::string command = std::string(NUSSELT_ENGINE) + " 12 " + threads + " " + trace;
        ASSERT_EQ(std::system(command.c_str()), 0) << command; // not 0 where a frame allocated
    }
    const nlohmann::json events = nlohmann::json::parse(read(trace)).at("traceEvents");
    std::map<int, std::vector<std::string>> open;
    std::map<int, double> last;
    std::map<int, std::set<std::string>> names;
    std::set<std::string> all;
    for (const nlohmann::json& event : events) {
        if (event.empty()) continue;
        const int thread = event.at("tid");
        const std::string name = event.at("name");
        EXPECT_GE(event.at("ts").get<double>(), last[thread]);
        last[thread] = event.at("ts");
        if (event.at("ph") == "B") {
            open[thread].push_back(name);
        } else {
            ASSERT_FALSE(open[thread].empty());
            EXPECT_EQ(open[thread].back(), name);
            open[thread].pop_back();
        }
        names[thread].insert(name);
        all.insert(name);
    }
    for (const char* name : {"frame", "animate", "particles", "shade", "nusselt receivers"})
        EXPECT_EQ(all.count(name), 1u) << name;
    // The main thread alone waits, so it surely has both the engine's work and nusselt's.
    EXPECT_EQ(names[0].count("nusselt wait"), 1u);
    EXPECT_EQ(names[0].count("frame"), 1u);
    std::remove(trace.c_str());
}
#endif

// Both are the same lines, between the markers.
TEST(Engine, EmbeddingIsWhatTheReadmeShows) {
    const auto snippet = [](const std::string& text) {
        const size_t begin = text.find("// [embed]"), end = text.find("// [/embed]");
        return begin == std::string::npos || end == std::string::npos ? "" : text.substr(begin, end - begin);
    };
    const std::string source = snippet(read(NUSSELT_SOURCE_DIR "/examples/engine/main.cpp"));
    ASSERT_FALSE(source.empty());
    EXPECT_LT(std::count(source.begin(), source.end(), '\n'), 40);
    const std::string shown = snippet(read(NUSSELT_SOURCE_DIR "/README.md"));
    EXPECT_EQ(shown, source); // which tests/readme compiles
    // The whole engine, without blank lines and comments.
    int lines = 0;
    for (const char* file : {"main.cpp", "job_system.h", "trace.h"}) {
        std::istringstream text(read(std::string(NUSSELT_SOURCE_DIR "/examples/engine/") + file));
        for (std::string line; std::getline(text, line);) {
            const size_t first = line.find_first_not_of(' ');
            lines += first != std::string::npos && line.compare(first, 2, "//") != 0;
        }
    }
    EXPECT_LT(lines, 300);
}

std::vector<std::vector<float>> frame(const Executor& executor) {
    ContextDesc desc;
    desc.executor = executor;
    Host host("fight", desc);
    for (int i = 0; i < 5; ++i) {
        FrameId id;
        EXPECT_TRUE(submit(host.context, host.frame(), &id).ok());
        EXPECT_TRUE(wait(host.context, id, nullptr).ok());
    }
    return host.transfer;
}

TEST(Adapters, WorkStealingJobSystem) {
    const std::vector<std::vector<float>> serial = frame(serial_executor());
    for (const uint32_t workers : {0u, 1u, 2u, 7u}) {
        JobSystem jobs(workers);
        const Executor executor{&jobs,
                                [](void* user, void (*run)(void*), void* argument) -> void* {
                                    return static_cast<JobSystem*>(user)->push("nusselt", run, argument);
                                },
                                [](void* user, void* ticket) {
                                    static_cast<JobSystem*>(user)->finish(static_cast<Job*>(ticket));
                                },
                                workers};
        EXPECT_EQ(frame(executor), serial) << workers;
    }
}

// A host whose tasks are threads of their own; every third runs at once.
struct ThreadHost {
    static void* enqueue(adapters::RangeTask* task, int items, int, void* task_context, void* user) {
        ThreadHost& self = *static_cast<ThreadHost*>(user);
        if (self.enqueued++ % 3 == 2) {
            task(0, items, 0, task_context);
            return nullptr;
        }
        ++self.unfinished;
        return new std::thread(task, 0, items, 1, task_context);
    }
    static void finish(void* task, void* user) {
        std::thread* thread = static_cast<std::thread*>(task);
        thread->join();
        delete thread;
        --static_cast<ThreadHost*>(user)->unfinished;
    }
    std::atomic<int> enqueued = 0, unfinished = 0;
};

TEST(Adapters, PairOfCallbacks) {
    const std::vector<std::vector<float>> serial = frame(serial_executor());
    for (const uint32_t workers : {1u, 3u, 100u}) {
        ThreadHost host;
        adapters::CallbackPair pair({&host, ThreadHost::enqueue, ThreadHost::finish, workers});
        EXPECT_EQ(frame(pair.executor()), serial) << workers;
        EXPECT_GT(host.enqueued, 0);
        EXPECT_EQ(host.unfinished, 0);
    }
}

} // namespace

} // namespace nusselt::test
