// Compares results with tests/golden/hashes.txt, with the standard library alone: so that any compiler, also
// a cross compiler, can build it. Usage: hashes HASHES [FIRST_SCENES]. Every check is one frame: scenes,
// instruction sets, numbers of workers, floating-point modes of the host. Exit status 1 where a hash differs.
#include "bench/scenes/scene.h"
#include "nusselt/nusselt.h"

#include <cfenv>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <map>
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

// One thread a task.
Executor thread_executor(uint32_t workers) {
    if (workers == 0) return serial_executor();
    return {nullptr,
            [](void*, void (*run)(void*), void* argument) -> void* { return new std::thread(run, argument); },
            [](void*, void* ticket) {
                std::thread* thread = static_cast<std::thread*>(ticket);
                thread->join();
                delete thread;
            },
            workers};
}

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
    uint32_t workers;
    Mode mode;
};

struct Entry {
    double time;
    Quality quality;
    uint64_t hash;
};

uint64_t run(const scenes::Scene& scene, const Entry& entry, const Setup& setup) {
    scenes::Pose pose;
    scene.pose(entry.time * scene.duration, pose);
    const ModeScope mode(setup.mode);
    ContextDesc desc;
    desc.executor = thread_executor(setup.workers);
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

} // namespace

int main(int argc, char** argv) {
    if (argc < 2) return 2;
    const std::map<std::string, std::vector<Entry>> entries = read(argv[1]);
    size_t scenes_left = argc > 2 ? size_t(std::atoi(argv[2])) : entries.size();
    int checks = 0, wrong = 0;
    for (auto scene = entries.begin(); scene != entries.end() && scenes_left > 0; ++scene, --scenes_left) {
        const scenes::Scene made = scenes::builtin(scene->first);
        for (const Entry& entry : scene->second) {
            const bool first = &entry == &scene->second.front();
            std::vector<Setup> setups;
            for (const Isa isa : {Isa::scalar, Isa::sse4, Isa::avx2, Isa::avx512, Isa::neon}) {
                if (!isa_available(isa)) continue;
                if (isa != Isa::scalar || first || !has_feature(Feature::simd))
                    setups.push_back({isa, 0, Mode::usual});
                // The reference is slow, and the modes and workers are the same code's.
                if (isa == Isa::scalar && has_feature(Feature::simd)) continue;
                for (const uint32_t workers : {1u, 2u, 3u, 8u, 64u})
                    if (first) setups.push_back({isa, workers, Mode::usual});
                for (const Mode mode : {Mode::down, Mode::up, Mode::toward_zero, Mode::flush_denormals})
                    if (first) setups.push_back({isa, 2, mode});
            }
            for (const Setup& setup : setups) {
                ++checks;
                if (run(made, entry, setup) == entry.hash) continue;
                ++wrong;
                std::printf("%s %.1f %s: another hash with %s, %u workers, mode %s\n", scene->first.c_str(),
                            entry.time, quality_name(entry.quality), isa_name(setup.isa), setup.workers,
                            mode_names[static_cast<int>(setup.mode)]);
            }
        }
    }
    std::printf("%d checks, %d wrong; %s\n", checks, wrong, configuration());
    return checks > 0 && wrong == 0 ? 0 : 1;
}
