#!/usr/bin/env bash
# docs/trust-ledger.md, from what the stress tests and the fuzzers left in WORK: ledger.sh WORK SEED FRAMES REVISION. From
# the repository's root.
set -euo pipefail

work=$1
seed=$2
frames=$3
revision=$4
{
    echo "# Ledger of the last stress run"
    echo
    echo "Written by \`./nusselt.sh stress\`; not by hand. Seed $seed, revision $revision," \
        "$(date -u +%Y-%m-%d), $(grep -m1 'model name' /proc/cpuinfo | cut -d: -f2 | sed 's/^ //'), $(nproc) processors."
    if [[ -n ${NUSSELT_RUN:-} ]]; then
        echo "Each program ran under \`$NUSSELT_RUN\`, and whatever it measures in seconds is worse for it."
    fi
    echo
    echo "| program | tests passed | outcome | seconds |"
    echo "|---|---|---|---|"
    awk -F'\t' '{printf "| `%s` | %s | %s | %s |\n", $1, $2, $3, $4}' "$work/results.tsv"
    echo
    echo "20,000 random cases a property, $frames frames of animation."
    echo
    echo "| figure | value | unit |"
    echo "|---|---|---|"
    awk -F'\t' '{printf "| %s | %s | %s |\n", $1, $2, $3}' "$work/figures.tsv"
    echo
    if [[ -s $work/fuzz.tsv ]]; then
        echo "| fuzz target | seconds | executions | edges covered | found | planted bug found |"
        echo "|---|---|---|---|---|---|"
        awk -F'\t' '{printf "| `%s` | %s | %s | %s | %s | %s |\n", $1, $2, $3, $4, $5, $6}' "$work/fuzz.tsv"
    else
        echo "Not fuzzed in this run."
    fi
} >docs/trust-ledger.md
echo "ledger: docs/trust-ledger.md"
