// What each thread did when, as a Chrome trace: open it in ui.perfetto.dev or chrome://tracing.
#pragma once

#include <chrono>
#include <cstdint>
#include <cstdio>
#include <vector>

struct Event {
    const char* name;
    double us;
    char phase; // B or E
};

inline thread_local uint32_t this_thread = 0;        // 0 is the main thread, then the workers
inline std::vector<std::vector<Event>> trace_events; // by thread, as many as were reserved

inline void record(const char* name, char phase) {
    if (trace_events.empty()) return;
    std::vector<Event>& mine = trace_events[this_thread];
    const std::chrono::duration<double, std::micro> now = std::chrono::steady_clock::now().time_since_epoch();
    if (mine.size() < mine.capacity()) mine.push_back({name, now.count(), phase});
}

// With the signature of nusselt's profiler hook.
inline void begin_zone(void*, const char* name) {
    record(name, 'B');
}
inline void end_zone(void*, const char* name) {
    record(name, 'E');
}

inline bool write_trace(const char* path) {
    std::FILE* file = std::fopen(path, "w");
    if (!file) return false;
    std::fputs("{\"traceEvents\":[{}", file);
    for (size_t thread = 0; thread < trace_events.size(); ++thread)
        for (const Event& e : trace_events[thread])
            std::fprintf(file, ",\n{\"ph\":\"%c\",\"name\":\"%s\",\"pid\":1,\"tid\":%zu,\"ts\":%.3f}",
                         e.phase, e.name, thread, e.us - trace_events[0][0].us);
    std::fputs("]}\n", file);
    return std::fclose(file) == 0;
}
