#include "tools/commands/demo_crowd.h"

#include "tools/commands/crowd.h"
#include "tools/render/render.h"
#include "tools/report/base64.h"
#include "tools/report/stop.h"

#include <nlohmann/json.hpp>

#include <algorithm>

namespace nusselt::tools {

namespace {

using Json = nlohmann::ordered_json;

// One, two, four, ... of the scene; the last ones' frames stay in `frames`.
std::vector<CrowdCost> measure_growth(const scenes::Scene& scene, float spacing, const CrowdScale& scale,
                                      const EngineOptions& options, Engine& one, CrowdFrames& frames) {
    std::vector<CrowdCost> costs;
    for (uint32_t n = 1; n <= crowd_objects; n *= 2) {
        const Crowd crowd = make_crowd(scene, n, spacing);
        Engine all(crowd.scene, options, scene.name);
        frames = run_crowd(crowd, all, one, Quality::standard, scale.runs);
        const double per_receiver = 1e3 / std::max(frames.stats.receivers_computed, 1u);
        costs.push_back({n, per_receiver * frames.grouped_ms, per_receiver * frames.together_ms,
                         per_receiver * frames.alone_ms});
    }
    return costs;
}

} // namespace

Json show_crowd(const scenes::Scene& scene, const CrowdScale& scale, const EngineOptions& options,
                const Image& environment, OutputDirectory& out) {
    scenes::Pose pose;
    scene.pose(0.3 * scene.duration, pose);
    const float spacing = crowd_spacing(pose);
    Engine one(scene, options, scene.name);
    CrowdFrames frames;
    const std::vector<CrowdCost> costs = measure_growth(scene, spacing, scale, options, one, frames);
    throw_if_interrupted();

    const Crowd crowd = make_crowd(scene, crowd_objects, spacing);
    const Assembly all = assemble(crowd.scene, crowd.pose);
    const TraceScene traced = make_trace_scene(all);
    TraceOptions trace;
    trace.rays = scale.rays;
    trace.cancel = &interrupted();
    std::vector<float> reference = trace_transfer(traced, all, trace).transfer;
    trace.lift = clear_lift;
    const std::vector<uint8_t> clear =
        clear_receivers(reference, trace_transfer(traced, all, trace).transfer);
    throw_if_interrupted();
    const TransferError error = transfer_error(frames.grouped, reference, clear),
                        alone_error = transfer_error(frames.alone, reference, clear);

    const std::vector<float> light = project_environment(environment, "sky");
    Framing framing = make_framing({crowd_direction[0], crowd_direction[1], crowd_direction[2]}, 32,
                                   scale.width, scale.height);
    for (const std::vector<glm::vec3>& positions : crowd.pose.positions)
        include(framing, positions);
    const View view = cast_view(traced, frame_camera(framing), scale.width, scale.height);
    const auto colored = [&](std::vector<float>& transfer, const std::vector<glm::vec3>& albedo) {
        return color_view(view, all, one.shade(light.data(), transfer, albedo));
    };
    std::vector<float> open = open_transfers(all.normals);
    const std::vector<glm::vec3> white(all.positions.size(), glm::vec3(1));
    const float exposure = exposure_for(colored(open, white), view.covered);
    const Picture pictures[3] = {finish_view(view, colored(frames.alone, all.albedo), exposure, nullptr),
                                 finish_view(view, colored(frames.grouped, all.albedo), exposure, nullptr),
                                 finish_view(view, colored(reference, all.albedo), exposure, nullptr)};
    out.add("frames/crowd.png", encode_png(beside({&pictures[0], &pictures[1], &pictures[2]}, 6)));
    Json images = Json::array();
    for (const Picture& picture : pictures)
        images.push_back(base64(encode_jpeg(picture, 88)));
    Json growth = Json::array();
    for (const CrowdCost& cost : costs)
        growth.push_back({{"objects", cost.objects},
                          {"us_as_objects", cost.grouped},
                          {"us_as_one_object", cost.together},
                          {"us_each_alone", cost.alone}});
    return {{"name", scene.name},
            {"objects", crowd_objects},
            {"vertices", all.positions.size()},
            {"triangles", all.indices.size() / 3},
            {"width", scale.width},
            {"height", scale.height},
            {"cpu_ms", frames.grouped_ms},
            {"over_alone", frames.grouped_ms / frames.alone_ms},
            {"clear_mean", error.mean},
            {"clear_p99", error.p99},
            {"alone_clear_mean", alone_error.mean},
            {"growth", std::move(growth)},
            {"plot", plot_crowd(costs)},
            {"images", std::move(images)}};
}

} // namespace nusselt::tools
