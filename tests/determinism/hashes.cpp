// Compares results with tests/golden/hashes.txt, with the standard library alone: so that any compiler, also
// a cross compiler, can build it. Every check is one frame of a context and meshes of its own. Exit status 1
// where a hash differs. Usage: hashes HASHES [one|some|all [SCENE]]   (default: some)
//   one   the first scene, as under `some`
//   some  every entry of the file on every instruction set, and each scene's first one with every number of
//         workers, executor and floating-point mode of the host: some hundreds of checks
//   all   everything with everything, the slow reference too
#include "bench/scenes/scene.h"
#include "nusselt/nusselt.h"

#include <cfenv>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <map>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#if defined(__x86_64__)
#include <immintrin.h>
#endif

using namespace nusselt;

namespace {

uint64_t hash_bytes(const void* data, size_t size, uint64_t hash) {
    const unsigned char* bytes = static_cast<const unsigned char*>(data);
    for (size_t i = 0; i < size; ++i)
        hash = (hash ^ bytes[i]) * 0x100000001b3u;
    return hash;
}

void check(const Status& status) {
    if (status.ok()) return;
    std::printf("%s\n", status.text);
    std::exit(1);
}

// The last task first, and none before `finish`: all on the thread that waits.
struct LastFirst {
    struct Task {
        void (*run)(void*);
        void* argument;
        bool returned = false;
    };
    static void* enqueue(void* user, void (*run)(void*), void* argument) {
        LastFirst& self = *static_cast<LastFirst*>(user);
        self.waiting.push_back(new Task{run, argument});
        return self.waiting.back();
    }
    static void finish(void* user, void* ticket) {
        LastFirst& self = *static_cast<LastFirst*>(user);
        Task* const wanted = static_cast<Task*>(ticket);
        while (!wanted->returned) {
            Task* const task = self.waiting.back();
            self.waiting.pop_back();
            task->run(task->argument);
            task->returned = true;
        }
        delete wanted;
    }
    std::vector<Task*> waiting;
};

// One thread a task.
void* start_thread(void*, void (*run)(void*), void* argument) {
    return new std::thread(run, argument);
}
void join_thread(void*, void* ticket) {
    const std::unique_ptr<std::thread> thread(static_cast<std::thread*>(ticket));
    thread->join();
}

enum class Kind { serial, threads, last_first, tbb };
constexpr const char* kind_names[] = {"serial", "threads", "last task first", "TBB"};

// The host's modes while a frame is submitted and waited for; threads made meanwhile inherit them.
enum class Mode { usual, down, up, toward_zero, flush_denormals };
constexpr const char* mode_names[] = {"usual", "down", "up", "toward zero", "FTZ and DAZ"};

struct ModeScope {
    explicit ModeScope(Mode mode) {
        const int rounding[] = {FE_TONEAREST, FE_DOWNWARD, FE_UPWARD, FE_TOWARDZERO, FE_TONEAREST};
        std::fesetround(rounding[static_cast<int>(mode)]);
        if (mode == Mode::flush_denormals) set_flush(true);
    }
    ~ModeScope() {
        std::fesetround(FE_TONEAREST);
        set_flush(false);
    }
    static void set_flush([[maybe_unused]] bool on) {
#if defined(__x86_64__)
        _mm_setcsr((_mm_getcsr() & ~0x8040u) | (on ? 0x8040u : 0u));
#elif defined(__aarch64__)
        uint64_t control;
        __asm__ volatile("mrs %0, fpcr" : "=r"(control));
        control = (control & ~(uint64_t{1} << 24)) | uint64_t{on} << 24;
        __asm__ volatile("msr fpcr, %0" : : "r"(control));
#endif
    }
};

struct Setup {
    Isa isa;
    Kind kind = Kind::serial;
    uint32_t workers = 1;
    Mode mode = Mode::usual;
};

struct Entry {
    double time;
    Quality quality;
    uint64_t hash;
};

uint64_t run(const scenes::Scene& scene, const Entry& entry, const Setup& setup) {
    scenes::Pose pose;
    scene.pose(entry.time * scene.duration, pose);
    LastFirst last_first;
    ContextDesc desc;
    if (setup.kind == Kind::threads) desc.executor = {nullptr, start_thread, join_thread, setup.workers};
    if (setup.kind == Kind::last_first)
        desc.executor = {&last_first, LastFirst::enqueue, LastFirst::finish, setup.workers};
    if (setup.kind == Kind::tbb) check(create_tbb_executor(setup.workers, &desc.executor));
    const ModeScope mode(setup.mode);
    desc.isa = setup.isa;
    Context* context = nullptr;
    check(create_context(desc, &context));
    const size_t words = quality_mask_bits(entry.quality) / 32;
    std::vector<FrameMesh> meshes;
    std::vector<std::vector<float>> transfer;
    std::vector<std::vector<uint32_t>> masks;
    for (size_t m = 0; m < scene.meshes.size(); ++m) {
        const scenes::Mesh& mesh = scene.meshes[m];
        const size_t count = mesh.rest_positions.size();
        MeshId id;
        check(add_mesh(context,
                       {{&mesh.rest_positions[0].x, count, 12},
                        {&mesh.rest_normals[0].x, count, 12},
                        mesh.indices.data(),
                        mesh.indices.size()},
                       &id));
        transfer.emplace_back(25 * count);
        masks.emplace_back(words * count);
        meshes.push_back({id,
                          {&pose.positions[m][0].x, count, 12},
                          {&pose.normals[m][0].x, count, 12},
                          {transfer[m].data(), count, 100},
                          {masks[m].data(), count, 4 * words}});
    }
    FrameId frame;
    check(submit(context, {meshes.data(), static_cast<uint32_t>(meshes.size()), entry.quality}, &frame));
    check(wait(context, frame, nullptr));
    check(destroy_context(context));
    destroy_executor(&desc.executor);
    uint64_t hash = 0xcbf29ce484222325u;
    for (size_t m = 0; m < meshes.size(); ++m) {
        hash = hash_bytes(transfer[m].data(), 4 * transfer[m].size(), hash);
        hash = hash_bytes(masks[m].data(), 4 * masks[m].size(), hash);
    }
    return hash;
}

std::map<std::string, std::vector<Entry>> read(const char* path) {
    std::map<std::string, std::vector<Entry>> entries;
    std::ifstream file(path);
    for (std::string line; std::getline(file, line);) {
        char scene[32], quality[32];
        unsigned long long hash;
        Entry entry;
        if (std::sscanf(line.c_str(), "%31s %lf %31s %llx", scene, &entry.time, quality, &hash) != 4 ||
            !quality_from_name(quality, &entry.quality))
            continue;
        entry.hash = hash;
        entries[scene].push_back(entry);
    }
    return entries;
}

constexpr uint32_t worker_counts[] = {1, 2, 3, 8, 64};
constexpr Mode modes[] = {Mode::usual, Mode::down, Mode::up, Mode::toward_zero, Mode::flush_denormals};

std::vector<Kind> kinds() {
    std::vector<Kind> all = {Kind::serial, Kind::threads, Kind::last_first};
    if (has_feature(Feature::tbb)) all.push_back(Kind::tbb);
    return all;
}

// The reference is slow, and has nothing of its own to do with executors.
bool is_slow(Isa isa) {
    return isa == Isa::scalar && has_feature(Feature::simd);
}

std::vector<Setup> setups(bool all, bool first) {
    std::vector<Setup> made;
    for (const Isa isa : {Isa::scalar, Isa::sse4, Isa::avx2, Isa::avx512, Isa::neon}) {
        if (!isa_available(isa)) continue;
        if (all) {
            for (const Kind kind : kinds()) {
                for (const uint32_t workers : worker_counts) {
                    if (kind == Kind::serial && workers > 1) continue;
                    for (const Mode mode : modes)
                        made.push_back({isa, kind, workers, mode});
                }
            }
            continue;
        }
        if (first || !is_slow(isa)) made.push_back({isa});
        if (!first) continue;
        for (const Mode mode : modes) {
            if (mode == Mode::usual) continue;
            made.push_back({isa, Kind::serial, 1, mode});
            if (is_slow(isa)) break;
            for (const Kind kind : kinds()) {
                if (kind != Kind::serial) made.push_back({isa, kind, 2, mode});
            }
        }
        for (const Kind kind : kinds()) {
            if (kind == Kind::serial || is_slow(isa)) continue;
            for (const uint32_t workers : worker_counts)
                made.push_back({isa, kind, workers});
        }
    }
    return made;
}

} // namespace

int main(int argc, char** argv) {
    const std::string how = argc > 2 ? argv[2] : "some";
    const std::string only = argc > 3 ? argv[3] : "";
    if (argc < 2 || argc > 4 || (how != "one" && how != "some" && how != "all")) {
        std::fprintf(stderr, "usage: hashes HASHES [one|some|all [SCENE]]\n");
        return 2;
    }
    int checks = 0, wrong = 0;
    for (const auto& [name, entries] : read(argv[1])) {
        if (!only.empty() && name != only) continue;
        const scenes::Scene scene = scenes::builtin(name);
        for (const Entry& entry : entries) {
            for (const Setup& setup : setups(how == "all", &entry == &entries.front())) {
                ++checks;
                if (run(scene, entry, setup) == entry.hash) continue;
                ++wrong;
                std::printf("%s %.1f %s: another hash with %s, %s, %u workers, mode %s\n", name.c_str(),
                            entry.time, quality_name(entry.quality), isa_name(setup.isa),
                            kind_names[static_cast<int>(setup.kind)], setup.workers,
                            mode_names[static_cast<int>(setup.mode)]);
            }
        }
        if (how == "one") break;
    }
    std::printf("%d checks, %d wrong; %s\n", checks, wrong, configuration());
    return checks > 0 && wrong == 0 ? 0 : 1;
}
