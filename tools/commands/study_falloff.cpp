// Occlusion that fades with distance: what a frame costs, how wrong it is, and how much of the occlusion is
// left.
#include "tools/commands/study.h"
#include "tools/report/stop.h"
#include "tools/trace/trace.h"

#include <algorithm>
#include <cstdio>

namespace nusselt::tools {

namespace {

// Of transfer vectors against traced ones, over the receivers that have these.
TransferError error_of(const std::vector<float>& ours, const TraceScene& traced, const Assembly& chosen,
                       const std::vector<uint8_t>& clear, const Falloff& falloff, uint32_t rays) {
    TraceOptions options;
    options.rays = rays;
    options.fade_from = static_cast<double>(falloff.from);
    options.fade_to = static_cast<double>(falloff.to);
    options.cancel = &interrupted();
    const TraceResult reference = trace_transfer(traced, chosen, options);
    throw_if_interrupted();
    return transfer_error(ours, reference.transfer, clear);
}

double mean_of_first_terms(const std::vector<float>& transfer) {
    double sum = 0;
    for (size_t k = 0; k < transfer.size(); k += 25)
        sum += transfer[k];
    return sum / static_cast<double>(std::max<size_t>(transfer.size() / 25, 1));
}

} // namespace

Study study_falloff(const Subject& subject, const StudyOptions& options) {
    Study study;
    study.table.columns = {
        "from", "to (parts of the diagonal)", "over none", "triangles", "occlusion left", "error", "p99",
        "worst"};
    const Assembly all = assemble(subject.scene, subject.pose);
    const TraceScene traced = make_trace_scene(all);
    Assembly chosen = all; // receivers without a normal are not traced
    std::fill(chosen.normals.begin(), chosen.normals.end(), glm::vec3(0));
    for (const uint32_t v : choose_receivers(all.positions.size(), options.quick ? 300 : 2000))
        chosen.normals[v] = all.normals[v];
    const uint32_t rays = options.quick ? 1024 : 16384;
    TraceOptions whole_distance;
    whole_distance.rays = rays;
    whole_distance.cancel = &interrupted();
    const TraceResult reference = trace_transfer(traced, chosen, whole_distance);
    whole_distance.lift = clear_lift;
    const std::vector<uint8_t> clear =
        clear_receivers(reference.transfer, trace_transfer(traced, chosen, whole_distance).transfer);
    throw_if_interrupted();
    Bounds bounds;
    grow(bounds, all.positions);
    const float size = diagonal(bounds);
    Engine engine(subject.scene, options.engine, subject.name);
    const auto text = [](const char* format, double value) {
        char out[32];
        std::snprintf(out, sizeof out, format, value);
        return std::string(out);
    };
    const double open = mean_of_first_terms(open_transfers(all.normals));
    std::vector<float> whole, faded;
    FrameStats stats;
    const auto cpu = [&](const Falloff& falloff, std::vector<float>& transfer) {
        engine.fade(falloff);
        stats = engine.frame(subject.pose, options.quality, transfer);
        return stats.cpu_ms;
    };
    // `part`: of the diagonal; of the last frame.
    const auto add_row = [&](const Falloff& part, double ratio, const std::vector<float>& transfer) {
        const double hidden = open - mean_of_first_terms(whole), left = open - mean_of_first_terms(transfer);
        const TransferError error =
            error_of(transfer, traced, chosen, clear, {part.from * size, part.to * size}, rays);
        const bool fades = part.to > 0;
        study.table.rows.push_back({fades ? text("%.2f", double{part.from}) : "none",
                                    fades ? text("%.2f", double{part.to}) : "none", text("%.2f x", ratio),
                                    text("%.0f", static_cast<double>(stats.triangles_rasterized) /
                                                     std::max<double>(stats.receivers_computed, 1)),
                                    percent(hidden > 0 ? left / hidden : 0), percent(error.mean),
                                    percent(error.p99), percent(error.max)});
    };
    cpu({}, whole);
    add_row({}, 1, whole);
    double done = 0;
    constexpr Falloff parts[] = {{0.4f, 0.8f}, {0.2f, 0.4f}, {0.1f, 0.2f}, {0.05f, 0.1f}, {0.02f, 0.04f}};
    for (const Falloff& part : parts) {
        const Falloff falloff{part.from * size, part.to * size};
        const std::vector<double> times = measure_in_turns(
            options.quick ? 5 : 15, {[&] { return cpu({}, whole); }, [&] { return cpu(falloff, faded); }});
        add_row(part, times[1] / times[0], faded);
        options.progress(++done / std::size(parts));
    }
    return study;
}

} // namespace nusselt::tools
