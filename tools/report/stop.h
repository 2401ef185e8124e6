// The wish to stop, and an end within a tenth of a second.
#pragma once

#include <atomic>
#include <thread>

namespace nusselt::tools {

// Set by SIGINT and SIGTERM once watch_signals() was called. Long work looks at it and ends with
// throw_if_interrupted.
std::atomic<bool>& interrupted();
void watch_signals();
void throw_if_interrupted();

// While one lives, the program ends soon after a signal whatever it is doing: loading a large model, adding
// it, a long frame. Work that has not ended by itself within 20 ms is left where it is, an OutputDirectory
// that has not committed is removed, and the process exits as throw_if_interrupted would have made it. Not
// while a command has something to tell. One at a time.
class PromptStop {
public:
    PromptStop();
    ~PromptStop();
    PromptStop(const PromptStop&) = delete;
    PromptStop& operator=(const PromptStop&) = delete;

private:
    std::atomic<bool> left_{false};
    std::thread thread_;
};

} // namespace nusselt::tools
