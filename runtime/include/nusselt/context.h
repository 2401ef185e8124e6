// A context: memory, executor, tables and meshes. Several may live in one process; the plane tables are
// shared.
#pragma once

#include "nusselt/allocator.h"
#include "nusselt/clock.h"
#include "nusselt/executor.h"
#include "nusselt/profiler.h"
#include "nusselt/status.h"

#include <cstddef>
#include <cstdint>

namespace nusselt {

// Instruction sets, those of x86-64 in rising order; neon is that of aarch64. All give the same bits.
enum class Isa : uint32_t { scalar = 0, sse4 = 1, avx2 = 2, avx512 = 3, neon = 4, best = 0xFFFFFFFFu };

// "scalar", "sse4", "avx2", "avx512", "neon"; "best" for Isa::best; "unknown" for anything else. Never null.
const char* isa_name(Isa isa);
// The instruction set of that name, `best` included; false and *out untouched where there is none.
bool isa_from_name(const char* name, Isa* out);
// Whether this build has it and this machine and its operating system run it.
bool isa_available(Isa isa);

struct Context;

struct ContextDesc {
    Allocator allocator; // default: the C++ heap
    Executor executor;   // default (enqueue null): serial_executor()
    Isa isa = Isa::best; // `best` takes NUSSELT_ISA from the environment first, then the highest available
    Profiler profiler;   // default: none, and nothing is spent on it
    Clock clock;         // of time budgets; default: std::chrono::steady_clock
};

// Makes a context. `unsupported`: the instruction set is not available here (or NUSSELT_ISA names no
// available one). Builds the tables of a quality when the first context asks for it (under a second together,
// at most 29 MB in a process); they are released with the last context.
Status create_context(const ContextDesc& desc, Context** out);

// Destroys the context and its meshes. `busy` while a frame is in flight: wait for it first. Null is ignored.
Status destroy_context(Context* context);

// The instruction set in use; never `best`.
Isa context_isa(const Context* context);

} // namespace nusselt
