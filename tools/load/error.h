// Inside the loader a problem is thrown; load_model catches it. Nothing passes its border.
#pragma once

#include "tools/load/model.h"

#include <string>
#include <string_view>

namespace nusselt::load {

// Text from a file, fit for a message: printable ASCII only, the rest as \xNN, at most `limit` characters.
std::string printable(std::string_view text, size_t limit = 40);

[[noreturn]] void fail(std::string code, std::string where, std::string what, std::string cure);

// The common cures.
extern const char* const export_again;    // a file that breaks the format's rules
extern const char* const file_incomplete; // a file cut short

} // namespace nusselt::load
