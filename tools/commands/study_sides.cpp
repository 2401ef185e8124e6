// Receivers that are seen from both sides: a frame of both against one of each side.
#include "tools/commands/study.h"

#include <algorithm>
#include <cstdio>

namespace nusselt::tools {

Study study_sides(const Subject& subject, const StudyOptions& options) {
    Study study;
    study.table.columns = {"frame", "ms", "over the front alone", "over a frame each", "triangles",
                           "error", "p99"};
    scenes::Pose behind = subject.pose;
    for (std::vector<glm::vec3>& normals : behind.normals) {
        for (glm::vec3& n : normals)
            n = -n;
    }
    Engine one(subject.scene, options.engine, subject.name),
        both(subject.scene, options.engine, subject.name);
    std::vector<float> front_alone, back_alone, front;
    BackArrays back;
    both.see_backs(TwoSided::all, &back);
    FrameStats stats[3];
    const auto frame = [&](uint32_t way, Engine& engine, const scenes::Pose& pose, std::vector<float>& out) {
        stats[way] = engine.frame(pose, options.quality, out);
        return stats[way].cpu_ms;
    };
    const std::vector<double> times =
        measure_in_turns(options.quick ? 5 : 15, {[&] { return frame(0, one, subject.pose, front_alone); },
                                                  [&] { return frame(1, one, behind, back_alone); },
                                                  [&] { return frame(2, both, subject.pose, front); }});
    options.progress(0.5);
    const size_t receivers = options.quick ? 600 : 3000;
    const uint32_t rays = options.quick ? 1024 : 4096;
    const Reference of_front = trace_some(assemble(subject.scene, subject.pose), receivers, rays),
                    of_back = trace_some(assemble(subject.scene, behind), receivers, rays);
    // What is closed has no clear receiver on its inside.
    const auto error = [](const std::vector<float>& ours, const Reference& reference) {
        const TransferError e = transfer_error(ours, reference.transfer, reference.clear);
        return std::pair(e.receivers ? percent(e.mean) : "-", e.receivers ? percent(e.p99) : "-");
    };
    const std::pair<std::string, std::string> errors[] = {
        error(front_alone, of_front), error(back_alone, of_back), error(back.transfer, of_back)};
    constexpr const char* names[] = {"the front alone", "the back alone", "both (error: of the back)"};
    for (size_t k = 0; k < std::size(names); ++k) {
        const auto text = [](const char* format, double value) {
            char out[32];
            std::snprintf(out, sizeof out, format, value);
            return std::string(out);
        };
        study.table.rows.push_back({names[k], text("%.2f", times[k]), text("%.2f x", times[k] / times[0]),
                                    k < 2 ? "-" : text("%.2f x", times[2] / (times[0] + times[1])),
                                    text("%.0f", static_cast<double>(stats[k].triangles_rasterized) /
                                                     std::max<double>(stats[k].receivers_computed, 1)),
                                    errors[k].first, errors[k].second});
    }
    options.progress(1);
    return study;
}

} // namespace nusselt::tools
