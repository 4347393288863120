#!/usr/bin/env python3
"""What a covariance costs after an Update of a living pose graph: the table of docs/incremental.md.

    benchmarks/live_covariance_figures.py [FILE.g2o…] [--repeats 3] [--tolerance 1e-4] [--steps 0] [--build build]

Plays each graph pose by pose (replay --covariance; without files M3500 below INCERES_DATA_DIR or ../shared/data) and asks after
each Update for the undamped marginal of the newest pose, then of another. Of each step the least time of the repeats counts: a
step is the same work every time, and what is above it is the machine's. A row has microseconds, and in brackets the share of the
Update's median. One thread; leave the machine alone meanwhile.
"""

import argparse
import json
import os
import pathlib
import statistics
import subprocess
import sys
import tempfile

from stock_environment import stock_environment

ROOT = pathlib.Path(__file__).resolve().parent.parent
DATA = pathlib.Path(os.environ.get("INCERES_DATA_DIR", ROOT.parent / "shared" / "data"))
COVARIANCES = {"newest pose": "covariance_ns_newest", "another pose": "covariance_ns_any"}


def play(tool, path, arguments):
    """Microseconds of each step: the Update's, and of each covariance that was to be had."""
    with tempfile.NamedTemporaryFile(suffix=".json") as report:
        command = [tool, "--problem", f"g2o:{path}", "--nostock", "--nooptimum", "--covariance", "--function_tolerance",
                   str(arguments.tolerance), "--steps", str(arguments.steps), "--print_every", "1000000", "--json", report.name]
        done = subprocess.run(command, env=stock_environment(1), capture_output=True, text=True, check=False)
        if done.returncode != 0:
            raise RuntimeError(f"{path}: {done.stderr.strip()}")
        steps = [row["ours"] for row in json.load(report)["rows"]]
    times = {"Update": [1e3 * step["ms"] for step in steps]}
    for name, key in COVARIANCES.items():
        times[name] = [1e-3 * step["work"][key] if key in step["work"] else None for step in steps]
    return times


def least_of(runs, name):
    columns = zip(*(run[name] for run in runs))
    return [min(column) for column in columns if None not in column]


def print_rows(path, runs):
    median_update = statistics.median(least_of(runs, "Update"))
    for name in runs[0]:
        times = least_of(runs, name)
        cells = [f"{value:.0f} ({value / median_update:.2f})" for value in (statistics.median(times), statistics.mean(times), max(times))]
        print(f"| {path.stem} | {name} | {len(times)} | {' | '.join(cells)} |", flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("files", nargs="*", type=pathlib.Path)
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--tolerance", type=float, default=1e-4, help="the function tolerance")
    parser.add_argument("--steps", type=int, default=0, help="poses to play; 0: all")
    parser.add_argument("--build", type=pathlib.Path, default=ROOT / "build", help="the build directory")
    arguments = parser.parse_args()
    print("| file | what | steps | median, µs | mean | largest |\n" + "|---" * 6 + "|", flush=True)
    try:
        for path in arguments.files or [DATA / "pose_graph" / "M3500.g2o"]:
            print_rows(path, [play(arguments.build.resolve() / "bin" / "replay", path, arguments) for _ in range(arguments.repeats)])
    except (OSError, RuntimeError, KeyError) as error:
        print(error, file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
