// Texts of the command line, in parts.
#pragma once

#include <string>
#include <vector>

namespace nusselt::tools {

// The parts of NAME:NUMBER:..., at least one; any of them may be empty.
std::vector<std::string> split_at_colons(const std::string& text);

} // namespace nusselt::tools
