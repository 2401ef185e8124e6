#include "tools/commands/reflection.h"

#include "tools/commands/arguments.h"
#include "tools/report/failure.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <map>

namespace nusselt::tools {

namespace {

constexpr size_t most_materials = 65536;
constexpr float too_sharp = 0.3f; // of nusselt::lobe_beyond_bands

float number(const std::string& text, double low, double high, const std::string& whole,
             const std::string& option) {
    char* end = nullptr;
    const double value = std::strtod(text.c_str(), &end);
    if (text.empty() || *end || !(value >= low && value <= high)) {
        throw Failure(
            option,
            "'" + whole + "' has '" + text +
                "' where a number is wanted: lambert, phong:EXPONENT[:SPECULAR] with 0 to 10000 and "
                "0 to 1, ggx:ROUGHNESS[:METALLIC] with 0 to 1 each, or model",
            exit_usage);
    }
    return static_cast<float>(value);
}

Material material_of(const Reflectance& r, const glm::vec3& albedo, const glm::vec2& gloss) {
    const float base[3] = {albedo.x, albedo.y, albedo.z};
    if (r.kind == Reflectance::Kind::model) return metallic_roughness(base, gloss.x, gloss.y);
    if (r.kind == Reflectance::Kind::ggx) return metallic_roughness(base, r.metallic, r.roughness);
    Material m;
    m.brdf = Brdf::phong;
    m.exponent = r.exponent;
    for (size_t c = 0; c < 3; ++c) {
        m.specular[c] = r.kind == Reflectance::Kind::phong ? r.specular * base[c] : 0.0f;
        m.diffuse[c] = base[c] - m.specular[c];
    }
    return m;
}

} // namespace

Reflectance parse_reflectance(const std::string& text, const std::string& option) {
    const std::vector<std::string> parts = split_at_colons(text);
    Reflectance r;
    const auto wanted = [&](size_t k, float fallback, double low, double high) {
        return parts.size() > k ? number(parts[k], low, high, text, option) : fallback;
    };
    if (parts[0] == "phong" && parts.size() <= 3) {
        r.kind = Reflectance::Kind::phong;
        r.exponent = static_cast<uint32_t>(std::lround(wanted(1, 20, 0, 10000)));
        r.specular = wanted(2, 0.5f, 0, 1);
    } else if (parts[0] == "ggx" && parts.size() <= 3) {
        r.kind = Reflectance::Kind::ggx;
        r.roughness = wanted(1, 0.5f, 0, 1);
        r.metallic = wanted(2, 0, 0, 1);
    } else if (text == "model") {
        r.kind = Reflectance::Kind::model;
    } else if (text != "lambert") {
        throw Failure(option,
                      "there is no '" + text +
                          "'; choose lambert, phong:EXPONENT[:SPECULAR], ggx:ROUGHNESS[:METALLIC], or model "
                          "(a glTF file's own metallic-roughness)",
                      exit_usage);
    }
    return r;
}

Palette make_palette(const scenes::Scene& scene, const Reflectance& reflectance) {
    Palette palette;
    std::map<std::array<float, 5>, uint16_t> known;
    for (const scenes::Mesh& mesh : scene.meshes) {
        std::vector<uint16_t>& numbers = palette.material_of.emplace_back();
        for (size_t v = 0; v < mesh.rest_positions.size(); ++v) {
            const glm::vec3 albedo = v < mesh.albedo.size() ? mesh.albedo[v] : glm::vec3(1);
            const glm::vec2 gloss =
                reflectance.kind == Reflectance::Kind::model && v < mesh.metallic_roughness.size()
                    ? mesh.metallic_roughness[v]
                    : glm::vec2(0, 1);
            const std::array<float, 5> key = {albedo.x, albedo.y, albedo.z, gloss.x, gloss.y};
            auto it = known.find(key);
            if (it == known.end()) {
                if (palette.materials.size() < most_materials)
                    palette.materials.push_back(material_of(reflectance, albedo, gloss));
                it = known.emplace(key, static_cast<uint16_t>(palette.materials.size() - 1)).first;
            }
            numbers.push_back(it->second);
        }
    }
    return palette;
}

std::string ringing_warning(const Palette& palette) {
    float worst = 0;
    for (const Material& m : palette.materials) {
        if (m.specular[0] > 0 || m.specular[1] > 0 || m.specular[2] > 0)
            worst = std::max(worst, lobe_beyond_bands(m));
    }
    if (worst <= too_sharp) return {};
    char text[256];
    std::snprintf(
        text, sizeof text,
        "25 terms leave out %.0f %% of the sharpest highlight: it is wider than it should be and rings "
        "under a hard light; --window hann:6 damps that",
        100 * static_cast<double>(worst));
    return text;
}

} // namespace nusselt::tools
