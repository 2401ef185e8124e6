#include "tests/fuzz/fuzz.h"
#include "tests/fuzz/model_checks.h"
#include "tools/load/formats.h"

#include <algorithm>

namespace nusselt::fuzz {

namespace {

void put(load::Bytes& out, uint32_t value) {
    for (uint32_t i = 0; i < 4; ++i)
        out.push_back(uint8_t(value >> 8 * i));
}

// Mostly what it should be.
uint32_t about(Bytes& in, uint32_t right) {
    const uint8_t kind = in.byte();
    if (kind < 224) return right;
    if (kind < 240) return right + uint32_t(int32_t(int8_t(in.byte())));
    return in.word();
}

} // namespace

// A header and up to four chunks whose lengths, types and order are the input's.
int glb(const uint8_t* data, size_t size) {
    Bytes in{data, size};
    const std::string document =
        R"({"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0]}],"nodes":[{"mesh":0}],)"
        R"("meshes":[{"primitives":[{"attributes":{"POSITION":0}}]}],"buffers":[{"byteLength":36}],)"
        R"("bufferViews":[{"buffer":0,"byteLength":36}],)"
        R"("accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3","min":[0,0,0],"max":[1,1,0]}]} )";
    const float corners[9] = {0, 0, 0, 1, 0, 0, 0, 1, 0};
    load::Bytes body;
    const uint32_t chunks = in.below(5) ? 2 : in.below(5);
    for (uint32_t c = 0; c < chunks; ++c) {
        const bool json = c == 0 ? in.byte() < 250 : in.byte() > 250;
        load::Bytes content;
        if (in.byte() > 240) {
            for (uint32_t i = in.below(64); i > 0; --i)
                content.push_back(in.byte());
        } else if (json) {
            content.assign(document.begin(), document.end());
        } else {
            const auto* bytes = reinterpret_cast<const uint8_t*>(corners);
            content.assign(bytes, bytes + 36);
        }
        put(body, about(in, uint32_t(content.size())));
        put(body, about(in, json ? 0x4E4F534Au : 0x004E4942u));
        body.insert(body.end(), content.begin(), content.end());
    }
    load::Bytes file;
    put(file, about(in, 0x46546C67u));
    put(file, about(in, 2));
    put(file, about(in, uint32_t(body.size()) + 12));
    file.insert(file.end(), body.begin(), body.end());
    file.resize(std::min<size_t>(file.size(), about(in, uint32_t(file.size()))));
#if defined(NUSSELT_PLANT)
    // The missing "+ 8" of a chunk's header: tinygltf before 2.6.1.
    if (file.size() > 20) {
        uint32_t length = 0;
        std::memcpy(&length, file.data() + 12, 4);
        if (length <= file.size() - 12 && length > 0) {
            volatile uint8_t last = file.data()[20 + length - 1];
            (void)last;
        }
    }
#endif
    load_gltf(file.data(), file.size());
    return 0;
}

} // namespace nusselt::fuzz
