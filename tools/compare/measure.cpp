#include "tools/compare/measure.h"

#include "tools/commands/engine.h"
#include "tools/compare/clock.h"
#include "tools/compare/grid.h"
#include "tools/compare/peer.h"
#include "tools/compare/pictures.h"
#include "tools/report/failure.h"
#include "tools/trace/parallel.h"
#include "tools/trace/trace.h"

#include <glm/geometric.hpp>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <map>
#include <memory>
#include <new>
#include <thread>

namespace nusselt::tools {

namespace {

constexpr uint32_t ray_sides[] = {4, 8, 12, 16, 20, 24, 28, 32, 40, 64};
constexpr uint32_t naive_side = 32;
constexpr double frame_step = 1.0 / 30; // between the two frames of a moment, seconds
constexpr size_t worst_kept = 12;

// Counts what the library asks for.
struct CountingAllocator {
    std::atomic<int64_t> bytes{0};

    Allocator allocator() {
        Allocator a;
        a.user = this;
        a.allocate = [](void* user, size_t size, size_t alignment) -> void* {
            static_cast<CountingAllocator*>(user)->bytes += static_cast<int64_t>(size);
            return ::operator new(size, std::align_val_t(alignment), std::nothrow);
        };
        a.release = [](void* user, void* memory, size_t size, size_t alignment) {
            static_cast<CountingAllocator*>(user)->bytes -= static_cast<int64_t>(size);
            ::operator delete(memory, std::align_val_t(alignment));
        };
        return a;
    }
};

uint64_t hash_of(const std::vector<float>& values, uint64_t hash) {
    // FNV-1a over the words.
    for (const float value : values) {
        uint32_t word;
        std::memcpy(&word, &value, 4);
        hash = (hash ^ word) * 0x100000001B3u;
    }
    return hash;
}
constexpr uint64_t hash_start = 0xCBF29CE484222325u;

// A moment with its reference. Odd ones follow the one before by frame_step and are only there for the
// change.
struct Moment {
    double time = 0;
    bool follows = false;
    scenes::Pose pose;
    Assembly all;
    std::vector<uint32_t> receivers;       // all with position and normal of their own
    std::vector<uint32_t> traced;          // those with a reference
    std::vector<float> reference, half[2]; // 25 a vertex
    std::vector<uint8_t> clear;            // a vertex
};

struct Candidate {
    Entry entry;
    Quality quality = Quality::standard;
    const SampleGrid* grid = nullptr;
    bool per_block = false; // floor: a block's blocked bits weigh the same
    Gatherer gatherer;
    std::vector<double> us, wall, refit;
    FrameStats fastest;
    double fastest_us = 0;
};

void add_stats(FrameStats& sum, const FrameStats& s) {
    sum.receivers += s.receivers;
    sum.receivers_computed += s.receivers_computed;
    sum.receivers_invalid += s.receivers_invalid;
    sum.clusters_tested += s.clusters_tested;
    sum.clusters_rasterized += s.clusters_rasterized;
    sum.triangles_considered += s.triangles_considered;
    sum.triangles_rasterized += s.triangles_rasterized;
    sum.fan_triangles += s.fan_triangles;
    sum.blocks_uniform += s.blocks_uniform;
    sum.blocks_partial += s.blocks_partial;
    sum.triangles_invalid += s.triangles_invalid;
    sum.threads = std::max(sum.threads, s.threads);
    sum.wall_ms += s.wall_ms;
    sum.cpu_ms += s.cpu_ms;
    sum.refit_ms += s.refit_ms;
    sum.cull_ms += s.cull_ms;
    sum.transform_ms += s.transform_ms;
    sum.raster_ms += s.raster_ms;
    sum.integrate_ms += s.integrate_ms;
    sum.rotate_ms += s.rotate_ms;
}

// A frame of ours with the time of the whole call. With one thread that thread's own clock tells the
// processor time, whatever the library's account leaves out; with more, the library's account is all there
// is.
FrameStats timed_frame(Engine& engine, const scenes::Pose& pose, Quality quality,
                       std::vector<float>& transfer) {
    const double wall = wall_ms(), cpu = cpu_ms();
    FrameStats stats = engine.frame(pose, quality, transfer);
    stats.wall_ms = wall_ms() - wall;
    if (engine.threads() == 1) stats.cpu_ms = cpu_ms() - cpu;
    return stats;
}

std::vector<Moment> make_moments(const scenes::Scene& scene, uint32_t frames) {
    std::vector<Moment> moments;
    const bool moves = scene.duration > 0;
    for (uint32_t k = 0; k < (moves ? frames : 1); ++k) {
        const double time = scene.duration * (k + 0.5) / frames;
        const double step = std::min(frame_step, scene.duration / (2.0 * frames));
        for (int second = 0; second <= (moves ? 1 : 0); ++second) {
            Moment moment;
            moment.time = time + second * step;
            moment.follows = second == 1;
            scene.pose(moment.time, moment.pose);
            moment.all = assemble(scene, moment.pose);
            moment.receivers = distinct_receivers(moment.all);
            moments.push_back(std::move(moment));
        }
    }
    return moments;
}

// False: interrupted.
bool trace_reference(Moment& moment, const MeasureOptions& options, const std::vector<uint32_t>& wanted,
                     uint64_t seed, const std::function<void(double)>& show) {
    moment.traced = wanted;
    // A receiver without a normal is left out by the tracer.
    Assembly only = moment.all;
    std::vector<uint8_t> is_wanted(only.positions.size());
    for (const uint32_t vertex : wanted)
        is_wanted[vertex] = 1;
    for (size_t v = 0; v < is_wanted.size(); ++v)
        if (!is_wanted[v]) only.normals[v] = glm::vec3(0);

    const TraceScene scene = make_trace_scene(moment.all);
    TraceOptions trace;
    trace.rays = options.reference_rays;
    trace.halves = true;
    trace.seed = seed;
    trace.cancel = &interrupted();
    trace.progress = [&](double done) { show(0.8 * done); };
    TraceResult result = trace_transfer(scene, only, trace);
    if (result.cancelled) return false;
    trace.halves = false;
    trace.rays = std::max(options.reference_rays / 4, 1024u);
    trace.lift = clear_lift;
    trace.progress = [&](double done) { show(0.8 + 0.2 * done); };
    const TraceResult lifted = trace_transfer(scene, only, trace);
    if (lifted.cancelled) return false;
    moment.reference = std::move(result.transfer);
    moment.half[0] = std::move(result.half[0]);
    moment.half[1] = std::move(result.half[1]);
    moment.clear = clear_receivers(moment.reference, lifted.transfer);
    return true;
}

// The noise of the mean of two halves is half their difference.
void gather_noise(const std::vector<Moment>& moments, SceneReport& report) {
    std::vector<double> all, clear;
    for (const Moment& moment : moments) {
        if (moment.follows) continue;
        for (const uint32_t vertex : moment.traced) {
            if (!(seen_part(&moment.reference[size_t{25} * vertex]) >= 0.01)) {
                ++report.dark;
                continue;
            }
            double difference = 0, size = 0;
            for (size_t i = size_t{25} * vertex; i < size_t{25} * vertex + 25; ++i) {
                const double d = (double{moment.half[0][i]} - moment.half[1][i]) / 2;
                difference += d * d;
                size += double{moment.reference[i]} * moment.reference[i];
            }
            all.push_back(std::sqrt(difference / size));
            if (moment.clear[vertex]) clear.push_back(all.back());
        }
    }
    report.counted = all.size();
    report.clear = clear.size();
    report.noise_all = distribution(std::move(all));
    report.noise_clear = distribution(std::move(clear));
    // Two references that differ by chance alone.
    report.noise_change = report.noise_all.mean * std::sqrt(2.0);
}

std::vector<float> exact_masks(const Moment& moment, const SampleGrid& grid, bool per_block) {
    std::vector<float> transfer(moment.all.positions.size() * 25);
    const TraceScene scene = make_trace_scene(moment.all);
    // The paper's integration: all used bits of a block weigh the same.
    std::vector<double> mean;
    if (per_block) {
        mean.assign(grid.weights.size() / 16, 0.0);
        for (size_t block = 0; block < grid.used.size() / 16; ++block) {
            double used = 0;
            for (size_t k = 0; k < 16; ++k) {
                used += grid.used[block * 16 + k];
                for (size_t i = 0; i < 25; ++i)
                    mean[block * 25 + i] += grid.weights[(block * 16 + k) * 25 + i];
            }
            for (size_t i = 0; i < 25; ++i)
                mean[block * 25 + i] /= std::max(used, 1.0);
        }
    }
    parallel_blocks(moment.traced.size(), 16, [&](size_t begin, size_t end) {
        std::vector<glm::dvec3> directions(grid.used.size());
        std::vector<uint8_t> blocked;
        for (size_t r = begin; r < end; ++r) {
            const uint32_t vertex = moment.traced[r];
            const glm::dvec3 n = glm::normalize(glm::dvec3(moment.all.normals[vertex]));
            const double across = std::sqrt(n.x * n.x + n.y * n.y);
            const double cosine = across > 0 ? n.x / across : 1, sine = across > 0 ? n.y / across : 0;
            const glm::dvec3 t(n.z * cosine, n.z * sine, -across), b(-sine, cosine, 0);
            for (size_t k = 0; k < directions.size(); ++k)
                directions[k] = double{grid.x[k]} * t + double{grid.y[k]} * b + double{grid.z[k]} * n;
            if (!trace_blocked(scene, moment.all, vertex, directions, blocked)) continue;
            double local[25], world[25];
            std::copy(grid.total, grid.total + 25, local);
            for (size_t k = 0; k < blocked.size(); ++k) {
                if (!blocked[k] || !grid.used[k]) continue;
                const double* weight = per_block ? &mean[k / 16 * 25] : &grid.weights[k * 25];
                for (size_t i = 0; i < 25; ++i)
                    local[i] -= weight[i];
            }
            rotate_to_normal(n.x, n.y, n.z, local, world);
            for (size_t i = 0; i < 25; ++i)
                transfer[size_t{25} * vertex + i] = static_cast<float>(world[i]);
        }
    });
    return transfer;
}

// A scene's name may come from a file.
std::string file_name(const std::string& name) {
    std::string safe = name.substr(0, 80);
    for (char& c : safe)
        if (!(c >= 'a' && c <= 'z') && !(c >= 'A' && c <= 'Z') && !(c >= '0' && c <= '9') && c != '-')
            c = '_';
    return safe;
}

std::string text_of(uint32_t number) {
    return std::to_string(number);
}

std::vector<Candidate> make_candidates(const MeasureOptions& options, const std::vector<Light>& lights) {
    // Grids are the same for all scenes of a run.
    static std::map<uint32_t, SampleGrid> grids;
    static const SampleGrid paper = disk_grid(32);
    const auto grid_of = [&](uint32_t side) {
        auto found = grids.find(side);
        if (found == grids.end()) found = grids.emplace(side, concentric_grid(side)).first;
        return &found->second;
    };
    std::vector<Candidate> candidates;
    const auto add = [&](std::string name, Kind kind, uint32_t samples) -> Candidate& {
        Candidate candidate{{}, Quality::standard, nullptr, false, Gatherer(lights), {}, {}, {}, {}, 0};
        candidate.entry.name = std::move(name);
        candidate.entry.kind = kind;
        candidate.entry.samples = samples;
        candidates.push_back(std::move(candidate));
        return candidates.back();
    };
    for (const Quality quality : {Quality::paper, Quality::draft, Quality::standard, Quality::fine})
        add(quality_name(quality), Kind::ours, quality_mask_bits(quality)).quality = quality;
    for (const uint32_t side : ray_sides)
        if (side * side <= options.most_peer_rays)
            add("embree " + text_of(side * side), Kind::peer, side * side).grid = grid_of(side);
    if (options.naive)
        add("naive " + text_of(naive_side * naive_side), Kind::naive, naive_side * naive_side).grid =
            grid_of(naive_side);
    if (options.floors) {
        for (const uint32_t side : {16u, 32u, 64u})
            add("floor " + text_of(side * side), Kind::floor, side * side).grid = grid_of(side);
        add("floor disk 1024", Kind::floor, 1024).grid = &paper;
        Candidate& blocks = add("floor disk 1024, 4x4 blocks", Kind::floor, 1024);
        blocks.grid = &paper;
        blocks.per_block = true;
    }
    return candidates;
}

bool timed(const Candidate& candidate) {
    return candidate.entry.kind != Kind::floor;
}

// Errors of one candidate over all moments. False: interrupted.
bool gather_errors(Candidate& candidate, const std::vector<Moment>& moments, Engine& engine, Peer& peer) {
    std::vector<float> now, before;
    for (uint32_t m = 0; m < moments.size(); ++m) {
        if (interrupted()) return false;
        const Moment& moment = moments[m];
        if (moment.follows && !timed(candidate)) continue; // exact rays are slow, and nobody waits for them
        if (moment.follows) before = now;
        switch (candidate.entry.kind) {
        case Kind::ours:
            engine.frame(moment.pose, candidate.quality, now);
            break;
        case Kind::peer:
        case Kind::naive:
            peer.frame(moment.all, moment.traced, *candidate.grid,
                       candidate.entry.kind == Kind::naive ? PeerLoop::single : PeerLoop::packets, now);
            break;
        case Kind::floor:
            now = exact_masks(moment, *candidate.grid, candidate.per_block);
            break;
        }
        if (moment.follows) {
            candidate.gatherer.add_change(before, moments[m - 1].reference, now, moment.reference,
                                          moment.traced);
        } else {
            candidate.gatherer.add(m, now, moment.reference, moment.traced, moment.clear);
        }
    }
    return true;
}

void time_candidate(Candidate& candidate, const std::vector<Moment>& moments, Engine& engine, Peer& peer,
                    bool keep) {
    static std::vector<float> transfer;
    FrameStats sum;
    double cpu = 0, wall = 0, refit = 0, receivers = 0, frames = 0;
    for (const Moment& moment : moments) {
        if (moment.follows) continue;
        ++frames;
        if (candidate.entry.kind == Kind::ours) {
            const FrameStats stats = timed_frame(engine, moment.pose, candidate.quality, transfer);
            add_stats(sum, stats);
            receivers += stats.receivers_computed;
            cpu += stats.cpu_ms;
            wall += stats.wall_ms;
        } else {
            const PeerTime time = peer.frame(
                moment.all, moment.receivers, *candidate.grid,
                candidate.entry.kind == Kind::naive ? PeerLoop::single : PeerLoop::packets, transfer);
            receivers += static_cast<double>(moment.receivers.size());
            cpu += time.cpu_ms;
            wall += time.wall_ms;
            refit += time.refit_ms;
        }
    }
    if (!keep) return;
    const double us = receivers > 0 ? 1e3 * cpu / receivers : 0;
    if (candidate.us.empty() || us < candidate.fastest_us) {
        candidate.fastest_us = us;
        candidate.fastest = sum;
    }
    candidate.us.push_back(us);
    candidate.wall.push_back(wall / frames);
    candidate.refit.push_back(refit / frames);
}

void measure_scaling(const scenes::Scene& scene, const MeasureOptions& options,
                     const std::vector<Moment>& moments, SceneReport& report) {
    const uint32_t most =
        options.scaling_threads ? options.scaling_threads : std::max(1u, std::thread::hardware_concurrency());
    std::vector<std::unique_ptr<Engine>> engines;
    try {
        for (uint32_t threads = 1; threads <= most; threads = threads < 4 ? threads + 1 : threads * 2)
            engines.push_back(
                std::make_unique<Engine>(scene, EngineOptions{threads, options.isa, {}}, scene.name));
    } catch (const Failure& failure) {
        // A build without TBB.
        report.notes.push_back(std::string("scaling: ") + failure.what());
    }
    const Quality qualities[] = {Quality::standard, Quality::fine};
    std::vector<std::vector<double>> wall(engines.size() * 2), us(engines.size() * 2);
    std::vector<ScalingPoint> points(engines.size() * 2);
    std::vector<float> transfer;
    for (uint32_t repeat = 0; repeat <= options.repeats; ++repeat) {
        for (size_t k = 0; k < points.size(); ++k) {
            if (interrupted()) return;
            Engine& engine = *engines[k / 2];
            ScalingPoint& point = points[k];
            point.entry = quality_name(qualities[k % 2]);
            point.threads = engine.threads();
            point.hash = hash_start;
            double total_wall = 0, total_cpu = 0, receivers = 0, frames = 0;
            for (const Moment& moment : moments) {
                if (moment.follows) continue;
                const FrameStats stats = timed_frame(engine, moment.pose, qualities[k % 2], transfer);
                point.hash = hash_of(transfer, point.hash);
                point.took_part = std::max(point.took_part, stats.threads);
                total_wall += stats.wall_ms;
                total_cpu += stats.cpu_ms;
                receivers += stats.receivers_computed;
                ++frames;
            }
            // The first round warms up.
            if (repeat == 0) continue;
            wall[k].push_back(total_wall / frames);
            us[k].push_back(receivers > 0 ? 1e3 * total_cpu / receivers : 0);
        }
    }
    for (size_t k = 0; k < points.size(); ++k) {
        points[k].wall_ms = time_of(wall[k]);
        points[k].us = time_of(us[k]);
        report.scaling.push_back(points[k]);
    }
}

} // namespace

const char* kind_name(Kind kind) {
    switch (kind) {
    case Kind::ours:
        return "ours";
    case Kind::peer:
        return "peer";
    case Kind::naive:
        return "naive";
    case Kind::floor:
        return "floor";
    }
    return "unknown";
}

Time time_of(std::vector<double> values) {
    if (values.empty()) return {};
    std::sort(values.begin(), values.end());
    const size_t n = values.size();
    return {values.front(), (values[(n - 1) / 2] + values[n / 2]) / 2};
}

SceneReport measure_scene(const scenes::Scene& scene, const MeasureOptions& options,
                          const std::vector<Light>& lights,
                          const std::function<void(double, const char*)>& show) {
    SceneReport report;
    report.name = scene.name;
    for (const Light& light : lights)
        report.lights.push_back(light.name);
    std::vector<Moment> moments = make_moments(scene, options.frames);
    report.vertices = moments[0].all.positions.size();
    report.triangles = moments[0].all.indices.size() / 3;
    report.receivers = moments[0].receivers.size();

    // The same vertices in every frame, so that the change has both ends.
    std::vector<uint32_t> wanted;
    {
        const std::vector<uint32_t>& all = moments[0].receivers;
        const size_t step = (all.size() + options.most_receivers - 1) / std::max(options.most_receivers, 1u);
        for (size_t k = 0; k < all.size(); k += std::max<size_t>(step, 1))
            wanted.push_back(all[k]);
    }
    report.reference_rays = options.reference_rays;
    report.reference_receivers = static_cast<uint32_t>(wanted.size());
    const double traced_from = wall_ms();
    size_t traced = 0;
    for (Moment& moment : moments) {
        const bool done = trace_reference(moment, options, wanted, 1000 + traced, [&](double part) {
            show(0.5 * (static_cast<double>(traced) + part) / static_cast<double>(moments.size()),
                 "reference");
        });
        if (!done) break;
        ++traced;
    }
    if (traced < moments.size()) {
        moments.resize(traced);
        report.notes.push_back("interrupted: fewer frames than asked for");
    }
    if (moments.empty())
        throw Failure("interrupted", "before the first reference was traced; nothing to tell");
    report.reference_seconds = (wall_ms() - traced_from) / 1e3;
    for (const Moment& moment : moments)
        if (!moment.follows) report.times.push_back(moment.time);
    gather_noise(moments, report);

    CountingAllocator counter;
    const double adding = wall_ms();
    Engine engine(scene, {options.threads, options.isa, counter.allocator()}, scene.name);
    report.add_mesh_ms = wall_ms() - adding;
    report.isa = isa_name(engine.isa());
    for (size_t m = 0; m < scene.meshes.size(); ++m) {
        const MeshInfo info = engine.mesh(m);
        report.mesh_bytes += info.bytes;
        report.levels = std::max(report.levels, info.levels);
        report.coarse_triangles += info.levels ? info.level_triangles[info.levels - 1] : 0;
    }
    std::optional<Peer> peer;
    peer.emplace(moments[0].all, options.threads);
    report.peer_build_ms = peer->build_ms();

    std::vector<Candidate> candidates = make_candidates(options, lights);
    for (size_t k = 0; k < candidates.size();) {
        show(0.5 + 0.15 * static_cast<double>(k) / static_cast<double>(candidates.size()), "errors");
        bool good = false;
        try {
            good = gather_errors(candidates[k], moments, engine, *peer);
        } catch (const Failure& failure) {
            report.notes.push_back(candidates[k].entry.name + ": " + failure.what());
        }
        // What is not there, or was cut short, isn't told.
        if (good) {
            ++k;
        } else {
            candidates.erase(candidates.begin() + static_cast<std::ptrdiff_t>(k));
        }
    }
    for (uint32_t repeat = 0; repeat <= options.repeats && !interrupted(); ++repeat) {
        show(0.65 + 0.3 * repeat / (options.repeats + 1.0), "times");
        // The first round warms up caches and allocations.
        for (Candidate& candidate : candidates)
            if (timed(candidate) && !interrupted()) {
                const bool cheap = candidate.entry.kind == Kind::ours;
                if (repeat > 0 || cheap) time_candidate(candidate, moments, engine, *peer, repeat > 0);
            }
        if (repeat > 0) report.repeats = repeat;
    }
    report.complete = !interrupted();
    report.context_bytes = static_cast<uint64_t>(counter.bytes.load());
    report.peer_bytes = peer->bytes();
    // Embree limits TBB in the whole process to the threads of its device, which scaling must not inherit.
    peer.reset();

    std::vector<CurvePoint> all_curve, clear_curve;
    for (Candidate& candidate : candidates) {
        Entry& entry = candidate.entry;
        entry.all = candidate.gatherer.all();
        entry.clear = candidate.gatherer.clear();
        entry.all.noisy = entry.all.each.mean <= report.noise_all.mean;
        entry.clear.noisy = entry.clear.each.mean <= report.noise_clear.mean;
        entry.absolute = candidate.gatherer.absolute();
        entry.ambient = candidate.gatherer.ambient();
        entry.change = candidate.gatherer.change();
        entry.radiance = candidate.gatherer.radiance();
        entry.histogram_all = candidate.gatherer.histogram(false);
        entry.histogram_clear = candidate.gatherer.histogram(true);
        entry.worst = candidate.gatherer.worst(worst_kept);
        entry.us = time_of(candidate.us);
        entry.wall_ms = time_of(candidate.wall);
        entry.refit_ms = time_of(candidate.refit);
        if (entry.kind == Kind::ours && !candidate.us.empty()) entry.stats = candidate.fastest;
        if (entry.kind != Kind::peer || candidate.us.empty()) continue;
        all_curve.push_back({entry.all.each.mean, entry.us.min});
        clear_curve.push_back({entry.clear.each.mean, entry.us.min});
        report.peer_refit_ms = entry.refit_ms.median;
    }
    for (Candidate& candidate : candidates) {
        Entry& entry = candidate.entry;
        entry.peer_all = time_at_error(all_curve, entry.all.each.mean);
        entry.peer_clear = time_at_error(clear_curve, entry.clear.each.mean);
        report.entries.push_back(entry);
    }
    show(0.95, "scaling");
    if (!interrupted()) measure_scaling(scene, options, moments, report);
    if (options.pictures && !interrupted()) {
        std::vector<float> transfer;
        for (const Entry& entry : report.entries) {
            if (entry.kind != Kind::ours || entry.worst.empty()) continue;
            // The frame of the worst receiver.
            const Moment& moment = moments[entry.worst[0].frame];
            Quality quality = Quality::standard;
            quality_from_name(entry.name.c_str(), &quality);
            engine.frame(moment.pose, quality, transfer);
            report.shots.push_back({file_name(scene.name) + "_" + entry.name, entry.name,
                                    error_picture(moment.all, scene.view_direction, transfer,
                                                  moment.reference, moment.traced, moment.clear)});
        }
    }
    return report;
}

} // namespace nusselt::tools
