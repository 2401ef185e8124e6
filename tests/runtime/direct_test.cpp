// Direct integration of an environment through whole frames: constant skies, suns, walls, bad input.
#include "tests/runtime/fixture.h"

#include <algorithm>
#include <cmath>

#include <glm/geometric.hpp>

namespace nusselt::test {

namespace {

using Stream = nusselt::Output;

constexpr double pi = 3.14159265358979323846;
constexpr uint32_t width = 512, height = 256;

struct Sky {
    Context* context;
    Environment* environment = nullptr;

    Sky(Context* c, const std::vector<float>& rgb, uint32_t bits = 1024) : context(c) {
        EnvironmentDesc desc;
        desc.rgb = rgb.data();
        desc.width = width;
        desc.height = height;
        desc.mask_bits = bits;
        const Status status = create_environment(c, desc, &environment);
        EXPECT_TRUE(status.ok()) << status.text;
    }
    ~Sky() { destroy_environment(context, environment); }
    Sky(const Sky&) = delete;
    Sky& operator=(const Sky&) = delete;
};

std::vector<float> constant_sky(float r, float g, float b) {
    std::vector<float> rgb;
    for (uint32_t k = 0; k < width * height; ++k)
        rgb.insert(rgb.end(), {r, g, b});
    return rgb;
}

// A disc of `degrees` across whose irradiance on a surface that faces it is pi: radiance 1 off white.
std::vector<float> sun(const glm::vec3& towards, double degrees) {
    std::vector<float> rgb(size_t(3) * width * height);
    double area = 0;
    std::vector<size_t> pixels;
    for (uint32_t k = 0; k < width * height; ++k) {
        const double a = 2 * pi * ((k % width + 0.5) / width - 0.5), p = pi * (k / width + 0.5) / height;
        const glm::dvec3 d(std::sin(p) * std::cos(a), std::cos(p), std::sin(p) * std::sin(a));
        if (glm::dot(d, glm::dvec3(towards)) < std::cos(degrees / 2 * pi / 180)) continue;
        pixels.push_back(k);
        area +=
            (std::cos(pi * (k / width) / height) - std::cos(pi * (k / width + 1) / height)) * 2 * pi / width;
    }
    for (const size_t k : pixels)
        std::fill_n(rgb.begin() + std::ptrdiff_t(3 * k), 3, float(pi / area));
    return rgb;
}

std::vector<glm::vec3> run(Context* context, const std::vector<Posed>& meshes, const Environment* environment,
                           Quality quality = Quality::standard, const Gloss* gloss = nullptr,
                           StatusCode wanted = StatusCode::ok) {
    std::vector<glm::vec3> radiance(meshes[0].positions.size());
    Stream s;
    s.kind = OutputKind::direct;
    s.data = radiance.data();
    s.count = radiance.size();
    std::vector<FrameMesh> frame = frame_of(meshes);
    frame[0].outputs = &s;
    frame[0].output_count = 1;
    frame[0].gloss = gloss;
    FrameDesc desc;
    desc.meshes = frame.data();
    desc.mesh_count = uint32_t(frame.size());
    desc.quality = quality;
    desc.environment = environment;
    FrameId id;
    const Status started = submit(context, desc, &id);
    EXPECT_EQ(started.code, wanted) << started.text;
    if (started.ok()) {
        EXPECT_TRUE(wait(context, id, nullptr).ok());
    }
    return radiance;
}

std::vector<glm::vec3> directions(uint32_t count, uint64_t seed) {
    Random random(seed);
    std::vector<glm::vec3> all;
    for (uint32_t i = 0; i < count; ++i)
        all.push_back(random.direction());
    return all;
}

TEST(Direct, AConstantSkyIsItsOwnRadiance) {
    Engine engine;
    const std::vector<glm::vec3> normals = directions(50, 1);
    const scenes::Mesh mesh = points(std::vector<glm::vec3>(50, glm::vec3(0)), normals);
    const Posed posed = at_rest(add(engine.context, mesh), mesh);
    for (const Quality quality : {Quality::standard, Quality::fine, Quality::paper}) {
        const Sky sky(engine.context, constant_sky(1, 0.5f, 2), quality_mask_bits(quality));
        // The paper's grid lacks the cells on the rim.
        const double budget = quality == Quality::paper ? 0.02 : 1e-4;
        for (const glm::vec3& c : run(engine.context, {posed}, sky.environment, quality)) {
            EXPECT_NEAR(c.x, 1, budget);
            EXPECT_NEAR(c.y, 0.5, budget);
            EXPECT_NEAR(c.z, 2, 2 * budget);
        }
    }
}

TEST(Direct, ASunGivesItsCosine) {
    Engine engine;
    std::vector<glm::vec3> normals = directions(400, 2);
    const scenes::Mesh mesh = points(std::vector<glm::vec3>(normals.size(), glm::vec3(0)), normals);
    const Posed posed = at_rest(add(engine.context, mesh), mesh);
    const glm::vec3 towards = glm::normalize(glm::vec3(0.3f, 0.8f, -0.5f));
    for (const Quality quality : {Quality::standard, Quality::fine}) {
        const Sky sky(engine.context, sun(towards, 2), quality_mask_bits(quality));
        const std::vector<glm::vec3> radiance = run(engine.context, {posed}, sky.environment, quality);
        double worst = 0, mean = 0;
        for (size_t v = 0; v < normals.size(); ++v) {
            const double error =
                std::fabs(double(radiance[v].x) - std::max(0.0, double(glm::dot(normals[v], towards))));
            worst = std::max(worst, error);
            mean += error / double(normals.size());
        }
        std::printf("    %s: mean %.4f most %.4f\n", quality_name(quality), mean, worst);
        EXPECT_LE(mean, 0.03);
        EXPECT_LE(worst, 0.2);
    }
}

// The wall hides half of the sky; the sun's shadow has an edge of a few cells.
TEST(Direct, AWallCastsAnEdge) {
    Engine engine;
    const scenes::Mesh receiver = points({{0, 0, 0}}, {{0, 0, 1}});
    const scenes::Mesh wall = wall_beside();
    const std::vector<Posed> meshes = {at_rest(add(engine.context, receiver), receiver),
                                       at_rest(add(engine.context, wall), wall)};
    for (const float degrees : {-60.0f, -30.0f, -10.0f, 10.0f, 30.0f, 60.0f}) {
        const float a = degrees * float(pi) / 180;
        const Sky sky(engine.context, sun({std::sin(a), 0, std::cos(a)}, 2));
        const double wanted = degrees < 0 ? std::cos(double(a)) : 0;
        EXPECT_NEAR(run(engine.context, meshes, sky.environment)[0].x, wanted, 0.12) << degrees;
    }
}

TEST(Direct, GlossyMaterialsMirrorTheSun) {
    Engine engine;
    const scenes::Mesh mesh = points({{0, 0, 0}}, {{0, 0, 1}});
    const Posed posed = at_rest(add(engine.context, mesh), mesh);
    Material m;
    m.brdf = Brdf::phong;
    m.exponent = 100;
    std::fill_n(m.diffuse, 3, 0.0f);
    std::fill_n(m.specular, 3, 1.0f);
    Gloss gloss;
    gloss.materials = &m;
    gloss.material_count = 1;
    gloss.eye[2] = 1;
    const Sky above(engine.context, sun({0, 0, 1}, 2)), aside(engine.context, sun({0.6f, 0, 0.8f}, 2));
    // (e + 2) / (2 pi) times the irradiance pi, less what the filter takes off the peak.
    const float peak = run(engine.context, {posed}, above.environment, Quality::standard, &gloss)[0].x;
    EXPECT_NEAR(peak, 51, 10);
    EXPECT_LE(run(engine.context, {posed}, aside.environment, Quality::standard, &gloss)[0].x, 0.5f);
    // A Lambert material is the same as none.
    m.exponent = 1;
    std::fill_n(m.diffuse, 3, 1.0f);
    std::fill_n(m.specular, 3, 0.0f);
    EXPECT_EQ(run(engine.context, {posed}, aside.environment, Quality::standard, &gloss),
              run(engine.context, {posed}, aside.environment));
}

TEST(Direct, SameBitsOnEveryInstructionSet) {
    const scenes::Scene scene = scenes::builtin("cloth");
    const std::vector<float> light = sun(glm::normalize(glm::vec3(1, 2, 1)), 3);
    std::vector<glm::vec3> first;
    for (const Isa isa : available_isas()) {
        Engine engine(with_isa(isa));
        const Sky sky(engine.context, light);
        const std::vector<glm::vec3> radiance =
            run(engine.context, posed(scene, add_all(engine.context, scene), 0.5), sky.environment);
        if (first.empty()) first = radiance;
        EXPECT_EQ(radiance, first) << isa_name(isa);
    }
}

// S8, as ShProject's: pixels as bright as floats go, and worse: finite radiance, and told. Diffuse, and of a
// mirror that gathers what a whole hemisphere sends.
TEST(Direct, RadianceOutOfRangeIsClampedAndTold) {
    Engine engine;
    const scenes::Mesh mesh = points({{0, 0, 0}}, {{0, 0.6f, 0.8f}});
    const Posed posed = at_rest(add(engine.context, mesh), mesh);
    const float white[3] = {1, 1, 1};
    const Material metal = metallic_roughness(white, 1, 0);
    Gloss gloss;
    gloss.eye[1] = 3;
    gloss.materials = &metal;
    gloss.material_count = 1;
    for (const float value : {1e35f, 1e36f, 1e38f, 3.4e38f, INFINITY, -INFINITY, std::nanf(""), -1e38f}) {
        const std::vector<float> rgb(3 * 8 * 4, value);
        EnvironmentDesc desc;
        desc.rgb = rgb.data();
        desc.width = 8;
        desc.height = 4;
        Environment* made = nullptr;
        uint64_t bad = 0;
        ASSERT_TRUE(create_environment(engine.context, desc, &made, &bad).ok());
        EXPECT_EQ(bad, value == 1e35f ? 0u : 32u) << value;
        const float expected = value >= 1e35f && std::isfinite(value) ? 1e35f : 0;
        for (const Gloss* with : {static_cast<const Gloss*>(nullptr), static_cast<const Gloss*>(&gloss)}) {
            const glm::vec3 c = run(engine.context, {posed}, made, Quality::standard, with)[0];
            for (int k = 0; k < 3; ++k) {
                EXPECT_TRUE(std::isfinite(c[k])) << value;
                EXPECT_NEAR(c[k], expected, with ? 0.2f * expected : 2e33f) << value;
            }
        }
        destroy_environment(engine.context, made);
    }
}

TEST(Direct, BadInput) {
    Engine engine;
    std::vector<float> rgb = constant_sky(1, 1, 1);
    Environment* made = nullptr;
    EnvironmentDesc desc;
    desc.rgb = rgb.data();
    desc.width = width;
    desc.height = height;
    EXPECT_EQ(create_environment(nullptr, desc, &made).code, StatusCode::invalid_argument);
    EXPECT_EQ(create_environment(engine.context, desc, nullptr).code, StatusCode::invalid_argument);
    desc.mask_bits = 2048;
    EXPECT_EQ(create_environment(engine.context, desc, &made).code, StatusCode::invalid_argument);
    desc.mask_bits = 1024;
    desc.width = 0;
    EXPECT_EQ(create_environment(engine.context, desc, &made).code, StatusCode::invalid_argument);
    desc.width = width;
    desc.rgb = nullptr;
    EXPECT_EQ(create_environment(engine.context, desc, &made).code, StatusCode::invalid_argument);
    EXPECT_EQ(made, nullptr);
    rgb[5] = std::nanf("");
    rgb[300] = -1;
    rgb[301] = INFINITY; // the same pixel
    desc.rgb = rgb.data();
    uint64_t bad = 0;
    ASSERT_TRUE(create_environment(engine.context, desc, &made, &bad).ok());
    EXPECT_EQ(bad, 2u);
    const scenes::Mesh mesh = points({{0, 0, 0}}, {{0, 1, 0}});
    const Posed posed = at_rest(add(engine.context, mesh), mesh);
    EXPECT_NEAR(run(engine.context, {posed}, made)[0].x, 1, 0.01);
    run(engine.context, {posed}, nullptr, Quality::standard, nullptr, StatusCode::invalid_argument);
    run(engine.context, {posed}, made, Quality::fine, nullptr, StatusCode::invalid_argument);
    destroy_environment(engine.context, made);
    destroy_environment(engine.context, nullptr);
    // One row and one column: no pixel has a neighbour.
    desc.width = desc.height = 1;
    ASSERT_TRUE(create_environment(engine.context, desc, &made).ok());
    EXPECT_NEAR(run(engine.context, {posed}, made)[0].x, 1, 1e-3);
    destroy_environment(engine.context, made);
}

} // namespace

} // namespace nusselt::test
