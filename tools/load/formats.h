// The readers behind load_model, one a format. Each throws LoadError (error.h).
#pragma once

#include "tools/load/file.h"
#include "tools/load/model.h"

#include <string>

namespace nusselt::load {

Model read_gltf(const std::string& path, Bytes file, const LoadLimits& limits); // .gltf and .glb
Model read_obj(const std::string& path, Bytes file, const LoadLimits& limits);
Model read_ply(const std::string& path, Bytes file, const LoadLimits& limits);

// A name from a file without its control characters; other UTF-8 stays.
std::string clean_name(const std::string& name);

} // namespace nusselt::load
