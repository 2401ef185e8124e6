// Contexts, meshes and frames in few words, for the tests of the library.
#pragma once

#include "bench/scenes/builtin.h"
#include "bench/scenes/scene.h"
#include "bench/scenes/shapes.h"
#include "nusselt/nusselt.h"

#include <gtest/gtest.h>

#include <array>
#include <cstdint>
#include <random>
#include <string>
#include <vector>

namespace nusselt::test {

// Destroyed with its meshes; fails the test where it can't be made.
struct Engine {
    Context* context = nullptr;

    explicit Engine(const ContextDesc& desc = {});
    ~Engine();
    Engine(const Engine&) = delete;
    Engine& operator=(const Engine&) = delete;
};

ContextDesc with_isa(Isa isa);
std::vector<Isa> available_isas();

Vec3View view(const std::vector<glm::vec3>& v); // valid as long as the vector stays as it is
MeshId add(Context* context, const scenes::Mesh& mesh);

// What a frame is given, and what it gives.
struct Posed {
    MeshId mesh;
    std::vector<glm::vec3> positions, normals;
    bool receives = true;
    std::vector<uint32_t> needed = {}; // FrameMesh::needed; empty: all
    bool back_receives = false;
    std::vector<uint32_t> back_needed = {}; // BackSide::needed; empty: as the front
    uint32_t object = 0;
};
struct Output {
    std::vector<std::array<float, 25>> transfer;
    std::vector<uint32_t> masks; // quality_mask_bits / 32 a vertex

    bool operator==(const Output& other) const; // bit for bit
};
struct Outputs {
    std::vector<Output> meshes, backs;
    FrameStats stats;

    bool operator==(const Outputs& other) const { return meshes == other.meshes && backs == other.backs; }
};
// What isn't written keeps words that no result has. `settings` but for its meshes.
Outputs run_frame(Context* context, const std::vector<Posed>& meshes, FrameDesc settings);
Outputs run_frame(Context* context, const std::vector<Posed>& meshes, Quality quality = Quality::standard);

// A scene's meshes, and its pose at a time.
std::vector<MeshId> add_all(Context* context, const scenes::Scene& scene);
std::vector<Posed> posed(const scenes::Scene& scene, const std::vector<MeshId>& meshes, double time);
Outputs run_scene(Context* context, const scenes::Scene& scene, double time,
                  Quality quality = Quality::standard);

// As it stands, in its rest pose.
Posed at_rest(MeshId id, const scenes::Mesh& mesh);
// Their meshes, positions, normals and objects; nothing receives yet. Looks into `meshes`.
std::vector<FrameMesh> frame_of(const std::vector<Posed>& meshes);
// Hides x > 0 from a receiver at the origin, nearly all of it.
scenes::Mesh wall_beside();
Outputs run_at_rest(Context* context, const std::vector<scenes::Mesh>& meshes,
                    Quality quality = Quality::standard);

// Vertices without triangles.
scenes::Mesh points(const std::vector<glm::vec3>& positions, const std::vector<glm::vec3>& normals);
// Triangles of their own vertices: 3 corners each.
scenes::Mesh soup(const std::vector<glm::vec3>& corners);

uint32_t blocked_bits(const Output& output, size_t vertex, Quality quality = Quality::standard);

bool is_unwritten(const Output& output, size_t vertex);
bool same_result(const Output& a, const Output& b, size_t vertex); // bit for bit

struct Random {
    std::mt19937_64 engine;
    explicit Random(uint64_t seed) : engine(seed) {}
    float between(float low, float high) {
        return low + (high - low) * float(double(engine() >> 11) * 0x1p-53);
    }
    uint32_t below(uint32_t count) { return uint32_t(engine() % count); }
    glm::vec3 direction();
};

// Cases of a test on one thread: a twentieth where the thread sanitizer, who sees nothing there, makes each
// slow.
constexpr uint64_t cases(uint64_t count) {
#if defined(__SANITIZE_THREAD__)
    return count / 20;
#else
    return count;
#endif
}

// FNV-1a.
uint64_t hash_bytes(const void* data, size_t size, uint64_t hash = 0xcbf29ce484222325ull);
uint64_t hash(const Outputs& outputs);

} // namespace nusselt::test
