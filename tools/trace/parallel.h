// A loop over blocks on all of the machine's threads, for tracing and drawing.
#pragma once

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <exception>
#include <mutex>
#include <thread>
#include <vector>

namespace nusselt::tools {

// Calls body(begin, end) for blocks of at most `block` that cover [0, count), in rising order of begin but
// side by side. What a body throws is thrown here, after all threads have stopped.
template<class Body>
void parallel_blocks(size_t count, size_t block, const Body& body) {
    std::atomic<size_t> next{0};
    std::exception_ptr thrown;
    std::mutex thrown_mutex;
    const auto work = [&] {
        try {
            for (size_t begin = next.fetch_add(block); begin < count; begin = next.fetch_add(block))
                body(begin, std::min(begin + block, count));
        } catch (...) {
            next = count;
            const std::lock_guard lock(thrown_mutex);
            if (!thrown) thrown = std::current_exception();
        }
    };
    const size_t blocks = (count + block - 1) / block;
    const size_t threads = std::min<size_t>(std::max(1u, std::thread::hardware_concurrency()), blocks);
    std::vector<std::jthread> others;
    try {
        for (size_t k = 1; k < threads; ++k)
            others.emplace_back(work);
    } catch (const std::system_error&) {
        // Fewer threads then.
    }
    work();
    others.clear();
    if (thrown) std::rethrow_exception(thrown);
}

} // namespace nusselt::tools
