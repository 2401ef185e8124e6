// Where the error lies: the model in false colours.
#pragma once

#include "tools/image/image.h"
#include "tools/trace/assembly.h"

#include <glm/vec3.hpp>

#include <cstdint>
#include <vector>

namespace nusselt::tools {

// Relative error of each vertex from blue (1e-3 and less) over green and yellow (1e-1) to red (1 and more),
// on a logarithmic scale. Grey: no reference, or sees under 1 %; darker grey: dark. Not clear receivers are
// mixed with grey.
Picture error_picture(const Assembly& all, const glm::vec3& view_direction, const std::vector<float>& ours,
                      const std::vector<float>& reference, const std::vector<uint32_t>& receivers,
                      const std::vector<uint8_t>& clear);

// The scale's colour of an error, linear RGB.
glm::vec3 error_color(double error);

} // namespace nusselt::tools
