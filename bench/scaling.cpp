// How frames scale with threads: one object and many, 500 to 200,000 vertices, beside what the machine itself
// gives to as many independent contexts; the cost of an empty frame; many more workers than cores. Everything
// is measured by turns, so that a noisy machine hurts all alike. Exit status 1 where a result depends on who
// computed it. Usage: scaling [--quick | --plan] [--threads MOST] [--json FILE]
//
// What no noise touches is the plan: the processor time of every piece of a frame on one thread, given out to
// more threads as the task graph does, stage by stage. --plan tells that alone, and fails where a scene of
// 1,900 vertices or more does not allow two threads 1.95 times one.
#include "bench/pool.h"
#include "bench/scenes/scene.h"
#include "bench/scenes/shapes.h"
#include "nusselt/nusselt.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <functional>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <time.h>

namespace nusselt::bench {
namespace {

using nlohmann::json;

constexpr int moments = 2; // poses that follow one another, so that every frame moves

void check(const Status& status) {
    if (status.ok()) return;
    std::fprintf(stderr, "scaling: %s\n", status.text);
    std::exit(1);
}

double now_us() {
    return std::chrono::duration<double, std::micro>(std::chrono::steady_clock::now().time_since_epoch())
        .count();
}

double median(std::vector<double> values) {
    std::sort(values.begin(), values.end());
    return values[values.size() / 2];
}

struct Subject {
    std::string name;
    size_t vertices = 0;
    std::vector<scenes::Mesh> meshes;
    scenes::Pose poses[moments];
};

// A ring with swellings that wander: it shadows itself from every side.
Subject rings(const std::string& name, uint32_t objects, uint32_t around, uint32_t across) {
    Subject s;
    s.name = name;
    const scenes::Mesh ring = scenes::torus(1, 0.45f, around, across);
    const auto side = static_cast<uint32_t>(std::ceil(std::sqrt(objects)));
    s.meshes.assign(objects, ring);
    for (int moment = 0; moment < moments; ++moment) {
        scenes::Pose& pose = s.poses[moment];
        for (uint32_t object = 0; object < objects; ++object) {
            const glm::vec3 place{3.2f * float(object % side), 0, 3.2f * float(object / side)};
            std::vector<glm::vec3> positions = ring.rest_positions;
            for (glm::vec3& p : positions) {
                const float angle = std::atan2(p.z, p.x);
                const float swell = 0.12f * std::sin(6 * angle + float(moment) + 0.3f * float(object));
                p = place + p * (1 + swell) + glm::vec3(0, 0.15f * std::sin(3 * angle + float(moment)), 0);
            }
            std::vector<glm::vec3> normals;
            scenes::compute_normals(positions, ring.indices, normals);
            pose.positions.push_back(std::move(positions));
            pose.normals.push_back(std::move(normals));
        }
    }
    s.vertices = size_t(objects) * ring.rest_positions.size();
    return s;
}

Subject built_in(const std::string& name) {
    Subject s;
    s.name = name;
    const scenes::Scene scene = scenes::builtin(name);
    s.meshes = scene.meshes;
    for (int moment = 0; moment < moments; ++moment)
        scene.pose(scene.duration * (0.4 + 0.1 * moment), s.poses[moment]);
    for (const scenes::Mesh& mesh : s.meshes)
        s.vertices += mesh.rest_positions.size();
    return s;
}

// One vertex, no triangle: all that is left is the graph.
Subject empty() {
    Subject s;
    s.name = "empty";
    s.vertices = 1;
    s.meshes.resize(1);
    s.meshes[0].rest_positions = {{0, 0, 0}};
    s.meshes[0].rest_normals = {{0, 1, 0}};
    for (int moment = 0; moment < moments; ++moment)
        s.poses[moment] = {{{{float(moment), 0, 0}}}, {{{0, 1, 0}}}};
    return s;
}

Vec3View view(const std::vector<glm::vec3>& vectors) {
    return {&vectors[0].x, vectors.size(), sizeof(glm::vec3)};
}

// A subject in a context of its own.
struct World {
    World(const Subject& subject, const Executor& executor, const Profiler& profiler = {}) {
        ContextDesc desc;
        desc.executor = executor;
        desc.profiler = profiler;
        check(create_context(desc, &context));
        for (size_t m = 0; m < subject.meshes.size(); ++m) {
            const scenes::Mesh& mesh = subject.meshes[m];
            FrameMesh use;
            check(add_mesh(context,
                           {view(mesh.rest_positions), view(mesh.rest_normals), mesh.indices.data(),
                            mesh.indices.size()},
                           &use.mesh));
            transfer.emplace_back(25 * mesh.rest_positions.size());
            use.transfer = {transfer[m].data(), mesh.rest_positions.size(), 100};
            for (int moment = 0; moment < moments; ++moment) {
                use.positions = view(subject.poses[moment].positions[m]);
                use.normals = view(subject.poses[moment].normals[m]);
                frames[moment].push_back(use);
            }
        }
        run();
        for (const std::vector<float>& values : transfer) {
            for (const float value : values) {
                uint32_t word;
                std::memcpy(&word, &value, 4);
                hash = (hash ^ word) * 0x100000001B3u;
            }
        }
    }
    ~World() { check(destroy_context(context)); }
    World(const World&) = delete;
    World& operator=(const World&) = delete;

    void run() {
        for (const std::vector<FrameMesh>& meshes : frames) {
            FrameDesc desc;
            desc.meshes = meshes.data();
            desc.mesh_count = static_cast<uint32_t>(meshes.size());
            FrameId id;
            check(submit(context, desc, &id));
            check(wait(context, id, nullptr));
        }
    }

    Context* context = nullptr;
    std::vector<FrameMesh> frames[moments];
    std::vector<std::vector<float>> transfer;
    uint64_t hash = 0xCBF29CE484222325u; // of the last moment's results
};

double thread_cpu_us() {
    timespec t{};
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
    return double(t.tv_sec) * 1e6 + double(t.tv_nsec) * 1e-3;
}

// Processor time of every piece of the moments' frames on one thread.
struct Pieces {
    struct Piece {
        const char* stage;
        double us;
    };
    std::vector<Piece> all;
    double start = 0;

    Profiler hook() {
        return {this, [](void* user, const char*) { static_cast<Pieces*>(user)->start = thread_cpu_us(); },
                [](void* user, const char* zone) {
                    Pieces& self = *static_cast<Pieces*>(user);
                    // Those around whole calls end last, with a start that is not theirs.
                    if (std::strcmp(zone, "nusselt submit") == 0 || std::strcmp(zone, "nusselt wait") == 0)
                        return;
                    self.all.push_back({zone, thread_cpu_us() - self.start});
                }};
    }
};

// The median piece by piece of several runs.
std::vector<Pieces::Piece> pieces_of(const Subject& subject) {
    Pieces pieces;
    World world(subject, serial_executor(), pieces.hook());
    std::vector<std::vector<Pieces::Piece>> runs(7);
    for (std::vector<Pieces::Piece>& run : runs) {
        pieces.all.clear();
        world.run();
        run = pieces.all;
    }
    std::vector<Pieces::Piece> typical = runs[0];
    for (size_t i = 0; i < typical.size(); ++i) {
        std::vector<double> us;
        for (const std::vector<Pieces::Piece>& run : runs)
            us.push_back(run[i].us);
        typical[i].us = median(us);
    }
    return typical;
}

// How many times as fast as one thread so many are, if whoever is free takes the stage's next piece.
double planned_gain(const std::vector<Pieces::Piece>& pieces, uint32_t threads) {
    double all = 0, span = 0;
    for (size_t i = 0; i < pieces.size();) {
        std::vector<double> busy(threads);
        for (const char* stage = pieces[i].stage; i < pieces.size() && pieces[i].stage == stage; ++i) {
            *std::min_element(busy.begin(), busy.end()) += pieces[i].us;
            all += pieces[i].us;
        }
        span += *std::max_element(busy.begin(), busy.end());
    }
    return all / span;
}

// Something to be timed, in frames a call.
struct Variant {
    std::string name;
    double frames;
    std::function<void()> run;
    std::vector<double> us; // a frame, by round

    double least() const { return *std::min_element(us.begin(), us.end()); }
};

// By turns, for about as long as told, at least `rounds` times.
void measure(std::vector<Variant>& variants, double seconds, int rounds) {
    const double end = now_us() + 1e6 * seconds;
    for (int round = 0; round < rounds || now_us() < end; ++round) {
        for (Variant& v : variants) {
            const double start = now_us();
            v.run();
            v.us.push_back((now_us() - start) / v.frames);
        }
    }
}

// How many times as much as `base` it gets done: the median of the rounds, each against its own, and the
// least times' ratio.
struct Gain {
    double median, least;
};
Gain gain(const Variant& base, const Variant& v) {
    std::vector<double> ratios;
    for (size_t i = 0; i < v.us.size(); ++i)
        ratios.push_back(base.us[i] / v.us[i]);
    return {median(ratios), base.least() / v.least()};
}

struct Report {
    json out = json::object();
    bool differed = false;

    void expect(const std::string& subject, const std::string& variant, uint64_t wanted, uint64_t hash) {
        if (hash == wanted) return;
        differed = true;
        std::fprintf(stderr, "scaling: %s: the result on %s differs from the serial executor's\n",
                     subject.c_str(), variant.c_str());
    }
};

struct TbbOrPool {
    explicit TbbOrPool(uint32_t threads) {
        if (has_feature(Feature::tbb)) {
            check(create_tbb_executor(threads, &executor));
        } else {
            pool = std::make_unique<Pool>(threads - 1);
            executor = pool->executor();
        }
    }
    ~TbbOrPool() { destroy_executor(&executor); }
    TbbOrPool(const TbbOrPool&) = delete;
    TbbOrPool& operator=(const TbbOrPool&) = delete;

    Executor executor;
    std::unique_ptr<Pool> pool;
};

// 1, 2, ... threads of one frame, and as many contexts with a thread of their own, which share nothing but
// the machine: what one frame can at most reach here.
void scale(const Subject& subject, uint32_t most, double seconds, Report& report) {
    const std::vector<Pieces::Piece> pieces = pieces_of(subject);
    World serial(subject, serial_executor());
    std::vector<Variant> variants;
    const double frames_a_call =
        std::clamp(std::floor(4000.0 / double(subject.vertices)), 1.0, 8.0) * moments;
    const auto repeat = [=](World& world) {
        for (double i = 0; i < frames_a_call; i += moments)
            world.run();
    };
    variants.push_back({"1", frames_a_call, [&] { repeat(serial); }, {}});
    std::vector<std::unique_ptr<TbbOrPool>> executors;
    std::vector<std::unique_ptr<World>> worlds;
    for (uint32_t threads = 2; threads <= most;
         threads = threads < most ? std::min(2 * threads, most) : most + 1) {
        executors.push_back(std::make_unique<TbbOrPool>(threads));
        World& world = *worlds.emplace_back(std::make_unique<World>(subject, executors.back()->executor));
        report.expect(subject.name, std::to_string(threads) + " threads", serial.hash, world.hash);
        variants.push_back({std::to_string(threads), frames_a_call, [&] { repeat(world); }, {}});
        const size_t first = worlds.size();
        for (uint32_t t = 0; t < threads; ++t)
            worlds.push_back(std::make_unique<World>(subject, serial_executor()));
        variants.push_back({std::to_string(threads) + " apart",
                            frames_a_call * threads,
                            [&, first, threads] {
                                std::vector<std::thread> hosts;
                                for (uint32_t t = 1; t < threads; ++t)
                                    hosts.emplace_back([&, t] { repeat(*worlds[first + t]); });
                                repeat(*worlds[first]);
                                for (std::thread& host : hosts)
                                    host.join();
                            },
                            {}});
    }
    measure(variants, seconds, 5);
    json& out = report.out["scaling"][subject.name];
    out = {{"vertices", subject.vertices},
           {"objects", subject.meshes.size()},
           {"frame_ms", {{"min", variants[0].least() / 1e3}, {"median", median(variants[0].us) / 1e3}}}};
    for (size_t i = 1; i < variants.size(); i += 2) {
        const Gain frame = gain(variants[0], variants[i]), apart = gain(variants[0], variants[i + 1]);
        const double planned = planned_gain(pieces, static_cast<uint32_t>(std::stoul(variants[i].name)));
        std::printf("%-12s %8zu %8zu %9.3f %9s %8.2f %8.2f %10.2f %8.2f %7.2f\n", subject.name.c_str(),
                    subject.vertices, subject.meshes.size(), variants[0].least() / 1e3,
                    variants[i].name.c_str(), frame.median, frame.least, apart.median, apart.least, planned);
        out["threads"][variants[i].name] = {{"gain", {{"median", frame.median}, {"least", frame.least}}},
                                            {"apart", {{"median", apart.median}, {"least", apart.least}}},
                                            {"planned", planned}};
    }
    if (variants.size() == 1)
        std::printf("%-12s %8zu %8zu %9.3f\n", subject.name.c_str(), subject.vertices, subject.meshes.size(),
                    variants[0].least() / 1e3);
    std::fflush(stdout);
}

// The plan alone; false where two threads are not allowed what was promised.
bool plan(const Subject& subject) {
    const std::vector<Pieces::Piece> pieces = pieces_of(subject);
    double us = 0;
    for (const Pieces::Piece& piece : pieces)
        us += piece.us / moments;
    std::printf("%-12s %8zu %8zu %9.3f", subject.name.c_str(), subject.vertices, subject.meshes.size(),
                us / 1e3);
    for (const uint32_t threads : {2u, 4u, 8u, 16u})
        std::printf(" %8.2f", planned_gain(pieces, threads));
    const bool kept = subject.vertices < 1900 || planned_gain(pieces, 2) >= 1.95;
    std::printf("%s\n", kept ? "" : "  under 1.95 on two threads");
    return kept;
}

int plan_all() {
    std::printf("What the pieces of a frame allow, times one thread\n%-12s %8s %8s %9s %8s %8s %8s %8s\n",
                "scene", "vertices", "objects", "1: ms", "2", "4", "8", "16");
    bool kept = plan(rings("ring 500", 1, 25, 20));
    kept &= plan(rings("ring 2000", 1, 50, 40));
    kept &= plan(rings("rings 2000", 4, 25, 20));
    kept &= plan(rings("ring 8000", 1, 100, 80));
    for (const std::string& name : scenes::builtin_names())
        kept &= plan(built_in(name));
    return kept ? 0 : 1;
}

// What a frame costs that has nothing to do.
void overhead(uint32_t cores, double seconds, Report& report) {
    const Subject subject = empty();
    const TbbOrPool few(cores);
    Pool many(64);
    World serial(subject, serial_executor()), on_few(subject, few.executor),
        on_many(subject, many.executor());
    std::vector<Variant> variants;
    constexpr double frames = 200;
    const auto add = [&](const std::string& name, World& world) {
        report.expect(subject.name, name, serial.hash, world.hash);
        variants.push_back({name,
                            frames,
                            [&] {
                                for (double i = 0; i < frames; i += moments)
                                    world.run();
                            },
                            {}});
    };
    add("serial", serial);
    add(std::to_string(cores) + " threads", on_few);
    add("64 workers", on_many);
    measure(variants, seconds, 5);
    std::printf("\nAn empty frame, us:");
    for (const Variant& v : variants) {
        std::printf("  %s %.2f (median %.2f)", v.name.c_str(), v.least(), median(v.us));
        report.out["empty_frame_us"][v.name] = {{"min", v.least()}, {"median", median(v.us)}};
    }
    std::printf("\n");
}

// 64 workers on the machine's cores keep what part of the throughput?
void oversubscribe(const Subject& subject, uint32_t cores, double seconds, Report& report) {
    Pool few(std::max(cores - 1, 1u)), many(63);
    World serial(subject, serial_executor()), on_few(subject, few.executor()),
        on_many(subject, many.executor());
    report.expect(subject.name, "a pool", serial.hash, on_few.hash);
    report.expect(subject.name, "64 workers", serial.hash, on_many.hash);
    std::vector<Variant> variants;
    variants.push_back({"cores", moments, [&] { on_few.run(); }, {}});
    variants.push_back({"64", moments, [&] { on_many.run(); }, {}});
    measure(variants, seconds, 5);
    const Gain kept = gain(variants[0], variants[1]);
    std::printf("64 workers on %u cores keep of the throughput, %s: %.2f (least times %.2f)\n", cores,
                subject.name.c_str(), kept.median, kept.least);
    report.out["oversubscription"][subject.name] = {{"median", kept.median}, {"least", kept.least}};
}

int run(bool quick, uint32_t most, const std::string& file) {
    Report report;
    report.out["configuration"] = configuration();
    report.out["cores"] = std::thread::hardware_concurrency();
    const double seconds = quick ? 0.4 : 4;
    std::printf(
        "%s\nGains over one thread; 'apart': as many contexts, each on a thread of its own, which no frame "
        "can beat; 'plan': what the pieces of a frame allow.\n%-12s %8s %8s %9s %9s %8s %8s %10s %8s %7s\n",
        configuration(), "scene", "vertices", "objects", "1: ms", "threads", "gain", "(least)", "apart",
        "(least)", "plan");
    scale(rings("ring 500", 1, 25, 20), most, seconds, report);
    scale(rings("ring 2000", 1, 50, 40), most, seconds, report);
    scale(rings("rings 2000", 4, 25, 20), most, seconds, report);
    scale(rings("ring 8000", 1, 100, 80), most, seconds, report);
    for (const std::string& name : scenes::builtin_names())
        scale(built_in(name), most, seconds, report);
    if (!quick) {
        scale(rings("rings 8000", 16, 25, 20), most, seconds, report);
        scale(rings("ring 32000", 1, 200, 160), most, seconds, report);
        scale(rings("rings 32000", 64, 25, 20), most, seconds, report);
        scale(rings("ring 200000", 1, 500, 400), most, seconds, report);
        scale(rings("rings 200000", 400, 25, 20), most, seconds, report);
    }
    overhead(std::max(most, 2u), seconds / 2, report);
    oversubscribe(rings("ring 8000", 1, 100, 80), most, seconds, report);
    oversubscribe(rings("ring 2000", 1, 50, 40), most, seconds, report);
    if (!file.empty()) {
        std::ofstream out(file);
        out << report.out.dump(1) << '\n';
        out.close();
        if (!out) {
            std::fprintf(stderr, "scaling: %s: not written; is its folder there?\n", file.c_str());
            return 1;
        }
    }
    return report.differed ? 1 : 0;
}

} // namespace
} // namespace nusselt::bench

int main(int argc, char** argv) {
    bool quick = false, plan = false;
    uint32_t most = std::max(1u, std::thread::hardware_concurrency());
    std::string file;
    for (int i = 1; i < argc; ++i) {
        const std::string option = argv[i];
        const bool has_value = i + 1 < argc;
        if (option == "--quick") {
            quick = true;
        } else if (option == "--plan") {
            plan = true;
        } else if (option == "--threads" && has_value && std::atoi(argv[i + 1]) > 0) {
            most = static_cast<uint32_t>(std::atoi(argv[++i]));
        } else if (option == "--json" && has_value) {
            file = argv[++i];
        } else {
            std::fprintf(stderr, "usage: scaling [--quick | --plan] [--threads MOST] [--json FILE]\n");
            return 2;
        }
    }
    return plan ? nusselt::bench::plan_all() : nusselt::bench::run(quick, most, file);
}
