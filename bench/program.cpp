#include "bench/program.h"

#include "nusselt/nusselt.h"

#include <benchmark/benchmark.h>

int main(int argc, char** argv) {
    benchmark::AddCustomContext("configuration", nusselt::configuration());
    nusselt::bench::register_all();
    benchmark::Initialize(&argc, argv);
    if (benchmark::ReportUnrecognizedArguments(argc, argv)) return 1;
    benchmark::RunSpecifiedBenchmarks();
    benchmark::Shutdown();
    return 0;
}
