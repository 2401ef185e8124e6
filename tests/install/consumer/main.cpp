// A host: shadows a small scene, which draws in kernels, jobs and memory, and prints a hash of the result:
// the same however the library was built, found and linked.
#include "nusselt/nusselt.h"

#include <cstdio>
#include <cstring>
#include <vector>

namespace {

bool failed(const nusselt::Status& status) {
    if (!status.ok()) std::puts(status.text);
    return !status.ok();
}

// A sheet of `side` by `side` vertices in waves, from integers alone: exact under any compiler flag.
struct Sheet {
    std::vector<float> positions, normals, transfer;
    std::vector<uint32_t> indices;

    Sheet(uint32_t side, int height) {
        for (uint32_t z = 0; z < side; ++z) {
            for (uint32_t x = 0; x < side; ++x) {
                const int wave = static_cast<int>(x * 5 % 7 + z * 3 % 5);
                const float point[3] = {static_cast<float>(x), static_cast<float>(height * 8 + wave) / 8,
                                        static_cast<float>(z)};
                positions.insert(positions.end(), point, point + 3);
                normals.insert(normals.end(), {0, 1, 0});
                const uint32_t v = z * side + x;
                if (x + 1 < side && z + 1 < side)
                    indices.insert(indices.end(), {v, v + side, v + 1, v + 1, v + side, v + side + 1});
            }
        }
        transfer.resize(positions.size() / 3 * 25);
    }
};

} // namespace

int main() {
    if (failed(nusselt::check_version())) return 1;
    nusselt::Executor executor;
    if (nusselt::has_feature(nusselt::Feature::tbb)) {
        if (failed(nusselt::create_tbb_executor(2, &executor))) return 1;
    }
    nusselt::ContextDesc desc;
    desc.executor = executor;
    nusselt::Context* context = nullptr;
    if (failed(nusselt::create_context(desc, &context))) return 1;
    Sheet sheets[] = {Sheet(24, 0), Sheet(9, 5)};
    std::vector<nusselt::FrameMesh> meshes;
    for (Sheet& sheet : sheets) {
        const size_t count = sheet.positions.size() / 3;
        nusselt::FrameMesh mesh;
        mesh.positions = {sheet.positions.data(), count, 12};
        mesh.normals = {sheet.normals.data(), count, 12};
        mesh.transfer = {sheet.transfer.data(), count, 100};
        if (failed(nusselt::add_mesh(
                context, {mesh.positions, {}, sheet.indices.data(), sheet.indices.size()}, &mesh.mesh)))
            return 1;
        meshes.push_back(mesh);
    }
    nusselt::FrameDesc frame;
    frame.meshes = meshes.data();
    frame.mesh_count = static_cast<uint32_t>(meshes.size());
    nusselt::FrameId id;
    if (failed(nusselt::submit(context, frame, &id)) || failed(nusselt::wait(context, id, nullptr))) return 1;
    uint64_t hash = 0xcbf29ce484222325u;
    for (const Sheet& sheet : sheets) {
        for (const float value : sheet.transfer) {
            uint32_t word;
            std::memcpy(&word, &value, 4);
            hash = (hash ^ word) * 0x100000001b3u;
        }
    }
    if (failed(nusselt::destroy_context(context))) return 1;
    nusselt::destroy_executor(&executor);
    std::printf("%s\nhash %016llx\n", nusselt::configuration(), static_cast<unsigned long long>(hash));
    return 0;
}
