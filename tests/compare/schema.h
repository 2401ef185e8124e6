// Enough of JSON Schema to check our reports: type, properties, required, additionalProperties, items, enum,
// const, minimum, minItems; $ref to #/$defs/NAME.
#pragma once

#include <nlohmann/json_fwd.hpp>

#include <string>
#include <vector>

namespace nusselt::test {

// One line a violation.
std::vector<std::string> violations(const nlohmann::json& schema, const nlohmann::json& value);

} // namespace nusselt::test
