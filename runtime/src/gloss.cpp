#include "gloss.h"

#include "jobs/float_environment.h"
#include "kernels/prepare.h"

#include <algorithm>
#include <cmath>

namespace nusselt {

namespace {

#include "kernels/sh_formulas.inl"

using namespace kernels;

constexpr double pi = 3.14159265358979323846;
constexpr uint32_t most_exponent = 10000;
constexpr float least_height = 0.01f;  // of a view above the tangent plane: half a degree
constexpr float unseen_height = -0.5f; // below this a receiver counts as hidden by its own surface

struct Double {
    double operator()(double value) const { return value; }
};

// The GGX lobe about as wide as cos^e.
float alpha_of(float exponent) {
    return std::sqrt(2 / (exponent + 2));
}

bool grey(const Material& m) {
    return m.diffuse[0] == m.diffuse[1] && m.diffuse[0] == m.diffuse[2] && m.specular[0] == m.specular[1] &&
           m.specular[0] == m.specular[2];
}

const Material& material_at(const Gloss& gloss, uint32_t vertex) {
    // A number beyond the materials has the last: the array is the caller's and may be written meanwhile.
    const uint32_t number = gloss.material_of ? gloss.material_of[vertex] : 0;
    return gloss.materials[std::min(number, gloss.material_count - 1)];
}

// Towards the viewer in the lane's tangent frame. Returns whether the receiver may be seen.
bool local_view(const Frame& frame, const Gloss& gloss, const Batch& batch, uint32_t lane, float out[3]) {
    float to[3], largest = 0;
    for (uint32_t k = 0; k < 3; ++k) {
        to[k] = gloss.distant ? gloss.eye[k]
                              : (gloss.eye[k] - frame.origin[k]) * frame.scale - batch.position[k][lane];
        largest = std::max(largest, std::fabs(to[k]));
    }
    out[0] = out[1] = 0;
    out[2] = 1;
    if (!(largest > 0 && largest <= FLT_MAX)) return true;
    // Scaled first: squares could leave the range of float.
    for (float& t : to)
        t /= largest;
    float local[3];
    for (uint32_t row = 0; row < 3; ++row)
        local[row] = batch.axis[row][0][lane] * to[0] + batch.axis[row][1][lane] * to[1] +
                     batch.axis[row][2][lane] * to[2];
    const float length = std::sqrt(local[0] * local[0] + local[1] * local[1] + local[2] * local[2]);
    const float height = std::max(local[2] / length, least_height);
    const float flat = std::sqrt(local[0] * local[0] + local[1] * local[1]);
    const float across = std::sqrt(1 - std::min(height, 1.0f) * std::min(height, 1.0f));
    out[0] = flat > 0 ? local[0] / flat * across : across;
    out[1] = flat > 0 ? local[1] / flat * across : 0.0f;
    out[2] = std::min(height, 1.0f);
    return local[2] >= unseen_height * length;
}

Reflection reflection_of(const Material& m, float sharpest) {
    Reflection r{};
    r.lobe = m.brdf == Brdf::phong ? Lobe::phong : Lobe::ggx;
    r.alpha = std::max(m.roughness * m.roughness, sharpest);
    const float most = 2 / (sharpest * sharpest) - 2;
    r.exponent = std::min(m.exponent, static_cast<uint32_t>(most));
    std::copy(m.diffuse, m.diffuse + 3, r.diffuse);
    std::copy(m.specular, m.specular + 3, r.specular);
    // The BRDF's core, by bits: as far as it varies much within a block. 26 degrees; 21 of a wide lobe, 18 of
    // a very wide one (runtime/doc/adr/0007).
    const float width = m.brdf == Brdf::phong ? alpha_of(float(r.exponent)) : r.alpha;
    r.core = width > 0.5f ? 0.95f : width > 0.2f ? 0.93f : 0.90f;
    return r;
}

// Whether a part of it doesn't depend on the view.
bool is_diffuse(const Reflection& r) {
    return r.diffuse[0] > 0 || r.diffuse[1] > 0 || r.diffuse[2] > 0;
}

// The receivers' materials and views; returns whether all are grey.
bool reflect(const Frame& frame, const Gloss& gloss, const uint32_t* receivers, uint32_t count,
             const Batch& batch, Reflection reflections[lanes]) {
    bool all_grey = true;
    const Material* before = nullptr;
    Reflection reflection{};
    for (uint32_t lane = 0; lane < lanes; ++lane) {
        const Material& material = material_at(gloss, receivers[lane < count ? lane : 0]);
        if (&material != before) reflection = reflection_of(material, frame.cells->sharpest);
        before = &material;
        reflections[lane] = reflection;
        if (!local_view(frame, gloss, batch, lane, reflections[lane].view))
            reflections[lane].lobe = Lobe::none;
        all_grey = all_grey && grey(material);
    }
    return all_grey;
}

} // namespace

bool is_from_masks(OutputKind kind, const Gloss* gloss) {
    return kind == OutputKind::glossy || kind == OutputKind::direct ||
           (kind == OutputKind::radiance && gloss);
}

Status check_gloss(const Gloss& gloss) {
    const auto bad = [](const char* text) { return Status{StatusCode::invalid_argument, text}; };
    if (!gloss.materials || gloss.material_count == 0)
        return bad("no frame started: a gloss has no materials; give at least one");
    for (const float e : gloss.eye) {
        if (!is_finite(e))
            return bad("no frame started: a gloss's eye is not finite; give a position, or a "
                       "direction with distant = 1");
    }
    const auto in_unit = [](float v) { return v >= 0 && v <= 1; };
    for (uint32_t i = 0; i < gloss.material_count; ++i) {
        const Material& m = gloss.materials[i];
        if (static_cast<uint32_t>(m.brdf) > static_cast<uint32_t>(Brdf::ggx))
            return bad("no frame started: a material has an unknown BRDF; use one of nusselt::Brdf");
        for (uint32_t c = 0; c < 3; ++c) {
            if (!in_unit(m.diffuse[c]) || !in_unit(m.specular[c]))
                return bad(
                    "no frame started: a material's diffuse or specular is outside 0 to 1, which would "
                    "reflect more light than there is; scale it down");
        }
        if (m.brdf == Brdf::ggx && !in_unit(m.roughness))
            return bad("no frame started: a material's roughness is outside 0 to 1; clamp it");
        if (m.brdf == Brdf::phong && m.exponent > most_exponent)
            return bad("no frame started: a material's exponent is above 10000; clamp it");
    }
    return {};
}

uint32_t make_glossy(const Frame& frame, const MeshSlice& slice, const uint32_t* receivers, uint32_t count,
                     const Batch& batch, Worker& worker) {
    const auto copy = [](const float from[25][lanes], float to[25][lanes]) {
        std::copy(&from[0][0], &from[0][0] + 25 * lanes, &to[0][0]);
    };
    if (!slice.in.gloss) {
        for (auto& channel : worker.glossy)
            copy(worker.turned, channel);
        return 1;
    }
    Reflection reflections[lanes];
    const bool all_grey = reflect(frame, *slice.in.gloss, receivers, count, batch, reflections);
    const uint32_t channels = all_grey ? 1 : 3;
    if (slice.masks_alone && std::any_of(reflections, reflections + lanes, is_diffuse)) {
        frame.kernels->integrate(*frame.tables, worker.masks.data(), batch.valid, frame.quality.paper, 5,
                                 worker.local, worker.tally.counters);
    } else if (slice.masks_alone) {
        std::fill_n(&worker.local[0][0], 25 * lanes, 0.0f);
    }
    frame.light_kernels->integrate_glossy(*frame.tables, *frame.cells, worker.masks.data(), batch.valid,
                                          reflections, channels, worker.local, worker.glossy);
    for (uint32_t c = 0; c < channels; ++c)
        frame.kernels->rotate(batch, 5, worker.glossy[c], worker.glossy[c]);
    for (uint32_t c = channels; c < 3; ++c)
        copy(worker.glossy[0], worker.glossy[c]);
    return channels;
}

void make_direct(const Frame& frame, const MeshSlice& slice, const uint32_t* receivers, uint32_t count,
                 const Batch& batch, const Worker& worker, float rgb[3][lanes]) {
    Reflection reflections[lanes];
    if (slice.in.gloss) reflect(frame, *slice.in.gloss, receivers, count, batch, reflections);
    frame.light_kernels->integrate_sky(*frame.tables, *frame.cells, frame.environment->map, batch,
                                       worker.masks.data(), slice.in.gloss ? reflections : nullptr, rgb);
}

Material metallic_roughness(const float base_color[3], float metallic, float roughness) {
    const jobs::FloatEnvironment environment;
    constexpr float dielectric = 0.04f;
    Material m;
    m.roughness = roughness;
    for (uint32_t c = 0; c < 3; ++c) {
        // (1 - F) of the dielectric is (1 - 0.04) (1 - (1 - v.h)^5).
        m.diffuse[c] = (1 - dielectric) * (1 - metallic) * base_color[c];
        m.specular[c] = dielectric * (1 - metallic) + base_color[c] * metallic;
    }
    return m;
}

float sharpest_roughness(uint32_t mask_bits) {
    const jobs::FloatEnvironment environment;
    return std::sqrt(sharpest_alpha(mask_bits));
}

float lobe_beyond_bands(const Material& material, uint32_t bands) {
    const jobs::FloatEnvironment environment;
    constexpr int steps = 4096;
    const double alpha = std::max(double(material.roughness) * double(material.roughness), 1e-3);
    double coefficient[5] = {}, square = 0;
    for (int i = 0; i < steps; ++i) {
        const double angle = (i + 0.5) / steps * pi / 2, z = std::cos(angle);
        double f = 0;
        if (material.brdf == Brdf::phong) {
            f = std::pow(z, double(material.exponent));
        } else {
            const double half = (1 + z) / 2; // cosine squared of the half vector with both
            const double d = half * (alpha * alpha - 1) + 1;
            f = 1 / (d * d * (z + std::sqrt(alpha * alpha + (1 - alpha * alpha) * z * z)));
        }
        double basis[25];
        sh_basis(Double(), std::sin(angle), 0.0, z, basis);
        const double value = f * z, area = std::sin(angle);
        for (uint32_t l = 0; l < 5; ++l)
            coefficient[l] += value * basis[l * (l + 1)] * area;
        square += value * value * area;
    }
    // The step and the turn about the axis: 2 pi da once for the norm, twice for squared coefficients.
    const double step = pi / 2 / steps * 2 * pi;
    double kept = 0;
    for (uint32_t l = 0; l < std::min(bands, 5u); ++l)
        kept += coefficient[l] * coefficient[l] * step;
    return static_cast<float>(std::sqrt(std::max(1 - kept / square, 0.0)));
}

} // namespace nusselt
