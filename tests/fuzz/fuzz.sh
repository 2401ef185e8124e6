#!/usr/bin/env bash
# Runs every fuzz target, and proves that each sees: the same target with a planted bug must stop. Called by
# ./nusselt.sh fuzz and stress, from the repository's root: fuzz.sh SECONDS FUZZ_BUILD WORK [TARGET...]. Inputs that broke
# something are kept in tests/fuzz/regress. Writes WORK/fuzz.tsv: target, seconds, executions, edges covered, what was
# found, when the planted bug was. Exits 1 where something was found, or a planted bug was not. NUSSELT_FUZZ_SEED: where
# the fuzzers start (default: somewhere else each time). NUSSELT_RUN: a command in front of each program ("nice -n 10").
set -uo pipefail

seconds=$1
build=$2
work=$3
shift 3
here=tests/fuzz
read -ra run <<<"${NUSSELT_RUN:-}"
targets=("$@")
if [[ ${#targets[@]} == 0 ]]; then
    for program in "$build"/fuzz/fuzz_*; do
        targets+=("${program##*/fuzz_}")
    done
fi
failed=0
mkdir -p "$work"
: >"$work/fuzz.tsv"
for target in "${targets[@]}"; do
    mkdir -p "$work/corpus/$target" "$here/regress/$target" "$work/planted/$target" \
        "$work/planted_corpus/$target"
    # What a fuzzer learns goes to the first folder that it is given.
    options=(-timeout=20 -rss_limit_mb=2048 -malloc_limit_mb=1024 -print_final_stats=1 -close_fd_mask=3 -max_len=16384)
    log=$work/fuzz_$target.log
    if "${run[@]}" "$build/fuzz/fuzz_$target" "${options[@]}" -max_total_time="$seconds" -seed="${NUSSELT_FUZZ_SEED:-0}" \
        -artifact_prefix="$here/regress/$target/" "$work/corpus/$target" "$here/seeds/$target" "$here/regress/$target" \
        >"$log" 2>&1; then
        found=nothing
    else
        found=FOUND
        failed=1
        echo "fuzz_$target found something: see $here/regress/$target and $log" >&2
    fi
    start=$SECONDS
    # A crash of the kind that was planted, and not a program that does not start.
    if ! "${run[@]}" "$build/fuzz/planted_$target" "${options[@]}" -max_total_time=$((seconds > 180 ? seconds : 180)) -seed=1 \
        -artifact_prefix="$work/planted/$target/" "$work/planted_corpus/$target" "$here/seeds/$target" >"$work/planted_$target.log" 2>&1 &&
        grep -q '^SUMMARY: ' "$work/planted_$target.log"; then
        planted="in $((SECONDS - start)) s"
    else
        planted=MISSED
        failed=1
        echo "planted_$target: the planted bug was not found, see $work/planted_$target.log" >&2
    fi
    rmdir "$here/regress/$target" 2>/dev/null
    printf '%s\t%s\t%s\t%s\t%s\t%s\n' "$target" "$seconds" "$(awk '/number_of_executed_units/ {print $2}' "$log")" \
        "$(grep -o 'cov: [0-9]*' "$log" | tail -1 | cut -d' ' -f2)" "$found" "$planted" | tee -a "$work/fuzz.tsv"
done
exit $failed
