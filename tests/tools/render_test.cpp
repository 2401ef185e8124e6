#include "tools/render/render.h"

#include <glm/geometric.hpp>
#include <gtest/gtest.h>

#include <cmath>

namespace nusselt::tools {
namespace {

Assembly square() {
    Assembly all;
    all.positions = {{-1, -1, 0}, {1, -1, 0}, {1, 1, 0}, {-1, 1, 0}};
    all.normals.assign(4, {0, 0, 1});
    all.albedo.assign(4, glm::vec3(1));
    all.indices = {0, 1, 2, 0, 2, 3};
    return all;
}

Camera frame(const std::vector<glm::vec3>& positions, const glm::vec3& direction, uint32_t width,
             uint32_t height) {
    Framing framing = make_framing(direction, 35, width, height);
    include(framing, positions);
    return frame_camera(framing);
}

TEST(Camera, FitsWhatItShows) {
    const std::vector<glm::vec3> positions = {
        {-3, 1, 2}, {5, 2, 9}, {NAN, 100, 0}, {0, 1.5f, 30}, {1000, 1, 2}};
    for (const float scale : {1e-6f, 1.0f, 1e6f}) {
        std::vector<glm::vec3> scaled = positions;
        for (glm::vec3& p : scaled)
            p *= scale;
        for (const glm::vec3 direction :
             {glm::vec3(-0.4f, -0.35f, -1), glm::vec3(0, -1, 0), glm::vec3(1, 0, 0)}) {
            const Camera camera = frame(scaled, direction, 640, 360);
            float widest = 0;
            for (const glm::vec3& p : scaled) {
                if (std::isnan(p.x)) continue;
                const glm::vec3 d = p - camera.eye;
                const float depth = glm::dot(d, camera.forward);
                const float x = glm::dot(d, camera.right) / glm::dot(camera.right, camera.right) / depth;
                const float y = glm::dot(d, camera.up) / glm::dot(camera.up, camera.up) / depth;
                ASSERT_GT(depth, 0);
                widest = std::max({widest, std::abs(x), std::abs(y)});
            }
            EXPECT_LE(widest, 0.95f);
            EXPECT_GT(widest, 0.9f);
        }
    }
}

TEST(View, InterpolatesRadianceTheRightWayUp) {
    const Assembly all = square();
    const TraceScene scene = make_trace_scene(all);
    const Camera camera = frame(all.positions, {0, 0, -1}, 60, 60);
    const View view = cast_view(scene, camera, 60, 60);
    // Red grows with x, green with y.
    std::vector<float> radiance;
    for (const glm::vec3& p : all.positions)
        radiance.insert(radiance.end(), {(p.x + 1) / 2, (p.y + 1) / 2, 0.25f});
    const Image image = color_view(view, all, radiance);
    const auto pixel = [&](size_t x, size_t y) { return &image.rgb[(y * 60 + x) * 3]; };
    EXPECT_EQ(view.covered[30 * 60 + 30], 9);
    EXPECT_EQ(view.covered[0], 0);
    EXPECT_NEAR(pixel(30, 30)[0], 0.5, 0.02);
    EXPECT_NEAR(pixel(30, 30)[2], 0.25, 1e-5);
    EXPECT_GT(pixel(45, 30)[0], 0.7);
    EXPECT_GT(pixel(30, 15)[1], 0.7); // row 15 is above the middle
    EXPECT_LT(pixel(30, 45)[1], 0.3);

    const Picture picture = finish_view(view, image, 1, nullptr);
    EXPECT_GT(picture.rgb[0], 200); // the light background
    const Image environment = sky(64, 32, 0);
    EXPECT_NE(finish_view(view, image, 1, &environment).rgb, picture.rgb);
}

TEST(View, BacksHaveTheirOwnRadiance) {
    const Assembly all = square();
    const TraceScene scene = make_trace_scene(all);
    const std::vector<float> front(12, 0.75f);
    BackRadiance backs{std::vector<float>(12, 0.25f), std::vector<uint8_t>(4, 1)};
    for (const float side : {1.0f, -1.0f}) {
        const View view = cast_view(scene, frame(all.positions, {0, 0, -side}, 30, 30), 30, 30);
        const auto middle = [&](const BackRadiance& b) {
            return color_view(view, all, front, b).rgb[(15 * 30 + 15) * 3];
        };
        EXPECT_FLOAT_EQ(middle({}), 0.75f);
        EXPECT_FLOAT_EQ(middle(backs), side > 0 ? 0.75f : 0.25f);
        backs.has_back[0] = 0; // a corner of both triangles
        EXPECT_FLOAT_EQ(middle(backs), 0.75f);
        backs.has_back[0] = 1;
    }
}

TEST(View, EmptySceneIsBackground) {
    Assembly all;
    all.positions = {{0, 0, 0}};
    all.normals = {{0, 0, 1}};
    all.albedo = {glm::vec3(1)};
    const View view = cast_view(make_trace_scene(all), frame(all.positions, {0, 0, -1}, 8, 8), 8, 8);
    for (const uint8_t covered : view.covered)
        EXPECT_EQ(covered, 0);
    EXPECT_EQ(exposure_for(color_view(view, all, {0, 0, 0}), view.covered), 1.0f);
}

} // namespace
} // namespace nusselt::tools
