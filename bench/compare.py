#!/usr/bin/env python3
"""Compares two JSON files of Google Benchmark and says what changed beyond the noise.

usage: bench/compare.py BEFORE.json AFTER.json [--threshold PERCENT]

A benchmark counts as changed where its time moved by more than the threshold and by more than three times the
noise. The noise is the larger of two: that of the repetitions (--benchmark_repetitions; median absolute deviation),
and how far the benchmarks of the two files moved apart from each other: most of them don't change from one run to
the next, but a shared machine does, and repetitions within one run don't see it. What all of them moved by together
is told apart. Exit code: 0 nothing slower, 1 something slower, 2 usage.
"""
import argparse
import json
import math
import statistics
import sys


def read(path):
    with open(path, encoding="utf-8") as file:
        data = json.load(file)
    times, labels = {}, {}
    for run in data["benchmarks"]:
        if run.get("run_type") == "aggregate" or run.get("error_occurred") or run["name"].startswith("machine/"):
            continue
        name = run.get("run_name", run["name"])
        # Wall time where the benchmark asked for it: threads work outside the clock of the one that is measured.
        key = "real_time" if "/real_time" in name else "cpu_time"
        times.setdefault(name, []).append(run[key] * {"ns": 1, "us": 1e3, "ms": 1e6, "s": 1e9}[run["time_unit"]])
        labels[name] = run.get("label", "")
    return data.get("context", {}), times, labels


def spread(values):
    if len(values) < 3:
        return None
    middle = statistics.median(values)
    # 1.4826 makes the median absolute deviation that of a normal distribution; the median of n is that much surer.
    return 1.4826 * statistics.median(abs(v - middle) for v in values) / middle / math.sqrt(len(values))


def text(nanoseconds):
    for unit, size in (("s", 1e9), ("ms", 1e6), ("us", 1e3)):
        if nanoseconds >= size:
            return f"{nanoseconds / size:.3g} {unit}"
    return f"{nanoseconds:.3g} ns"


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("before")
    parser.add_argument("after")
    parser.add_argument("--threshold", type=float, default=3, help="percent below which nothing counts (default 3)")
    arguments = parser.parse_args()
    try:
        before_context, before, before_labels = read(arguments.before)
        after_context, after, after_labels = read(arguments.after)
    except (OSError, ValueError, KeyError) as error:
        print(f"compare.py: {error!r}; give two files written with --benchmark_out_format=json", file=sys.stderr)
        return 2

    for key in ("configuration", "num_cpus", "mhz_per_cpu"):
        if before_context.get(key) != after_context.get(key):
            print(f"{key}: {before_context.get(key)} -> {after_context.get(key)}")

    names = [name for name in before if name in after]
    moved = {name: math.log(statistics.median(after[name]) / statistics.median(before[name])) for name in names}
    together = statistics.median(moved.values()) if moved else 0
    common = 1.4826 * statistics.median(abs(m - together) for m in moved.values()) if moved else 0
    changed = []
    for name in names:
        own = [spread(before[name]), spread(after[name])]
        noise = common if None in own else max(common, math.hypot(*own))
        limit = max(3 * noise, math.log1p(arguments.threshold / 100))
        if abs(moved[name]) > limit:
            changed.append((moved[name], name, limit))

    for move, name, limit in sorted(changed):
        word = "faster" if move < 0 else "SLOWER"
        factor = math.exp(abs(move))
        print(f"{word} {factor:6.2f} x  {text(statistics.median(before[name])):>9} -> "
              f"{text(statistics.median(after[name])):>9}  {name}  (noise up to {math.exp(limit):.2f} x)")
    for name in names:
        if before_labels[name] != after_labels[name]:
            print(f"label: {name}: {before_labels[name]} -> {after_labels[name]}")
    for name in sorted(set(before) ^ set(after)):
        print(f"only in {'the first' if name in before else 'the second'}: {name}")
    slower = sum(move > 0 for move, _, _ in changed)
    print(f"{len(names)} compared: {len(changed) - slower} faster, {slower} slower, "
          f"{len(names) - len(changed)} within the noise; all together {100 * math.expm1(together):+.1f} %, "
          f"apart {100 * math.expm1(common):.1f} %")
    return 1 if slower else 0


if __name__ == "__main__":
    sys.exit(main())
