// What must hold of a model that a loader let through.
#pragma once

#include "tools/load/model.h"

namespace nusselt::fuzz {

// Small enough that an input cannot ask for more than some megabytes.
load::LoadLimits small_limits();
void check_model(const load::Model& model);
void check_error(const load::LoadError& error);
// Reads bytes as the format does, with everything checked; a refusal is fine.
void load_gltf(const uint8_t* data, size_t size);

} // namespace nusselt::fuzz
