#include "tools/report/progress.h"

#include "tools/report/failure.h"

#include <algorithm>
#include <csignal>
#include <cstdio>
#include <unistd.h>

namespace nusselt::tools {

namespace {

std::atomic<bool> stop{false};
static_assert(std::atomic<bool>::is_always_lock_free, "the signal handler writes it");

void on_signal(int number) {
    stop.store(true);
    // A second one ends the program the usual way.
    std::signal(number, SIG_DFL);
}

} // namespace

std::atomic<bool>& interrupted() {
    return stop;
}

void watch_signals() {
    std::signal(SIGINT, on_signal);
    std::signal(SIGTERM, on_signal);
    // A reader of stdout that went away shows as a failed write.
    std::signal(SIGPIPE, SIG_IGN);
    // So does a file that may not grow as far.
    std::signal(SIGXFSZ, SIG_IGN);
}

void throw_if_interrupted() {
    if (stop.load(std::memory_order_relaxed))
        throw Failure("interrupted", "nothing was written; run it again");
}

Progress::Progress(std::string label) : label_(std::move(label)), terminal_(isatty(STDERR_FILENO) == 1) {}

Progress::~Progress() {
    if (drawn_) std::fputs("\r\033[K", stderr);
}

void Progress::show(double done, const std::string& detail) {
    if (!terminal_) return;
    const auto now = std::chrono::steady_clock::now();
    if (drawn_ && now - last_ < std::chrono::milliseconds(50)) return;
    last_ = now;
    drawn_ = true;
    constexpr int width = 30;
    const int filled = static_cast<int>(std::clamp(done, 0.0, 1.0) * width);
    std::string bar(static_cast<size_t>(filled), '#');
    bar.append(static_cast<size_t>(width - filled), '.');
    std::fprintf(stderr, "\r\033[K%s [%s] %3.0f %% %s", label_.c_str(), bar.c_str(),
                 100 * std::clamp(done, 0.0, 1.0), detail.c_str());
    std::fflush(stderr);
}

} // namespace nusselt::tools
