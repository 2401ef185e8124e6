#include "tests/runtime/fixture.h"

#include <bit>
#include <cmath>
#include <cstring>

#include <glm/geometric.hpp>

namespace nusselt::test {

Engine::Engine(const ContextDesc& desc) {
    const Status status = create_context(desc, &context);
    EXPECT_TRUE(status.ok()) << status.text;
}

Engine::~Engine() {
    const Status status = destroy_context(context);
    EXPECT_TRUE(status.ok()) << status.text;
}

ContextDesc with_isa(Isa isa) {
    ContextDesc desc;
    desc.isa = isa;
    return desc;
}

std::vector<Isa> available_isas() {
    std::vector<Isa> all;
    for (const Isa isa : {Isa::scalar, Isa::sse4, Isa::avx2, Isa::avx512, Isa::neon}) {
        if (isa_available(isa)) all.push_back(isa);
    }
    return all;
}

Vec3View view(const std::vector<glm::vec3>& v) {
    return {v.empty() ? nullptr : &v[0].x, v.size(), sizeof(glm::vec3)};
}

MeshId add(Context* context, const scenes::Mesh& mesh) {
    MeshId id;
    const Status status = add_mesh(
        context,
        {view(mesh.rest_positions), view(mesh.rest_normals), mesh.indices.data(), mesh.indices.size()}, &id);
    EXPECT_TRUE(status.ok()) << status.text;
    return id;
}

bool Output::operator==(const Output& other) const {
    return transfer.size() == other.transfer.size() && masks == other.masks &&
           (transfer.empty() ||
            std::memcmp(transfer.data(), other.transfer.data(), transfer.size() * 100) == 0);
}

namespace {

const float unwritten_value = std::bit_cast<float>(0x7FABCDEFu);
constexpr uint32_t unwritten_mask = 0xDEADBEEF;

} // namespace

bool is_unwritten(const Output& output, size_t vertex) {
    const size_t words = output.masks.size() / output.transfer.size();
    bool all = true;
    for (const float& value : output.transfer[vertex])
        all = all && std::memcmp(&value, &unwritten_value, 4) == 0;
    for (size_t i = vertex * words; i < (vertex + 1) * words; ++i)
        all = all && output.masks[i] == unwritten_mask;
    return all;
}

bool same_result(const Output& a, const Output& b, size_t vertex) {
    const size_t words = a.masks.size() / a.transfer.size();
    return std::memcmp(&a.transfer[vertex], &b.transfer[vertex], 100) == 0 &&
           std::memcmp(&a.masks[vertex * words], &b.masks[vertex * words], 4 * words) == 0;
}

Outputs run_frame(Context* context, const std::vector<Posed>& meshes, Quality quality) {
    return run_frame(context, meshes, FrameDesc{nullptr, 0, quality});
}

Outputs run_frame(Context* context, const std::vector<Posed>& meshes, FrameDesc settings) {
    const uint32_t words = quality_mask_bits(settings.quality) / 32;
    Outputs out;
    out.meshes.resize(meshes.size());
    out.backs.resize(meshes.size());
    std::vector<FrameMesh> frame = frame_of(meshes);
    const auto prepare = [&](Output& o, size_t count, TransferView& transfer, MaskView& masks) {
        o.transfer.resize(count);
        for (auto& t : o.transfer)
            t.fill(unwritten_value);
        o.masks.assign(count * words, unwritten_mask);
        transfer = {o.transfer[0].data(), count, 100};
        masks = {o.masks.data(), count, size_t(words) * 4};
    };
    for (size_t i = 0; i < meshes.size(); ++i) {
        const Posed& m = meshes[i];
        frame[i].needed = m.needed.empty() ? nullptr : m.needed.data();
        frame[i].back.needed = m.back_needed.empty() ? nullptr : m.back_needed.data();
        if (m.receives) prepare(out.meshes[i], m.positions.size(), frame[i].transfer, frame[i].masks);
        if (m.back_receives)
            prepare(out.backs[i], m.positions.size(), frame[i].back.transfer, frame[i].back.masks);
    }
    settings.meshes = frame.data();
    settings.mesh_count = uint32_t(frame.size());
    FrameId id;
    const Status started = submit(context, settings, &id);
    EXPECT_TRUE(started.ok()) << started.text;
    if (!started.ok()) return out;
    const Status done = wait(context, id, &out.stats);
    EXPECT_TRUE(done.ok()) << done.text;
    return out;
}

std::vector<MeshId> add_all(Context* context, const scenes::Scene& scene) {
    std::vector<MeshId> ids;
    for (const scenes::Mesh& mesh : scene.meshes)
        ids.push_back(add(context, mesh));
    return ids;
}

std::vector<Posed> posed(const scenes::Scene& scene, const std::vector<MeshId>& meshes, double time) {
    scenes::Pose pose;
    scene.pose(time, pose);
    std::vector<Posed> out;
    for (size_t i = 0; i < meshes.size(); ++i)
        out.push_back({meshes[i], pose.positions[i], pose.normals[i]});
    return out;
}

Outputs run_scene(Context* context, const scenes::Scene& scene, double time, Quality quality) {
    const std::vector<MeshId> ids = add_all(context, scene);
    Outputs out = run_frame(context, posed(scene, ids, time), quality);
    for (const MeshId id : ids)
        EXPECT_TRUE(remove_mesh(context, id).ok());
    return out;
}

std::vector<FrameMesh> frame_of(const std::vector<Posed>& meshes) {
    std::vector<FrameMesh> frame(meshes.size());
    for (size_t m = 0; m < meshes.size(); ++m) {
        frame[m].mesh = meshes[m].mesh;
        frame[m].positions = view(meshes[m].positions);
        frame[m].normals = view(meshes[m].normals);
        frame[m].object = meshes[m].object;
    }
    return frame;
}

scenes::Mesh wall_beside() {
    scenes::Mesh wall;
    wall.rest_positions = {
        {0.02f, -1000, -1000}, {0.02f, 1000, -1000}, {0.02f, 1000, 1000}, {0.02f, -1000, 1000}};
    wall.rest_normals.assign(4, {-1, 0, 0});
    wall.indices = {0, 1, 2, 0, 2, 3};
    return wall;
}

Posed at_rest(MeshId id, const scenes::Mesh& mesh) {
    return {id, mesh.rest_positions, mesh.rest_normals};
}

Outputs run_at_rest(Context* context, const std::vector<scenes::Mesh>& meshes, Quality quality) {
    std::vector<Posed> all;
    for (const scenes::Mesh& mesh : meshes)
        all.push_back(at_rest(add(context, mesh), mesh));
    Outputs out = run_frame(context, all, quality);
    for (const Posed& p : all)
        EXPECT_TRUE(remove_mesh(context, p.mesh).ok());
    return out;
}

scenes::Mesh points(const std::vector<glm::vec3>& positions, const std::vector<glm::vec3>& normals) {
    return {"points", positions, normals, {}, {}, {}};
}

scenes::Mesh soup(const std::vector<glm::vec3>& corners) {
    scenes::Mesh mesh;
    mesh.rest_positions = corners;
    for (uint32_t i = 0; i < corners.size(); ++i)
        mesh.indices.push_back(i);
    scenes::compute_normals(mesh.rest_positions, mesh.indices, mesh.rest_normals);
    return mesh;
}

uint32_t blocked_bits(const Output& output, size_t vertex, Quality quality) {
    const uint32_t words = quality_mask_bits(quality) / 32;
    uint32_t count = 0;
    for (uint32_t i = 0; i < words; ++i)
        count += uint32_t(std::popcount(output.masks[vertex * words + i]));
    return count;
}

glm::vec3 Random::direction() {
    for (;;) {
        const glm::vec3 d(between(-1, 1), between(-1, 1), between(-1, 1));
        const float square = glm::dot(d, d);
        if (square > 0.01f && square < 1) return d / std::sqrt(square);
    }
}

uint64_t hash_bytes(const void* data, size_t size, uint64_t hash) {
    const auto* bytes = static_cast<const unsigned char*>(data);
    for (size_t i = 0; i < size; ++i)
        hash = (hash ^ bytes[i]) * 0x100000001b3ull;
    return hash;
}

uint64_t hash(const Outputs& outputs) {
    uint64_t h = hash_bytes(nullptr, 0);
    for (const Output& o : outputs.meshes) {
        h = hash_bytes(o.transfer.data(), o.transfer.size() * 100, h);
        h = hash_bytes(o.masks.data(), o.masks.size() * 4, h);
    }
    return h;
}

} // namespace nusselt::test
