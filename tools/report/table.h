// A table of texts.
#pragma once

#include <string>
#include <vector>

namespace nusselt::tools {

struct Table {
    std::vector<std::string> columns;
    std::vector<std::vector<std::string>> rows;
};
// Aligned columns, a line each.
std::string to_text(const Table& table);
std::string to_markdown(const Table& table);

} // namespace nusselt::tools
