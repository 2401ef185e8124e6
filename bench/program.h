// A Google Benchmark program is a file of benchmarks and program.cpp.
#pragma once

namespace nusselt::bench {

// Defined by each program: registers its benchmarks, and what else its file's context should tell.
void register_all();

} // namespace nusselt::bench
