// Where the error lies: the model in false colours.
#pragma once

#include "tools/compare/figures.h"
#include "tools/compare/moment.h"
#include "tools/image/image.h"

#include <glm/vec3.hpp>

#include <array>
#include <cstdint>
#include <vector>

namespace nusselt::tools {

// Relative error of each vertex from blue (1e-3 and less) over green and yellow (1e-1) to red (1 and more),
// on a logarithmic scale. Grey: no reference, or sees under 1 %; darker grey: dark. Not clear receivers are
// mixed with grey. The camera looks along `view_direction`, or from the side or end that shows more of the
// `worst` vertices; those in view are ringed, the first of them with a double ring.
Picture error_picture(const Moment& moment, const glm::vec3& view_direction, const std::vector<float>& ours,
                      const std::vector<Worst>& worst);

// Ours and the reference, lit by the same light in the same view. The reference must be of all receivers.
std::array<Picture, 2> lit_pictures(const Moment& moment, const glm::vec3& view_direction,
                                    const std::vector<float>& ours, const Light& light);

// The scale's colour of an error, linear RGB.
glm::vec3 error_color(double error);

} // namespace nusselt::tools
