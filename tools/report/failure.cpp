#include "tools/report/failure.h"

namespace nusselt::tools {

std::string printable(const std::string& text) {
    constexpr size_t longest = 400;
    std::string result;
    for (const char c : text) {
        if (result.size() == longest) return result + "...";
        const auto byte = static_cast<unsigned char>(c);
        result += byte < 0x20 || byte == 0x7F ? '?' : c;
    }
    return result;
}

std::string failure_line(const std::string& subject, const std::string& text) {
    return "nusselt: " + printable(subject) + ": " + printable(text);
}

} // namespace nusselt::tools
