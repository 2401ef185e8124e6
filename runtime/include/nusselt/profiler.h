// The profiler hook: named zones of a host's profiler around the library's work.
#pragma once

namespace nusselt {

// `begin` and `end` come in pairs on one thread, nested properly, on as many threads at once as the executor
// has. `zone` is a static string: "nusselt submit", "nusselt wait" and "nusselt add_mesh" around those calls,
// and one for every piece of a frame's stages (from some microseconds to half a millisecond each):
// "nusselt extents", "nusselt scale", "nusselt points", "nusselt clusters", "nusselt bands", "nusselt
// receivers"; of several objects also "nusselt far"; with a history also "nusselt changes", "nusselt order"
// and "nusselt kept". The functions must not throw, block, or call the library. Both or neither.
struct Profiler {
    void* user = nullptr;
    void (*begin)(void* user, const char* zone) = nullptr;
    void (*end)(void* user, const char* zone) = nullptr;
};

} // namespace nusselt
