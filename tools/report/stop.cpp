#include "tools/report/stop.h"

#include "tools/report/failure.h"
#include "tools/report/output.h"

#include <cerrno>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <fcntl.h>
#include <functional>
#include <system_error>
#include <unistd.h>

namespace nusselt::tools {

namespace {

constexpr auto grace = std::chrono::milliseconds(20);
constexpr char by_signal = 's', by_owner = 'o';

std::atomic<bool> stop{false};
// The pipe on which a PromptStop waits: a signal handler may do little more than write to it.
std::atomic<int> wake{-1};
static_assert(std::atomic<bool>::is_always_lock_free && std::atomic<int>::is_always_lock_free,
              "the signal handler uses them");

void notify(char why) {
    const int pipe = wake.load();
    if (pipe >= 0 && ::write(pipe, &why, 1) < 0) {
        // A full pipe: it is awake already.
    }
}

void on_signal(int number) {
    const int error = errno;
    stop.store(true);
    notify(by_signal);
    // A second one ends the program the usual way.
    std::signal(number, SIG_DFL);
    errno = error;
}

Failure interruption() {
    return {"interrupted", "nothing was written; run it again"};
}

// `left`: who sets it first ends the program, this thread or the one whose work it is.
void end_promptly(int pipe, std::atomic<bool>& left) {
    char why = 0;
    ssize_t count;
    while ((count = ::read(pipe, &why, 1)) < 0 && errno == EINTR) {
    }
    if (count == 1 && why == by_signal) {
        std::this_thread::sleep_for(grace);
        if (!left && abandon_output() && !left.exchange(true)) {
            const Failure failure = interruption();
            std::fprintf(stderr, "%s%s\n", isatty(STDERR_FILENO) == 1 ? "\r\033[K" : "",
                         failure_line(failure.subject, failure.what()).c_str());
            std::fflush(stderr);
            ::_exit(failure.exit_code);
        }
    }
    ::close(pipe);
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
    if (stop.load(std::memory_order_relaxed)) throw interruption();
}

PromptStop::PromptStop() {
    // Without a pipe or a thread, work that looks at interrupted() still ends.
    int ends[2];
    if (::pipe2(ends, O_CLOEXEC) != 0) return;
    try {
        thread_ = std::thread(end_promptly, ends[0], std::ref(left_));
    } catch (const std::system_error&) {
        ::close(ends[0]);
        ::close(ends[1]);
        return;
    }
    wake.store(ends[1]);
    if (stop.load()) notify(by_signal); // it came before the pipe
}

PromptStop::~PromptStop() {
    if (!thread_.joinable()) return;
    left_.exchange(true);
    notify(by_owner);
    thread_.join(); // does not return where the other was first
    wake.store(-1); // not closed: a handler may be about to write to it
}

} // namespace nusselt::tools
