#include "tests/fuzz/fuzz.h"
#include "tests/fuzz/model_checks.h"
#include "tools/load/formats.h"

#include <cstdlib>

namespace nusselt::fuzz {

int gltf(const uint8_t* data, size_t size) {
#if defined(NUSSELT_PLANT)
    // A loader that trusts a buffer's byteLength.
    const std::string text(reinterpret_cast<const char*>(data), size);
    const size_t at = text.find("\"byteLength\":");
    if (at != std::string::npos) {
        const unsigned long length = std::strtoul(text.c_str() + at + 13, nullptr, 10);
        const load::Bytes buffer(64);
        if (length > 64 && length < 100000) {
            volatile uint8_t last = buffer.data()[length];
            (void)last;
        }
    }
#endif
    load_gltf(data, size);
    return 0;
}

} // namespace nusselt::fuzz
