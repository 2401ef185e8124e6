// The ray-traced reference of glossy transfer, by definition and in double.
#pragma once

#include "tools/trace/trace.h"

#include <nusselt/gloss.h>

#include <atomic>
#include <cstdint>
#include <functional>
#include <vector>

namespace nusselt::tools {

// The BRDF of nusselt/gloss.h for unit vectors in the tangent frame, s and v above it, by its textbook
// formulas. Roughness and exponent as they are, without the library's limits.
void brdf(const Material& material, const glm::dvec3& s, const glm::dvec3& v, double out[3]);

struct GlossyOptions {
    uint32_t rays =
        1024; // a receiver, one in the middle of each cell of a square grid; rounded up to a square
    bool shadows = true;
    const std::atomic<bool>* cancel = nullptr;
    std::function<void(double)> progress = nullptr; // from one thread at a time, in [0, 1]
};

// Glossy transfer vectors of the vertices `only` (empty: all): 75 numbers each, [channel][term], for a viewer
// at `eye`, with the library's rules for views that are zero or from below. `materials` by number,
// `material_of` a number a vertex.
std::vector<float> trace_glossy(const TraceScene& scene, const Assembly& all,
                                const std::vector<Material>& materials,
                                const std::vector<uint16_t>& material_of, const glm::vec3& eye,
                                const std::vector<uint32_t>& only, const GlossyOptions& options);

} // namespace nusselt::tools
