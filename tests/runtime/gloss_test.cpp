// Glossy transfer and radiance through whole frames: closed forms, quadrature, bad input.
#include "tests/runtime/fixture.h"

#include <algorithm>
#include <cmath>

#include <glm/geometric.hpp>

namespace nusselt::test {

namespace {

using Stream = nusselt::Output;
using Vector75 = std::array<float, 75>;

constexpr double pi = 3.14159265358979323846;
constexpr double y00 = 0.28209479177387814, y10 = 0.4886025119029199;

struct Result {
    Status status;
    std::vector<Vector75> glossy;
    std::vector<glm::vec3> radiance;
};

// The first mesh receives, all block.
Result run(Context* context, const std::vector<Posed>& meshes, const Gloss* gloss,
           const float* light = nullptr, Quality quality = Quality::standard, float* transfer = nullptr) {
    const size_t count = meshes[0].positions.size();
    Result r;
    r.glossy.resize(count);
    r.radiance.resize(count);
    std::vector<Stream> streams;
    Stream s;
    s.count = count;
    if (gloss) {
        s.kind = OutputKind::glossy;
        s.data = r.glossy.data();
        streams.push_back(s);
    }
    if (light) {
        s.kind = OutputKind::radiance;
        s.data = r.radiance.data();
        streams.push_back(s);
    }
    std::vector<FrameMesh> frame = frame_of(meshes);
    frame[0].outputs = streams.data();
    frame[0].output_count = uint32_t(streams.size());
    frame[0].gloss = gloss;
    if (transfer) frame[0].transfer = {transfer, count, 100};
    FrameDesc desc;
    desc.meshes = frame.data();
    desc.mesh_count = uint32_t(frame.size());
    desc.quality = quality;
    desc.light = light;
    FrameId id;
    r.status = submit(context, desc, &id);
    if (r.status.ok()) r.status = wait(context, id, nullptr);
    return r;
}

Material phong(uint32_t exponent, float diffuse, float specular) {
    Material m;
    m.brdf = Brdf::phong;
    m.exponent = exponent;
    std::fill_n(m.diffuse, 3, diffuse);
    std::fill_n(m.specular, 3, specular);
    return m;
}

Gloss seen_from(const glm::vec3& eye, const Material& material) {
    Gloss g;
    g.eye[0] = eye.x;
    g.eye[1] = eye.y;
    g.eye[2] = eye.z;
    g.materials = &material;
    g.material_count = 1;
    return g;
}

TEST(Gloss, OpenPhongSeenHeadOn) {
    Engine engine;
    const scenes::Mesh mesh = points({{0.3f, 0.2f, 1}}, {{0, 0, 1}});
    const Posed posed = at_rest(add(engine.context, mesh), mesh);
    for (const Quality quality : {Quality::standard, Quality::fine}) {
        for (const uint32_t e : {0u, 1u, 5u, 20u, 100u}) {
            const Material material = phong(e, 0.3f, 0.5f);
            const Gloss gloss = seen_from({0.3f, 0.2f, 9}, material);
            const Result r = run(engine.context, {posed}, &gloss, nullptr, quality);
            ASSERT_TRUE(r.status.ok()) << r.status.text;
            // 2 pi (e + 2) / (2 pi) times the integrals of z^(e + 1) and z^(e + 2).
            EXPECT_NEAR(r.glossy[0][0], y00 * 0.8, 0.008) << e;
            EXPECT_NEAR(r.glossy[0][2], y10 * (0.3 * 2 / 3 + 0.5 * (e + 2.0) / (e + 3.0)), 0.014) << e;
            EXPECT_NEAR(r.glossy[0][1], 0, 1e-3) << e;
            EXPECT_EQ(r.glossy[0][25], r.glossy[0][0]);
        }
    }
}

// Relative L2 difference from quadrature with the formulas of glTF 2.0, appendix B, written out anew.
double ggx_error(const Vector75& ours, const Material& m, const glm::dvec3& v, uint32_t channel) {
    constexpr int steps = 400;
    const double a2 = std::pow(double(m.roughness), 4);
    double exact[25] = {};
    for (int i = 0; i < steps; ++i) {
        for (int k = 0; k < 2 * steps; ++k) {
            const double z = std::sqrt((i + 0.5) / steps), p = 2 * pi * (k + 0.5) / (2 * steps),
                         s = std::sqrt(1 - z * z);
            const glm::dvec3 l(s * std::cos(p), s * std::sin(p), z), h = glm::normalize(l + v);
            const double k5 = std::pow(1 - glm::dot(v, h), 5);
            const double d = a2 / (pi * std::pow(h.z * h.z * (a2 - 1) + 1, 2));
            const double g = 1 / (l.z + std::sqrt(a2 + (1 - a2) * l.z * l.z)) /
                             (v.z + std::sqrt(a2 + (1 - a2) * v.z * v.z));
            const double f0 = double(m.specular[channel]);
            const double f = double(m.diffuse[channel]) / pi * (1 - k5) + (f0 + (1 - f0) * k5) * d * g;
            float basis[25];
            sh_evaluate(float(l.x), float(l.y), float(l.z), basis);
            for (int t = 0; t < 25; ++t)
                exact[t] += f * double(basis[t]) * pi / (2.0 * steps * steps);
        }
    }
    double square = 0, size = 0;
    for (uint32_t t = 0; t < 25; ++t) {
        square += std::pow(double(ours[25 * channel + t]) - exact[t], 2);
        size += exact[t] * exact[t];
    }
    return std::sqrt(square / size);
}

TEST(Gloss, OpenGgxIsGltfs) {
    Engine engine;
    const scenes::Mesh mesh = points({{0, 0, 0}}, {{0, 0, 1}});
    const Posed posed = at_rest(add(engine.context, mesh), mesh);
    const float base[3] = {0.9f, 0.5f, 0.1f};
    for (const float metallic : {0.0f, 0.4f, 1.0f}) {
        for (const float roughness : {0.3f, 0.5f, 0.8f, 1.0f}) {
            const Material m = metallic_roughness(base, metallic, roughness);
            for (const double tilt : {0.0, 0.7, 1.2}) {
                const glm::dvec3 v(std::sin(tilt) * 0.6, -std::sin(tilt) * 0.8, std::cos(tilt));
                Gloss gloss = seen_from(glm::vec3(v * 3.0), m);
                gloss.distant = 1;
                const Result r = run(engine.context, {posed}, &gloss);
                ASSERT_TRUE(r.status.ok()) << r.status.text;
                for (uint32_t c = 0; c < 3; ++c)
                    EXPECT_LE(ggx_error(r.glossy[0], m, v, c), metallic > 0 ? 0.08 : 0.035)
                        << metallic << " " << roughness << " " << tilt;
            }
        }
    }
}

TEST(Gloss, AWallInTheMirrorsDirectionHidesTheLobe) {
    Engine engine;
    const scenes::Mesh receiver = points({{0, 0, 0}}, {{0, 0, 1}});
    const scenes::Mesh wall = wall_beside();
    const std::vector<Posed> meshes = {at_rest(add(engine.context, receiver), receiver),
                                       at_rest(add(engine.context, wall), wall)};
    const Material material = phong(100, 0, 1);
    Gloss gloss = seen_from({-1, 0, 1}, material);
    EXPECT_NEAR(run(engine.context, meshes, &gloss).glossy[0][0], 0, 1e-4); // mirrored into the wall
    gloss.eye[0] = 1;
    EXPECT_NEAR(run(engine.context, meshes, &gloss).glossy[0][0], y00 * std::sqrt(0.5), 0.01);
    gloss.eye[0] = 0;
    EXPECT_NEAR(run(engine.context, meshes, &gloss).glossy[0][0], y00 / 2, 0.02);
}

TEST(Gloss, RadianceIsTheDotProduct) {
    Engine engine;
    const scenes::Scene scene = scenes::builtin("fight");
    const std::vector<Posed> meshes = posed(scene, add_all(engine.context, scene), 0.4);
    const Outputs plain = run_frame(engine.context, meshes);
    float light[75];
    Random random(5);
    for (float& c : light)
        c = random.between(-0.2f, 1);
    const float gold[3] = {1, 0.77f, 0.34f};
    const Material material = metallic_roughness(gold, 0.8f, 0.4f);
    const Gloss gloss = seen_from({3, 2, 5}, material);
    const Result r = run(engine.context, meshes, &gloss, light);
    ASSERT_TRUE(r.status.ok()) << r.status.text;
    const Result lambert = run(engine.context, meshes, nullptr, light);
    std::vector<float> shaded(3 * r.radiance.size());
    std::vector<std::array<float, 25>> transfer = plain.meshes[0].transfer;
    ASSERT_TRUE(
        shade(engine.context, light, {transfer[0].data(), transfer.size(), 100}, {}, shaded.data()).ok());
    for (size_t v = 0; v < r.radiance.size(); ++v) {
        for (int c = 0; c < 3; ++c) {
            float sum = 0;
            for (int t = 0; t < 25; ++t)
                sum += light[3 * t + c] * r.glossy[v][size_t(25 * c + t)];
            ASSERT_EQ(r.radiance[v][c], sum);
            ASSERT_EQ(lambert.radiance[v][c], shaded[3 * v + size_t(c)]);
        }
    }
}

// Alone, white surfaces' transfer vectors are made only as far as a material has use for them.
TEST(Gloss, AloneAsBesideTransferVectors) {
    Engine engine;
    const scenes::Scene scene = scenes::builtin("chess");
    const std::vector<Posed> meshes = posed(scene, add_all(engine.context, scene), 0.4);
    const size_t count = meshes[0].positions.size();
    float light[75];
    Random random(7);
    for (float& c : light)
        c = random.between(-0.2f, 1);
    const float gold[3] = {1, 0.77f, 0.34f}, grey[3] = {0.6f, 0.6f, 0.6f};
    const Material metal[2] = {metallic_roughness(gold, 1, 0.4f), metallic_roughness(grey, 1, 0.6f)};
    const Material mixed[2] = {metallic_roughness(gold, 1, 0.3f), metallic_roughness(gold, 0, 0.5f)};
    const Material plain[2] = {metallic_roughness(grey, 0, 0.5f), phong(30, 0.5f, 0.5f)};
    std::vector<uint16_t> numbers(count); // of some batches one, of others both
    for (size_t v = 0; v < count; ++v)
        numbers[v] = uint16_t(v / 40 % 2);
    for (const Material* materials : {metal, mixed, plain}) {
        Gloss gloss = seen_from({0, 5, 5}, materials[0]);
        gloss.material_count = 2;
        gloss.material_of = numbers.data();
        std::vector<float> transfer(25 * count);
        const Result alone = run(engine.context, meshes, &gloss, light);
        const Result beside = run(engine.context, meshes, &gloss, light, Quality::standard, transfer.data());
        ASSERT_TRUE(alone.status.ok() && beside.status.ok());
        EXPECT_EQ(alone.glossy, beside.glossy);
        EXPECT_EQ(alone.radiance, beside.radiance);
        EXPECT_GT(alone.glossy[0][0], 0);
    }
}

TEST(Gloss, SameBitsOnEveryInstructionSet) {
    const scenes::Scene scene = scenes::builtin("chess");
    const float gold[3] = {1, 0.77f, 0.34f};
    const Material materials[2] = {metallic_roughness(gold, 1, 0.3f), phong(30, 0.5f, 0.5f)};
    std::vector<Vector75> first;
    for (const Isa isa : available_isas()) {
        Engine engine(with_isa(isa));
        const std::vector<Posed> meshes = posed(scene, add_all(engine.context, scene), 0.4);
        std::vector<uint16_t> numbers(meshes[0].positions.size());
        for (size_t v = 0; v < numbers.size(); ++v)
            numbers[v] = uint16_t(v / 3 % 2);
        Gloss gloss = seen_from({0, 5, 5}, materials[0]);
        gloss.material_count = 2;
        gloss.material_of = numbers.data();
        const Result r = run(engine.context, meshes, &gloss);
        ASSERT_TRUE(r.status.ok()) << r.status.text;
        if (first.empty()) first = r.glossy;
        EXPECT_EQ(r.glossy, first) << isa_name(isa);
    }
}

// A vertex that repeats another one in all but its material has a result of its own.
TEST(Gloss, RepeatedVerticesOfOtherMaterials) {
    Engine engine;
    const scenes::Mesh mesh = points({{0, 0, 0}, {0, 0, 0}, {0, 0, 0}}, {{0, 0, 1}, {0, 0, 1}, {0, 0, 1}});
    const Posed posed = at_rest(add(engine.context, mesh), mesh);
    const Material materials[2] = {phong(10, 0.2f, 0.2f), phong(10, 0.6f, 0.3f)};
    const uint16_t numbers[3] = {0, 1, 9}; // beyond the materials: the last
    Gloss gloss = seen_from({1, 1, 1}, materials[0]);
    gloss.material_count = 2;
    gloss.material_of = numbers;
    const Result r = run(engine.context, {posed}, &gloss);
    ASSERT_TRUE(r.status.ok()) << r.status.text;
    EXPECT_NEAR(r.glossy[0][0], y00 * 0.4, 0.04);
    EXPECT_NEAR(r.glossy[1][0], y00 * 0.9, 0.06);
    EXPECT_EQ(r.glossy[2], r.glossy[1]);
}

TEST(Gloss, ViewsThatAreNone) {
    Engine engine;
    const scenes::Mesh mesh = points({{0.5f, 0.25f, 2}}, {{0, 0, 1}});
    const Posed posed = at_rest(add(engine.context, mesh), mesh);
    const float grey[3] = {0.5f, 0.5f, 0.5f};
    for (const Material& m : {metallic_roughness(grey, 1, 0.4f), phong(20, 0.1f, 0.9f)}) {
        Gloss gloss = seen_from({0.5f, 0.25f, 2}, m); // at the receiver
        const Result at = run(engine.context, {posed}, &gloss);
        gloss.eye[2] = 7;
        EXPECT_EQ(at.glossy, run(engine.context, {posed}, &gloss).glossy); // as along the normal
        gloss.distant = 1;
        std::fill_n(gloss.eye, 3, 0.0f);
        EXPECT_EQ(at.glossy, run(engine.context, {posed}, &gloss).glossy);
        gloss.distant = 0;
        for (const glm::vec3& below :
             {glm::vec3(0.5f, 0.25f, -3), glm::vec3(9, 1, 0), glm::vec3(1e30f, 0, -1e30f)}) {
            const Gloss from_below = seen_from(below, m);
            const Result r = run(engine.context, {posed}, &from_below);
            ASSERT_TRUE(r.status.ok());
            for (const float t : r.glossy[0]) {
                ASSERT_TRUE(std::isfinite(t));
                ASSERT_LE(std::fabs(t), 3.0f);
            }
        }
    }
}

// Further than 30 degrees below the horizon nobody sees the lobe; nearer it may show at a silhouette.
TEST(Gloss, ReceiversThatFaceAwayKeepTheirDiffusePart) {
    Engine engine;
    const glm::vec3 place(0.3f, 0.2f, 1);
    const scenes::Mesh mesh = points({place}, {{0, 0, 1}});
    const Posed posed = at_rest(add(engine.context, mesh), mesh);
    const Material shiny = phong(5, 0.5f, 0.5f), matte = phong(5, 0.5f, 0);
    const auto from_below = [&](float degrees, const Material& material) {
        const float angle = degrees * float(pi) / 180;
        const Gloss gloss =
            seen_from(place + 4.0f * glm::vec3(std::cos(angle), 0, -std::sin(angle)), material);
        return run(engine.context, {posed}, &gloss).glossy[0];
    };
    EXPECT_EQ(from_below(32, shiny), from_below(32, matte));
    EXPECT_GT(from_below(28, shiny)[0], from_below(28, matte)[0] + 0.01f);
    EXPECT_NEAR(from_below(28, shiny)[0], from_below(1, shiny)[0], 1e-5f) << "as grazing";
}

TEST(Gloss, RefusedAndClamped) {
    Engine engine;
    const scenes::Mesh mesh = points({{0, 0, 0}}, {{0, 0, 1}});
    const Posed posed = at_rest(add(engine.context, mesh), mesh);
    const float grey[3] = {0.5f, 0.5f, 0.5f};
    const auto code = [&](const Material& m) {
        const Gloss g = seen_from({0, 1, 1}, m);
        return run(engine.context, {posed}, &g).status.code;
    };
    const Material good = metallic_roughness(grey, 0.5f, 0.5f);
    EXPECT_EQ(code(good), StatusCode::ok);
    for (const float bad : {-0.1f, 1.01f, std::nanf(""), INFINITY}) {
        Material m = good;
        m.specular[1] = bad;
        EXPECT_EQ(code(m), StatusCode::invalid_argument) << bad;
        m = good;
        m.diffuse[2] = bad;
        EXPECT_EQ(code(m), StatusCode::invalid_argument) << bad;
        m = good;
        m.roughness = bad;
        EXPECT_EQ(code(m), StatusCode::invalid_argument) << bad;
    }
    EXPECT_EQ(code(phong(10001, 0.5f, 0.5f)), StatusCode::invalid_argument);
    Material unknown = good;
    unknown.brdf = Brdf(7);
    EXPECT_EQ(code(unknown), StatusCode::invalid_argument);
    Gloss g = seen_from({0, 1, std::nanf("")}, good);
    EXPECT_EQ(run(engine.context, {posed}, &g).status.code, StatusCode::invalid_argument);
    g = seen_from({0, 1, 1}, good);
    g.materials = nullptr;
    EXPECT_EQ(run(engine.context, {posed}, &g).status.code, StatusCode::invalid_argument);
    g.materials = &good;
    g.material_count = 0;
    EXPECT_EQ(run(engine.context, {posed}, &g).status.code, StatusCode::invalid_argument);

    // Roughness 0 counts as the sharpest that the cells carry.
    Material mirror = metallic_roughness(grey, 1, 0);
    Gloss sharp = seen_from({0, 1, 1}, mirror);
    const Result at_zero = run(engine.context, {posed}, &sharp);
    mirror.roughness = sharpest_roughness(1024);
    EXPECT_EQ(at_zero.glossy, run(engine.context, {posed}, &sharp).glossy);

    // Streams without what they need.
    Vector75 memory;
    Stream s;
    s.count = 1;
    s.data = memory.data();
    FrameMesh m;
    m.mesh = posed.mesh;
    m.positions = view(posed.positions);
    m.normals = view(posed.normals);
    m.outputs = &s;
    m.output_count = 1;
    FrameDesc desc;
    desc.meshes = &m;
    desc.mesh_count = 1;
    FrameId id;
    s.kind = OutputKind::glossy;
    EXPECT_EQ(submit(engine.context, desc, &id).code, StatusCode::invalid_argument); // no gloss
    s.kind = OutputKind::radiance;
    EXPECT_EQ(submit(engine.context, desc, &id).code, StatusCode::invalid_argument); // no light
    const float light[75] = {};
    desc.light = light;
    s.format = OutputFormat::packed8;
    EXPECT_EQ(submit(engine.context, desc, &id).code, StatusCode::invalid_argument); // no range
}

TEST(Gloss, WhatBandsLeaveOut) {
    // cos^(e + 1) about the normal has closed coefficients; e = 0 is the clamped cosine: band 3 is empty.
    EXPECT_NEAR(lobe_beyond_bands(phong(0, 0, 1), 3), lobe_beyond_bands(phong(0, 0, 1), 4), 1e-3);
    float last = 0;
    for (const uint32_t e : {2u, 10u, 50u, 500u}) {
        const float beyond = lobe_beyond_bands(phong(e, 0, 1));
        EXPECT_GT(beyond, last) << e;
        last = beyond;
    }
    EXPECT_LT(lobe_beyond_bands(phong(0, 0, 1)), 0.05f);
    EXPECT_GT(last, 0.8f);
    const float grey[3] = {0.5f, 0.5f, 0.5f};
    EXPECT_GT(lobe_beyond_bands(metallic_roughness(grey, 1, 0.3f)),
              lobe_beyond_bands(metallic_roughness(grey, 1, 0.6f)));
}

} // namespace

} // namespace nusselt::test
