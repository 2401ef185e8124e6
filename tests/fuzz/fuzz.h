// The fuzz targets: each takes any bytes and stops the process where a promise is broken. One body each, run
// by libFuzzer (entry.cpp) and, over the kept inputs, by every test run (replay_test.cpp). With NUSSELT_PLANT
// a target has a bug of a kind that was found in the wild; the fuzzer must find it, or it proves nothing.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <string>

namespace nusselt::fuzz {

int gltf(const uint8_t* data, size_t size);        // a .gltf's bytes
int gltf_struct(const uint8_t* data, size_t size); // a valid scene in which some fields are broken
int glb(const uint8_t* data, size_t size);         // chunks made of bytes
int skin(const uint8_t* data, size_t size);        // weights, joints and transforms of any bits
int hdr(const uint8_t* data, size_t size);
int exr(const uint8_t* data, size_t size);
int obj_ply(const uint8_t* data, size_t size);
int mask_diff(const uint8_t* data, size_t size); // raw triangles through every instruction set
int sh(const uint8_t* data, size_t size);
int api(const uint8_t* data, size_t size);         // calls on one to four threads
int cli(const uint8_t* data, size_t size);         // command lines
int visible_set(const uint8_t* data, size_t size); // a file of a visible set, changed

// Says what, and aborts.
[[noreturn]] void broken(const char* what);
inline void expect(bool holds, const char* what) {
    if (!holds) broken(what);
}

// Bytes taken one after the other; zeros when they are used up.
struct Bytes {
    const uint8_t* data;
    size_t size, at = 0;

    bool empty() const { return at >= size; }
    uint8_t byte() { return at < size ? data[at++] : uint8_t(0); }
    uint32_t below(uint32_t count) {
        return count ? (byte() | uint32_t(count > 256 ? byte() : 0) << 8) % count : 0;
    }
    uint32_t word() {
        uint32_t value = 0;
        for (uint32_t i = 0; i < 4; ++i)
            value |= uint32_t(byte()) << 8 * i;
        return value;
    }
    float raw_float() {
        const uint32_t bits = word();
        float value;
        std::memcpy(&value, &bits, 4);
        return value;
    }
    float small_float() { return (float(byte()) - 128) / 64; }
};

} // namespace nusselt::fuzz
