#include "tools/commands/choice.h"

#include "tools/report/failure.h"

#include <cmath>
#include <cstdio>

namespace nusselt::tools {

namespace {

std::string list_clips(const load::Model& model) {
    if (model.clips.empty()) return "the model has none, leave --clip out";
    constexpr size_t most = 40;
    std::string list = "there are";
    for (size_t k = 0; k < model.clips.size() && k < most; ++k) {
        list += (k ? ", " : " ") + std::to_string(k) + " '" + model.clips[k].name + "' (" +
                seconds_text(model.clips[k].duration) + ")";
    }
    if (model.clips.size() > most) list += " and " + std::to_string(model.clips.size() - most) + " more";
    return list;
}

} // namespace

std::string seconds_text(double seconds) {
    char text[32];
    std::snprintf(text, sizeof text, "%.4g s", seconds);
    return text;
}

load::Model load_or_fail(const std::string& path, bool warn) {
    load::LoadResult result = load::load_model(path);
    if (!result.ok) {
        std::string line = load::describe(path, result.error);
        // The subject is put in front again when the failure is told.
        if (line.starts_with(path + ": ")) line.erase(0, path.size() + 2);
        throw Failure(path, line);
    }
    if (warn) {
        for (const std::string& warning : result.model.warnings)
            std::fprintf(stderr, "%s\n", failure_line(path, "warning: " + warning).c_str());
    }
    return std::move(result.model);
}

int find_clip(const load::Model& model, const std::string& wanted) {
    for (size_t k = 0; k < model.clips.size(); ++k)
        if (model.clips[k].name == wanted) return static_cast<int>(k);
    for (size_t k = 0; k < model.clips.size(); ++k)
        if (std::to_string(k) == wanted) return static_cast<int>(k);
    throw Failure("--clip", "there is no clip '" + wanted + "'; " + list_clips(model), exit_usage);
}

Choice choose(const std::string& path, const std::string& clip, bool moving) {
    Choice choice{load_or_fail(path, true), {}, -1};
    if (!clip.empty()) {
        choice.clip = find_clip(choice.model, clip);
    } else if (moving && !choice.model.clips.empty()) {
        choice.clip = 0;
    }
    choice.scene = load::make_scene(choice.model, choice.clip);
    size_t vertices = 0;
    for (const scenes::Mesh& mesh : choice.scene.meshes)
        vertices += mesh.rest_positions.size();
    if (vertices == 0) throw Failure(path, "draws no mesh; give a model with triangles");
    return choice;
}

void check_time(const Choice& choice, double seconds, const std::string& option) {
    if (std::isfinite(seconds) && seconds >= 0 && seconds <= choice.scene.duration) return;
    if (choice.clip < 0) {
        throw Failure(option, "the model has no clip and stands still; leave the option out", exit_usage);
    }
    const load::Clip& clip = choice.model.clips[static_cast<size_t>(choice.clip)];
    throw Failure(option,
                  seconds_text(seconds) + " is outside clip " + std::to_string(choice.clip) + " '" +
                      clip.name + "', which lasts " + seconds_text(choice.scene.duration) +
                      "; choose a time in it",
                  exit_usage);
}

} // namespace nusselt::tools
