// Glossy transfer: its cost over diffuse transfer, its error against rays, and what 25 terms leave out.
#include "tools/commands/study.h"
#include "tools/render/render.h"
#include "tools/report/stop.h"
#include "tools/trace/glossy.h"

#include <glm/geometric.hpp>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstring>

namespace nusselt::tools {

namespace {

struct Case {
    const char* name;
    Reflectance reflectance;
};

using Kind = Reflectance::Kind;
constexpr Case cases[] = {{"phong 5", {Kind::phong, 5, 0.5f, 0, 0}},
                          {"phong 20", {Kind::phong, 20, 0.5f, 0, 0}},
                          {"phong 100", {Kind::phong, 100, 0.5f, 0, 0}},
                          {"plastic, roughness 0.3", {Kind::ggx, 0, 0, 0.3f, 0}},
                          {"plastic, roughness 0.6", {Kind::ggx, 0, 0, 0.6f, 0}},
                          {"metal, roughness 0.3", {Kind::ggx, 0, 0, 0.3f, 1}},
                          {"metal, roughness 0.4", {Kind::ggx, 0, 0, 0.4f, 1}},
                          {"metal, roughness 0.6", {Kind::ggx, 0, 0, 0.6f, 1}},
                          {"metal, roughness 1", {Kind::ggx, 0, 0, 1.0f, 1}}};

// White: then one channel is the whole. Coloured otherwise.
scenes::Scene with_albedo(const scenes::Scene& scene, const glm::vec3& albedo) {
    scenes::Scene made = scene;
    for (scenes::Mesh& mesh : made.meshes)
        mesh.albedo.assign(mesh.rest_positions.size(), albedo);
    return made;
}

// Relative L2 error of 75 numbers over the receivers that reflect anything.
struct GlossyError {
    double mean = 0, p99 = 0;
};
GlossyError error_of(const StreamArray& stream, const std::vector<float>& reference,
                     const std::vector<uint32_t>& receivers) {
    std::vector<double> errors;
    for (size_t k = 0; k < receivers.size(); ++k) {
        float ours[75];
        std::memcpy(ours, stream.bytes.data() + size_t{receivers[k]} * sizeof ours, sizeof ours);
        double square = 0, size = 0;
        for (size_t i = 0; i < 75; ++i) {
            const double wanted = reference[75 * k + i];
            square += (ours[i] - wanted) * (ours[i] - wanted);
            size += wanted * wanted;
        }
        constexpr double one_percent = 0.0028209479;
        if (reference[75 * k] > one_percent) errors.push_back(std::sqrt(square / size));
    }
    GlossyError error;
    if (errors.empty()) return error;
    std::sort(errors.begin(), errors.end());
    for (const double e : errors)
        error.mean += e / static_cast<double>(errors.size());
    error.p99 = errors[errors.size() * 99 / 100];
    return error;
}

} // namespace

Study study_glossy(const Subject& subject, const StudyOptions& options) {
    Study study;
    Table& table = study.table;
    table.columns = {"material", "instead of diffuse", "coloured", "beside it", "coloured, beside", "error",
                     "p99",      "beyond 25 terms"};
    const Assembly all = assemble(subject.scene, subject.pose);
    const TraceScene traced = make_trace_scene(all);
    Framing framing = make_framing(subject.scene.view_direction, 32, 960, 720);
    for (const std::vector<glm::vec3>& positions : subject.pose.positions)
        include(framing, positions);
    const glm::vec3 eye = frame_camera(framing).eye;
    // A receiver that faces away has a view from below: not counted.
    std::vector<uint32_t> receivers;
    for (const uint32_t v : choose_receivers(all.positions.size(), options.quick ? 300 : 4000))
        if (glm::dot(eye - all.positions[v], all.normals[v]) > 0) receivers.push_back(v);
    Engine engine(subject.scene, options.engine, subject.name);
    const std::vector<float> light(75, 0.0f);
    std::vector<float> transfer;
    std::vector<StreamArray> none, glossy(1);
    glossy[0].kind = OutputKind::glossy;
    double done = 0;
    for (const Case& c : cases) {
        Reflectance reflectance = c.reflectance;
        const Palette white = make_palette(with_albedo(subject.scene, glm::vec3(1)), reflectance);
        const Palette gold = make_palette(with_albedo(subject.scene, {1, 0.77f, 0.34f}), reflectance);
        const auto cpu = [&](const Palette& palette, std::vector<StreamArray>& streams, bool alone) {
            engine.look(palette, eye, light);
            engine.make_streams_alone(alone);
            return engine.frame(subject.pose, options.quality, transfer, nullptr, &streams).cpu_ms;
        };
        // White ones last: the error is theirs.
        const std::vector<double> times = measure_in_turns(
            options.quick ? 5 : 15,
            {[&] { return cpu(white, none, false); }, [&] { return cpu(white, glossy, true); },
             [&] { return cpu(gold, glossy, true); }, [&] { return cpu(gold, glossy, false); },
             [&] { return cpu(white, glossy, false); }});
        std::vector<uint16_t> numbers;
        for (const std::vector<uint16_t>& mesh : white.material_of)
            numbers.insert(numbers.end(), mesh.begin(), mesh.end());
        GlossyOptions trace;
        trace.rays = options.quick ? 1024 : 9216;
        trace.cancel = &interrupted();
        const GlossyError error = error_of(
            glossy[0], trace_glossy(traced, all, white.materials, numbers, eye, receivers, trace), receivers);
        throw_if_interrupted();
        const auto ratio = [&](size_t way) {
            char text[32];
            std::snprintf(text, sizeof text, "%.2f x", times[way] / times[0]);
            return std::string(text);
        };
        table.rows.push_back({c.name, ratio(1), ratio(2), ratio(4), ratio(3), percent(error.mean),
                              percent(error.p99),
                              percent(static_cast<double>(lobe_beyond_bands(white.materials[0])))});
        options.progress(++done / std::size(cases));
    }
    return study;
}

} // namespace nusselt::tools
