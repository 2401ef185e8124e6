// Who may call what at once, and who creates threads.
#include "bench/scenes/shapes.h"
#include "tests/embed/fixture.h"

#include <atomic>
#include <cstring>
#include <filesystem>

namespace nusselt::test {

namespace {

std::ptrdiff_t threads_of_the_process() {
    const std::filesystem::path folder = "/proc/self/task";
    if (!std::filesystem::exists(folder)) return -1;
    return std::distance(std::filesystem::directory_iterator(folder), std::filesystem::directory_iterator());
}

TEST(Threads, SerialCreatesNone) {
    static std::ptrdiff_t most;
    const std::ptrdiff_t before = most = threads_of_the_process();
    ContextDesc desc;
    desc.executor = serial_executor();
    desc.profiler.begin = [](void*, const char*) { most = std::max(most, threads_of_the_process()); };
    desc.profiler.end = [](void*, const char*) {};
    {
        Host host("fight", desc);
        FrameId id;
        FrameStats stats;
        ASSERT_TRUE(submit(host.context, host.frame(), &id).ok());
        ASSERT_TRUE(wait(host.context, id, &stats).ok());
        EXPECT_EQ(stats.threads, 1u);
    }
    EXPECT_EQ(most, before);
    EXPECT_EQ(threads_of_the_process(), before);
}

// A mesh above another one, bent by a time, with the arrays of its frame.
struct Pair {
    Pair(Context* c, float time) : context(c) {
        for (const scenes::Mesh& mesh : {scenes::torus(1, 0.4f, 20, 10), scenes::plane(3, 10)}) {
            const size_t count = mesh.rest_positions.size();
            positions.push_back(mesh.rest_positions);
            normals.push_back(mesh.rest_normals);
            for (glm::vec3& p : positions.back())
                p.y += time * p.x * p.x;
            transfer.emplace_back(25 * count);
            FrameMesh use;
            EXPECT_TRUE(
                add_mesh(
                    context,
                    {{&mesh.rest_positions[0].x, count, 12}, {}, mesh.indices.data(), mesh.indices.size()},
                    &use.mesh)
                    .ok());
            use.positions = {&positions.back()[0].x, count, 12};
            use.normals = {&normals.back()[0].x, count, 12};
            use.transfer = {transfer.back().data(), count, 100};
            meshes.push_back(use);
        }
    }
    ~Pair() {
        for (const FrameMesh& use : meshes)
            EXPECT_TRUE(remove_mesh(context, use.mesh).ok());
    }
    Pair(const Pair&) = delete;
    Pair& operator=(const Pair&) = delete;

    void start() { EXPECT_TRUE(submit(context, {meshes.data(), 2}, &frame).ok()); }
    void finish() { EXPECT_TRUE(wait(context, frame, nullptr).ok()); }

    Context* context;
    std::vector<std::vector<glm::vec3>> positions, normals;
    std::vector<std::vector<float>> transfer;
    std::vector<FrameMesh> meshes;
    FrameId frame;
};

// Four host threads on two contexts: each adds meshes, keeps two frames in flight, waits for them in another
// order and removes the meshes, while a fifth polls and cancels what is not there.
TEST(Threads, ContextsMeshesAndFramesAtOnce) {
    constexpr int rounds = 12;
    std::vector<std::vector<std::vector<float>>> expected;
    {
        Context* serial = nullptr;
        ASSERT_TRUE(create_context({}, &serial).ok());
        for (int i = 0; i < 3; ++i) {
            Pair pair(serial, 0.2f * float(i));
            pair.start();
            pair.finish();
            expected.push_back(pair.transfer);
        }
        ASSERT_TRUE(destroy_context(serial).ok());
    }
    Executor tbb;
    const bool has_tbb = create_tbb_executor(2, &tbb).ok();
    Context* contexts[2] = {};
    for (int i = 0; i < 2; ++i) {
        ContextDesc desc;
        desc.executor = i == 1 && has_tbb ? tbb : ThreadExecutor::hook(2);
        ASSERT_TRUE(create_context(desc, &contexts[i]).ok());
    }
    std::atomic<bool> stop = false;
    std::thread stranger([&] {
        while (!stop) {
            bool done = true;
            EXPECT_EQ(poll(contexts[0], {1000, 1}, &done).code, StatusCode::stale_handle);
            EXPECT_EQ(cancel(contexts[1], {1000, 1}).code, StatusCode::stale_handle);
            EXPECT_EQ(wait(contexts[0], {1000, 1}, nullptr).code, StatusCode::stale_handle);
            std::this_thread::yield();
        }
    });
    std::vector<std::thread> hosts;
    for (int host = 0; host < 4; ++host) {
        hosts.emplace_back([&, host] {
            for (int round = 0; round < rounds; ++round) {
                const size_t a = size_t(host + round) % 3, b = size_t(host + 2 * round + 1) % 3;
                Pair first(contexts[host % 2], 0.2f * float(a)), second(contexts[host % 2], 0.2f * float(b));
                first.start();
                second.start();
                (round % 2 ? second : first).finish();
                (round % 2 ? first : second).finish();
                EXPECT_EQ(first.transfer, expected[a]) << host << " " << round;
                EXPECT_EQ(second.transfer, expected[b]) << host << " " << round;
            }
        });
    }
    for (std::thread& host : hosts)
        host.join();
    stop = true;
    stranger.join();
    for (Context* context : contexts)
        EXPECT_TRUE(destroy_context(context).ok());
    destroy_executor(&tbb);
}

} // namespace

} // namespace nusselt::test
