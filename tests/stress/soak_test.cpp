// An hour of animation without the waiting: nothing grows, nothing drifts, and a frame is what a cold start
// gives.
#include "tests/runtime/fixture.h"
#include "tests/stress/ledger.h"

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <dirent.h>
#include <unistd.h>

namespace nusselt::test {

namespace {

// NUSSELT_STRESS_FRAMES; an hour at 60 Hz is 216,000.
uint32_t soak_frames() {
    const char* text = std::getenv("NUSSELT_STRESS_FRAMES");
    return text && *text ? uint32_t(std::strtoul(text, nullptr, 10)) : 2000;
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
            const double t = frame / 60.0;
            std::vector<Posed> out;
            for (size_t m = 0; m < ids.size(); ++m) {
                out.push_back(at_rest(ids[m], scene.meshes[m]));
                for (glm::vec3& p : out.back().positions)
                    p += 0.2f * glm::vec3(float(std::sin(t + double(m) + double(p.x))),
                                          float(m == 2 ? 1.5 : 0.3), float(std::cos(1.3 * t + double(p.y))));
            }
            return out;
        };
        const uint32_t warm = std::min(500u, frames / 4), window = std::max(1u, frames / 10);
        for (uint32_t frame = 0; frame < frames; ++frame) {
            if (frame == warm) {
                before = resident_kilobytes();
                files = entries("/proc/self/fd");
                tasks = entries("/proc/self/task");
            }
            // A mesh goes and comes back now and then, as in an engine.
            if (frame % 97 == 96) {
                ASSERT_TRUE(remove_mesh(engine.context, ids[2]).ok());
                ids[2] = add(engine.context, scene.meshes[2]);
            }
            const std::vector<Posed> posed = pose(frame);
            const Outputs out = run_frame(engine.context, posed);
            if (frame >= warm && frame < warm + window) first_ms += out.stats.cpu_ms;
            if (frame >= frames - window) last_ms += out.stats.cpu_ms;
            if (frame % 500 == 499 || frame + 1 == frames) {
                Engine cold;
                std::vector<Posed> again = posed;
                for (size_t m = 0; m < again.size(); ++m)
                    again[m].mesh = add(cold.context, scene.meshes[m]);
                ASSERT_EQ(run_frame(cold.context, again), out) << "frame " << frame;
            }
        }
        const double grown = resident_kilobytes() - before;
        figure("soak: frames", frames, "");
        figure("soak: resident memory gained per 1,000 frames after warming up",
               grown / std::max(0.001, double(frames - warm) / 1000), "KB");
        figure("soak: processor time of the last tenth against the first", last_ms / first_ms, "times");
        // Cold contexts in between move the heap a little, once.
        EXPECT_LE(grown, 2048 + double(frames) / 1000);
        EXPECT_EQ(entries("/proc/self/fd"), files);
        EXPECT_LE(entries("/proc/self/task"), tasks);
        EXPECT_LE(last_ms, 2.5 * first_ms);
    }
    if (threads) destroy_executor(&desc.executor);
}

} // namespace

} // namespace nusselt::test
