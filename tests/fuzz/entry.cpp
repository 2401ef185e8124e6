#include "tests/fuzz/fuzz.h"

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
    return nusselt::fuzz::NUSSELT_FUZZ_TARGET(data, size);
}
