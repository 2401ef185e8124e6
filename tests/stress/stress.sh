#!/usr/bin/env bash
# All stress tests and fuzz targets within a budget, and the ledger of what was run. Called by ./nusselt.sh stress, from
# the repository's root: stress.sh MINUTES RELEASE_BUILD [FUZZ_BUILD]. Exits 1 where anything failed, a fuzzer found
# something, or a planted bug was not found. NUSSELT_RUN: a command in front of each program ("nice -n 10").
set -uo pipefail

minutes=$1
release=$2
fuzz=${3:-}
work=build/stress
read -ra run <<<"${NUSSELT_RUN:-}"
mkdir -p "$work"
failed=0
revision=$(git describe --always --dirty) # that of the programs: the tree may change within the hour

figures=$work/figures.tsv
: >"$figures"
frames=$((minutes * 10800))
[[ $frames -gt 216000 ]] && frames=216000 # an hour at 60 Hz
seed=${NUSSELT_STRESS_SEED:-$(date +%s)}
results=$work/results.tsv
: >"$results"
for test in stress_kernels_test stress_frame_test stress_faults_test program_faults_test; do
    start=$SECONDS
    if NUSSELT_LEDGER=$figures NUSSELT_STRESS_CASES=20000 NUSSELT_STRESS_FRAMES=$frames NUSSELT_STRESS_SEED=$seed \
        "${run[@]}" "$release/tests/$test" >"$work/$test.log" 2>&1; then
        outcome=passed
    else
        outcome=FAILED
        failed=1
        grep -E 'Failure|FAILED|seed' "$work/$test.log" | head -20 >&2
    fi
    printf '%s\t%s\t%s\t%s\n' "$test" "$(grep -c '^\[       OK' "$work/$test.log")" "$outcome" $((SECONDS - start)) >>"$results"
    echo "$test: $outcome"
done

: >"$work/fuzz.tsv"
if [[ -n $fuzz ]]; then
    # What the tests have left of the budget, half of it at least; planted bugs are found within seconds.
    left=$((minutes * 60 - SECONDS))
    [[ $left -lt $((minutes * 30)) ]] && left=$((minutes * 30))
    seconds=$((left / $(find "$fuzz/fuzz" -name 'fuzz_*' | wc -l)))
    tests/fuzz/fuzz.sh "$((seconds < 3 ? 3 : seconds))" "$fuzz" "$work" || failed=1
fi

tests/stress/ledger.sh "$work" "$seed" "$frames" "$revision" || failed=1
exit $failed
