#include "tools/commands/choice.h"
#include "tools/commands/commands.h"
#include "tools/report/failure.h"
#include "tools/trace/assembly.h"

#include <nlohmann/json.hpp>

#include <algorithm>
#include <cstdio>

namespace nusselt::tools {

namespace {

using Json = nlohmann::ordered_json;

Json describe_mesh(const scenes::Mesh& mesh, const MeshInfo& info) {
    Json levels = Json::array();
    for (uint32_t level = 0; level < info.levels; ++level)
        levels.push_back(info.level_triangles[level]);
    return {{"name", mesh.name},
            {"vertices", info.vertices},
            {"triangles", info.triangles},
            {"welded_vertices", info.welded_vertices},
            {"degenerate_triangles", info.degenerate_triangles},
            {"components", info.components},
            {"closed_components", info.closed_components},
            {"boundary_edges", info.boundary_edges},
            {"non_manifold_edges", info.non_manifold_edges},
            {"flipped_edges", info.flipped_edges},
            {"level_triangles", levels},
            {"clusters", info.clusters},
            {"bytes", info.bytes}};
}

std::string closedness(const Json& mesh) {
    const auto closed = mesh["closed_components"].get<uint32_t>(), all = mesh["components"].get<uint32_t>();
    if (closed == all && all > 0) return "closed";
    if (closed == 0) return "open";
    return std::to_string(closed) + " of " + std::to_string(all) + " parts closed";
}

void print_text(const Json& report) {
    const auto text = [](const Json& value) { return printable(value.get<std::string>()); };
    const auto number = [](const Json& value) { return std::to_string(value.get<uint64_t>()); };
    const auto append = [](std::string& list, const char* separator, const std::string& item) {
        if (!list.empty()) list.append(separator);
        list.append(item);
    };
    std::printf("%s: %s%s%s\n", text(report["file"]).c_str(), text(report["format"]).c_str(),
                report["generator"].get<std::string>().empty() ? "" : ", made by ",
                text(report["generator"]).c_str());
    std::printf("%s vertices, %s triangles, %zu mesh%s, %zu clip%s, %.6g across\n",
                number(report["vertices"]).c_str(), number(report["triangles"]).c_str(),
                report["meshes"].size(), report["meshes"].size() == 1 ? "" : "es", report["clips"].size(),
                report["clips"].size() == 1 ? "" : "s", report["diagonal"].get<double>());
    std::printf("%s nodes, %s skins, %s joints, %s morph targets\n", number(report["nodes"]).c_str(),
                number(report["skins"]).c_str(), number(report["joints"]).c_str(),
                number(report["morph_targets"]).c_str());
    std::printf("\nmeshes\n");
    for (const Json& mesh : report["meshes"]) {
        std::string levels;
        for (const Json& triangles : mesh["level_triangles"])
            append(levels, " ", number(triangles));
        std::printf("  %-24s %8s vertices %8s triangles  %s; levels %s\n", text(mesh["name"]).c_str(),
                    number(mesh["vertices"]).c_str(), number(mesh["triangles"]).c_str(),
                    closedness(mesh).c_str(), levels.c_str());
        std::string odd;
        for (const char* key :
             {"boundary_edges", "non_manifold_edges", "flipped_edges", "degenerate_triangles"}) {
            if (mesh[key] == 0) continue;
            std::string name = key;
            std::replace(name.begin(), name.end(), '_', ' ');
            append(odd, ", ", number(mesh[key]).append(" ").append(name));
        }
        if (!odd.empty()) std::printf("  %-24s %s\n", "", odd.c_str());
    }
    if (!report["clips"].empty()) std::printf("\nclips\n");
    for (const Json& clip : report["clips"]) {
        std::string paths;
        for (const Json& path : clip["paths"])
            append(paths, ", ", text(path));
        std::printf("  %3s %-28s %10s  %s\n", number(clip["number"]).c_str(), text(clip["name"]).c_str(),
                    seconds_text(clip["duration"].get<double>()).c_str(), paths.c_str());
    }
    if (!report["warnings"].empty()) std::printf("\nwarnings\n");
    for (const Json& warning : report["warnings"])
        std::printf("  %s\n", text(warning).c_str());
}

} // namespace

void run_info(const InfoOptions& options) {
    const load::Model model = load_or_fail(options.model, false);
    const scenes::Scene scene = load::make_scene(model, -1);
    const Engine engine(scene, {.threads = 1, .isa = Isa::best}, options.model);
    scenes::Pose pose;
    scene.pose(0, pose);
    Bounds bounds;
    for (const std::vector<glm::vec3>& positions : pose.positions)
        grow(bounds, positions);

    Json report;
    report["file"] = options.model;
    report["name"] = model.name;
    report["format"] = model.format;
    report["generator"] = model.generator;
    report["extensions"] = model.extensions;
    uint64_t vertices = 0, triangles = 0;
    Json meshes = Json::array();
    for (size_t m = 0; m < scene.meshes.size(); ++m) {
        meshes.push_back(describe_mesh(scene.meshes[m], engine.mesh(m)));
        vertices += scene.meshes[m].rest_positions.size();
        triangles += scene.meshes[m].indices.size() / 3;
    }
    report["vertices"] = vertices;
    report["triangles"] = triangles;
    report["stored_vertices"] = model.stored_vertices;
    report["stored_triangles"] = model.stored_triangles;
    report["nodes"] = model.nodes;
    report["materials"] = model.materials;
    report["skins"] = model.skins;
    report["joints"] = model.joints;
    report["morph_targets"] = model.morph_targets;
    report["meshes_without_normals"] = model.meshes_without_normals;
    report["diagonal"] = diagonal(bounds);
    report["bounds"] = {{bounds.low.x, bounds.low.y, bounds.low.z},
                        {bounds.high.x, bounds.high.y, bounds.high.z}};
    report["meshes"] = std::move(meshes);
    Json clips = Json::array();
    for (size_t k = 0; k < model.clips.size(); ++k) {
        clips.push_back({{"number", k},
                         {"name", model.clips[k].name},
                         {"duration", model.clips[k].duration},
                         {"paths", model.clips[k].paths}});
    }
    report["clips"] = std::move(clips);
    report["warnings"] = model.warnings;

    if (options.json) {
        // A name in a file need not be UTF-8.
        const std::string text = report.dump(2, ' ', false, Json::error_handler_t::replace);
        std::printf("%s\n", text.c_str());
    } else {
        print_text(report);
    }
}

} // namespace nusselt::tools
