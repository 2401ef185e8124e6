// Inside the loader a problem is thrown; load_model catches it. Nothing passes its border.
#pragma once

#include "tools/load/model.h"

#include <string>
#include <string_view>
#include <vector>

namespace nusselt::load {

// Text from a file, fit for a message: printable ASCII only, the rest as \xNN, at most `limit` characters.
std::string printable(std::string_view text, size_t limit = 40);

[[noreturn]] void fail(std::string code, std::string where, std::string what, std::string cure);

// Adds a line to Model::warnings: where, what was found, what becomes of it, and a stable code. A file with a
// flaw in every part says it 32 times.
void warn(std::vector<std::string>& warnings, const char* code, const std::string& text);

// The common cures.
extern const char* const export_again;    // a file that breaks the format's rules
extern const char* const file_incomplete; // a file cut short

} // namespace nusselt::load
