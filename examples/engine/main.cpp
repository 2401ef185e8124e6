// A small engine around nusselt: a job system and frame loop of its own, several characters, nusselt's tasks
// among its own. Usage: engine [FRAMES [THREADS [TRACE.json]]]
#include "bench/scenes/scene.h"
#include "examples/engine/job_system.h"

#include <nusselt/nusselt.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <new>

std::atomic<uint64_t> allocations = 0; // the whole process's, nusselt's included

void* operator new(size_t size) {
    ++allocations;
    return std::malloc(size);
}
void* operator new(size_t size, std::align_val_t alignment, const std::nothrow_t&) noexcept {
    ++allocations;
    return std::aligned_alloc(size_t(alignment), (size + size_t(alignment) - 1) & ~(size_t(alignment) - 1));
}
void operator delete(void* memory) noexcept {
    std::free(memory);
}
void operator delete(void* memory, size_t) noexcept {
    std::free(memory);
}
void operator delete(void* memory, std::align_val_t) noexcept {
    std::free(memory);
}

void check(const nusselt::Status& status) {
    if (status.ok()) return;
    std::fprintf(stderr, "engine: %s\n", status.text);
    std::exit(1);
}

// [embed]
struct Shadows {
    nusselt::Context* context = nullptr;
    nusselt::FrameId frame;

    explicit Shadows(JobSystem& jobs) {
        check(nusselt::check_version());
        nusselt::ContextDesc desc;
        desc.executor.user = &jobs;
        desc.executor.enqueue = [](void* user, void (*run)(void*), void* argument) -> void* {
            return static_cast<JobSystem*>(user)->push("nusselt", run, argument);
        };
        desc.executor.finish = [](void* user, void* ticket) {
            static_cast<JobSystem*>(user)->finish(static_cast<Job*>(ticket));
        };
        desc.executor.concurrency = jobs.workers();
        desc.profiler = {nullptr, begin_zone, end_zone};
        check(nusselt::create_context(desc, &context));
    }
    ~Shadows() { (void)nusselt::destroy_context(context); } // its meshes go with it

    nusselt::MeshId add(nusselt::Vec3View positions, const std::vector<uint32_t>& indices) {
        nusselt::MeshId mesh;
        check(nusselt::add_mesh(context, {positions, {}, indices.data(), indices.size()}, &mesh));
        return mesh;
    }
    void start(const std::vector<nusselt::FrameMesh>& meshes) { // whose arrays are nusselt's until `finish`
        check(nusselt::submit(context, {meshes.data(), uint32_t(meshes.size())}, &frame));
    }
    nusselt::FrameStats finish() {
        nusselt::FrameStats stats;
        check(nusselt::wait(context, frame, &stats));
        return stats;
    }
};
// [/embed]

namespace scenes = nusselt::scenes;

// The poses of a clip at equal steps: to animate allocates nothing.
std::vector<scenes::Pose> bake(const scenes::Scene& scene) {
    std::vector<scenes::Pose> poses(48);
    for (size_t i = 0; i < poses.size(); ++i)
        scene.pose(scene.duration * double(i) / double(poses.size()), poses[i]);
    return poses;
}

struct Character {
    const std::vector<scenes::Pose>* clip = nullptr;
    size_t step = 0; // of the clip
    glm::vec3 place{0};
    nusselt::FrameMesh frame; // without transfer it is out of sight, and blocks
    std::vector<glm::vec3> positions;
    std::vector<float> transfer;
    std::vector<float> uploaded;               // colours, in place of the graphics card's memory
    const nusselt::Context* context = nullptr; // to shade with
    const float* light = nullptr;
};

void animate(void* argument) {
    Character& c = *static_cast<Character*>(argument);
    const scenes::Pose& pose = (*c.clip)[++c.step % c.clip->size()];
    for (size_t v = 0; v < c.positions.size(); ++v)
        c.positions[v] = c.place + pose.positions[0][v];
    c.frame.positions = {&c.positions[0].x, c.positions.size()};
    c.frame.normals = {&pose.normals[0][0].x, c.positions.size()};
}

void shade(void* argument) {
    Character& c = *static_cast<Character*>(argument);
    if (!c.frame.transfer.data) return;
    check(nusselt::shade(c.context, c.light, c.frame.transfer, {}, c.uploaded.data()));
}

struct Particles { // what else an engine has to do
    std::vector<float> height = std::vector<float>(2000, 1.0f), speed = std::vector<float>(2000, 0.01f);
};

void simulate(void* argument) {
    Particles& p = *static_cast<Particles*>(argument);
    for (int step = 0; step < 20; ++step)
        for (size_t i = 0; i < p.height.size(); ++i) {
            p.speed[i] = p.height[i] < 0 ? std::fabs(p.speed[i]) : p.speed[i] - 1e-4f;
            p.height[i] += p.speed[i];
        }
}

int main(int argc, char** argv) {
    const int frames = std::max(argc > 1 ? std::atoi(argv[1]) : 200, 1), warm_up = 30;
    const int threads = std::max(argc > 2 ? std::atoi(argv[2]) : int(std::thread::hardware_concurrency()), 1);
    JobSystem jobs(uint32_t(threads) - 1);
    Shadows shadows(jobs);

    float light[75]; // a sky, bright above
    const float sky[12] = {0.6f, 0.8f, 1.2f, 0.6f, 0.8f, 1.2f, 0.1f, 0.1f, 0.1f, 0.1f, 0.1f, 0.1f};
    check(nusselt::sh_project_latlong(sky, 1, 4, light, nullptr));
    const scenes::Scene models[2] = {scenes::builtin("hand"), scenes::builtin("fight")};
    const std::vector<scenes::Pose> clips[2] = {bake(models[0]), bake(models[1])};
    std::vector<Character> characters(5);
    for (size_t i = 0; i < characters.size(); ++i) {
        Character& c = characters[i];
        const scenes::Mesh& mesh = models[i > 0].meshes[0];
        const size_t vertices = mesh.rest_positions.size();
        c.clip = &clips[i > 0];
        c.place = {3.0f * float(i), 0, 0};
        c.step = 5 * i;
        c.positions.resize(vertices);
        c.transfer.resize(25 * vertices);
        c.uploaded.resize(3 * vertices);
        c.context = shadows.context;
        c.light = light;
        c.frame.mesh = shadows.add({&mesh.rest_positions[0].x, vertices}, mesh.indices);
    }
    std::vector<Particles> particles(8);
    std::vector<nusselt::FrameMesh> meshes(characters.size());
    std::vector<Job*> pending(particles.size() + characters.size());
    std::vector<double> times(static_cast<size_t>(frames));
    if (argc > 3) trace_events.resize(size_t(threads));
    for (std::vector<Event>& events : trace_events)
        events.reserve(600 * times.size());

    const auto run_all = [&](const char* name, void (*run)(void*), auto& objects) {
        for (size_t i = 0; i < objects.size(); ++i)
            pending[i] = jobs.push(name, run, &objects[i]);
        for (size_t i = 0; i < objects.size(); ++i)
            jobs.finish(pending[i]);
    };
    double receivers = 0, work_ms = 0;
    for (int frame = -warm_up; frame < frames; ++frame) {
        if (frame == 0) allocations = 0;
        const auto start = std::chrono::steady_clock::now();
        begin_zone(nullptr, "frame");
        run_all("animate", animate, characters);
        for (size_t i = 0; i < characters.size(); ++i) {
            Character& c = characters[i];
            const bool seen = std::fabs(c.place.x - 6 - 6 * std::sin(0.02f * float(frame))) < 5;
            c.frame.transfer = {seen ? c.transfer.data() : nullptr, c.positions.size()};
            meshes[i] = c.frame;
        }
        shadows.start(meshes);
        run_all("particles", simulate, particles);
        const nusselt::FrameStats stats = shadows.finish();
        run_all("shade", shade, characters);
        end_zone(nullptr, "frame");
        if (frame < 0) continue;
        times[size_t(frame)] =
            std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start).count();
        receivers += stats.receivers_written;
        work_ms += stats.cpu_ms;
    }
    const uint64_t allocated = allocations;
    std::sort(times.begin(), times.end());
    const auto percentile = [&](size_t p) { return times[p * (times.size() - 1) / 100]; };
    std::printf("frame on %d threads: median %.2f ms, 95 %% %.2f ms, 99 %% %.2f ms, worst %.2f ms\n", threads,
                percentile(50), percentile(95), percentile(99), times.back());
    std::printf("nusselt: %.0f receivers, %.2f ms of processor time a frame; %s\n", receivers / frames,
                work_ms / frames, nusselt::configuration());
    std::printf("%.0f allocations in %d frames\n", double(allocated), frames);
    const bool traced = argc < 4 || write_trace(argv[3]);
    if (!traced) std::fprintf(stderr, "engine: %s: not written; is its folder there?\n", argv[3]);
    return allocated > 0 || !traced;
}
