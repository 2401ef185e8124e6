#include "tools/report/table.h"

#include <algorithm>

namespace nusselt::tools {

std::string to_text(const Table& table) {
    std::vector<size_t> widths;
    for (size_t k = 0; k < table.columns.size(); ++k) {
        widths.push_back(table.columns[k].size());
        for (const auto& row : table.rows)
            widths[k] = std::max(widths[k], row[k].size());
    }
    std::string text;
    const auto line = [&](const std::vector<std::string>& cells) {
        std::string row;
        for (size_t k = 0; k < cells.size(); ++k)
            row += cells[k] + std::string(widths[k] - cells[k].size() + 2, ' ');
        row.erase(row.find_last_not_of(' ') + 1);
        text += row + "\n";
    };
    line(table.columns);
    for (const auto& row : table.rows)
        line(row);
    return text;
}

std::string to_markdown(const Table& table) {
    std::string text;
    const auto line = [&](const std::vector<std::string>& cells) {
        text += "|";
        for (const std::string& cell : cells)
            text += " " + cell + " |";
        text += "\n";
    };
    line(table.columns);
    line(std::vector<std::string>(table.columns.size(), "---"));
    for (const auto& row : table.rows)
        line(row);
    return text;
}

} // namespace nusselt::tools
