#include "tools/compare/measure.h"

#include "tools/commands/engine.h"
#include "tools/compare/clock.h"
#include "tools/compare/floor.h"
#include "tools/compare/grid.h"
#include "tools/compare/moment.h"
#include "tools/compare/peer.h"
#include "tools/compare/pictures.h"
#include "tools/compare/scaling.h"
#include "tools/compare/timing.h"
#include "tools/report/failure.h"
#include "tools/report/stop.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <map>
#include <new>

namespace nusselt::tools {

namespace {

constexpr uint32_t ray_sides[] = {4, 8, 12, 16, 20, 24, 28, 32, 40, 64};
constexpr uint32_t naive_side = 32, centred_side = 32;
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

struct Candidate {
    Entry entry;
    Quality quality = Quality::standard;
    const SampleGrid* grid = nullptr;
    bool per_block = false; // floor: a block's blocked bits weigh the same
    Gatherer gatherer;
    std::vector<double> us, wall, update;
    FrameStats fastest;
    double fastest_us = 0;
    double error_ms = 0; // peer: wall time of the pass over a receiver of all moments that don't follow
    PeerSetup setup;
    uint32_t computed = 0; // ours: receivers of all these moments
};

// The time that a scene may take.
struct Limit {
    double start = wall_ms(), ms = 0; // 0: none
    bool past(double share) const { return ms > 0 && wall_ms() - start > share * ms; }
    double left_ms(double share) const { return start + share * ms - wall_ms(); }
    bool stop(double share = 1) const { return interrupted() || past(share); }
};
// Shares of the limit at which the stages must be done.
constexpr double reference_share = 0.4, errors_share = 0.65, times_share = 0.95;

constexpr size_t peer_run = 64; // neighbouring receivers that are timed together, for the caches' sake
constexpr uint32_t least_receivers = 64;

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
    static std::map<uint32_t, SampleGrid> rays, masks;
    static const SampleGrid paper = disk_grid(32), centred = concentric_grid(centred_side);
    const auto ray_grid = [&](uint32_t side) {
        auto found = rays.find(side);
        if (found == rays.end()) found = rays.emplace(side, scattered_grid(side)).first;
        return &found->second;
    };
    const auto grid_of_masks = [&](uint32_t side) {
        auto found = masks.find(side);
        if (found == masks.end()) found = masks.emplace(side, mask_grid(side)).first;
        return &found->second;
    };
    std::vector<Candidate> candidates;
    const auto add = [&](std::string name, Kind kind, uint32_t samples) -> Candidate& {
        Candidate candidate{{}, Quality::standard, nullptr, false, Gatherer(lights), {}, {}, {}, {}, 0, 0, {},
                            0};
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
            add("embree " + text_of(side * side), Kind::peer, side * side).grid = ray_grid(side);
    if (centred_side * centred_side <= options.most_peer_rays)
        add("embree 1024, cell centres", Kind::centred, 1024).grid = &centred;
    if (options.naive)
        add("naive " + text_of(naive_side * naive_side), Kind::naive, naive_side * naive_side).grid =
            ray_grid(naive_side);
    for (const uint32_t side : {16u, 32u, 64u})
        add("floor " + text_of(side * side), Kind::floor, side * side).grid = grid_of_masks(side);
    add("floor 1024, cell centres", Kind::floor, 1024).grid = &centred;
    add("floor disk 1024", Kind::floor, 1024).grid = &paper;
    Candidate& blocks = add("floor disk 1024, 4x4 blocks", Kind::floor, 1024);
    blocks.grid = &paper;
    blocks.per_block = true;
    return candidates;
}

bool timed(const Candidate& candidate) {
    return candidate.entry.kind != Kind::floor;
}

// In the order of what a cut-short run is missed for most.
std::vector<size_t> by_need(const std::vector<Candidate>& candidates) {
    const auto need = [&](size_t k) {
        const Entry& entry = candidates[k].entry;
        if (entry.kind == Kind::ours) return 0;
        if (entry.name == "floor 1024") return 1;
        return entry.kind == Kind::peer ? 2 : 3;
    };
    std::vector<size_t> order(candidates.size());
    for (size_t k = 0; k < order.size(); ++k)
        order[k] = k;
    std::stable_sort(order.begin(), order.end(), [&](size_t a, size_t b) { return need(a) < need(b); });
    return order;
}

// Errors of one candidate over all moments. False: stopped; no limit stops ours.
bool gather_errors(Candidate& candidate, const std::vector<Moment>& moments, Engine& engine, Peer& peer,
                   const Limit& limit) {
    std::vector<float> now, before;
    for (uint32_t m = 0; m < moments.size(); ++m) {
        if (candidate.entry.kind == Kind::ours ? interrupted().load() : limit.stop(errors_share))
            return false;
        const Moment& moment = moments[m];
        if (moment.follows && !timed(candidate)) continue; // exact rays are slow, and nobody waits for them
        if (moment.follows) before = now;
        switch (candidate.entry.kind) {
        case Kind::ours: {
            const FrameStats stats = engine.frame(moment.pose, candidate.quality, now);
            if (!moment.follows) candidate.computed += stats.receivers_computed;
            break;
        }
        case Kind::peer:
        case Kind::centred:
        case Kind::naive: {
            const PeerTime time =
                peer.frame(moment.all, moment.traced, *candidate.grid,
                           candidate.entry.kind == Kind::naive ? PeerLoop::single : PeerLoop::packets, now);
            if (!moment.follows)
                candidate.error_ms +=
                    time.wall_ms / static_cast<double>(std::max<size_t>(moment.traced.size(), 1));
            break;
        }
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

// One round of one candidate over all moments. The peer takes the receivers of `chosen[moment]`, and its time
// is scaled up to all of them.
void time_candidate(Candidate& candidate, const std::vector<Moment>& moments,
                    const std::vector<std::vector<uint32_t>>& chosen, Engine& engine, Peer& peer,
                    std::vector<float>& transfer, bool keep) {
    FrameStats sum;
    double cpu = 0, wall = 0, update = 0, receivers = 0, frames = 0;
    for (size_t m = 0; m < moments.size(); ++m) {
        const Moment& moment = moments[m];
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
                moment.all, chosen[m], *candidate.grid,
                candidate.entry.kind == Kind::naive ? PeerLoop::single : PeerLoop::packets, transfer);
            const auto all = static_cast<double>(moment.receivers.size());
            const double scale = all / static_cast<double>(std::max<size_t>(chosen[m].size(), 1));
            receivers += all;
            cpu += time.update_ms + (time.cpu_ms - time.update_ms) * scale;
            wall += time.update_wall_ms + (time.wall_ms - time.update_wall_ms) * scale;
            update += time.update_ms;
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
    candidate.update.push_back(update / frames);
}

// How many receivers a moment get a reference so that the scene keeps its limit: a few are traced to see.
// What the other entries' errors take is about one and a half times the reference.
uint32_t affordable_receivers(const std::vector<Moment>& moments, const MeasureOptions& options,
                              const Limit& limit) {
    double ms[2] = {};
    constexpr uint32_t counts[2] = {16, 80};
    for (int k = 0; k < 2; ++k) {
        Moment pilot = moments[0];
        const double start = wall_ms();
        if (!trace_reference(pilot, evenly(pilot.receivers, counts[k], 1), options.reference_rays, 1,
                             [](double) {}))
            return 0;
        ms[k] = wall_ms() - start;
    }
    const double each = std::max((ms[1] - ms[0]) / (counts[1] - counts[0]), 1e-3);
    const double once = std::max(ms[0] - counts[0] * each, 0.0);
    const double count = (limit.left_ms(reference_share) / static_cast<double>(moments.size()) - once) / each;
    return static_cast<uint32_t>(
        std::clamp(count, double{least_receivers}, static_cast<double>(options.most_receivers)));
}

// How many receivers the peer is timed on so that all rounds keep the limit.
size_t affordable_peer_receivers(const std::vector<Candidate>& candidates, const std::vector<Moment>& moments,
                                 const MeasureOptions& options, const Limit& limit, double ours_ms) {
    size_t all = 0;
    double each = 0;
    for (const Moment& moment : moments)
        all = std::max(all, moment.receivers.size());
    if (limit.ms == 0) return all;
    for (const Candidate& candidate : candidates)
        each += candidate.error_ms;
    if (!(each > 0)) return all;
    const double round = limit.left_ms(times_share) / options.repeats - ours_ms;
    return std::max<size_t>(static_cast<size_t>(std::max(round, 0.0) / each), 4 * peer_run);
}

} // namespace

const char* kind_name(Kind kind) {
    switch (kind) {
    case Kind::ours:
        return "ours";
    case Kind::peer:
        return "peer";
    case Kind::centred:
        return "centred";
    case Kind::naive:
        return "naive";
    case Kind::floor:
        return "floor";
    }
    return "unknown";
}

SceneReport measure_scene(const scenes::Scene& scene, const MeasureOptions& options,
                          const std::vector<Light>& lights,
                          const std::function<void(double, const char*)>& show) {
    Limit limit;
    limit.ms = options.limit_seconds * 1e3;
    SceneReport report;
    report.name = scene.name;
    for (const Light& light : lights)
        report.lights.push_back(light.name);
    std::vector<Moment> moments = make_moments(scene, options.frames);
    report.vertices = moments[0].all.positions.size();
    report.triangles = moments[0].all.indices.size() / 3;
    report.receivers = moments[0].receivers.size();

    // The same vertices in every frame, so that the change has both ends.
    const uint32_t most =
        limit.ms > 0 ? affordable_receivers(moments, options, limit) : options.most_receivers;
    const std::vector<uint32_t> wanted = evenly(moments[0].receivers, most, 1);
    report.reference_rays = options.reference_rays;
    report.reference_receivers = static_cast<uint32_t>(wanted.size());
    const double traced_from = wall_ms();
    size_t traced = 0;
    for (Moment& moment : moments) {
        const bool done =
            trace_reference(moment, wanted, options.reference_rays, 1000 + traced, [&](double part) {
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
    report.noise = reference_noise(moments);

    CountingAllocator counter;
    const double adding = wall_ms();
    Engine engine(scene, {options.threads, options.isa, counter.allocator()}, scene.name);
    report.add_mesh_ms = wall_ms() - adding;
    report.isa = isa_name(engine.isa());
    for (size_t m = 0; m < scene.meshes.size(); ++m) {
        const MeshInfo info = engine.mesh(m);
        report.mesh_bytes += info.bytes;
        report.levels = std::max(report.levels, info.levels);
        report.coarse_triangles += info.coarse_triangles;
    }
    std::optional<Peer> peer;
    peer.emplace(moments[0].all, options.threads);
    report.peer_build_ms = peer->build_ms();

    std::vector<Candidate> candidates = make_candidates(options, lights);
    const size_t wanted_candidates = candidates.size();
    // On the last pose: its BVH is refitted from the first.
    show(0.5, "tuning Embree");
    std::vector<const SampleGrid*> grids;
    for (const Candidate& candidate : candidates)
        if (candidate.entry.kind == Kind::peer) grids.push_back(candidate.grid);
    if (!interrupted()) peer->tune(moments.back().all, moments.back().receivers, grids);
    for (Candidate& candidate : candidates)
        if (candidate.entry.kind == Kind::peer) {
            candidate.setup = peer->setup_of(*candidate.grid);
            candidate.entry.setup = setup_name(candidate.setup);
        }
    {
        // What is not there, or was cut short, isn't told.
        std::vector<uint8_t> good(candidates.size());
        double done = 0;
        for (const size_t k : by_need(candidates)) {
            show(0.5 + 0.15 * done++ / static_cast<double>(candidates.size()), "errors");
            try {
                good[k] = gather_errors(candidates[k], moments, engine, *peer, limit);
            } catch (const Failure& failure) {
                report.notes.push_back(candidates[k].entry.name + ": " + failure.what());
            }
        }
        size_t kept = 0;
        for (size_t k = 0; k < candidates.size(); ++k)
            if (good[k]) std::swap(candidates[kept++], candidates[k]);
        candidates.erase(candidates.begin() + static_cast<std::ptrdiff_t>(kept), candidates.end());
    }

    std::vector<std::vector<uint32_t>> chosen;
    bool short_of_time = candidates.size() < wanted_candidates;
    for (uint32_t repeat = 0; repeat <= options.repeats && !interrupted(); ++repeat) {
        // Ours is timed at least once.
        if (repeat > 1 && limit.past(times_share)) {
            short_of_time = true;
            break;
        }
        show(0.65 + 0.3 * repeat / (options.repeats + 1.0), "times");
        // The first round warms up caches and allocations; the peer has none of its own.
        std::vector<float> transfer;
        const double start = wall_ms();
        for (Candidate& candidate : candidates) {
            const bool ours = candidate.entry.kind == Kind::ours;
            if (!timed(candidate) || interrupted() || (repeat == 0 && !ours)) continue;
            if (ours || !limit.past(times_share)) {
                time_candidate(candidate, moments, chosen, engine, *peer, transfer, repeat > 0);
            } else {
                short_of_time = true;
            }
        }
        if (repeat == 0) {
            const size_t count =
                affordable_peer_receivers(candidates, moments, options, limit, wall_ms() - start);
            for (const Moment& moment : moments)
                chosen.push_back(evenly(moment.receivers, count, peer_run));
            report.peer_receivers = chosen[0].size();
        } else {
            report.repeats = repeat;
        }
    }
    if (limit.ms > 0 && short_of_time) report.notes.push_back("the time limit cut it short");
    for (const Candidate& candidate : candidates) {
        if (candidate.entry.kind == Kind::ours && !candidate.us.empty() &&
            candidate.fastest.receivers_computed != candidate.computed)
            report.notes.push_back(candidate.entry.name +
                                   ": the timed frames did less than whole frames; its times mean nothing");
    }
    report.complete = !interrupted() && !short_of_time;
    report.context_bytes = static_cast<uint64_t>(counter.bytes.load());
    report.peer_bytes = peer->bytes();
    // Embree limits TBB in the whole process to the threads of its device, which scaling must not inherit.
    peer.reset();

    std::vector<CurvePoint> all_curve, clear_curve;
    for (Candidate& candidate : candidates) {
        Entry& entry = candidate.entry;
        entry.all = candidate.gatherer.all();
        entry.clear = candidate.gatherer.clear();
        entry.all.noisy = entry.all.each.mean <= report.noise.all.mean;
        entry.clear.noisy = entry.clear.each.mean <= report.noise.clear.mean;
        entry.absolute = candidate.gatherer.absolute();
        entry.ambient = candidate.gatherer.ambient();
        entry.change = candidate.gatherer.change();
        entry.radiance = candidate.gatherer.radiance();
        entry.histogram_all = candidate.gatherer.histogram(false);
        entry.histogram_clear = candidate.gatherer.histogram(true);
        entry.worst = candidate.gatherer.worst(worst_kept);
        entry.us = time_of(candidate.us);
        entry.wall_ms = time_of(candidate.wall);
        entry.update_ms = time_of(candidate.update);
        if (entry.kind == Kind::ours && !candidate.us.empty()) entry.stats = candidate.fastest;
        if (entry.kind != Kind::peer || candidate.us.empty()) continue;
        all_curve.push_back({entry.all.each.mean, entry.us.min});
        clear_curve.push_back({entry.clear.each.mean, entry.us.min});
        if (!candidate.setup.rebuild) report.peer_refit_ms = entry.update_ms.median;
    }
    for (Candidate& candidate : candidates) {
        Entry& entry = candidate.entry;
        entry.peer_all = time_at_error(all_curve, entry.all.each.mean);
        entry.peer_clear = time_at_error(clear_curve, entry.clear.each.mean);
        report.entries.push_back(entry);
    }
    show(0.95, "scaling");
    if (limit.ms == 0 && !interrupted()) measure_scaling(scene, options, moments, report);
    std::vector<float> transfer;
    std::vector<Shot> lit_shots;
    for (const Entry& entry : report.entries) {
        if (entry.kind != Kind::ours || entry.worst.empty() || limit.stop()) continue;
        if (limit.ms > 0 && entry.name != "standard") continue;
        // The frame of the worst receiver.
        const Moment& moment = moments[entry.worst[0].frame];
        Quality quality = Quality::standard;
        quality_from_name(entry.name.c_str(), &quality);
        engine.frame(moment.pose, quality, transfer);
        std::vector<Worst> here;
        for (const Worst& each : entry.worst)
            if (each.frame == entry.worst[0].frame) here.push_back(each);
        const std::string name = file_name(scene.name) + "_" + entry.name;
        report.shots.push_back({name,
                                entry.name + ": relative error of each vertex, at the worst one's moment",
                                error_picture(moment, scene.view_direction, transfer, here)});
        if (quality != Quality::standard || moment.traced.size() != moment.receivers.size() || lights.empty())
            continue;
        std::array<Picture, 2> lit = lit_pictures(moment, scene.view_direction, transfer, lights[0]);
        lit_shots.push_back(
            {name + "_lit", "standard under the light '" + lights[0].name + "'", std::move(lit[0])});
        lit_shots.push_back({file_name(scene.name) + "_reference_lit",
                             "the reference under the same light, moment and view", std::move(lit[1])});
    }
    for (Shot& shot : lit_shots)
        report.shots.push_back(std::move(shot));
    return report;
}

} // namespace nusselt::tools
