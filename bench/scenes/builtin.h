// The built-in scenes, one a file.
#pragma once

#include "scene.h"

namespace nusselt::scenes {

Scene make_cloth();
Scene make_fight();
Scene make_chess();
// `cell`: edge length of the grid that the skin is meshed on, centimetres; half of it gives four times the
// triangles. The built-in scene's own gives 15,892.
constexpr float hand_cell = 0.2965f;
Scene make_hand(float cell = hand_cell);

} // namespace nusselt::scenes
