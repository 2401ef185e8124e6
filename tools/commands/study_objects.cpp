// Many objects that shadow one another: what each costs beside being alone, and the error of all together,
// with the others as proxies, with all as one object, and with each alone.
#include "tools/commands/crowd.h"
#include "tools/commands/study.h"
#include "tools/image/image.h"
#include "tools/render/render.h"
#include "tools/trace/trace.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

namespace nusselt::tools {

namespace {

// The crowd under the built-in sky, from above, for each of several sets of transfer vectors.
struct Pictures {
    Assembly all;
    View view;
    Image environment = sky(1024, 512, 0);
    std::vector<float> light = project_environment(environment, "sky");
    float exposure = 0;

    Pictures(const Crowd& crowd, const Engine& engine, bool quick)
        : all(assemble(crowd.scene, crowd.pose)), traced(make_trace_scene(all)) {
        const uint32_t width = quick ? 160 : 720, height = quick ? 90 : 405;
        Framing framing =
            make_framing({crowd_direction[0], crowd_direction[1], crowd_direction[2]}, 32, width, height);
        for (const std::vector<glm::vec3>& positions : crowd.pose.positions)
            include(framing, positions);
        view = cast_view(traced, frame_camera(framing), width, height);
        exposure =
            exposure_for(color_view(view, all, shaded(engine, open_transfers(all.normals))), view.covered);
    }
    std::string png(const Engine& engine, const std::vector<float>& transfer) const {
        return encode_png(
            finish_view(view, color_view(view, all, shaded(engine, transfer)), exposure, &environment));
    }

private:
    std::vector<float> shaded(const Engine& engine, std::vector<float> transfer) const {
        const std::vector<glm::vec3> white(all.positions.size(), glm::vec3(1));
        return engine.shade(light.data(), transfer, white);
    }
    TraceScene traced;
};

} // namespace

Study study_objects(const Subject& subject, const StudyOptions& options) {
    Study study;
    Table& table = study.table;
    table.columns = {"objects",   "us a receiver", "over alone", "as one, us",    "as one, over alone",
                     "triangles", "error",         "p99",        "as one, error", "alone, error"};
    const float spacing = crowd_spacing(subject.pose);
    Engine one(subject.scene, options.engine, subject.name);
    std::vector<CrowdCost> costs;
    std::vector<uint32_t> counts;
    for (uint32_t n = 1; n <= options.most_objects; n *= options.quick ? 4 : 2)
        counts.push_back(n);
    for (const uint32_t n : counts) {
        const Crowd crowd = make_crowd(subject.scene, n, spacing);
        Engine all(crowd.scene, options.engine, subject.name);
        const CrowdFrames frames = run_crowd(crowd, all, one, options.quality, options.quick ? 3 : 7);
        const Reference reference = trace_some(assemble(crowd.scene, crowd.pose), options.quick ? 600 : 3000,
                                               options.quick ? 1024 : 4096);
        const auto error = [&](const std::vector<float>& transfer) {
            return transfer_error(transfer, reference.transfer, reference.clear);
        };
        const double receivers = frames.stats.receivers_computed;
        costs.push_back({n, 1e3 * frames.grouped_ms / receivers, 1e3 * frames.together_ms / receivers,
                         1e3 * frames.alone_ms / receivers});
        const auto text = [](const char* format, double value) {
            char out[32];
            std::snprintf(out, sizeof out, format, value);
            return std::string(out);
        };
        table.rows.push_back(
            {std::to_string(n), text("%.2f", costs.back().grouped),
             text("%.2f x", frames.grouped_ms / frames.alone_ms), text("%.2f", costs.back().together),
             text("%.2f x", frames.together_ms / frames.alone_ms),
             text("%.0f", static_cast<double>(frames.stats.triangles_rasterized) / receivers),
             percent(error(frames.grouped).mean), percent(error(frames.grouped).p99),
             percent(error(frames.together).mean), percent(error(frames.alone).mean)});
        if (n == 16 && options.pictures) {
            const Pictures pictures(crowd, all, options.quick);
            study.pictures = {{"objects.png", pictures.png(all, frames.grouped)},
                              {"as_one.png", pictures.png(all, frames.together)},
                              {"alone.png", pictures.png(all, frames.alone)}};
        }
        options.progress(static_cast<double>(n) / counts.back());
    }
    std::string plot = plot_crowd(costs);
    plot.insert(4, " xmlns=\"http://www.w3.org/2000/svg\"");
    study.pictures.emplace_back("objects.svg", plot);
    return study;
}

} // namespace nusselt::tools
