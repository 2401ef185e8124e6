// `nusselt pvs`: records which blockers matter in a clip's frames, and tells what that saves and misses.
#pragma once

#include "tools/commands/engine.h"

#include <string>

namespace nusselt::tools {

struct PvsOptions {
    std::string model, out, clip;
    uint32_t frames = 60, segments = 1;
    Quality quality = Quality::standard;
    TwoSided two_sided = TwoSided::model; // whose backs are recorded, of whole meshes
    bool watertight = false;
    EngineOptions engine;
};
void run_pvs(const PvsOptions& options);

// The bytes of a file of at most a gigabyte and a half. Throws Failure.
std::string read_set(const std::string& path);

} // namespace nusselt::tools
