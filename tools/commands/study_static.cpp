// What stands still: a scene on a ground that only receives, moving or not, with a history and without.
#include "tools/commands/roles.h"
#include "tools/commands/study.h"

#include <algorithm>
#include <cstdio>

namespace nusselt::tools {

Study study_static(const Subject& subject, const StudyOptions& options) {
    Study study;
    study.table.columns = {"frame", "ms", "over all anew", "refit, ms", "receivers computed"};
    constexpr double moments[] = {0.45, 0.47};
    scenes::Scene scene = subject.scene;
    (void)add_ground(scene, {moments[0] * scene.duration, moments[1] * scene.duration});
    scenes::Scene solid = scene;
    solid.meshes.back().hides = true;
    scenes::Pose poses[2];
    for (uint32_t k = 0; k < 2; ++k)
        scene.pose(moments[k] * scene.duration, poses[k]);
    Engine anew(scene, options.engine, subject.name), blocking(solid, options.engine, subject.name),
        moving(scene, options.engine, subject.name), still(scene, options.engine, subject.name);
    for (Engine* engine : {&moving, &still}) {
        engine->keep_still();
        engine->hold_origin();
    }
    struct Way {
        const char* name;
        Engine* engine;
        bool moves;
        FrameStats stats;
        uint32_t frames = 0;
    };
    Way ways[] = {{"all anew", &anew, true, {}},
                  {"all anew, the ground blocks too", &blocking, true, {}},
                  {"with a history, the scene moves on its ground", &moving, true, {}},
                  {"with a history, nothing moves", &still, false, {}}};
    std::vector<float> transfer;
    std::vector<std::function<double()>> turns;
    for (Way& way : ways) {
        turns.emplace_back([&] {
            const scenes::Pose& pose = poses[way.moves ? way.frames++ % 2 : 0];
            way.stats = way.engine->frame(pose, options.quality, transfer);
            return way.stats.cpu_ms;
        });
    }
    const std::vector<double> times = measure_in_turns(options.quick ? 6 : 16, turns);
    for (size_t k = 0; k < std::size(ways); ++k) {
        const FrameStats& stats = ways[k].stats;
        const auto text = [](const char* format, double value) {
            char out[32];
            std::snprintf(out, sizeof out, format, value);
            return std::string(out);
        };
        study.table.rows.push_back({ways[k].name, text("%.2f", times[k]), text("%.2f x", times[k] / times[0]),
                                    text("%.2f", stats.refit_ms), std::to_string(stats.receivers_computed)});
    }
    options.progress(1);
    return study;
}

} // namespace nusselt::tools
