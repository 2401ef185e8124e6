// A progress bar on a terminal; nothing in a pipe.
#pragma once

#include <chrono>
#include <string>

namespace nusselt::tools {

class Progress {
public:
    explicit Progress(std::string label);
    ~Progress();
    Progress(const Progress&) = delete;
    Progress& operator=(const Progress&) = delete;

    // `done` in [0, 1]. Draws at most twenty times a second. One thread at a time.
    void show(double done, const std::string& detail = {});

private:
    std::string label_;
    bool terminal_;
    bool drawn_ = false;
    std::chrono::steady_clock::time_point last_{};
};

} // namespace nusselt::tools
