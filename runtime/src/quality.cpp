#include "quality.h"

#include <cstring>

namespace nusselt {

namespace {

constexpr QualitySettings settings[quality_count] = {
    {"paper", kernels::paper_layout, 0, 0, 0, 0, 0, true, true},
    {"draft", kernels::draft_layout, 0.14f, 0.2f, 0.04f, 1, 3, false, true},
    {"standard", kernels::standard_layout, 0.06f, 0.1f, 0.03f, 1, 3, false, true},
    {"fine", kernels::fine_layout, 0.04f, 0.05f, 0.015f, 1, 3, false, true},
};

} // namespace

const QualitySettings* quality_settings(Quality quality) {
    const uint32_t index = static_cast<uint32_t>(quality);
    return index < quality_count ? &settings[index] : nullptr;
}

const char* quality_name(Quality quality) {
    const QualitySettings* q = quality_settings(quality);
    return q ? q->name : "unknown";
}

bool quality_from_name(const char* name, Quality* out) {
    if (!name || !out) return false;
    for (uint32_t i = 0; i < quality_count; ++i) {
        if (std::strcmp(name, settings[i].name) == 0) {
            *out = static_cast<Quality>(i);
            return true;
        }
    }
    return false;
}

uint32_t quality_mask_bits(Quality quality) {
    const QualitySettings* q = quality_settings(quality);
    return q ? kernels::mask_bits(q->layout) : 0;
}

} // namespace nusselt
