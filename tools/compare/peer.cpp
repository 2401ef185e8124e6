#include "tools/compare/peer.h"

#include "tools/compare/clock.h"
#include "tools/compare/moment.h"
#include "tools/compare/widest.h"
#include "tools/report/failure.h"

#include <embree3/rtcore.h>
#include <glm/geometric.hpp>
#include <pmmintrin.h>
#include <xmmintrin.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <bit>
#include <cmath>
#include <cstring>
#include <iterator>
#include <string>
#include <unordered_map>

namespace nusselt::tools {

namespace {

constexpr uint32_t batch = 16; // receivers that are rotated together

struct FlushDenormals {
    unsigned saved = _mm_getcsr();
    FlushDenormals() {
        _MM_SET_FLUSH_ZERO_MODE(_MM_FLUSH_ZERO_ON);
        _MM_SET_DENORMALS_ZERO_MODE(_MM_DENORMALS_ZERO_ON);
    }
    ~FlushDenormals() { _mm_setcsr(saved); }
    FlushDenormals(const FlushDenormals&) = delete;
    FlushDenormals& operator=(const FlushDenormals&) = delete;
};

bool count_memory(void* user, ssize_t bytes, bool) {
    *static_cast<std::atomic<int64_t>*>(user) += bytes;
    return true;
}

struct Frame {
    float t[3], b[3], n[3], origin[3];
};

NUSSELT_INLINE void aim_body(const Frame& f, const float* x, const float* y, const float* z, RTCRay16& rays) {
    for (int k = 0; k < 16; ++k) {
        rays.dir_x[k] = x[k] * f.t[0] + y[k] * f.b[0] + z[k] * f.n[0];
        rays.dir_y[k] = x[k] * f.t[1] + y[k] * f.b[1] + z[k] * f.n[1];
        rays.dir_z[k] = x[k] * f.t[2] + y[k] * f.b[2] + z[k] * f.n[2];
        rays.tfar[k] = INFINITY;
    }
}

// sum -= what the cells of a block with a set bit weigh.
NUSSELT_INLINE void subtract_body(uint32_t bits, const float* weight, const float* block, float* sum) {
    if (bits == 0xFFFF) {
        for (int i = 0; i < 32; ++i)
            sum[i] -= block[i];
        return;
    }
    for (; bits; bits &= bits - 1) {
        const float* cell = weight + size_t{32} * static_cast<uint32_t>(std::countr_zero(bits));
        for (int i = 0; i < 32; ++i)
            sum[i] -= cell[i];
    }
}

struct Arithmetic {
    void (*aim)(const Frame&, const float*, const float*, const float*, RTCRay16&);
    void (*subtract)(uint32_t, const float*, const float*, float*);
};

void aim_any(const Frame& f, const float* x, const float* y, const float* z, RTCRay16& rays) {
    aim_body(f, x, y, z, rays);
}
void subtract_any(uint32_t bits, const float* weight, const float* block, float* sum) {
    subtract_body(bits, weight, block, sum);
}
NUSSELT_AVX2 void aim_avx2(const Frame& f, const float* x, const float* y, const float* z, RTCRay16& rays) {
    aim_body(f, x, y, z, rays);
}
NUSSELT_AVX2 void subtract_avx2(uint32_t bits, const float* weight, const float* block, float* sum) {
    subtract_body(bits, weight, block, sum);
}

const Arithmetic& arithmetic() {
    static const Arithmetic chosen =
        has_avx2() ? Arithmetic{aim_avx2, subtract_avx2} : Arithmetic{aim_any, subtract_any};
    return chosen;
}

bool finite(const glm::vec3& v) {
    return std::isfinite(v.x) && std::isfinite(v.y) && std::isfinite(v.z);
}

} // namespace

std::string setup_name(const PeerSetup& setup) {
    return std::string(setup.rebuild ? "rebuilt" : "refitted") +
           (setup.coherent ? ", coherent" : ", incoherent");
}

Peer::Peer(const Assembly& first, uint32_t threads) : threads_(threads), executor_(serial_executor()) {
    tree_of({}, first);
    if (threads_ > 1) {
        const Status status = create_tbb_executor(threads_, &executor_);
        if (!status.ok()) throw Failure("--threads", status.text);
    }
}

Peer::~Peer() {
    destroy_executor(&executor_);
    // Before the counter that it counts into.
    for (std::unique_ptr<Tree>& tree : trees_)
        tree.reset();
}

Peer::Tree& Peer::tree_of(const PeerSetup& setup, const Assembly& all) {
    std::unique_ptr<Tree>& place = trees_[setup.rebuild];
    if (place) return *place;
    const std::string config = "threads=" + std::to_string(threads_);
    auto made = std::make_unique<Tree>(
        Tree{{rtcNewDevice(config.c_str()), rtcReleaseDevice}, {nullptr, rtcReleaseScene}, nullptr, nullptr});
    Tree& tree = *made;
    if (!tree.device) {
        throw Failure("Embree", "cannot be started; this machine or its installation lacks what it needs");
    }
    RTCDevice device = tree.device.get();
    if (!setup.rebuild) rtcSetDeviceMemoryMonitorFunction(device, count_memory, &counted_);
    const FlushDenormals guard;
    tree.scene.reset(rtcNewScene(device));
    if (!setup.rebuild) rtcSetSceneFlags(tree.scene.get(), RTC_SCENE_FLAG_DYNAMIC);
    rtcSetSceneBuildQuality(tree.scene.get(),
                            setup.rebuild ? RTC_BUILD_QUALITY_MEDIUM : RTC_BUILD_QUALITY_LOW);
    const size_t triangles = all.indices.size() / 3;
    if (triangles > 0) {
        tree.geometry = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_TRIANGLE);
        rtcSetGeometryBuildQuality(tree.geometry,
                                   setup.rebuild ? RTC_BUILD_QUALITY_MEDIUM : RTC_BUILD_QUALITY_REFIT);
        tree.positions = rtcSetNewGeometryBuffer(tree.geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3,
                                                 sizeof(glm::vec3), all.positions.size());
        void* indices = rtcSetNewGeometryBuffer(tree.geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3,
                                                3 * sizeof(uint32_t), triangles);
        if (tree.positions && indices) {
            std::memcpy(tree.positions, all.positions.data(), all.positions.size() * sizeof(glm::vec3));
            std::memcpy(indices, all.indices.data(), triangles * 3 * sizeof(uint32_t));
            rtcCommitGeometry(tree.geometry);
            rtcAttachGeometry(tree.scene.get(), tree.geometry);
        }
        rtcReleaseGeometry(tree.geometry); // the scene holds it
        if (!tree.positions || !indices)
            throw Failure("Embree",
                          "has no memory for the scene; close other programs or use a smaller model");
    }
    const double start = wall_ms();
    rtcCommitScene(tree.scene.get());
    if (!setup.rebuild) build_ms_ = wall_ms() - start;
    if (rtcGetDeviceError(device) != RTC_ERROR_NONE)
        throw Failure("Embree",
                      "could not build the scene, most likely for lack of memory; use a smaller model");
    place = std::move(made);
    return *place;
}

void Peer::update(const Tree& tree, const Assembly& all) const {
    if (tree.geometry) {
        std::memcpy(tree.positions, all.positions.data(), all.positions.size() * sizeof(glm::vec3));
        rtcUpdateGeometryBuffer(tree.geometry, RTC_BUFFER_TYPE_VERTEX, 0);
        rtcCommitGeometry(tree.geometry);
    }
    rtcCommitScene(tree.scene.get());
}

void Peer::tune(const Assembly& all, const std::vector<uint32_t>& receivers,
                const std::vector<const SampleGrid*>& grids) {
    constexpr size_t timed = 192, run = 64;
    constexpr int rounds = 2;
    const std::vector<uint32_t> some = evenly(receivers, timed, run);
    if (some.empty()) return;
    std::vector<float> transfer(all.positions.size() * 25);
    const FlushDenormals guard;
    const clockid_t clock = threads_ > 1 ? CLOCK_PROCESS_CPUTIME_ID : CLOCK_THREAD_CPUTIME_ID;
    Bounds bounds;
    grow(bounds, all.positions);
    diagonal_ = diagonal(bounds);
    double update_ms[2] = {INFINITY, INFINITY};
    for (const bool rebuild : {false, true}) {
        const Tree& tree = tree_of({rebuild, false}, all);
        for (int round = 0; round < rounds; ++round) {
            const double start = cpu_ms(clock);
            update(tree, all);
            update_ms[rebuild] = std::min(update_ms[rebuild], cpu_ms(clock) - start);
        }
    }
    for (const SampleGrid* grid : grids) {
        double trace_ms[4];
        std::fill(std::begin(trace_ms), std::end(trace_ms), INFINITY);
        const auto setup_at = [](size_t number) { return PeerSetup{(number & 1) != 0, (number & 2) != 0}; };
        for (int round = 0; round < rounds; ++round) {
            for (size_t number = 0; number < std::size(trace_ms); ++number) {
                const PeerSetup setup = setup_at(number);
                const Tree& tree = tree_of(setup, all);
                const double start = cpu_ms();
                for (size_t k = 0; k < some.size(); k += batch)
                    trace(tree, setup.coherent, all, &some[k],
                          static_cast<uint32_t>(std::min<size_t>(batch, some.size() - k)), *grid,
                          PeerLoop::packets, transfer.data());
                trace_ms[number] = std::min(trace_ms[number], cpu_ms() - start);
            }
        }
        double least = INFINITY;
        for (size_t number = 0; number < std::size(trace_ms); ++number) {
            const PeerSetup setup = setup_at(number);
            const double each = update_ms[setup.rebuild] / static_cast<double>(receivers.size()) +
                                trace_ms[number] / static_cast<double>(some.size());
            if (each >= least) continue;
            least = each;
            setups_[grid->side] = setup;
        }
    }
}

PeerSetup Peer::setup_of(const SampleGrid& grid) const {
    const auto found = setups_.find(grid.side);
    return found == setups_.end() ? PeerSetup{} : found->second;
}

void Peer::trace(const Tree& tree, bool coherent, const Assembly& all, const uint32_t* receivers,
                 uint32_t count, const SampleGrid& grid, PeerLoop loop, float* transfer) const {
    const Arithmetic& compute = arithmetic();
    alignas(64) int valid[16];
    alignas(64) RTCRay16 rays;
    std::fill(std::begin(valid), std::end(valid), -1);
    for (uint32_t k = 0; k < 16; ++k) {
        rays.tnear[k] = tnear * static_cast<float>(diagonal_);
        rays.time[k] = 0;
        rays.mask[k] = ~0u;
        rays.id[k] = k;
        rays.flags[k] = 0;
    }
    RTCIntersectContext context;
    rtcInitIntersectContext(&context);
    context.flags = coherent ? RTC_INTERSECT_CONTEXT_FLAG_COHERENT : RTC_INTERSECT_CONTEXT_FLAG_INCOHERENT;
    alignas(64) float total[32] = {};
    for (size_t i = 0; i < 25; ++i)
        total[i] = static_cast<float>(grid.total[i]);

    LaneRotation turn{};
    alignas(64) float local[25][batch] = {}, world[25][batch];
    bool good[batch] = {};
    for (uint32_t lane = 0; lane < count; ++lane) {
        const uint32_t vertex = receivers[lane];
        const glm::vec3 position = all.positions[vertex], normal = all.normals[vertex];
        const float length = glm::length(normal);
        good[lane] = finite(position) && finite(normal) && length > 0;
        if (!good[lane]) continue;
        const glm::vec3 n = normal / length;
        const float across = std::sqrt(n.x * n.x + n.y * n.y);
        const float cosine = across > 0 ? n.x / across : 1, sine = across > 0 ? n.y / across : 0;
        turn.cos_a[lane] = n.z;
        turn.sin_a[lane] = across;
        turn.cos_p[lane] = cosine;
        turn.sin_p[lane] = sine;
        const glm::vec3 origin = position + n * static_cast<float>(lift * diagonal_);
        const Frame frame{{n.z * cosine, n.z * sine, -across},
                          {-sine, cosine, 0},
                          {n.x, n.y, n.z},
                          {origin.x, origin.y, origin.z}};
        for (uint32_t k = 0; k < 16; ++k) {
            rays.org_x[k] = origin.x;
            rays.org_y[k] = origin.y;
            rays.org_z[k] = origin.z;
        }
        alignas(64) float sum[32];
        std::copy(std::begin(total), std::end(total), sum);
        const uint32_t blocks = grid.side * grid.side / 16;
        for (uint32_t block = 0; block < blocks; ++block) {
            const size_t cell = size_t{16} * block;
            compute.aim(frame, &grid.x[cell], &grid.y[cell], &grid.z[cell], rays);
            uint32_t bits = 0;
            if (loop == PeerLoop::packets) {
                rtcOccluded16(valid, tree.scene.get(), &context, &rays);
                for (uint32_t k = 0; k < 16; ++k)
                    bits |= static_cast<uint32_t>(rays.tfar[k] < 0) << k;
            } else {
                RTCIntersectContext lone;
                rtcInitIntersectContext(&lone);
                for (uint32_t k = 0; k < 16; ++k) {
                    RTCRay ray;
                    ray.org_x = origin.x;
                    ray.org_y = origin.y;
                    ray.org_z = origin.z;
                    ray.dir_x = rays.dir_x[k];
                    ray.dir_y = rays.dir_y[k];
                    ray.dir_z = rays.dir_z[k];
                    ray.tnear = rays.tnear[k];
                    ray.tfar = INFINITY;
                    ray.time = 0;
                    ray.mask = ~0u;
                    ray.id = 0;
                    ray.flags = 0;
                    rtcOccluded1(tree.scene.get(), &lone, &ray);
                    bits |= static_cast<uint32_t>(ray.tfar < 0) << k;
                }
            }
            if (bits) compute.subtract(bits, &grid.weight[cell * 32], &grid.block[cell * 2], sum);
        }
        for (uint32_t i = 0; i < 25; ++i)
            local[i][lane] = sum[i];
    }
    rotate_lanes(turn, local, world);
    for (uint32_t lane = 0; lane < count; ++lane) {
        float* out = transfer + size_t{25} * receivers[lane];
        for (uint32_t i = 0; i < 25; ++i)
            out[i] = good[lane] ? world[i][lane] : 0;
    }
}

PeerTime Peer::frame(const Assembly& all, const std::vector<uint32_t>& receivers, const SampleGrid& grid,
                     PeerLoop loop, std::vector<float>& transfer) {
    transfer.resize(all.positions.size() * 25);
    Bounds bounds;
    grow(bounds, all.positions);
    diagonal_ = diagonal(bounds);

    PeerTime time;
    const FlushDenormals guard;
    // Embree's threads are part of the update's processor time; with one thread only this one counts.
    const clockid_t clock = threads_ > 1 ? CLOCK_PROCESS_CPUTIME_ID : CLOCK_THREAD_CPUTIME_ID;
    const PeerSetup setup = setup_of(grid);
    const Tree& tree = tree_of(setup, all);
    const double start = wall_ms(), start_cpu = cpu_ms(clock);
    update(tree, all);
    time.update_ms = cpu_ms(clock) - start_cpu;
    time.update_wall_ms = wall_ms() - start;

    struct Work {
        const Peer* peer;
        const Tree* tree;
        bool coherent;
        const Assembly* all;
        const std::vector<uint32_t>* receivers;
        const SampleGrid* grid;
        PeerLoop loop;
        float* transfer;
        std::atomic<size_t> next{0};
        std::atomic<int64_t> cpu_ns{0};

        void run() {
            const FlushDenormals flush;
            const double begin = cpu_ms();
            const size_t step = size_t{batch} * 4;
            for (size_t r = next.fetch_add(step); r < receivers->size(); r = next.fetch_add(step)) {
                const size_t end = std::min(r + step, receivers->size());
                for (size_t k = r; k < end; k += batch) {
                    const auto count = static_cast<uint32_t>(std::min<size_t>(batch, end - k));
                    peer->trace(*tree, coherent, *all, receivers->data() + k, count, *grid, loop, transfer);
                }
            }
            cpu_ns += static_cast<int64_t>((cpu_ms() - begin) * 1e6);
        }
    } work{this, &tree, setup.coherent, &all, &receivers, &grid, loop, transfer.data()};
    std::vector<void*> tickets;
    for (uint32_t k = 1; k < threads_; ++k)
        tickets.push_back(executor_.enqueue(
            executor_.user, [](void* argument) { static_cast<Work*>(argument)->run(); }, &work));
    work.run();
    for (void* ticket : tickets)
        if (ticket) executor_.finish(executor_.user, ticket);
    time.wall_ms = wall_ms() - start;
    time.cpu_ms = time.update_ms + static_cast<double>(work.cpu_ns.load()) * 1e-6;
    bytes_ = static_cast<size_t>(std::max<int64_t>(counted_.load(), 0));
    return time;
}

std::vector<uint32_t> distinct_receivers(const Assembly& all) {
    using Key = std::array<uint32_t, 6>;
    struct Hash {
        size_t operator()(const Key& key) const {
            uint64_t hash = 0;
            for (const uint32_t part : key)
                hash = (std::rotl(hash, 23) ^ part) * 0x9E3779B97F4A7C15u;
            return hash ^ hash >> 29;
        }
    };
    std::unordered_map<Key, uint32_t, Hash> seen;
    seen.reserve(all.positions.size());
    std::vector<uint32_t> receivers;
    for (uint32_t v = 0; v < all.positions.size(); ++v) {
        const glm::vec3 &p = all.positions[v], &n = all.normals[v];
        // Adding zero makes -0 and +0 the same bits.
        const float parts[6] = {p.x + 0.0f, p.y + 0.0f, p.z + 0.0f, n.x + 0.0f, n.y + 0.0f, n.z + 0.0f};
        Key key;
        for (size_t i = 0; i < 6; ++i)
            key[i] = std::bit_cast<uint32_t>(parts[i]);
        if (seen.try_emplace(key, v).second) receivers.push_back(v);
    }
    return receivers;
}

} // namespace nusselt::tools
