#include "tools/commands/crowd.h"

#include "tools/commands/study.h"

#include <glm/common.hpp>
#include <glm/vec2.hpp>

#include <algorithm>
#include <cmath>
#include <cstdio>

namespace nusselt::tools {

namespace {

std::string formatted(const char* format, double a, double b = 0) {
    char text[96];
    std::snprintf(text, sizeof text, format, a, b);
    return text;
}

} // namespace

float crowd_spacing(const scenes::Pose& pose) {
    glm::vec2 low(INFINITY), high(-INFINITY);
    for (const std::vector<glm::vec3>& positions : pose.positions) {
        for (const glm::vec3& p : positions) {
            low = glm::min(low, glm::vec2(p.x, p.z));
            high = glm::max(high, glm::vec2(p.x, p.z));
        }
    }
    return 1.1f * std::max(high.x - low.x, high.y - low.y);
}

Crowd make_crowd(const scenes::Scene& scene, uint32_t objects, float spacing) {
    Crowd crowd;
    const auto across = static_cast<uint32_t>(std::ceil(std::sqrt(static_cast<double>(objects))));
    for (uint32_t k = 0; k < objects; ++k) {
        scenes::Pose& pose = crowd.alone.emplace_back();
        scene.pose(scene.duration * ((k * 7) % 16 + 0.5) / 16, pose);
        const glm::vec3 shift(spacing * static_cast<float>(k % across), 0,
                              spacing * static_cast<float>(k / across));
        for (std::vector<glm::vec3>& positions : pose.positions)
            for (glm::vec3& p : positions)
                p += shift;
        for (const scenes::Mesh& mesh : scene.meshes) {
            crowd.scene.meshes.push_back(mesh);
            crowd.object_of.push_back(k);
        }
        crowd.pose.positions.insert(crowd.pose.positions.end(), pose.positions.begin(), pose.positions.end());
        crowd.pose.normals.insert(crowd.pose.normals.end(), pose.normals.begin(), pose.normals.end());
    }
    crowd.scene.name = scene.name;
    return crowd;
}

CrowdFrames run_crowd(const Crowd& crowd, Engine& all, Engine& one, Quality quality, uint32_t rounds) {
    CrowdFrames frames;
    const auto ungrouped = [&] {
        all.group(std::vector<uint32_t>(crowd.object_of.size(), 0));
        return all.frame(crowd.pose, quality, frames.together).cpu_ms;
    };
    const auto as_objects = [&] {
        all.group(crowd.object_of);
        frames.stats = all.frame(crowd.pose, quality, frames.grouped);
        return frames.stats.cpu_ms;
    };
    const auto one_by_one = [&] {
        std::vector<float> own;
        double sum = 0;
        frames.alone.clear();
        for (const scenes::Pose& pose : crowd.alone) {
            sum += one.frame(pose, quality, own).cpu_ms;
            frames.alone.insert(frames.alone.end(), own.begin(), own.end());
        }
        return sum;
    };
    const std::vector<double> times = measure_in_turns(rounds, {as_objects, ungrouped, one_by_one});
    frames.grouped_ms = times[0];
    frames.together_ms = times[1];
    frames.alone_ms = times[2];
    return frames;
}

std::string plot_crowd(const std::vector<CrowdCost>& costs) {
    constexpr double left = 46, right = 430, top = 24, bottom = 220;
    double highest = 0;
    for (const CrowdCost& c : costs)
        highest = std::max({highest, c.grouped, c.together, c.alone});
    double step = 1;
    while (highest / step > 6)
        step *= step == 2 ? 2.5 : 2; // 1, 2, 5, 10, ...
    const double most = std::max(highest, step);
    const double doublings = costs.empty() ? 1 : std::max(std::log2(costs.back().objects), 1.0);
    const auto x = [&](const CrowdCost& c) {
        return left + (right - left) * std::log2(c.objects) / doublings;
    };
    const auto y = [&](double us) { return bottom - (bottom - top) * us / most; };

    std::string svg = "<svg width=\"520\" height=\"260\" viewBox=\"0 0 520 260\" font-family=\"sans-serif\" "
                      "font-size=\"11\"><rect width=\"520\" height=\"260\" fill=\"#fff\"/>"
                      "<text x=\"8\" y=\"14\">\xC2\xB5s a receiver</text>";
    for (double level = 0; level <= most; level += step) {
        svg += formatted("<path d=\"M46 %.1fH430\" stroke=\"#ddd\"/>", y(level));
        svg += formatted("<text x=\"38\" y=\"%.1f\" text-anchor=\"end\">", y(level) + 4) +
               formatted("%.0f</text>", level);
    }
    for (const CrowdCost& c : costs)
        svg += formatted("<text x=\"%.1f\" y=\"236\" text-anchor=\"middle\">", x(c)) +
               std::to_string(c.objects) + "</text>";
    svg += "<text x=\"238\" y=\"254\" text-anchor=\"middle\">objects</text>";
    const auto line = [&](double CrowdCost::*value, const char* color, const char* name, double least_label) {
        std::string points, dots;
        for (const CrowdCost& c : costs) {
            points += formatted("%.1f,%.1f ", x(c), y(c.*value));
            dots += formatted("<circle cx=\"%.1f\" cy=\"%.1f\" r=\"3\" fill=\"", x(c), y(c.*value)) + color +
                    "\"/>";
        }
        svg += std::string("<polyline fill=\"none\" stroke=\"") + color + "\" stroke-width=\"2\" points=\"" +
               points + "\"/>" + dots;
        if (costs.empty()) return;
        svg += formatted("<text x=\"438\" y=\"%.1f\" fill=\"",
                         std::min(y(costs.back().*value) + 4, least_label)) +
               color + "\">" + name + "</text>";
    };
    line(&CrowdCost::together, "#b33", "as one object", bottom - 28);
    line(&CrowdCost::grouped, "#26a", "as objects", bottom - 14);
    line(&CrowdCost::alone, "#777", "each alone", bottom);
    return svg + "</svg>\n";
}

} // namespace nusselt::tools
