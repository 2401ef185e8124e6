// How many instructions a kernel executes: with the time, its issue rate, which is told against what the
// machine can issue.
#pragma once

#include <cstddef>
#include <functional>

namespace nusselt::bench {

// Of `run` over its inputs 0 ... inputs - 1, over the sum of their `items`. By the processor's counter where
// the system lends it, over all inputs; otherwise by stepping a child process through inputs from all over,
// as many as a second or two allows. 0: this system does neither.
double instructions_per_item(size_t inputs, const std::function<void(size_t)>& run,
                             const std::function<double(size_t)>& items);

// Which of these it is, for reports.
const char* counting_method();

// Instructions a second that one core executes at most, of additions that don't wait for each other: the best
// of three mixes of general and 128-bit registers. 0: not known for this processor.
double issue_peak();

} // namespace nusselt::bench
