#!/usr/bin/env python3
"""Times problems in which much depends on which blocks are eliminated first, or on zeros in Jacobians, bare and with the drop-in
preloaded: few points seen by many cameras, many points seen by few, as many of both, streets, users' orderings, curves.

    benchmarks/elimination_figures.py [--build build] [--repetitions 11] [--only TEXT] [--seed 1]

Needs bin/elimination_problems (--benchmarks) and libinceres_dropin.so in the build directory. Bare and preloaded runs have the same
options and take turns, one run each per repetition; times are medians of Summary::total_time_in_seconds, memory is the process's
peak. All solves are on one thread, stock's CHOLMOD too (stock_environment.py). Leave the machine alone meanwhile. Exit code: 0 all
ratios within their limits and final costs stock's, 1 one is not, 2 a run could not be played.
"""

import argparse
import json
import pathlib
import statistics
import subprocess
import sys

from drop_in_figures import ROOT, find_dropin
from stock_environment import program_environment

COST_DIFFERENCE = 1e-6  # of final costs, at most
MEMORY = 2.0            # of stock's peak, at most

FEW_POINTS = {
    "500 cameras, 37 points of 166": ["--cameras", 500, "--long_points", 37, "--long_track", 166, "--intrinsics", 1],
    "1,000 cameras, 37 points of 333": ["--cameras", 1000, "--long_points", 37, "--long_track", 333, "--intrinsics", 1],
    "3,001 cameras, 41 points of 600": ["--cameras", 3001, "--long_points", 41, "--long_track", 600, "--intrinsics", 1],
    "1,201 cameras, 41 points of 240": ["--cameras", 1201, "--long_points", 41, "--long_track", 240, "--intrinsics", 1],
}
OTHERS = {
    "400 cameras, 300 points of 30": ["--cameras", 400, "--long_points", 300, "--long_track", 30],
    "20 cameras, 2,000 points of 6": ["--cameras", 20, "--points", 2000, "--track", 6],
    "200 cameras, 400 points of 12, anywhere": ["--cameras", 200, "--long_points", 400, "--long_track", 12],
    "street: 400 cameras, 8,000 points of 5": ["--cameras", 400, "--points", 8000, "--track", 5],
    "street and 10 points of 200": ["--cameras", 400, "--points", 4000, "--track", 5, "--long_points", 10, "--long_track", 200],
}
CURVES = {
    "curve: 151 control points, 800 observations": ["--curve", 151, "--observations", 800, "--iterations", 12],
    "curve: 40 control points, 1,500 observations": ["--curve", 40, "--observations", 1500, "--iterations", 12],
}


def figures():
    """(name, flags, largest ratio)."""
    for name, flags in FEW_POINTS.items():
        yield name, flags, 0.85
        yield f"{name}, SPARSE_NORMAL_CHOLESKY", [*flags, "--solver", "sparse_normal_cholesky"], 0.85
        yield f"{name}, cameras first", [*flags, "--ordering", "cameras"], 0.85
    # Points first fill all of S: of the larger problems stock would take minutes, and gigabytes.
    small = "200 cameras, 30 points of 70"
    yield f"{small}, points first", ["--cameras", 200, "--long_points", 30, "--long_track", 70, "--ordering", "points"], 0.85
    for name, flags in OTHERS.items():
        yield name, flags, 1.0
        yield f"{name}, SPARSE_NORMAL_CHOLESKY", [*flags, "--solver", "sparse_normal_cholesky"], 1.0
        yield f"{name}, points first", [*flags, "--ordering", "points"], 1.0
    for name, flags in CURVES.items():
        yield f"{name}, dynamic_sparsity", [*flags, "--solver", "sparse_normal_cholesky", "--dynamic", 1], 1.0
        yield name, [*flags, "--solver", "sparse_normal_cholesky", "--dynamic", 0], 1.0


def play(command, dropin=None):
    environment = program_environment("exact", dropin)
    result = subprocess.run([str(part) for part in command], env=environment, capture_output=True, text=True, check=False)
    if result.returncode != 0:
        raise RuntimeError(f"{' '.join(str(part) for part in command)}: {result.stdout.strip()} {result.stderr.strip()}")
    return json.loads(result.stdout)


def measure(name, command, dropin, repetitions, limit):
    """Prints a row; True if it is within its limits."""
    stock, ours = [], []
    for _ in range(repetitions):
        stock.append(play(command))
        ours.append(play(command, dropin))
    stock_ms = 1e3 * statistics.median(run["seconds"] for run in stock)
    ours_ms = 1e3 * statistics.median(run["seconds"] for run in ours)
    memory = statistics.median(run["peak_bytes"] for run in ours) / statistics.median(run["peak_bytes"] for run in stock)
    same_cost = abs(ours[0]["final_cost"] - stock[0]["final_cost"]) <= COST_DIFFERENCE * stock[0]["final_cost"]
    fine = same_cost and ours_ms <= limit * stock_ms and memory <= MEMORY
    verdict = "yes" if fine else "**no**" if same_cost else f"**no**, {ours[0]['final_cost']:g} for {stock[0]['final_cost']:g}"
    print(f"| {name} | {stock_ms:.1f} | {ours_ms:.1f} | {ours_ms / stock_ms:.2f} | {limit:g} | {memory:.2f} | {verdict} |", flush=True)
    return fine


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--build", type=pathlib.Path, default=ROOT / "build", help="the build directory")
    parser.add_argument("--repetitions", type=int, default=11, help="of every run, at least 1")
    parser.add_argument("--only", default="", help="only the problems whose name contains this")
    parser.add_argument("--seed", type=int, default=1, help="of the problems")
    arguments = parser.parse_args()
    if arguments.repetitions < 1:
        parser.error("--repetitions: at least 1")
    print(f"| problem | stock, ms | drop-in, ms | ratio | at most | peak memory, ratio | within limits, memory at most {MEMORY:g} |")
    print("|---|---|---|---|---|---|---|")
    fine, played = True, 0
    try:
        dropin = find_dropin(arguments.build)
        program = arguments.build / "bin" / "elimination_problems"
        for name, flags, limit in figures():
            if arguments.only in name:
                fine = measure(name, [program, "--seed", arguments.seed, *flags], dropin, arguments.repetitions, limit) and fine
                played += 1
    except (OSError, RuntimeError) as error:
        print(f"elimination_figures.py: {error}", file=sys.stderr)
        return 2
    return (0 if fine else 1) if played > 0 else 2


if __name__ == "__main__":
    sys.exit(main())
