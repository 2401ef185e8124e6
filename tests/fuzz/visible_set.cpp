#include "nusselt/nusselt.h"
#include "tests/fuzz/fuzz.h"

#include <algorithm>
#include <vector>

namespace nusselt::fuzz {

namespace {

// Two tents over one another.
struct Shapes {
    float positions[2][12] = {{0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1}, {0, 0, 2, 1, 0, 2, 0, 1, 2, 0, 0, 3}};
    float normals[2][12] = {{0, 0, 1, 0, 0, 1, 0, 0, 1, 0, 0, 1}, {0, 0, -1, 0, 0, -1, 0, 0, -1, 0, 0, -1}};
    uint32_t indices[9] = {0, 1, 3, 1, 2, 3, 2, 0, 3};
};

uint64_t seal(const std::vector<uint8_t>& file, size_t size) {
    uint64_t hash = 0xCBF29CE484222325u;
    for (size_t i = 0; i + 4 <= size; i += 4) {
        uint32_t word;
        std::memcpy(&word, file.data() + i, 4);
        hash = (hash ^ word) * 0x100000001B3u;
    }
    return hash;
}

} // namespace

// A good file in which bytes are changed, cut off or added; sealed anew or not.
int visible_set(const uint8_t* data, size_t size) {
    static const Shapes shapes;
    Context* context = nullptr;
    expect(create_context({}, &context).ok(), "a context is made");
    MeshId meshes[2];
    for (int m = 0; m < 2; ++m) {
        MeshDesc desc;
        desc.rest_positions = {shapes.positions[m], 4, 12};
        desc.indices = shapes.indices;
        desc.index_count = 9;
        expect(add_mesh(context, desc, &meshes[m]).ok(), "a mesh is added");
    }
    VisibleSet* made = nullptr;
    expect(create_visible_set(context, meshes, 2, Quality::draft, 2, &made).ok(), "a set is made");
    std::vector<uint8_t> file(visible_set_bytes(made));
    expect(write_visible_set(made, file.data(), file.size()).ok(), "a set is written");
    destroy_visible_set(context, made);

    Bytes in{data, size};
    const bool sealed = in.byte() & 1;
    while (!in.empty()) {
        const uint8_t what = in.byte();
        if (what == 0xFF) {
            file.resize(in.below(512));
        } else if (!file.empty()) {
            file[what % file.size()] = in.byte();
        }
    }
    if (sealed && file.size() >= 8) {
        const uint64_t sum = seal(file, file.size() - 8);
        std::memcpy(file.data() + file.size() - 8, &sum, 8);
    }
    VisibleSet* read = nullptr;
    const Status status = read_visible_set(context, meshes, 2, file.data(), file.size(), &read);
    expect(status.ok() == (read != nullptr), "a set is there or not");
    if (read) {
        std::vector<uint8_t> again(visible_set_bytes(read));
        expect(write_visible_set(read, again.data(), again.size()).ok(), "what was read is written");
        expect(again == file, "what was read is what was in the file");
        float transfer[2][4][25];
        FrameMesh frame[2];
        for (int m = 0; m < 2; ++m) {
            frame[m].mesh = meshes[m];
            frame[m].positions = {shapes.positions[m], 4, 12};
            frame[m].normals = {shapes.normals[m], 4, 12};
            frame[m].transfer = {transfer[m][0], 4, 100};
        }
        VisibleSetInfo info;
        expect(visible_set_info(read, &info).ok(), "it tells of itself");
        float parts[4];
        for (uint32_t segment = 0; segment < info.segments; ++segment) {
            for (uint32_t m = 0; m < 2; ++m) {
                expect(visible_set_parts(context, read, segment, m, meshes[m], parts, 4).ok(),
                       "it tells where it helps");
                for (const float part : parts) {
                    expect(part >= 0 && part <= 1, "a part is one of a whole");
#if defined(NUSSELT_PLANT)
                    // A host that counts by quarters, and forgets that a part may be the whole.
                    volatile int quarters[4] = {};
                    quarters[int(4 * part)] = 1;
#endif
                }
            }
        }
        expect(!visible_set_parts(context, read, info.segments, 0, meshes[0], parts, 4).ok(),
               "there is no segment past the last");
        FrameDesc desc;
        desc.meshes = frame;
        desc.mesh_count = 2;
        desc.quality = info.quality;
        desc.visible = read;
        desc.visible_segment = info.segments - 1;
        FrameId id;
        expect(submit(context, desc, &id).ok() && wait(context, id, nullptr).ok(), "frames take it");
    }
    destroy_visible_set(context, read);
    expect(destroy_context(context).ok(), "all is given back");
    return 0;
}

} // namespace nusselt::fuzz
