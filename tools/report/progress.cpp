#include "tools/report/progress.h"

#include <algorithm>
#include <cstdio>
#include <unistd.h>

namespace nusselt::tools {

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
