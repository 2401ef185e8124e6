// Output that is there whole or not at all.
#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace nusselt::tools {

// Writes beside `path` and renames, so that a reader finds the old file or the new one. Throws Failure.
void write_file(const std::string& path, std::string_view bytes);

// A directory of results. The files are gathered in a hidden directory on the same file system and appear in
// `path` when commit() is called; without it nothing is left behind, directories that were made for it
// included. Files that were in `path` before and aren't written again stay. The constructor fails at once
// where `path` can't be written.
class OutputDirectory {
public:
    explicit OutputDirectory(const std::string& path);
    ~OutputDirectory();
    OutputDirectory(const OutputDirectory&) = delete;
    OutputDirectory& operator=(const OutputDirectory&) = delete;

    // `name` is a file name, or SUBDIRECTORY/NAME.
    void add(const std::string& name, std::string_view bytes);
    void commit();

    const std::string& path() const { return path_; }

private:
    void open();
    void remove();
    friend bool abandon_output();

    std::string path_;
    std::string staging_;
    bool existed_ = false;
    bool committed_ = false;
    std::vector<std::string> names_;
    std::vector<std::string> made_; // parent directories, outermost first
};

// Removes what an OutputDirectory has gathered and keeps it from gathering more: whoever tries waits for
// ever, so the caller ends the process. False, and nothing done, where a directory was committed.
bool abandon_output();

} // namespace nusselt::tools
