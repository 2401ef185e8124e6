// The README's snippet with a mesh of one triangle under another.
#include <gtest/gtest.h>

#include <nusselt/nusselt.h>

#include <vector>

TEST(Readme, SnippetShadows) {
    const float rest_positions[] = {0, 0, 0, 1, 0, 0, 0, 0, 1, -9, 1, -9, 9, 1, -9, 0, 1, 18};
    const uint32_t indices[] = {0, 2, 1, 3, 5, 4};
    const size_t vertex_count = 6, index_count = 6;
    const float* positions = rest_positions;
    const std::vector<float> up = {0, 1, 0, 0, 1, 0, 0, 1, 0, 0, 1, 0, 0, 1, 0, 0, 1, 0};
    const float* normals = up.data();
    std::vector<float> transfers(vertex_count * 25), radiance(vertex_count * 3);
    float* transfer = transfers.data();
    float* rgb = radiance.data();
    float light[75] = {};
    light[0] = light[1] = light[2] = 3.5449077f; // radiance 1 from everywhere

#include "readme_snippet.inl"

    ASSERT_TRUE(status.ok()) << status.text;
    EXPECT_LT(rgb[0], 0.1f);           // under the large triangle
    EXPECT_NEAR(rgb[3 * 4], 1, 0.02f); // on top of it
    EXPECT_TRUE(destroy_context(context).ok());
}
