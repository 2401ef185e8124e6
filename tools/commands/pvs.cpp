#include "tools/commands/pvs.h"

#include "tools/commands/choice.h"
#include "tools/load/file.h"
#include "tools/report/failure.h"
#include "tools/report/output.h"
#include "tools/report/progress.h"
#include "tools/report/stop.h"
#include "tools/trace/trace.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <unistd.h>

namespace nusselt::tools {

namespace {

// What sets save and miss in some poses.
struct Trial {
    double ms_all = 0, ms_set = 0;
    uint64_t triangles_all = 0, triangles_set = 0; // looked at
    uint32_t frames = 0, masks_changed = 0;
    double error = 0, worst = 0; // of transfer vectors that see at least 1 %, mean and largest
};

// Both sides' results, one after the other.
struct Sides {
    std::vector<float> transfer;
    std::vector<uint32_t> masks;
};
Sides frame_of(Engine& engine, const scenes::Pose& pose, Quality quality, BackArrays& backs, double& ms,
               uint64_t& triangles) {
    Sides sides;
    const FrameStats stats = engine.frame(pose, quality, sides.transfer, &sides.masks);
    sides.transfer.insert(sides.transfer.end(), backs.transfer.begin(), backs.transfer.end());
    sides.masks.insert(sides.masks.end(), backs.masks.begin(), backs.masks.end());
    ms += stats.cpu_ms;
    triangles += stats.triangles_considered;
    return sides;
}

void try_pose(Engine& engine, const scenes::Pose& pose, Quality quality, BackArrays& backs, Trial& trial) {
    engine.use_visible(false);
    const Sides all = frame_of(engine, pose, quality, backs, trial.ms_all, trial.triangles_all);
    engine.use_visible(true);
    const Sides set = frame_of(engine, pose, quality, backs, trial.ms_set, trial.triangles_set);
    trial.masks_changed += all.masks != set.masks;
    const TransferError error = transfer_error(set.transfer, all.transfer);
    trial.error += error.mean;
    trial.worst = std::max(trial.worst, error.max);
    ++trial.frames;
}

void tell_trial(const char* where, const Trial& trial) {
    std::printf(
        "%s: masks of %u of %u frames as without it, error %.4f %% (worst vertex %.2f %%), %.0f %% of "
        "the triangles looked at, %.0f %% of the time\n",
        where, trial.frames - trial.masks_changed, trial.frames, 100 * trial.error / trial.frames,
        100 * trial.worst,
        100.0 * static_cast<double>(trial.triangles_set) /
            static_cast<double>(std::max<uint64_t>(trial.triangles_all, 1)),
        100 * trial.ms_set / trial.ms_all);
}

} // namespace

std::string read_set(const std::string& path) {
    try {
        const load::Bytes bytes = load::read_file(path, uint64_t{3} << 29);
        return {bytes.begin(), bytes.end()};
    } catch (const load::LoadError& error) {
        throw Failure(path, error.what + "; " + error.cure);
    }
}

void run_pvs(const PvsOptions& options) {
    const Choice choice = choose(options.model, options.clip, true);
    if (choice.clip < 0) throw Failure(options.model, "it has no animation; a set is of the frames of one");
    const std::filesystem::path parent = std::filesystem::path(options.out).parent_path();
    if (::access(parent.empty() ? "." : parent.c_str(), W_OK | X_OK) != 0)
        throw Failure(options.out,
                      "its directory is not there or may not be written to; choose another with --out");
    const double duration = choice.scene.duration;
    const auto moment = [&](double frame) {
        return options.frames > 1 ? duration * frame / (options.frames - 1) : 0.0;
    };
    Engine engine(choice.scene, options.engine, options.model);
    BackArrays backs;
    if (has_backs(choice.scene, options.two_sided)) engine.see_backs(options.two_sided, &backs, true);
    if (options.watertight) engine.make_watertight();
    engine.record_visible(options.quality, options.segments);
    scenes::Pose pose;
    std::vector<float> transfer;
    constexpr uint32_t tried = 6;
    {
        Progress progress("pvs");
        for (uint32_t k = 0; k < options.frames; ++k) {
            choice.scene.pose(moment(k), pose);
            // Its own segment, and those in which its neighbours lie: frames between the two want both.
            const uint32_t first = segment_at(moment(k - 1.0), duration, options.segments),
                           last = segment_at(moment(k + 1.0), duration, options.segments);
            for (uint32_t segment = first; segment <= last; ++segment) {
                throw_if_interrupted();
                engine.choose_segment(segment);
                engine.frame(pose, options.quality, transfer);
            }
            progress.show((k + 1.0) / (options.frames + 2 * tried));
        }
    }
    const std::string bytes = engine.visible_set();
    engine.use_visible(bytes, options.out);
    Trial recorded, between;
    for (uint32_t k = 0; k < tried; ++k) {
        throw_if_interrupted();
        const double frame = std::floor((k + 0.5) * (options.frames - 1) / tried);
        const auto try_at = [&](double time, Trial& trial) {
            choice.scene.pose(time, pose);
            engine.choose_segment(segment_at(time, duration, options.segments));
            try_pose(engine, pose, options.quality, backs, trial);
        };
        try_at(moment(frame), recorded);
        if (options.frames > 1) try_at(moment(frame + 0.5), between);
    }
    throw_if_interrupted();
    write_file(options.out, bytes);
    const VisibleSetInfo info = engine.visible_info();
    std::printf("%s: %u frames, %u segment%s, %s%s, %zu bytes, %.1f %% of the clusters matter to a batch\n",
                printable(options.out).c_str(), options.frames, info.segments, info.segments == 1 ? "" : "s",
                info.backs > 0 ? "both sides" : "one side", info.watertight ? ", watertight" : "",
                bytes.size(), 100 * info.kept);
    tell_trial("recorded frames", recorded);
    if (between.frames > 0) tell_trial("between them", between);
}

} // namespace nusselt::tools
