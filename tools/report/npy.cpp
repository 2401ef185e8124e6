#include "tools/report/npy.h"

#include <bit>

namespace nusselt::tools {

static_assert(std::endian::native == std::endian::little, "the arrays are written as they lie in memory");

namespace {

std::string npy_bytes(const char* type, const void* data, size_t item, const std::vector<size_t>& shape) {
    std::string header = std::string("{'descr': '") + type + "', 'fortran_order': False, 'shape': (";
    size_t count = 1;
    for (const size_t extent : shape) {
        header += std::to_string(extent) + ", ";
        count *= extent;
    }
    // A tuple of one keeps its comma.
    header.resize(header.size() - (shape.size() == 1 ? 1 : shape.empty() ? 0 : 2));
    header += "), }";
    // The format asks for the data to start on a multiple of 64 and for the header to end with a line feed.
    constexpr size_t prefix = 10;
    header.append(63 - (prefix + header.size()) % 64, ' ');
    header += '\n';

    std::string bytes("\x93NUMPY\x01\x00", 8);
    bytes += static_cast<char>(header.size() & 0xFF);
    bytes += static_cast<char>(header.size() >> 8);
    bytes += header;
    if (count > 0) bytes.append(static_cast<const char*>(data), count * item);
    return bytes;
}

} // namespace

std::string npy(const float* data, const std::vector<size_t>& shape) {
    return npy_bytes("<f4", data, 4, shape);
}

std::string npy(const uint32_t* data, const std::vector<size_t>& shape) {
    return npy_bytes("<u4", data, 4, shape);
}

std::string npy(const uint8_t* data, const std::vector<size_t>& shape) {
    return npy_bytes("|u1", data, 1, shape);
}

std::string npy(const int8_t* data, const std::vector<size_t>& shape) {
    return npy_bytes("|i1", data, 1, shape);
}

std::string npy_half(const uint16_t* data, const std::vector<size_t>& shape) {
    return npy_bytes("<f2", data, 2, shape);
}

} // namespace nusselt::tools
