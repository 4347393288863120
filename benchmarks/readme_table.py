#!/usr/bin/env python3
"""Measures the table of the README: ours against stock Ceres on the problems named below, one row a run of ab_compare.

    benchmarks/readme_table.py [--repeats 11] [--only TEXT]

Needs build/bin/ab_compare and the data of INCERES_DATA_DIR (or ../shared/data beside the repository). Leave the machine alone meanwhile.
"""

import argparse
import json
import os
import pathlib
import subprocess
import sys
import tempfile

ROOT = pathlib.Path(__file__).resolve().parent.parent
DATA = pathlib.Path(os.environ.get("INCERES_DATA_DIR", ROOT.parent / "shared" / "data"))
FIFTY = ["--max_num_iterations", "50", "--function_tolerance", "0", "--gradient_tolerance", "0", "--parameter_tolerance", "0"]
LADYBUG = f"bal:{DATA}/bal/problem-49-7776-pre.txt"

# What the row says, the problem, the flags.
ROWS = [
    ("Ladybug-49, LM, 50 iterations, AutoDiff, 1 thread", LADYBUG, FIFTY),
    ("the same, 2 threads", LADYBUG, FIFTY + ["--num_threads", "2"]),
    ("the same, our built-in factors, 1 thread", LADYBUG, FIFTY + ["--builtin_factors"]),
    ("the same, our built-in factors, 2 threads", LADYBUG, FIFTY + ["--builtin_factors", "--num_threads", "2"]),
    ("the same, analytic cost functions for both, 1 thread", LADYBUG, FIFTY + ["--analytic"]),
    ("the same, analytic cost functions for both, 2 threads", LADYBUG, FIFTY + ["--analytic", "--num_threads", "2"]),
    ("Ladybug-49, Dog-Leg, 50 iterations, AutoDiff, 1 thread", LADYBUG, FIFTY + ["--trust_region", "dogleg"]),
    ("bundled street, 16 cameras, LM, AutoDiff, 1 thread", f"bal:{ROOT}/bal_data/street-16-1200-pre.txt", []),
    ("sphere.g2o, Dog-Leg, AutoDiff, 1 thread", f"g2o:{DATA}/pose_graph/sphere.g2o", ["--trust_region", "dogleg"]),
    ("M3500.g2o, LM, AutoDiff, 1 thread", f"g2o:{DATA}/pose_graph/M3500.g2o", []),
    ("M3500.g2o, Dog-Leg, AutoDiff, 1 thread", f"g2o:{DATA}/pose_graph/M3500.g2o", ["--trust_region", "dogleg"]),
    ("sphere.g2o, incremental mode, Dog-Leg", f"g2o:{DATA}/pose_graph/sphere.g2o", ["--mode", "incremental", "--trust_region", "dogleg"]),
    ("M3500.g2o, incremental mode, Dog-Leg", f"g2o:{DATA}/pose_graph/M3500.g2o", ["--mode", "incremental", "--trust_region", "dogleg"]),
]


def measure(problem, flags, repeats):
    with tempfile.TemporaryDirectory() as folder:
        report = pathlib.Path(folder) / "report.json"
        command = [ROOT / "build/bin/ab_compare", "--problem", problem, "--repeats", str(repeats), "--json", report, *flags]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        return json.loads(report.read_text(encoding="utf-8"))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repeats", type=int, default=11)
    parser.add_argument("--only", default="", help="only the rows whose text contains this")
    arguments = parser.parse_args()
    print("| problem | ours | fastest stock | ratio | relative difference of final costs |\n|---|---|---|---|---|")
    for text, problem, flags in ROWS:
        if arguments.only not in text:
            continue
        report = measure(problem, flags, arguments.repeats)
        ours = next(run for run in report["runs"] if run["solver"] == "inceres")
        stock = min((run for run in report["runs"] if run["solver"] == "ceres"), key=lambda run: run["seconds"]["median"])
        print(
            f"| {text} | {1e3 * ours['seconds']['median']:.0f} ms | {1e3 * stock['seconds']['median']:.0f} ms "
            f"({stock['configuration'].upper()}) | **{report['ratio_to_best_stock']['median']:.2f}** "
            f"| {report['relative_cost_difference']:.0e} |",
            flush=True,
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
