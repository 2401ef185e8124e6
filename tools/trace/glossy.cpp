#include "tools/trace/glossy.h"

#include "tools/trace/parallel.h"
#include "tools/trace/sh.h"

#include <glm/geometric.hpp>
#include <glm/mat3x3.hpp>

#include <cmath>
#include <mutex>
#include <numbers>

namespace nusselt::tools {

namespace {

constexpr double pi = std::numbers::pi;

glm::dvec3 concentric(double u, double v) { // Shirley and Chiu 1997, to the hemisphere about z
    double radius = 0, angle = 0;
    if (std::abs(u) > std::abs(v)) {
        radius = u;
        angle = pi / 4 * (v / u);
    } else if (v != 0) {
        radius = v;
        angle = pi / 2 - pi / 4 * (u / v);
    }
    const double x = radius * std::cos(angle), y = radius * std::sin(angle);
    return {x, y, std::sqrt(std::max(1 - x * x - y * y, 0.0))};
}

glm::dmat3 frame_about(const glm::dvec3& n) { // columns: tangent, bitangent, normal
    const glm::dvec3 other = std::abs(n.x) < 0.6 ? glm::dvec3(1, 0, 0) : glm::dvec3(0, 1, 0);
    const glm::dvec3 t = glm::normalize(glm::cross(other, n));
    return {t, glm::cross(n, t), n};
}

// As nusselt/gloss.h says of views that are zero or from below.
glm::dvec3 view_in(const glm::dmat3& frame, const glm::dvec3& towards) {
    const double length = glm::length(towards);
    if (!(length > 0) || !std::isfinite(length)) return {0, 0, 1};
    glm::dvec3 v = glm::transpose(frame) * (towards / length);
    const double height = std::max(v.z, 0.01), flat = std::hypot(v.x, v.y),
                 across = std::sqrt(1 - height * height);
    return flat > 0 ? glm::dvec3(v.x / flat * across, v.y / flat * across, height)
                    : glm::dvec3(across, 0, height);
}

} // namespace

void brdf(const Material& material, const glm::dvec3& s, const glm::dvec3& v, double out[3]) {
    if (material.brdf == Brdf::phong) {
        const double e = material.exponent, cosine = std::max(v.z * s.z - v.x * s.x - v.y * s.y, 0.0);
        for (int c = 0; c < 3; ++c) {
            out[c] = double{material.diffuse[c]} / pi +
                     double{material.specular[c]} * (e + 2) / (2 * pi) * std::pow(cosine, e);
        }
        return;
    }
    // glTF 2.0, appendix B.3.
    const double alpha = double{material.roughness} * double{material.roughness}, square = alpha * alpha;
    const glm::dvec3 h = glm::normalize(s + v);
    const double edge = std::pow(1 - glm::dot(v, h), 5);
    const double denominator = h.z * h.z * (square - 1) + 1;
    const double d = square / (pi * denominator * denominator);
    const auto side = [&](double cosine) {
        return cosine + std::sqrt(square + (1 - square) * cosine * cosine);
    };
    for (int c = 0; c < 3; ++c) {
        const double fresnel = double{material.specular[c]} + (1 - double{material.specular[c]}) * edge;
        out[c] = double{material.diffuse[c]} / pi * (1 - edge) + fresnel * d / (side(s.z) * side(v.z));
    }
}

std::vector<float> trace_glossy(const TraceScene& scene, const Assembly& all,
                                const std::vector<Material>& materials,
                                const std::vector<uint16_t>& material_of, const glm::vec3& eye,
                                const std::vector<uint32_t>& only, const GlossyOptions& options) {
    const size_t count = only.empty() ? all.positions.size() : only.size();
    std::vector<float> result(count * 75);
    const auto side = static_cast<uint32_t>(std::ceil(std::sqrt(static_cast<double>(options.rays))));
    std::vector<glm::dvec3> local;
    for (uint32_t k = 0; k < side * side; ++k)
        local.push_back(concentric((k % side + 0.5) * 2 / side - 1, (k / side + 0.5) * 2 / side - 1));
    std::mutex telling;
    size_t done = 0;
    parallel_blocks(count, 64, [&](size_t begin, size_t end) {
        std::vector<glm::dvec3> directions(local.size());
        std::vector<uint8_t> blocked;
        for (size_t k = begin; k < end; ++k) {
            if (options.cancel && *options.cancel) return;
            const auto vertex = static_cast<uint32_t>(only.empty() ? k : only[k]);
            const glm::dvec3 normal(all.normals[vertex]);
            const double length = glm::length(normal);
            if (!(length > 0) || !std::isfinite(length)) continue;
            const glm::dmat3 frame = frame_about(normal / length);
            for (size_t i = 0; i < local.size(); ++i)
                directions[i] = frame * local[i];
            if (options.shadows) {
                if (!trace_blocked(scene, all, vertex, directions, blocked)) continue;
            } else {
                blocked.assign(local.size(), 0);
            }
            const Material& material = materials[material_of[vertex]];
            const glm::dvec3 view = view_in(frame, glm::dvec3(eye) - glm::dvec3(all.positions[vertex]));
            double sum[75] = {};
            for (size_t i = 0; i < local.size(); ++i) {
                if (blocked[i]) continue;
                double f[3], basis[25];
                brdf(material, local[i], view, f);
                sh_basis(directions[i].x, directions[i].y, directions[i].z, basis);
                for (int c = 0; c < 3; ++c) {
                    for (int term = 0; term < 25; ++term)
                        sum[25 * c + term] += f[c] * basis[term];
                }
            }
            // Rays are distributed as the cosine over pi.
            for (size_t i = 0; i < 75; ++i)
                result[75 * k + i] = static_cast<float>(sum[i] * pi / static_cast<double>(local.size()));
        }
        const std::lock_guard lock(telling);
        done += end - begin;
        if (options.progress) options.progress(static_cast<double>(done) / static_cast<double>(count));
    });
    return result;
}

} // namespace nusselt::tools
