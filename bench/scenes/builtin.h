// The built-in scenes, one a file.
#pragma once

#include "scene.h"

namespace nusselt::scenes {

Scene make_cloth();
Scene make_fight();
Scene make_chess();
Scene make_hand();

} // namespace nusselt::scenes
