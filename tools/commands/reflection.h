// How the meshes of a scene reflect, as the command line says it.
#pragma once

#include "bench/scenes/scene.h"

#include <nusselt/gloss.h>

#include <cstdint>
#include <string>
#include <vector>

namespace nusselt::tools {

// lambert, phong:EXPONENT[:SPECULAR], ggx:ROUGHNESS[:METALLIC], model.
struct Reflectance {
    enum class Kind { lambert, phong, ggx, model } kind = Kind::lambert;
    uint32_t exponent = 20;
    float specular = 0.5f; // phong: its part of the albedo; the diffuse part has the rest
    float roughness = 0.5f, metallic = 0;
};

// Throws Failure (usage) with what there is.
Reflectance parse_reflectance(const std::string& text, const std::string& option);

// Each mesh's materials, and the number of each vertex's.
struct Palette {
    std::vector<Material> materials;
    std::vector<std::vector<uint16_t>> material_of;
};

// From the meshes' albedos (and gloss, for Kind::model). Beyond 65536 different materials the last stands for
// the rest.
Palette make_palette(const scenes::Scene& scene, const Reflectance& reflectance);

// A warning where 25 terms are too few for a material's lobe; empty where they do.
std::string ringing_warning(const Palette& palette);

} // namespace nusselt::tools
