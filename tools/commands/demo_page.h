#pragma once

#include <nlohmann/json_fwd.hpp>

#include <string>

namespace nusselt::tools {

// The demo's page with everything in it; needs no network. `data`: run_demo says what it holds.
std::string demo_page(const nlohmann::ordered_json& data);

} // namespace nusselt::tools
