#!/usr/bin/env python3
"""Compares two JSON files of run_benchmarks.py, or of Google Benchmark itself: what became faster, what slower.

    benchmarks/compare_runs.py BEFORE.json AFTER.json [--threshold 0.05] [--all]

A benchmark with a label (the instruction set, or the problem) is compared with one of the same label only. It has changed if the
medians of its runs differ by more than the threshold and all runs of one file are on one side of all runs of the other (with one run
each: by the medians alone). Prints those, with --all every one. Exit code: 0 nothing became slower, 1 something did, 2 a file cannot
be read, or the two have no benchmark in common.
"""

import argparse
import json
import pathlib
import statistics
import sys

NANOSECONDS = {"ns": 1.0, "us": 1e3, "ms": 1e6, "s": 1e9}


def read_times(path):
    """{name and label: [real time in ns of each run]}; aggregates and skipped benchmarks are left out."""
    times = {}
    for benchmark in json.loads(path.read_text(encoding="utf-8"))["benchmarks"]:
        if benchmark.get("run_type") == "aggregate" or benchmark.get("error_occurred", False):
            continue
        label = benchmark.get("label", "")
        name = f"{benchmark['name']} ({label})" if label else benchmark["name"]
        times.setdefault(name, []).append(benchmark["real_time"] * NANOSECONDS[benchmark["time_unit"]])
    return times


def verdict(before, after, threshold):
    ratio = statistics.median(after) / statistics.median(before)
    if ratio < 1.0 - threshold and max(after) < min(before):
        return "faster"
    if ratio > 1.0 + threshold and min(after) > max(before):
        return "**slower**"
    return ""


def show(nanoseconds):
    for unit in ("s", "ms", "us"):
        if nanoseconds >= NANOSECONDS[unit]:
            return f"{nanoseconds / NANOSECONDS[unit]:.3g} {unit}"
    return f"{nanoseconds:.3g} ns"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("before", type=pathlib.Path)
    parser.add_argument("after", type=pathlib.Path)
    parser.add_argument("--threshold", type=float, default=0.05, help="relative change of the median that counts")
    parser.add_argument("--all", action="store_true", help="also what has not changed")
    arguments = parser.parse_args()
    try:
        before, after = read_times(arguments.before), read_times(arguments.after)
    except (OSError, ValueError, KeyError) as error:
        print(f"compare_runs.py: {error!r}", file=sys.stderr)
        return 2
    common = [name for name in before if name in after]
    if not common:
        print("compare_runs.py: the two files have no benchmark in common", file=sys.stderr)
        return 2
    verdicts = {name: verdict(before[name], after[name], arguments.threshold) for name in common}
    print("| benchmark | before | after | after / before | |\n|---|---|---|---|---|")
    for name in common:
        if arguments.all or verdicts[name]:
            old, new = statistics.median(before[name]), statistics.median(after[name])
            print(f"| {name} | {show(old)} | {show(new)} | {new / old:.2f} | {verdicts[name]} |")
    slower = sum(text == "**slower**" for text in verdicts.values())
    faster = sum(text == "faster" for text in verdicts.values())
    print(f"\n{len(common)} compared: {faster} faster, {slower} slower; only before: {len(before) - len(common)}, only after: "
          f"{len(after) - len(common)}")
    return 1 if slower else 0


if __name__ == "__main__":
    sys.exit(main())
