// A progress bar on a terminal; nothing in a pipe. And the wish to stop.
#pragma once

#include <atomic>
#include <chrono>
#include <string>

namespace nusselt::tools {

// Set by SIGINT and SIGTERM once watch_signals() was called. Long work looks at it and ends with
// throw_if_interrupted.
std::atomic<bool>& interrupted();
void watch_signals();
void throw_if_interrupted();

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
