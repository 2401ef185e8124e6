// What ends the program early: one line on stderr and an exit code.
#pragma once

#include <stdexcept>
#include <string>

namespace nusselt::tools {

constexpr int exit_failure = 1;
constexpr int exit_usage = 2;

// `subject` is the file or the option that it is about; `text` says what is wrong, and what to do.
struct Failure : std::runtime_error {
    std::string subject;
    int exit_code;

    Failure(std::string about, const std::string& text, int code = exit_failure)
        : std::runtime_error(text), subject(std::move(about)), exit_code(code) {}
};

// `text` without control characters, which may come from a file's name or its contents and are written as
// '?'; cut at 400 bytes.
std::string printable(const std::string& text);

// The line "nusselt: SUBJECT: TEXT" without its end. Control characters, which may come from a file's name or
// its contents, are written as '?'; each part is cut at 400 bytes.
std::string failure_line(const std::string& subject, const std::string& text);

} // namespace nusselt::tools
