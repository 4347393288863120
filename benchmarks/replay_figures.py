#!/usr/bin/env python3
"""Plays the replays that the incremental solver is judged by and prints each figure beside its limit.

    benchmarks/replay_figures.py [--build build] [--only TEXT] [--keep FOLDER] [--nooptimum]

Needs bin/replay in the build directory and the data of INCERES_DATA_DIR (or ../shared/data beside the repository); a replay whose
file is missing is skipped by name. One thread, stock's CHOLMOD too (stock_environment.py). Leave the machine alone meanwhile. Exit
code: 0 all figures within their limits, 1 one is not, 2 a replay could not be played.
"""

import argparse
import json
import os
import pathlib
import subprocess
import sys
import tempfile

from stock_environment import stock_environment

ROOT = pathlib.Path(__file__).resolve().parent.parent
DATA = pathlib.Path(os.environ.get("INCERES_DATA_DIR", ROOT.parent / "shared" / "data"))
LADYBUG = f"bal:{DATA}/bal/problem-49-7776-pre.txt"
FR3 = f"kf:{DATA}/keyframes/fr3_office.kf"
TOLERANCE = 1e-6


def at(*path):
    """The value under these keys of a report; None if there is none."""

    def get(report):
        for key in path:
            report = report.get(key) if report is not None else None
        return report

    return get


def largest_work_growth(report):
    """The largest growth in percent of a count of work that is not negligible; each count is printed by replay itself."""
    flat = report["flat"]
    growths = [growth for name, growth in flat["growth_percent"]["work"].items()
               if growth is not None and flat["early"]["work"][name] >= 10]
    return max(growths, default=None)


def num_in_excess(report):
    return len(report["steps_in_excess"])


MEDIAN = ("median step, ours / stock", at("ratio_median"))
TOTAL = ("all steps, ours / stock", at("ratio_total"))
FAILED = ("our steps that failed", at("failed_steps", "ours"), 0)
OUR_MEDIAN = ("our median step, ms", at("ours_ms", "median"))
EXCESS = ("largest relative excess over the batch optimum", at("max_relative_cost_excess"), TOLERANCE)
IN_EXCESS = ("steps above it", num_in_excess, 0)

# Of problems that no constant was chosen on.
GROWING = [(*MEDIAN, None), (*TOTAL, None), ("worst step that closes a loop, ours / stock", at("worst_loop_ratio"), None), (*OUR_MEDIAN, None),
           EXCESS, IN_EXCESS, FAILED]

# What is played, the flags, and the figures: what it is, how to find it in the report, the largest value (None: to be seen).
REPLAYS = [
    ("Ladybug-49, intrinsics held", LADYBUG, [], [(*MEDIAN, 0.10), (*TOTAL, 0.20), EXCESS, IN_EXCESS, FAILED]),
    ("Ladybug-49, free intrinsics", LADYBUG, ["--free_intrinsics"],
     [(*MEDIAN, 0.10), (*TOTAL, 0.20), EXCESS, IN_EXCESS, FAILED]),
    ("Ladybug-49, torture: free intrinsics, no priors", LADYBUG, ["--free_intrinsics", "--no_priors", "--nooptimum"],
     [(*TOTAL, 0.20), FAILED, ("steps after which stock's cost is lower", at("lower", "stock"), None),
      ("steps of stock that failed", at("failed_steps", "stock"), None),
      ("iterations of stock whose linear solve failed", at("stock_steps", "invalid_steps"), None)]),
    ("fr3_office, stock with AutoDiff, DENSE_SCHUR, DOGLEG", FR3, ["--stock_autodiff"],
     [(*MEDIAN, 0.03), (*TOTAL, None), ("worst step that closes a loop, ours / stock", at("worst_loop_ratio"), 0.4), (*OUR_MEDIAN, 2.0),
      ("our p95, ms (EIBA's is 5)", at("ours_ms", "p95"), 5.0),
      ("all our steps, ms (EIBA's take 230)", at("ours_ms", "total"), 230.0), EXCESS, IN_EXCESS, FAILED]),
    ("fr3_office, both with AutoDiff", FR3, ["--autodiff", "--nooptimum"], [(*MEDIAN, None), (*TOTAL, None), FAILED]),
    ("KITTI stereo odometry", f"stereo:{DATA}/stereo", [], GROWING),
    ("M3500, the first 1,000 poses", f"g2o:{DATA}/pose_graph/M3500.g2o", ["--steps", "1000"], GROWING),
    ("intel", f"g2o:{DATA}/pose_graph/intel.g2o", [], GROWING),
    ("parking-garage", f"g2o:{DATA}/pose_graph/parking-garage.g2o", [], GROWING),
    ("path of 2,000 cameras, no loops", "path:2000", ["--nostock", "--flat"],
     [("growth of a step's time, step 200 to the last hundred, %", at("flat", "growth_percent", "ms"), 20.0),
      ("largest growth of a count of work, %", largest_work_growth, 20.0),
      ("growth of the bytes per step, %", at("flat", "growth_percent", "bytes_per_step"), 20.0), (*OUR_MEDIAN, None), FAILED]),
]


def play(build, problem, flags, report):
    command = [build / "bin/replay", "--problem", problem, "--mode", "incremental", "--function_tolerance", str(TOLERANCE),
               "--print_every", "1000000", "--json", report, *flags]
    # Exit code 1 with a report: a solve of ours failed, which is one of the figures.
    report.unlink(missing_ok=True)
    result = subprocess.run([str(part) for part in command], env=stock_environment(), stdout=subprocess.DEVNULL, stderr=subprocess.PIPE,
                            text=True, check=False)
    if not report.exists():
        raise RuntimeError(f"{problem}: {result.stderr.strip()}")
    return json.loads(report.read_text(encoding="utf-8"))


def print_figure(text, value, largest):
    """Prints the row; True if the figure is within its limit, or has none."""
    fine = largest is None or (value is not None and value <= largest)
    shown = "not measured" if value is None else f"{value:.3g}"
    limit = "" if largest is None else f"at most {largest:g}"
    verdict = "" if largest is None else "yes" if fine else "**no**"
    print(f"| {text} | {shown} | {limit} | {verdict} |", flush=True)
    return fine


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--build", type=pathlib.Path, default=ROOT / "build", help="the build directory")
    parser.add_argument("--only", default="", help="only the replays whose name contains this")
    parser.add_argument("--keep", type=pathlib.Path, help="keep the JSON reports in this folder")
    parser.add_argument("--nooptimum", action="store_true", help="do not look for the batch optimum: much faster, excesses are missing")
    arguments = parser.parse_args()
    fine, played = True, 0
    with tempfile.TemporaryDirectory() as temporary:
        folder = arguments.keep or pathlib.Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        for number, (name, problem, flags, figures) in enumerate(REPLAYS):
            if arguments.only not in name:
                continue
            kind, _, file = problem.partition(":")
            if kind != "path" and not pathlib.Path(file).exists():
                print(f"\n{name}: skipped, {file} is missing")
                continue
            if arguments.nooptimum:
                flags = [*flags, "--nooptimum"]
                figures = [figure for figure in figures if figure not in (EXCESS, IN_EXCESS)]
            try:
                report = play(arguments.build, problem, flags, folder / f"replay-{number}.json")
            except (OSError, RuntimeError) as error:
                print(f"{name}: {error}", file=sys.stderr)
                return 2
            played += 1
            print(f"\n{name}: {report['steps']} steps\nours: {report['ours']}\nstock: {report['stock'] or 'not played'}\n")
            print("| figure | measured | limit | within it |\n|---|---|---|---|")
            for text, value_of, largest in figures:
                fine = print_figure(text, value_of(report), largest) and fine
    return (0 if fine else 1) if played > 0 else 2


if __name__ == "__main__":
    sys.exit(main())
