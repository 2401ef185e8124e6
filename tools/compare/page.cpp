#include "tools/compare/report.h"

#include <nlohmann/json.hpp>

namespace nusselt::tools {

std::string report_page(const Comparison& comparison) {
    return "<!doctype html><pre>" + terminal_table(comparison) + "</pre>";
}

} // namespace nusselt::tools
