#include "tools/commands/arguments.h"

namespace nusselt::tools {

std::vector<std::string> split_at_colons(const std::string& text) {
    std::vector<std::string> parts(1);
    for (const char c : text) {
        if (c == ':') {
            parts.emplace_back();
        } else {
            parts.back() += c;
        }
    }
    return parts;
}

} // namespace nusselt::tools
