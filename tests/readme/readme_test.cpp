// The README's C++: its snippet, and an engine's embedding over the example's job system.
#include "examples/engine/job_system.h"

#include <gtest/gtest.h>

#include <nusselt/nusselt.h>

#include <algorithm>
#include <vector>

namespace {

void check(const nusselt::Status& status) {
    ASSERT_TRUE(status.ok()) << status.text;
}

#include "readme_embed.inl"

// A small triangle under a large one.
const std::vector<float> floor_and_roof = {0, 0, 0, 1, 0, 0, 0, 0, 1, -9, 1, -9, 9, 1, -9, 0, 1, 18};
const std::vector<float> up = {0, 1, 0, 0, 1, 0, 0, 1, 0, 0, 1, 0, 0, 1, 0, 0, 1, 0};
const std::vector<uint32_t> triangles = {0, 2, 1, 3, 5, 4};

TEST(Readme, SnippetShadows) {
    const float* rest_positions = floor_and_roof.data();
    const uint32_t* indices = triangles.data();
    const size_t vertex_count = 6, index_count = 6;
    const float* positions = rest_positions;
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

TEST(Readme, EmbeddingShadows) {
    for (const uint32_t workers : {0u, 2u}) {
        JobSystem jobs(workers);
        Shadows shadows(jobs);
        std::vector<float> transfer(6 * 25);
        nusselt::FrameMesh mesh;
        mesh.mesh = shadows.add({floor_and_roof.data(), 6}, triangles);
        mesh.positions = {floor_and_roof.data(), 6};
        mesh.normals = {up.data(), 6};
        mesh.transfer = {transfer.data(), 6};
        for (int frame = 0; frame < 20; ++frame) {
            std::fill(transfer.begin(), transfer.end(), -1.0f);
            shadows.start({mesh});
            EXPECT_EQ(shadows.finish().receivers_written, 6u);
            EXPECT_LT(transfer[0], 0.03f);                // under the large triangle
            EXPECT_NEAR(transfer[4 * 25], 0.2821, 0.005); // on top of it: the whole sky
        }
    }
}

} // namespace
