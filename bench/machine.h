// What this machine can do at most, measured: the roof over the kernels.
#pragma once

#include <cstddef>
#include <cstdint>

namespace nusselt::bench {

// Bytes a second that one core loads from a buffer of that size, read in order with the widest vectors.
double load_peak(size_t bytes);
// The same, cache lines in random order: what a table look-up can hope for.
double gather_peak(size_t bytes);
// Single-precision multiplications and additions a second of one core, not fused.
double flop_peak();

} // namespace nusselt::bench
