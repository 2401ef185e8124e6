// What more threads bring.
#pragma once

#include "tools/compare/measure.h"
#include "tools/compare/moment.h"

namespace nusselt::tools {

// Qualities standard and fine on 1, 2, ... threads in turn; into report.scaling. Stops when interrupted.
void measure_scaling(const scenes::Scene& scene, const MeasureOptions& options,
                     const std::vector<Moment>& moments, SceneReport& report);

} // namespace nusselt::tools
