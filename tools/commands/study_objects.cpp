// Many objects that shadow one another: what each costs beside being alone, and the error of all together.
#include "tools/commands/study.h"
#include "tools/report/progress.h"
#include "tools/report/stop.h"
#include "tools/trace/trace.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

namespace nusselt::tools {

namespace {

struct Bounds2 {
    float low[2] = {INFINITY, INFINITY}, high[2] = {-INFINITY, -INFINITY};
};

// n of the subject on a grid over x and z, one body's width apart, each at its own moment.
struct Crowd {
    scenes::Scene scene;
    scenes::Pose pose;
    std::vector<scenes::Pose> alone; // of each, where it stands
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
        for (const scenes::Mesh& mesh : subject.scene.meshes)
            crowd.scene.meshes.push_back(mesh);
        crowd.pose.positions.insert(crowd.pose.positions.end(), pose.positions.begin(), pose.positions.end());
        crowd.pose.normals.insert(crowd.pose.normals.end(), pose.normals.begin(), pose.normals.end());
    }
    crowd.scene.name = subject.name;
    return crowd;
}

} // namespace

Table study_objects(const Subject& subject, const StudyOptions& options) {
    Table table;
    table.columns = {
        "objects", "us a receiver", "alone", "over the sum alone", "triangles a receiver", "error, clear",
        "p99"};
    Bounds2 bounds;
    for (const std::vector<glm::vec3>& positions : subject.pose.positions) {
        for (const glm::vec3& p : positions) {
            for (int k = 0; k < 2; ++k) {
                bounds.low[k] = std::min(bounds.low[k], k ? p.z : p.x);
                bounds.high[k] = std::max(bounds.high[k], k ? p.z : p.x);
            }
        }
    }
    const float spacing = 1.1f * std::max(bounds.high[0] - bounds.low[0], bounds.high[1] - bounds.low[1]);
    Engine one(subject.scene, options.engine, subject.name);
    Progress progress("study");
    std::vector<float> transfer;
    for (const uint32_t n : {1u, 2u, 4u, 8u, 16u}) {
        const Crowd crowd = make_crowd(subject, n, spacing);
        Engine all(crowd.scene, options.engine, subject.name);
        FrameStats stats;
        const std::vector<double> times = measure_in_turns(
            options.quick ? 3 : 9, {[&] {
                                        stats = all.frame(crowd.pose, options.quality, transfer);
                                        return stats.cpu_ms;
                                    },
                                    [&] {
                                        std::vector<float> own;
                                        double sum = 0;
                                        for (const scenes::Pose& pose : crowd.alone)
                                            sum += one.frame(pose, options.quality, own).cpu_ms;
                                        return sum;
                                    }});
        // Rays for evenly chosen receivers would want a list of them: all, with few rays.
        const Assembly assembly = assemble(crowd.scene, crowd.pose);
        const TraceScene traced = make_trace_scene(assembly);
        TraceOptions trace;
        trace.rays = options.quick ? 256 : 1024;
        trace.cancel = &interrupted();
        const std::vector<float> reference = trace_transfer(traced, assembly, trace).transfer;
        trace.lift = clear_lift;
        const std::vector<float> lifted = trace_transfer(traced, assembly, trace).transfer;
        throw_if_interrupted();
        const TransferError error = transfer_error(transfer, reference, clear_receivers(reference, lifted));
        const double receivers = stats.receivers_computed;
        char own[32], alone[32], ratio[32], triangles[32];
        std::snprintf(own, sizeof own, "%.2f", 1e3 * times[0] / receivers);
        std::snprintf(alone, sizeof alone, "%.2f", 1e3 * times[1] / receivers);
        std::snprintf(ratio, sizeof ratio, "%.2f x", times[0] / times[1]);
        std::snprintf(triangles, sizeof triangles, "%.0f",
                      static_cast<double>(stats.triangles_rasterized) / receivers);
        table.rows.push_back(
            {std::to_string(n), own, alone, ratio, triangles, percent(error.mean), percent(error.p99)});
        progress.show(n / 16.0);
    }
    return table;
}

} // namespace nusselt::tools
