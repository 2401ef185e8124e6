// S7. Radiance from transfer vectors against a sum over each mask's samples, one after the other, in double:
// under a constant light, one lobe, and the real environments of the shared data.
#include "tests/runtime/fixture.h"

#include "kernels/kernels.h"
#include "tools/image/image.h"
#include "tools/trace/sh.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>

namespace nusselt::test {

namespace {

namespace fs = std::filesystem;

const fs::path environments = fs::path(NUSSELT_SHARED_DIR) / "data/env";

using Light = std::array<float, 75>;

struct NamedLight {
    std::string name;
    Light terms;
};

std::vector<NamedLight> all_lights() {
    std::vector<NamedLight> all;
    Light constant{}, lobe{};
    for (size_t c = 0; c < 3; ++c)
        constant[c] = 3.5449077f; // radiance 1
    double basis[25];
    tools::sh_basis(0.36, 0.48, 0.8, basis);
    // As sharp as five bands show without ringing below 0.
    const double falls[5] = {1, 0.9, 0.7, 0.45, 0.2};
    for (size_t i = 0; i < 25; ++i) {
        for (size_t c = 0; c < 3; ++c)
            lobe[3 * i + c] = float(double(c + 1) * falls[size_t(std::sqrt(double(i)))] * basis[i]);
    }
    all.push_back({"constant", constant});
    all.push_back({"one lobe", lobe});
    for (const auto& entry : fs::directory_iterator(environments)) {
        const std::string extension = entry.path().extension().string();
        if (extension != ".hdr" && extension != ".exr") continue;
        const tools::Image image = tools::load_environment(entry.path().string());
        NamedLight light{entry.path().filename().string(), {}};
        EXPECT_TRUE(
            sh_project_latlong(image.rgb.data(), image.width, image.height, light.terms.data(), nullptr)
                .ok());
        all.push_back(light);
    }
    return all;
}

// What a receiver's mask leaves open of the light: the mean over all of its samples, as each stands for the
// same cosine-weighted solid angle.
std::array<double, 3> by_samples(const kernels::MaskLayout& layout, const glm::vec3& normal,
                                 const uint32_t* mask, const Light& light) {
    kernels::Batch batch{};
    alignas(64) float normals[3][kernels::lanes] = {};
    batch.valid = 1;
    for (int k = 0; k < 3; ++k)
        normals[k][0] = normal[k];
    kernels::kernels_for(kernels::Set::scalar)->prepare_batch(batch, normals);
    std::array<double, 3> sum{};
    const uint32_t bits = kernels::mask_bits(layout);
    for (uint32_t bit = 0; bit < bits; ++bit) {
        double d[3], basis[25], s[3] = {};
        if (!kernels::sample_direction(layout, bit, d) || mask[bit / 32] >> bit % 32 & 1) continue;
        for (int row = 0; row < 3; ++row) {
            for (int k = 0; k < 3; ++k)
                s[k] += d[row] * double(batch.axis[row][k][0]);
        }
        tools::sh_basis(s[0], s[1], s[2], basis);
        for (size_t i = 0; i < 25; ++i) {
            for (size_t c = 0; c < 3; ++c)
                sum[c] += double(light[3 * i + c]) * basis[i] / bits;
        }
    }
    return sum;
}

TEST(Shade, IsTheSumOverTheMasksSamplesUnderRealSkies) {
    struct Limit {
        Quality quality;
        const kernels::MaskLayout& layout;
        double mean, most; // of the light's mean radiance
    };
    if (!fs::exists(environments)) GTEST_SKIP() << "no shared data at " << environments;
    const std::vector<NamedLight> lights = all_lights();
    EXPECT_GE(lights.size(), 9u); // two made here, seven skies
    for (const Limit& limit : {Limit{Quality::standard, kernels::standard_layout, 0.006, 0.025},
                               Limit{Quality::fine, kernels::fine_layout, 0.0033, 0.0102}}) {
        Engine engine;
        const scenes::Scene scene = scenes::builtin("hand");
        const std::vector<Posed> frame = posed(scene, add_all(engine.context, scene), 0.4);
        const Outputs out = run_frame(engine.context, frame, limit.quality);
        const uint32_t words = quality_mask_bits(limit.quality) / 32;
        for (const NamedLight& light : lights) {
            double sum = 0, most = 0;
            uint32_t count = 0;
            const double mean_radiance =
                (double(light.terms[0]) + double(light.terms[1]) + double(light.terms[2])) / 3 / 3.5449077;
            auto transfer = out.meshes[0].transfer;
            std::vector<float> rgb(3 * transfer.size());
            ASSERT_TRUE(shade(engine.context, light.terms.data(), {transfer[0].data(), transfer.size(), 100},
                              {}, rgb.data())
                            .ok());
            for (size_t v = 0; v < transfer.size(); v += 29) {
                const auto exact = by_samples(limit.layout, frame[0].normals[v],
                                              out.meshes[0].masks.data() + v * words, light.terms);
                for (size_t c = 0; c < 3; ++c) {
                    const double error = std::fabs(double(rgb[3 * v + c]) - exact[c]) / mean_radiance;
                    sum += error;
                    most = std::max(most, error);
                    ++count;
                }
            }
            std::printf("    %s, %s: %u values, mean %.5f most %.4f of the mean radiance\n",
                        light.name.c_str(), quality_name(limit.quality), count, sum / count, most);
            EXPECT_LE(sum / count, limit.mean) << light.name;
            EXPECT_LE(most, limit.most) << light.name;
        }
    }
}

} // namespace

} // namespace nusselt::test
