#pragma once

#include <string>
#include <string_view>

namespace nusselt::tools {

std::string base64(std::string_view bytes);

} // namespace nusselt::tools
