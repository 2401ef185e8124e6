// A model file and a moment of it, as the options choose them.
#pragma once

#include "bench/scenes/scene.h"
#include "tools/load/model.h"

#include <optional>
#include <string>

namespace nusselt::tools {

// Loads `path`; what is wrong with it becomes a Failure. Its warnings go to stderr where `warn`.
load::Model load_or_fail(const std::string& path, bool warn);

// The clip that `wanted` names, or whose number it is; -1 for none. Throws Failure (usage) with the list of
// clips.
int find_clip(const load::Model& model, const std::string& wanted);

// `clip` empty: the first clip where `moving`, otherwise the nodes as they stand.
struct Choice {
    load::Model model;
    scenes::Scene scene;
    int clip = -1;
};
Choice choose(const std::string& path, const std::string& clip, bool moving);

// Throws Failure (usage) unless the clip has that moment.
void check_time(const Choice& choice, double seconds, const std::string& option);

std::string seconds_text(double seconds);

} // namespace nusselt::tools
