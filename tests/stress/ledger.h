// Figures that the stress tests measure, for docs/trust-ledger.md, and how many cases a property is tried on.
#pragma once

#include <cstdint>
#include <string>

namespace nusselt::test {

// NUSSELT_STRESS_CASES from the environment, else 2000 (what CI can afford), 200 under the thread sanitizer;
// 20,000 in
// ./nusselt.sh stress.
uint64_t stress_cases();
// NUSSELT_STRESS_SEED, else 1. Printed once.
uint64_t stress_seed();

// Prints the figure, and appends "name <tab> value <tab> unit" to the file that NUSSELT_LEDGER names.
void figure(const std::string& name, double value, const std::string& unit);

} // namespace nusselt::test
