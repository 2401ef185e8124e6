#include "tests/runtime/crowd.h"

#include <cmath>

namespace nusselt::test {

Posed moved(Posed mesh, const glm::vec3& by, uint32_t object) {
    for (glm::vec3& p : mesh.positions)
        p += by;
    mesh.object = object;
    return mesh;
}

std::vector<Posed> crowd(Context* context, uint32_t count, float spacing) {
    const scenes::Scene scene = scenes::builtin("fight");
    std::vector<Posed> all;
    for (uint32_t k = 0; k < count; ++k) {
        for (const Posed& mesh :
             posed(scene, add_all(context, scene), scene.duration * float(k) / float(count)))
            all.push_back(moved(mesh, {spacing * float(k % 2), 0, spacing * float(k / 2)}, k));
    }
    return all;
}

std::vector<Posed> as_one(std::vector<Posed> meshes, uint32_t number) {
    for (Posed& mesh : meshes)
        mesh.object = number;
    return meshes;
}

double norm(const std::array<float, 25>& a, const std::array<float, 25>& b) {
    double sum = 0;
    for (size_t i = 0; i < 25; ++i)
        sum += (double(a[i]) - b[i]) * (double(a[i]) - b[i]);
    return std::sqrt(sum);
}

double difference(const Outputs& a, const Outputs& b) {
    double sum = 0, count = 0;
    for (size_t m = 0; m < a.meshes.size(); ++m) {
        for (size_t v = 0; v < a.meshes[m].transfer.size(); ++v) {
            if (b.meshes[m].transfer[v][0] < 0.028f) continue;
            sum += norm(a.meshes[m].transfer[v], b.meshes[m].transfer[v]) / norm(b.meshes[m].transfer[v], {});
            ++count;
        }
    }
    return sum / count;
}

Outputs run_far(Context* context, const std::vector<Posed>& meshes, FrameDesc settings) {
    Outputs out;
    out.meshes.resize(meshes.size());
    out.backs.resize(meshes.size());
    std::vector<FrameMesh> frame = frame_of(meshes);
    const auto prepare = [](Output& o, size_t count) {
        o.transfer.resize(count);
        return TransferView{o.transfer[0].data(), count, 100};
    };
    for (size_t m = 0; m < meshes.size(); ++m) {
        const Posed& p = meshes[m];
        if (p.receives) frame[m].transfer = prepare(out.meshes[m], p.positions.size());
        if (p.back_receives) frame[m].back.transfer = prepare(out.backs[m], p.positions.size());
        frame[m].needed = p.needed.empty() ? nullptr : p.needed.data();
    }
    settings.meshes = frame.data();
    settings.mesh_count = uint32_t(frame.size());
    FrameId id;
    const Status started = submit(context, settings, &id);
    EXPECT_TRUE(started.ok()) << started.text;
    if (started.ok()) {
        EXPECT_TRUE(wait(context, id, &out.stats).ok());
    }
    return out;
}

Outputs each_alone(Context* context, const std::vector<Posed>& meshes) {
    Outputs all;
    for (size_t m = 0; m < meshes.size(); ++m)
        all.meshes.push_back(run_frame(context, {meshes[m]}).meshes[0]);
    return all;
}

} // namespace nusselt::test
