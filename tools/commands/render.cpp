#include "tools/render/render.h"

#include "tools/commands/choice.h"
#include "tools/commands/commands.h"
#include "tools/report/failure.h"
#include "tools/report/output.h"
#include "tools/report/progress.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

namespace nusselt::tools {

void run_render(const RenderOptions& options) {
    const bool several = options.frames.has_value();
    const Choice choice = choose(options.model, options.clip, several || options.time.has_value());
    std::vector<double> times{options.time.value_or(0)};
    if (several) {
        times.clear();
        for (uint32_t k = 0; k < *options.frames; ++k)
            times.push_back(k / options.fps);
        const double last = times.back();
        if (choice.clip >= 0 && last > choice.scene.duration) {
            const auto most = static_cast<uint64_t>(std::floor(choice.scene.duration * options.fps)) + 1;
            throw Failure("--frames",
                          "the last frame lies at " + seconds_text(last) + ", but the clip lasts " +
                              seconds_text(choice.scene.duration) + "; at this --fps it has " +
                              std::to_string(most) + " frames",
                          exit_usage);
        }
        check_time(choice, last, "--frames");
    } else {
        check_time(choice, times[0], "--time");
    }
    const Image environment =
        options.environment == "sky" ? sky(1024, 512, 0) : load_environment(options.environment);
    OutputDirectory out(options.out);
    const std::vector<float> light = project_environment(environment, options.environment);
    Engine engine(choice.scene, options.engine, options.model);

    // One camera for the whole clip.
    scenes::Pose pose;
    Framing framing = make_framing(choice.scene.view_direction, 32, options.width, options.height);
    for (const double time : times) {
        choice.scene.pose(time, pose);
        for (const std::vector<glm::vec3>& positions : pose.positions)
            include(framing, positions);
    }
    const Camera camera = frame_camera(framing);

    Progress progress("render");
    float exposure = 0;
    for (size_t k = 0; k < times.size(); ++k) {
        throw_if_interrupted();
        choice.scene.pose(times[k], pose);
        const Assembly all = assemble(choice.scene, pose);
        const TraceScene traced = make_trace_scene(all);
        const View view = cast_view(traced, camera, options.width, options.height);
        std::vector<float> open = open_transfers(all.normals);
        std::vector<float> transfer;
        if (options.shadows == Shadows::on) {
            engine.frame(pose, options.quality, transfer);
        } else if (options.shadows == Shadows::traced) {
            TraceOptions trace;
            trace.rays = options.rays;
            trace.cancel = &interrupted();
            trace.progress = [&](double part) {
                progress.show((static_cast<double>(k) + part) / static_cast<double>(times.size()));
            };
            transfer = trace_transfer(traced, all, trace).transfer;
            throw_if_interrupted();
        } else {
            transfer = open;
        }
        // From the first frame, white and unshadowed: so pictures compare with and without shadows, a clip
        // doesn't flicker, and what is dark stays dark.
        if (k == 0) {
            const std::vector<glm::vec3> white(all.positions.size(), glm::vec3(1));
            exposure =
                exposure_for(color_view(view, all, engine.shade(light.data(), open, white)), view.covered);
        }
        const Image colored = color_view(view, all, engine.shade(light.data(), transfer, all.albedo));
        char name[32];
        std::snprintf(name, sizeof name, "frame_%04zu.png", k);
        out.add(name, encode_png(finish_view(view, colored, exposure, &environment)));
        progress.show((static_cast<double>(k) + 1) / static_cast<double>(times.size()));
    }
    out.commit();
    std::printf("%s: %zu frame%s of %u x %u\n", printable(out.path()).c_str(), times.size(),
                times.size() == 1 ? "" : "s", options.width, options.height);
}

} // namespace nusselt::tools
