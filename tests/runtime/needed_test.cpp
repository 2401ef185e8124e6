// Receivers that nobody needs: which they are, and that leaving them out changes nothing else.
#include "tests/runtime/fixture.h"

#include <cmath>
#include <limits>

#include <glm/geometric.hpp>
#include <glm/gtc/matrix_transform.hpp>
#include <glm/mat4x4.hpp>

namespace nusselt::test {

namespace {

std::vector<uint32_t> no_bits(size_t vertices) {
    return std::vector<uint32_t>((vertices + 31) / 32, 0u);
}

bool bit(const std::vector<uint32_t>& bits, size_t vertex) {
    return bits[vertex / 32] >> (vertex % 32) & 1;
}

// The needed ones as in the whole frame, the others untouched.
void expect_same_where_needed(const Outputs& whole, const Outputs& part, const std::vector<Posed>& frame) {
    uint32_t needed = 0, all = 0;
    for (size_t m = 0; m < frame.size(); ++m) {
        for (size_t v = 0; v < frame[m].positions.size(); ++v) {
            ++all;
            if (frame[m].needed.empty() || bit(frame[m].needed, v)) {
                ++needed;
                ASSERT_TRUE(same_result(whole.meshes[m], part.meshes[m], v)) << m << " " << v;
            } else {
                ASSERT_TRUE(is_unwritten(part.meshes[m], v)) << m << " " << v;
            }
        }
    }
    const FrameStats& s = part.stats;
    EXPECT_EQ(s.receivers, needed);
    EXPECT_EQ(s.receivers_unneeded, all - needed);
    EXPECT_EQ(s.receivers_written, needed);
    EXPECT_EQ(s.receivers_computed + s.receivers_copied, needed);
}

TEST(Needed, AnyMaskGivesTheSameResultsWhereItIsSet) {
    Engine engine;
    Random random(7);
    for (const char* name : {"hand", "chess", "cloth"}) {
        const scenes::Scene scene = scenes::builtin(name);
        const std::vector<MeshId> ids = add_all(engine.context, scene);
        std::vector<Posed> frame = posed(scene, ids, 0.4 * scene.duration);
        for (const Quality quality : {Quality::draft, Quality::paper}) {
            for (Posed& mesh : frame)
                mesh.needed.clear();
            const Outputs whole = run_frame(engine.context, frame, quality);
            expect_same_where_needed(whole, whole, frame);
            for (const uint32_t one_in : {3u, 50u}) { // batches that stay nearly full, and nearly empty ones
                for (Posed& mesh : frame) {
                    mesh.needed = no_bits(mesh.positions.size());
                    for (size_t v = 0; v < mesh.positions.size(); ++v)
                        mesh.needed[v / 32] |= uint32_t(random.below(one_in) == 0) << v % 32;
                    if (mesh.positions.size() % 32) mesh.needed.back() |= 0x80000000u; // past the last vertex
                }
                expect_same_where_needed(whole, run_frame(engine.context, frame, quality), frame);
            }
        }
        for (Posed& mesh : frame)
            mesh.needed = no_bits(mesh.positions.size());
        const Outputs none = run_frame(engine.context, frame);
        EXPECT_EQ(none.stats.receivers, 0u);
        EXPECT_EQ(none.stats.receivers_computed, 0u);
        EXPECT_EQ(none.stats.triangles_considered, 0u);
    }
}

// A duplicate whose original nobody needs has to be computed itself.
TEST(Needed, DuplicatesWithoutTheirOriginal) {
    Engine engine;
    scenes::Mesh mesh = scenes::torus(1, 0.4f, 24, 12);
    const size_t count = mesh.rest_positions.size();
    for (size_t v = 0; v < count; ++v) {
        mesh.rest_positions.push_back(mesh.rest_positions[v]);
        mesh.rest_normals.push_back(mesh.rest_normals[v]);
    }
    std::vector<Posed> frame{at_rest(add(engine.context, mesh), mesh)};
    const Outputs whole = run_frame(engine.context, frame);
    EXPECT_EQ(whole.stats.receivers_copied, count);
    frame[0].needed = no_bits(2 * count);
    for (size_t v = 0; v < 2 * count; ++v)
        frame[0].needed[v / 32] |= uint32_t(v % 3 != 0) << v % 32;
    const Outputs part = run_frame(engine.context, frame);
    expect_same_where_needed(whole, part, frame);
    EXPECT_GT(part.stats.receivers_copied, 0u);
    EXPECT_LT(part.stats.receivers_copied, count);
}

struct View {
    Camera camera;
    glm::mat4 clip;
    glm::vec3 eye;
};

View look(glm::vec3 eye, glm::vec3 at, float field = 0.8f) {
    View view;
    view.eye = eye;
    view.clip = glm::perspective(field, 1.5f, 0.01f, 100.0f) * glm::lookAt(eye, at, glm::vec3(0, 1, 0));
    for (int row = 0; row < 4; ++row) {
        for (int column = 0; column < 4; ++column)
            view.camera.clip_from_position[4 * row + column] = view.clip[column][row];
    }
    for (int k = 0; k < 3; ++k)
        view.camera.eye[k] = eye[k];
    view.camera.eye[3] = 1;
    return view;
}

std::vector<uint32_t> marked(const Camera& camera, const scenes::Mesh& mesh) {
    std::vector<uint32_t> bits = no_bits(mesh.rest_positions.size());
    const Status status = mark_visible(camera, {&mesh.rest_positions[0].x, mesh.rest_positions.size(), 12},
                                       mesh.indices.data(), mesh.indices.size(), bits.data());
    EXPECT_TRUE(status.ok()) << status.text;
    return bits;
}

size_t count_bits(const std::vector<uint32_t>& bits) {
    size_t count = 0;
    for (const uint32_t word : bits)
        count += size_t(__builtin_popcount(word));
    return count;
}

// Every pixel's front-facing triangle, found without culling, has its corners marked.
TEST(MarkVisible, NothingThatShowsIsMissed) {
    const scenes::Mesh mesh = scenes::torus(1, 0.4f, 48, 24);
    for (const View& view : {look({0, 1, 4}, {0, 0, 0}), look({1.2f, 0.6f, 0.3f}, {0, 0, 0}),
                             look({1, 0.1f, 0}, {0, 0, 1}), look({0, 3, 0.01f}, {1, 0, 0}, 0.3f)}) {
        const std::vector<uint32_t> bits = marked(view.camera, mesh);
        const glm::mat4 back = glm::inverse(view.clip);
        size_t hits = 0;
        for (int y = 0; y < 40; ++y) {
            for (int x = 0; x < 60; ++x) {
                const glm::vec4 far =
                    back * glm::vec4((float(x) + 0.5f) / 30 - 1, (float(y) + 0.5f) / 20 - 1, 1, 1);
                const glm::vec3 direction = glm::normalize(glm::vec3(far) / far.w - view.eye);
                for (size_t i = 0; i < mesh.indices.size(); i += 3) {
                    const glm::vec3 a = mesh.rest_positions[mesh.indices[i]] - view.eye,
                                    b = mesh.rest_positions[mesh.indices[i + 1]] - view.eye,
                                    c = mesh.rest_positions[mesh.indices[i + 2]] - view.eye;
                    const float u = glm::dot(glm::cross(b, a), direction),
                                v = glm::dot(glm::cross(c, b), direction),
                                w = glm::dot(glm::cross(a, c), direction);
                    // Seen counter-clockwise from the eye, and in front of it.
                    if (!(u > 0 && v > 0 && w > 0)) continue;
                    if (glm::dot(glm::cross(b - a, c - a), a) >= 0) continue;
                    ++hits;
                    for (size_t k = 0; k < 3; ++k)
                        ASSERT_TRUE(bit(bits, mesh.indices[i + k])) << i;
                }
            }
        }
        EXPECT_GT(hits, 100u);
    }
}

TEST(MarkVisible, WhatIsBehindBesideOrTurnedAwayIsLeftOut) {
    const scenes::Mesh ball = scenes::sphere(4);
    const size_t all = ball.rest_positions.size();
    const size_t front = count_bits(marked(look({0, 0, 4}, {0, 0, 0}).camera, ball));
    // From 4 radii away three eighths of a sphere face the eye.
    EXPECT_GT(front, all * 36 / 100);
    EXPECT_LT(front, all * 45 / 100);
    EXPECT_EQ(count_bits(marked(look({0, 0, 4}, {0, 0, 8}).camera, ball)), 0u);
    EXPECT_EQ(count_bits(marked(look({0, 0, 4}, {9, 0, 4}).camera, ball)), 0u);
    const size_t corner = count_bits(marked(look({0, 0, 4}, {1.2f, 0, 0}, 0.2f).camera, ball));
    EXPECT_GT(corner, 0u);
    EXPECT_LT(corner, front / 2);

    View wider = look({0, 0, 4}, {1.2f, 0, 0}, 0.2f);
    wider.camera.margin = 0.5f;
    EXPECT_GT(count_bits(marked(wider.camera, ball)), corner);
    View both = look({0, 0, 4}, {0, 0, 0});
    both.camera.back_faces = true;
    EXPECT_EQ(count_bits(marked(both.camera, ball)), all);

    // A parallel projection along -z: half of the sphere.
    Camera parallel;
    for (const int diagonal : {0, 5})
        parallel.clip_from_position[diagonal] = 0.9f;
    parallel.clip_from_position[15] = 1;
    parallel.eye[2] = 1;
    const size_t half = count_bits(marked(parallel, ball));
    EXPECT_GT(half, all * 49 / 100);
    EXPECT_LT(half, all * 56 / 100);
}

TEST(MarkVisible, CamerasAdd) {
    const scenes::Mesh ball = scenes::sphere(3);
    const View left = look({-4, 0, 0}, {0, 0, 0}), right = look({4, 0, 0}, {0, 0, 0});
    std::vector<uint32_t> both = marked(left.camera, ball);
    const std::vector<uint32_t> other = marked(right.camera, ball);
    ASSERT_TRUE(mark_visible(right.camera, {&ball.rest_positions[0].x, ball.rest_positions.size(), 12},
                             ball.indices.data(), ball.indices.size(), both.data())
                    .ok());
    const std::vector<uint32_t> one = marked(left.camera, ball);
    for (size_t i = 0; i < both.size(); ++i)
        EXPECT_EQ(both[i], one[i] | other[i]);
}

TEST(MarkVisible, BadInput) {
    scenes::Mesh ball = scenes::sphere(1);
    const View view = look({0, 0, 4}, {0, 0, 8}); // it sees nothing
    ball.rest_positions[0] = glm::vec3(std::numeric_limits<float>::quiet_NaN());
    EXPECT_GT(count_bits(marked(view.camera, ball)), 0u); // in doubt

    std::vector<uint32_t> bits = no_bits(ball.rest_positions.size());
    const Vec3View positions{&ball.rest_positions[0].x, ball.rest_positions.size(), 12};
    const uint32_t wrong[] = {0, 1, uint32_t(ball.rest_positions.size())};
    const auto code = [&](Vec3View p, const uint32_t* indices, size_t count, uint32_t* needed) {
        return mark_visible(view.camera, p, indices, count, needed).code;
    };
    EXPECT_EQ(code(positions, wrong, 3, bits.data()), StatusCode::invalid_argument);
    EXPECT_EQ(code(positions, ball.indices.data(), 4, bits.data()), StatusCode::invalid_argument);
    EXPECT_EQ(code(positions, nullptr, 3, bits.data()), StatusCode::invalid_argument);
    EXPECT_EQ(code(positions, ball.indices.data(), 3, nullptr), StatusCode::invalid_argument);
    EXPECT_EQ(code({nullptr, 3, 12}, ball.indices.data(), 3, bits.data()), StatusCode::invalid_argument);
    EXPECT_EQ(code({positions.data, positions.count, 10}, ball.indices.data(), 3, bits.data()),
              StatusCode::invalid_argument);
    EXPECT_EQ(count_bits(bits), 0u);
    EXPECT_EQ(code(positions, nullptr, 0, bits.data()), StatusCode::ok);
}

} // namespace

} // namespace nusselt::test
