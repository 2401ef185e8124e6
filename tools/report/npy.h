// NumPy's .npy format, version 1.0, C order, little-endian.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

namespace nusselt::tools {

std::string npy(const float* data, const std::vector<size_t>& shape);         // '<f4'
std::string npy(const uint32_t* data, const std::vector<size_t>& shape);      // '<u4'
std::string npy(const uint8_t* data, const std::vector<size_t>& shape);       // '|u1'
std::string npy(const int8_t* data, const std::vector<size_t>& shape);        // '|i1'
std::string npy_half(const uint16_t* data, const std::vector<size_t>& shape); // '<f2', half floats

} // namespace nusselt::tools
