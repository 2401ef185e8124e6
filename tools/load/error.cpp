#include "tools/load/error.h"

namespace nusselt::load {

void warn(std::vector<std::string>& warnings, const char* code, const std::string& text) {
    constexpr size_t most = 32;
    if (warnings.size() < most) warnings.push_back(text + " [" + code + "]");
    if (warnings.size() == most) warnings.push_back("and more of the kind [MORE_WARNINGS]");
}

const char* const export_again = "export it again";
const char* const file_incomplete = "the file is incomplete, fetch it again";

std::string printable(std::string_view text, size_t limit) {
    static const char digits[] = "0123456789abcdef";
    std::string out;
    for (const char c : text) {
        if (out.size() + 4 > limit) return out + "...";
        const auto byte = static_cast<unsigned char>(c);
        if (byte >= 0x20 && byte < 0x7F) {
            out += c;
        } else {
            out += "\\x";
            out += digits[byte >> 4];
            out += digits[byte & 15];
        }
    }
    return out;
}

void fail(std::string code, std::string where, std::string what, std::string cure) {
    throw LoadError{std::move(code), std::move(where), std::move(what), std::move(cure)};
}

std::string describe(const std::string& path, const LoadError& error) {
    std::string text = printable(path, 400) + ": " + error.what;
    if (!error.where.empty()) text += " (" + error.where + ")";
    if (!error.cure.empty()) text += "; " + error.cure;
    return text + " [" + error.code + "]";
}

} // namespace nusselt::load
