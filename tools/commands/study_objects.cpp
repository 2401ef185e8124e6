// Many objects that shadow one another: what each costs beside being alone, and the error of all together,
// with the others as proxies, with all as one object, and with each alone.
#include "tools/commands/study.h"
#include "tools/image/image.h"
#include "tools/render/render.h"
#include "tools/report/progress.h"
#include "tools/report/stop.h"
#include "tools/trace/trace.h"

#include <glm/common.hpp>
#include <glm/vec2.hpp>

#include <algorithm>
#include <cmath>
#include <cstdio>

namespace nusselt::tools {

namespace {

// Over the ground.
float width_of(const scenes::Pose& pose) {
    glm::vec2 low(INFINITY), high(-INFINITY);
    for (const std::vector<glm::vec3>& positions : pose.positions) {
        for (const glm::vec3& p : positions) {
            low = glm::min(low, glm::vec2(p.x, p.z));
            high = glm::max(high, glm::vec2(p.x, p.z));
        }
    }
    return std::max(high.x - low.x, high.y - low.y);
}

// n of the subject on a grid over x and z, one body's width apart, each at its own moment.
struct Crowd {
    scenes::Scene scene;
    scenes::Pose pose;
    std::vector<uint32_t> object_of; // of each mesh
    std::vector<scenes::Pose> alone; // of each object, where it stands
};

Crowd make_crowd(const Subject& subject, uint32_t n, float spacing) {
    Crowd crowd;
    const auto across = static_cast<uint32_t>(std::ceil(std::sqrt(static_cast<double>(n))));
    for (uint32_t k = 0; k < n; ++k) {
        scenes::Pose& pose = crowd.alone.emplace_back();
        subject.scene.pose(subject.scene.duration * ((k * 7) % 16 + 0.5) / 16, pose);
        const glm::vec3 shift(spacing * static_cast<float>(k % across), 0,
                              spacing * static_cast<float>(k / across));
        for (std::vector<glm::vec3>& positions : pose.positions)
            for (glm::vec3& p : positions)
                p += shift;
        for (const scenes::Mesh& mesh : subject.scene.meshes) {
            crowd.scene.meshes.push_back(mesh);
            crowd.object_of.push_back(k);
        }
        crowd.pose.positions.insert(crowd.pose.positions.end(), pose.positions.begin(), pose.positions.end());
        crowd.pose.normals.insert(crowd.pose.normals.end(), pose.normals.begin(), pose.normals.end());
    }
    crowd.scene.name = subject.name;
    return crowd;
}

struct Reference {
    std::vector<float> transfer; // zeros but for the receivers that were traced
    std::vector<uint8_t> clear;
};

Reference trace_some(const Crowd& crowd, size_t receivers, uint32_t rays) {
    Assembly assembly = assemble(crowd.scene, crowd.pose);
    const TraceScene traced = make_trace_scene(assembly);
    // What has no normal isn't traced.
    std::vector<glm::vec3> normals(assembly.normals.size(), glm::vec3(0));
    for (const uint32_t v : choose_receivers(normals.size(), receivers))
        normals[v] = assembly.normals[v];
    assembly.normals = normals;
    TraceOptions trace;
    trace.rays = rays;
    trace.cancel = &interrupted();
    Reference reference;
    reference.transfer = trace_transfer(traced, assembly, trace).transfer;
    trace.lift = clear_lift;
    const std::vector<float> lifted = trace_transfer(traced, assembly, trace).transfer;
    throw_if_interrupted();
    reference.clear = clear_receivers(reference.transfer, lifted);
    return reference;
}

// The crowd under the built-in sky, from above, for each of several sets of transfer vectors.
struct Pictures {
    Assembly all;
    View view;
    Image environment = sky(1024, 512, 0);
    std::vector<float> light = project_environment(environment, "sky");
    float exposure = 0;

    Pictures(const Crowd& crowd, const Engine& engine, bool quick)
        : all(assemble(crowd.scene, crowd.pose)), traced(make_trace_scene(all)) {
        const uint32_t width = quick ? 160 : 720, height = quick ? 90 : 405;
        Framing framing = make_framing({-0.5f, -0.75f, -1}, 32, width, height);
        for (const std::vector<glm::vec3>& positions : crowd.pose.positions)
            include(framing, positions);
        view = cast_view(traced, frame_camera(framing), width, height);
        exposure =
            exposure_for(color_view(view, all, shaded(engine, open_transfers(all.normals))), view.covered);
    }
    std::string png(const Engine& engine, const std::vector<float>& transfer) const {
        return encode_png(
            finish_view(view, color_view(view, all, shaded(engine, transfer)), exposure, &environment));
    }

private:
    std::vector<float> shaded(const Engine& engine, std::vector<float> transfer) const {
        const std::vector<glm::vec3> white(all.positions.size(), glm::vec3(1));
        return engine.shade(light.data(), transfer, white);
    }
    TraceScene traced;
};

} // namespace

Table study_objects(const Subject& subject, const StudyOptions& options) {
    Table table;
    table.columns = {"objects",   "us a receiver", "over alone", "as one, us",    "as one, over alone",
                     "triangles", "error",         "p99",        "as one, error", "alone, error"};
    const float spacing = 1.1f * width_of(subject.pose);
    Engine one(subject.scene, options.engine, subject.name);
    Progress progress("study");
    const std::vector<uint32_t> counts =
        options.quick ? std::vector<uint32_t>{1, 4, 16, 64} : std::vector<uint32_t>{1, 2, 4, 8, 16, 32, 64};
    for (const uint32_t n : counts) {
        const Crowd crowd = make_crowd(subject, n, spacing);
        Engine all(crowd.scene, options.engine, subject.name);
        std::vector<float> together, grouped, alone;
        FrameStats stats;
        const auto ungrouped = [&] {
            all.group(std::vector<uint32_t>(crowd.object_of.size(), 0));
            return all.frame(crowd.pose, options.quality, together).cpu_ms;
        };
        const auto as_objects = [&] {
            all.group(crowd.object_of);
            stats = all.frame(crowd.pose, options.quality, grouped);
            return stats.cpu_ms;
        };
        const auto one_by_one = [&] {
            std::vector<float> own;
            double sum = 0;
            alone.clear();
            for (const scenes::Pose& pose : crowd.alone) {
                sum += one.frame(pose, options.quality, own).cpu_ms;
                alone.insert(alone.end(), own.begin(), own.end());
            }
            return sum;
        };
        const std::vector<double> times =
            measure_in_turns(options.quick ? 3 : 7, {as_objects, ungrouped, one_by_one});
        const Reference reference =
            trace_some(crowd, options.quick ? 600 : 3000, options.quick ? 1024 : 4096);
        const auto error = [&](const std::vector<float>& transfer) {
            return transfer_error(transfer, reference.transfer, reference.clear);
        };
        const double receivers = stats.receivers_computed;
        const auto text = [](const char* format, double value) {
            char out[32];
            std::snprintf(out, sizeof out, format, value);
            return std::string(out);
        };
        table.rows.push_back({std::to_string(n), text("%.2f", 1e3 * times[0] / receivers),
                              text("%.2f x", times[0] / times[2]), text("%.2f", 1e3 * times[1] / receivers),
                              text("%.2f x", times[1] / times[2]),
                              text("%.0f", static_cast<double>(stats.triangles_rasterized) / receivers),
                              percent(error(grouped).mean), percent(error(grouped).p99),
                              percent(error(together).mean), percent(error(alone).mean)});
        if (n == 16) {
            const Pictures pictures(crowd, all, options.quick);
            table.pictures = {{"objects.png", pictures.png(all, grouped)},
                              {"as_one.png", pictures.png(all, together)},
                              {"alone.png", pictures.png(all, alone)}};
        }
        progress.show(static_cast<double>(n) / counts.back());
    }
    return table;
}

} // namespace nusselt::tools
