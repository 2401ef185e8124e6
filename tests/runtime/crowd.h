// Several objects in one frame, for the tests of how they see one another.
#pragma once

#include "tests/runtime/fixture.h"

namespace nusselt::test {

Posed moved(Posed mesh, const glm::vec3& by, uint32_t object);

// Fighters side by side, two a row, each at its own moment.
std::vector<Posed> crowd(Context* context, uint32_t count, float spacing);
std::vector<Posed> as_one(std::vector<Posed> meshes, uint32_t number = 0);

double norm(const std::array<float, 25>& a, const std::array<float, 25>& b);
// Of receivers that see at least a tenth of the sky: the mean of the differences over the sizes.
double difference(const Outputs& a, const Outputs& b);

// Without masks, so that far objects are multiplied into the transfer vectors.
Outputs run_far(Context* context, const std::vector<Posed>& meshes, FrameDesc settings = {});
Outputs each_alone(Context* context, const std::vector<Posed>& meshes);

} // namespace nusselt::test
