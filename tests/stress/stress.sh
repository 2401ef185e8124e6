#!/usr/bin/env bash
# All stress tests and fuzz targets within a budget, and the ledger of what was run. Called by ./nusselt.sh stress, from
# the repository's root: stress.sh MINUTES RELEASE_BUILD [FUZZ_BUILD]. Exits 1 where anything failed, a fuzzer found
# something, or a planted bug was not found.
set -uo pipefail

minutes=$1
release=$2
fuzz=${3:-}
here=tests/fuzz
work=build/stress
ledger=docs/trust-ledger.md
mkdir -p "$work" docs
failed=0

figures=$work/figures.tsv
: >"$figures"
frames=$((minutes * 7200))
[[ $frames -gt 216000 ]] && frames=216000 # an hour at 60 Hz
seed=${NUSSELT_STRESS_SEED:-$(date +%s)}
results=$work/results.tsv
: >"$results"
for test in stress_kernels_test stress_frame_test; do
    start=$SECONDS
    if NUSSELT_LEDGER=$figures NUSSELT_STRESS_CASES=20000 NUSSELT_STRESS_FRAMES=$frames NUSSELT_STRESS_SEED=$seed \
        "$release/tests/$test" >"$work/$test.log" 2>&1; then
        outcome=passed
    else
        outcome=FAILED
        failed=1
        grep -E 'Failure|FAILED|seed' "$work/$test.log" | head -20 >&2
    fi
    printf '%s\t%s\t%s\t%s\n' "$test" "$(grep -c '^\[       OK' "$work/$test.log")" "$outcome" $((SECONDS - start)) >>"$results"
    echo "$test: $outcome"
done

targets=(gltf gltf_struct glb hdr exr obj_ply mask_diff sh api cli)
fuzzed=$work/fuzz.tsv
: >"$fuzzed"
if [[ -n $fuzz ]]; then
    # Two parts of three of the budget, one in ten of that for the planted bugs at most.
    seconds=$((minutes * 40 / ${#targets[@]}))
    [[ $seconds -lt 5 ]] && seconds=5
    for target in "${targets[@]}"; do
        mkdir -p "$work/corpus/$target" "$here/regress/$target" "$work/planted/$target"
        options=(-max_total_time="$seconds" -timeout=20 -rss_limit_mb=2048 -malloc_limit_mb=1024 -print_final_stats=1
            -close_fd_mask=3 -max_len=16384)
        inputs=("$work/corpus/$target" "$here/seeds/$target" "$here/regress/$target")
        if "$fuzz/fuzz/fuzz_$target" "${options[@]}" -artifact_prefix="$here/regress/$target/" "${inputs[@]}" \
            >"$work/fuzz_$target.log" 2>&1; then
            outcome=nothing
        else
            outcome=FOUND
            failed=1
            echo "fuzz_$target found something: see $here/regress/$target and $work/fuzz_$target.log" >&2
        fi
        start=$SECONDS
        if "$fuzz/fuzz/planted_$target" "${options[@]}" -max_total_time=$((seconds > 60 ? seconds : 60)) \
            -artifact_prefix="$work/planted/$target/" "$here/seeds/$target" >"$work/planted_$target.log" 2>&1; then
            planted=MISSED
            failed=1
            echo "planted_$target: the planted bug was not found" >&2
        else
            planted="in $((SECONDS - start)) s"
        fi
        log=$work/fuzz_$target.log
        printf '%s\t%s\t%s\t%s\t%s\t%s\n' "$target" "$seconds" \
            "$(awk '/number_of_executed_units/ {print $2}' "$log")" \
            "$(grep -o 'cov: [0-9]*' "$log" | tail -1 | cut -d' ' -f2)" "$outcome" "$planted" >>"$fuzzed"
        rmdir "$here/regress/$target" 2>/dev/null
    done
    rmdir "$here/regress" 2>/dev/null
fi

{
    echo "# Ledger of the last stress run"
    echo
    echo "Written by \`./nusselt.sh stress $minutes\`; not by hand. Seed $seed, revision $(git describe --always --dirty)," \
        "$(date -u +%Y-%m-%d), $(grep -m1 'model name' /proc/cpuinfo | cut -d: -f2 | sed 's/^ //')."
    echo
    echo "| test | cases passed | outcome | seconds |"
    echo "|---|---|---|---|"
    awk -F'\t' '{printf "| `%s` | %s | %s | %s |\n", $1, $2, $3, $4}' "$results"
    echo
    echo "20,000 random cases a property, $frames frames of animation."
    echo
    echo "| figure | value | unit |"
    echo "|---|---|---|"
    awk -F'\t' '{printf "| %s | %s | %s |\n", $1, $2, $3}' "$figures"
    if [[ -n $fuzz ]]; then
        echo
        echo "| fuzz target | seconds | executions | edges covered | found | planted bug found |"
        echo "|---|---|---|---|---|---|"
        awk -F'\t' '{printf "| `%s` | %s | %s | %s | %s | %s |\n", $1, $2, $3, $4, $5, $6}' "$fuzzed"
    else
        echo
        echo "Not fuzzed: clang++ is not here."
    fi
} >"$ledger"
echo "ledger: $ledger"
exit $failed
