// An hour of animation without the waiting: nothing grows, nothing drifts, and a frame is what a cold start
// gives. Level: the library's own, bit for bit.
#include "tests/jobs/executors.h"
#include "tests/runtime/fixture.h"
#include "tests/stress/ledger.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <dirent.h>
#include <optional>
#include <unistd.h>

namespace nusselt::test {

namespace {

// NUSSELT_STRESS_FRAMES; an hour at 60 Hz is 216,000.
uint32_t soak_frames() {
    const char* text = std::getenv("NUSSELT_STRESS_FRAMES");
#if defined(__SANITIZE_THREAD__)
    constexpr uint32_t few = 400;
#else
    constexpr uint32_t few = 2000;
#endif
    return text && *text ? uint32_t(std::strtoul(text, nullptr, 10)) : few;
}

double resident_kilobytes() {
    long pages = 0;
    if (std::FILE* file = std::fopen("/proc/self/statm", "r")) {
        if (std::fscanf(file, "%*s %ld", &pages) != 1) pages = 0;
        std::fclose(file);
    }
    return double(pages) * double(sysconf(_SC_PAGESIZE)) / 1024;
}

size_t entries(const char* folder) {
    size_t count = 0;
    if (DIR* const directory = opendir(folder)) {
        while (readdir(directory))
            ++count;
        closedir(directory);
    }
    return count;
}

// Two threads: oneTBB's, or of our own where the library was built without it, as for the thread sanitizer.
struct TwoThreads {
    Executor executor;
    std::optional<TestExecutor> own;

    TwoThreads() {
        if (create_tbb_executor(2, &executor).ok()) return;
        own.emplace(ExecutorOptions{"pool", Order::random, 2, 2});
        executor = own->hook();
    }
    ~TwoThreads() {
        if (!own) destroy_executor(&executor);
    }
    TwoThreads(const TwoThreads&) = delete;
    TwoThreads& operator=(const TwoThreads&) = delete;
};

// M15, the other half. Random scripts of edits: meshes move as wholes, in part, by one vertex or not at all,
// stop receiving, go, come back, turn a normal, in any order and quality; half of the scripts with a history,
// which keeps what it can. Every frame is what a cold start gives.
TEST(Soak, RandomEditsAreNeverStale) {
    const uint64_t scripts = stress_cases() / 20;
    uint64_t frames = 0, still = 0, reused = 0;
    const scenes::Mesh shapes[] = {scenes::torus(1, 0.4f, 16, 8), scenes::plane(3, 4),
                                   scenes::sphere(1, 0.3f)};
    for (uint64_t script = 0; script < scripts; ++script) {
        Random random(stress_seed() * 977 + script);
        std::optional<TwoThreads> threads;
        ContextDesc desc;
        if (script % 2) desc.executor = threads.emplace().executor;
        {
            Engine engine(desc);
            std::vector<size_t> shape{0, 1, 2};
            std::vector<Posed> now;
            for (const size_t s : shape)
                now.push_back(at_rest(add(engine.context, shapes[s]), shapes[s]));
            for (glm::vec3& p : now[2].positions)
                p.z += 1.6f;
            FrameDesc settings;
            const float origin[3] = {}; // a history keeps nothing where the origin moves
            if (script / 2 % 2) {
                ASSERT_TRUE(create_history(engine.context, &settings.history).ok());
                settings.origin = origin;
            }
            for (int frame = 0; frame < 8; ++frame) {
                const size_t m = random.below(uint32_t(now.size()));
                std::vector<glm::vec3>& p = now[m].positions;
                switch (random.below(9)) {
                case 0: // nothing
                    ++still;
                    break;
                case 1: // one vertex
                    p[random.below(uint32_t(p.size()))] += random.direction() * 0.2f;
                    break;
                case 2: { // all of it, stiffly
                    const glm::vec3 by = random.direction() * 0.3f;
                    for (glm::vec3& v : p)
                        v += by;
                    break;
                }
                case 3: // all of it, bent
                    for (glm::vec3& v : p)
                        v.z += 0.1f * std::sin(3 * v.x + float(frame));
                    break;
                case 4: // a normal
                    now[m].normals[random.below(uint32_t(p.size()))] = random.direction();
                    break;
                case 5: // only blocks, or receives again
                    now[m].receives = !now[m].receives;
                    break;
                case 6: // goes and comes back
                    ASSERT_TRUE(remove_mesh(engine.context, now[m].mesh).ok());
                    now[m].mesh = add(engine.context, shapes[shape[m]]);
                    break;
                case 7: // a vertex that is no number, or a number again
                    p[0].x = std::isfinite(p[0].x) ? std::nanf("") : 0.1f;
                    break;
                default: { // far away, or back
                    const float by = p[1].y > 50 ? -100.0f : 100.0f;
                    for (glm::vec3& v : p)
                        v.y += by;
                    break;
                }
                }
                if (random.below(4) == 0)
                    settings.quality = random.below(2) ? Quality::standard : Quality::draft;
                const Outputs got = run_frame(engine.context, now, settings);
                Engine cold;
                std::vector<Posed> again = now;
                for (size_t i = 0; i < again.size(); ++i)
                    again[i].mesh = add(cold.context, shapes[shape[i]]);
                FrameDesc plain = settings;
                plain.history = {};
                ASSERT_EQ(run_frame(cold.context, again, plain), got)
                    << "seed " << stress_seed() << ", script " << script << ", frame " << frame;
                ++frames;
                reused += got.stats.receivers_reused;
            }
            if (script / 2 % 2) {
                ASSERT_TRUE(remove_history(engine.context, settings.history).ok());
            }
        }
    }
    figure("M15 frames of random edits against cold starts", double(frames), "frames");
    EXPECT_GT(still, 0u);
    EXPECT_GT(reused, 0u);
}

TEST(Soak, NothingGrowsAndNothingDrifts) {
    const uint32_t frames = soak_frames();
    ContextDesc desc;
    const bool threads = create_tbb_executor(2, &desc.executor).ok();
    double first_ms = 0, last_ms = 0, before = 0;
    size_t files = 0, tasks = 0;
    {
        Engine engine(desc);
        scenes::Scene scene;
        scene.meshes = {scenes::torus(1, 0.4f, 20, 10), scenes::plane(3, 4), scenes::sphere(1, 0.3f)};
        std::vector<MeshId> ids = add_all(engine.context, scene);
        const auto pose = [&](uint32_t frame) {
            std::vector<Posed> out;
            for (size_t m = 0; m < ids.size(); ++m) {
                out.push_back(at_rest(ids[m], scene.meshes[m]));
                // The floor moves for a second in four, the sphere stops for one in five.
                const bool still = m == 1 ? frame / 60 % 4 != 0 : m == 2 && frame / 60 % 5 == 0;
                const double t = (still               ? frame / 60 * 60
                                  : frame % 300 < 290 ? frame
                                                      : frame / 300 * 300) /
                                 60.0;
                for (glm::vec3& p : out.back().positions)
                    p += 0.2f * glm::vec3(float(std::sin(t + double(m) + double(p.x))),
                                          float(m == 2 ? 1.5 : 0.3), float(std::cos(1.3 * t + double(p.y))));
            }
            return out;
        };
        // In turns of a hundred frames: a quarter without a history, a quarter with a budget of next to
        // nothing, which leaves most of a frame to later ones, and after each of these a quarter with the
        // history alone.
        enum class Kind { plain, history, budget, caught_up };
        HistoryId history;
        ASSERT_TRUE(create_history(engine.context, &history).ok());
        const float origin[3] = {}; // a history keeps nothing where the origin moves
        const auto kind_of = [](uint32_t frame) { return Kind(frame / 25 % 4); };
        const auto settings_of = [&](Kind kind) {
            FrameDesc settings;
            settings.origin = origin;
            if (kind != Kind::plain) settings.history = history;
            if (kind == Kind::budget) settings.budget_us = 10;
            return settings;
        };
        uint64_t reused = 0, stale = 0, compared = 0;
        double receivers = 0;
        for (const scenes::Mesh& mesh : scene.meshes)
            receivers += double(mesh.rest_positions.size());
        const uint32_t warm = std::min(500u, frames / 4), window = std::max(1u, frames / 10);
        for (uint32_t frame = 0; frame < frames; ++frame) {
            if (frame == warm) {
                before = resident_kilobytes();
                files = entries("/proc/self/fd");
                tasks = entries("/proc/self/task");
            }
            // A mesh goes and comes back now and then, as in an engine; some stand still, now and then all of
            // them.
            if (frame % 97 == 96) {
                ASSERT_TRUE(remove_mesh(engine.context, ids[2]).ok());
                ids[2] = add(engine.context, scene.meshes[2]);
            }
            const std::vector<Posed> posed = pose(frame);
            const Kind kind = kind_of(frame);
            const Outputs out = run_frame(engine.context, posed, settings_of(kind));
            reused += out.stats.receivers_reused;
            stale += out.stats.receivers_stale;
            ASSERT_TRUE(kind == Kind::budget || out.stats.receivers_stale == 0) << "frame " << frame;
            if (frame >= warm && frame < warm + window) first_ms += out.stats.cpu_ms;
            if (frame >= frames - window) last_ms += out.stats.cpu_ms;
            if (kind == Kind::budget) continue;
            // The last without a history, the last with one, and the first after a budget.
            if (frame % 500 == 24 || frame % 500 == 249 || frame % 500 == 475 || frame + 1 == frames) {
                ++compared;
                Engine cold;
                std::vector<Posed> again = posed;
                for (size_t m = 0; m < again.size(); ++m)
                    again[m].mesh = add(cold.context, scene.meshes[m]);
                const Outputs fresh = run_frame(cold.context, again, settings_of(Kind::plain));
                ASSERT_EQ(fresh, out) << "frame " << frame;
                if (kind != Kind::plain) continue;
                ASSERT_EQ(fresh.stats.clusters_tested, out.stats.clusters_tested) << "frame " << frame;
                ASSERT_EQ(fresh.stats.triangles_considered, out.stats.triangles_considered);
            }
        }
        const double grown = resident_kilobytes() - before;
        figure("soak: frames", frames, "");
        figure("soak: frames of these compared with a cold start", double(compared), "");
        figure("soak: results that the history kept", 100 * double(reused) / double(frames) / receivers, "%");
        figure("soak: results that the budget left to later frames",
               100 * double(stale) / double(frames) / receivers, "%");
        EXPECT_GT(reused, 0u);
        EXPECT_GT(stale, 0u);
        figure("soak: resident memory gained per 1,000 frames after warming up",
               grown / std::max(0.001, double(frames - warm) / 1000), "KB");
        figure("soak: processor time of the last tenth against the first", last_ms / first_ms, "times");
        // Cold contexts in between move the heap a little, once; a sanitizer's own records more.
#if defined(NUSSELT_SANITIZED)
        constexpr double once = 8192;
#else
        constexpr double once = 512;
#endif
        EXPECT_LE(grown, once + double(frames) / 1000);
        EXPECT_EQ(entries("/proc/self/fd"), files);
        EXPECT_LE(entries("/proc/self/task"), tasks);
        // What else the machine does in an hour shows in that: the same frame here and in a new context, in
        // turns.
        Engine fresh(desc);
        const std::vector<Posed> here = pose(frames);
        std::vector<Posed> there = here;
        for (size_t m = 0; m < there.size(); ++m)
            there[m].mesh = add(fresh.context, scene.meshes[m]);
        double old_ms = 1e30, new_ms = 1e30;
        for (int round = 0; round < (old_ms <= 1.15 * new_ms ? 30 : 400); ++round) {
            old_ms = std::min(old_ms, run_frame(engine.context, here).stats.cpu_ms);
            new_ms = std::min(new_ms, run_frame(fresh.context, there).stats.cpu_ms);
        }
        EXPECT_TRUE(remove_history(engine.context, history).ok());
        figure("soak: processor time of a frame in the old context against a new one, least", old_ms / new_ms,
               "times");
        EXPECT_LE(old_ms, 1.15 * new_ms);
    }
    if (threads) destroy_executor(&desc.executor);
}

} // namespace

} // namespace nusselt::test
