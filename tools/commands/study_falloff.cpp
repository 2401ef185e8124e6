// Occlusion that fades with distance: what a frame costs, and how much of the occlusion is left.
#include "tools/commands/study.h"
#include "tools/trace/trace.h"

#include <algorithm>
#include <cstdio>

namespace nusselt::tools {

namespace {

double mean_of_first_terms(const std::vector<float>& transfer) {
    double sum = 0;
    for (size_t k = 0; k < transfer.size(); k += 25)
        sum += transfer[k];
    return sum / static_cast<double>(std::max<size_t>(transfer.size() / 25, 1));
}

} // namespace

Study study_falloff(const Subject& subject, const StudyOptions& options) {
    Study study;
    study.table.columns = {"from", "to (parts of the diagonal)", "over none", "triangles", "occlusion left"};
    const Assembly all = assemble(subject.scene, subject.pose);
    Bounds bounds;
    grow(bounds, all.positions);
    const float size = diagonal(bounds);
    Engine engine(subject.scene, options.engine, subject.name);
    constexpr float parts[][2] = {{0.4f, 0.8f}, {0.2f, 0.4f}, {0.1f, 0.2f}, {0.05f, 0.1f}, {0.02f, 0.04f}};
    std::vector<float> whole, faded;
    const double open = mean_of_first_terms(open_transfers(all.normals));
    double done = 0;
    for (const auto& part : parts) {
        FrameStats stats;
        const auto cpu = [&](const Falloff& falloff, std::vector<float>& transfer) {
            engine.fade(falloff);
            stats = engine.frame(subject.pose, options.quality, transfer);
            return stats.cpu_ms;
        };
        const std::vector<double> times =
            measure_in_turns(options.quick ? 5 : 15, {[&] { return cpu({}, whole); },
                                                      [&] {
                                                          return cpu({part[0] * size, part[1] * size}, faded);
                                                      }});
        const auto text = [](const char* format, double value) {
            char out[32];
            std::snprintf(out, sizeof out, format, value);
            return std::string(out);
        };
        const double hidden = open - mean_of_first_terms(whole), left = open - mean_of_first_terms(faded);
        study.table.rows.push_back({text("%.2f", double{part[0]}), text("%.2f", double{part[1]}),
                                    text("%.2f x", times[1] / times[0]),
                                    text("%.0f", static_cast<double>(stats.triangles_rasterized) /
                                                     std::max<double>(stats.receivers_computed, 1)),
                                    percent(hidden > 0 ? left / hidden : 0)});
        options.progress(++done / std::size(parts));
    }
    return study;
}

} // namespace nusselt::tools
