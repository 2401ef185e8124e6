// Potentially visible sets of a scene's animation (section 3.2 of the paper): what they save over culling
// alone, and what they miss between the recorded frames.
#include "tools/commands/study.h"
#include "tools/report/failure.h"
#include "tools/report/stop.h"
#include "tools/trace/trace.h"

#include <algorithm>
#include <cstdio>

namespace nusselt::tools {

namespace {

struct Means {
    double ms = 0, looked_at = 0, drawn = 0; // a frame, a receiver, a receiver
};

} // namespace

Study study_pvs(const Subject& subject, const StudyOptions& options) {
    Study study;
    study.table.columns = {"quality",       "bytes", "looked at",       "looked at with a set",
                           "drawn",         "time",  "frames a second", "frames with a set",
                           "error between", "worst"};
    const uint32_t recorded = options.quick ? 10 : 40;
    const auto moment = [&](double frame) { return subject.scene.duration * frame / (recorded - 1); };
    constexpr Quality qualities[] = {Quality::draft, Quality::standard, Quality::fine};
    double done = 0;
    for (const Quality quality : qualities) {
        Engine engine(subject.scene, options.engine, subject.name);
        engine.record_visible(quality, 1);
        scenes::Pose pose;
        std::vector<float> all, set;
        for (uint32_t k = 0; k < recorded; ++k) {
            throw_if_interrupted();
            subject.scene.pose(moment(k), pose);
            engine.frame(pose, quality, all);
        }
        const std::string bytes = engine.visible_set();
        engine.use_visible(bytes, subject.name);
        // Recorded frames are timed; the error is told half-way to the next.
        Means without, with;
        double error = 0, worst = 0;
        constexpr uint32_t tried = 3;
        for (uint32_t k = 0; k < tried; ++k) {
            const uint32_t frame = (2 * k + 1) * (recorded - 1) / (2 * tried);
            subject.scene.pose(moment(frame), pose);
            const auto timed = [&](bool wanted, std::vector<float>& transfer, Means& means) {
                engine.use_visible(wanted);
                const FrameStats stats = engine.frame(pose, quality, transfer);
                const double receivers = std::max<double>(stats.receivers_computed, 1);
                means.looked_at = static_cast<double>(stats.triangles_considered) / receivers;
                means.drawn = static_cast<double>(stats.triangles_rasterized) / receivers;
                return stats.cpu_ms;
            };
            const std::vector<double> times =
                measure_in_turns(options.quick ? 5 : 15, {[&] { return timed(false, all, without); },
                                                          [&] { return timed(true, set, with); }});
            if (all != set)
                throw Failure(subject.name, "a set changed a frame that was recorded; please report it");
            without.ms += times[0] / tried;
            with.ms += times[1] / tried;
            subject.scene.pose(moment(frame + 0.5), pose);
            (void)timed(false, all, without);
            (void)timed(true, set, with);
            const TransferError between = transfer_error(set, all);
            error += between.mean / tried;
            worst = std::max(worst, between.max);
        }
        const auto text = [](const char* format, double value) {
            char out[32];
            std::snprintf(out, sizeof out, format, value);
            return std::string(out);
        };
        study.table.rows.push_back({quality_name(quality), std::to_string(bytes.size()),
                                    text("%.0f", without.looked_at), text("%.0f", with.looked_at),
                                    text("%.0f", with.drawn), text("%.2f x", with.ms / without.ms),
                                    text("%.0f", 1e3 / without.ms), text("%.0f", 1e3 / with.ms),
                                    text("%.4f %%", 100 * error), text("%.1f %%", 100 * worst)});
        options.progress(++done / std::size(qualities));
    }
    return study;
}

} // namespace nusselt::tools
