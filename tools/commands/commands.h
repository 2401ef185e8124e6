// The program's commands. Each throws Failure; everything else is a fault of the program.
#pragma once

#include "tools/commands/engine.h"
#include "tools/commands/further.h"
#include "tools/commands/roles.h"
#include "tools/compare/measure.h"

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace nusselt::tools {

struct DemoOptions {
    std::string out;
    bool quick = false; // small pictures, few frames and rays: for tests
    EngineOptions engine;
};
void run_demo(const DemoOptions& options);

struct InfoOptions {
    std::string model;
    bool json = false;
};
void run_info(const InfoOptions& options);

struct TransferOptions {
    std::string model, out, clip;
    std::optional<double> time;
    Quality quality = Quality::standard;
    EngineOptions engine;
    uint32_t repeat = 1;
    std::vector<StreamArray> streams; // written beside the transfer vectors
    TwoSided two_sided = TwoSided::off;
    std::string visible_set; // file; none: all blockers are looked at
};
void run_transfer(const TransferOptions& options);

enum class Shadows { off, on, traced };
// What a picture shows: light, an output as colours (bent normals as (n + 1) / 2), or how much of the
// blockers a set has each vertex look at.
enum class Show { radiance, ambient_occlusion, bent_normal, visible_set };

struct RenderOptions {
    std::string model, out, clip;
    std::string environment = "sky";
    std::optional<double> time;
    std::optional<uint32_t> frames;
    double fps = 30;
    Shadows shadows = Shadows::on;
    Show show = Show::radiance;
    Reflectance reflectance;
    Falloff falloff;
    Roles roles;
    FurtherModels further;
    bool watertight = false;
    bool keep = false; // what did not move since the frame before
    TwoSided two_sided = TwoSided::model;
    std::string visible_set;        // file of `nusselt pvs`; empty: none
    bool direct = false;            // light straight from the masks and the environment
    std::optional<ShWindow> window; // of the light
    float window_width = 5;
    uint32_t rays = 1024;
    uint32_t width = 960, height = 720;
    Quality quality = Quality::standard;
    EngineOptions engine;
};
void run_render(const RenderOptions& options);

struct CompareOptions {
    std::vector<std::string> models; // files, or directories to look through; none: the built-in `scene`
    std::string scene = "all", out, clip, readme;
    std::vector<std::string> environments;
    bool quick = false;
    std::vector<std::string> studies; // topics that are studied on each scene; none: as default_studies says
    MeasureOptions measure;
    std::string command; // as typed, for the report
};
void run_compare(const CompareOptions& options);

// Parses the command line, runs a command and returns the exit code.
int run_program(int argc, const char* const* argv);

} // namespace nusselt::tools
