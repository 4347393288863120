#!/usr/bin/env python3
"""One solve of Ladybug-49 from the file's start: ours in incremental mode against the time stock Ceres needs to get as close.

    benchmarks/one_shot.py [--repeats 11]
    benchmarks/one_shot.py --grid

Ours ends by its own function tolerance (1e-6); stock runs on (LM, function tolerance 0) in each of its configurations, and counts until
its cost is within 1e-5 of 13,344.24. One process a run, in turn, the time of the solve call; one thread, stock's CHOLMOD too
(stock_environment.py).

--grid plays ours from initial dampings of 1e-5 to 1e-1. There is no initial radius to vary beside it: in Levenberg-Marquardt it is
1/damping, and incremental steps have none before the first is refused. (At 1e-6 ours ends at 14,109 and stock at 13,421.)

Needs build/bin/bal_solve and the data of INCERES_DATA_DIR (or ../shared/data beside the repository). Leave the machine alone meanwhile.
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
LADYBUG = DATA / "bal/problem-49-7776-pre.txt"
MINIMUM = 13344.24
CLOSE = 1e-5

OURS = {
    "ours, built-in factors": ["--mode", "incremental", "--max_num_iterations", "100", "--builtin_factors"],
    "ours, AutoDiff": ["--mode", "incremental", "--max_num_iterations", "100"],
}
STOCK = {
    f"stock, {solver}{text}": ["--solver", "ceres", "--linear_solver", solver, "--max_num_iterations", "34", "--function_tolerance", "0", *flag]
    for solver in ("dense_schur", "sparse_schur")
    for text, flag in (("", []), (", landmarks first", ["--landmarks_first"]))
}


def solve(flags):
    with tempfile.TemporaryDirectory() as folder:
        report = pathlib.Path(folder) / "report.json"
        command = [str(ROOT / "build/bin/bal_solve"), "--input", str(LADYBUG), "--json", str(report), *flags]
        subprocess.run(command, check=True, env=stock_environment(), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        return json.loads(report.read_text(encoding="utf-8"))


def is_close(cost):
    return cost <= MINIMUM * (1.0 + CLOSE)


def seconds_until_close(report):
    for row in report["trace"]:
        if is_close(row["cost"]):
            return row["seconds"]
    raise SystemExit(f"{report['solver']} came no closer than {report['final_cost']}")


def compare(repeats):
    seconds = {name: [] for name in (*OURS, *STOCK)}
    costs = {}
    for _ in range(repeats):
        for name, flags in {**OURS, **STOCK}.items():
            report = solve(flags)
            seconds[name].append(report["seconds"] if name in OURS else seconds_until_close(report))
            costs[name] = report["final_cost"]
            if not is_close(report["final_cost"]):
                raise SystemExit(f"{name} ended at {report['final_cost']}, which is not within {CLOSE} of {MINIMUM}")
    medians = {name: statistics.median(values) for name, values in seconds.items()}
    best = min(STOCK, key=medians.get)
    print("| solver | median | ratio to the fastest stock | final cost |\n|---|---|---|---|")
    for name, median in medians.items():
        print(f"| {name} | {1e3 * median:.0f} ms | **{median / medians[best]:.3f}** | {costs[name]:.2f} |")


def play_grid():
    """Every start has to end close; exits with an error if one does not."""
    print("| initial damping |" + "".join(f" {name} |" for name in OURS) + "\n|---|" + "---|" * len(OURS))
    far = []
    for exponent in range(-5, 0):
        row = f"| 1e{exponent} |"
        for name, flags in OURS.items():
            report = solve([*flags, "--initial_trust_region_radius", f"1e{-exponent}"])
            row += f" {report['final_cost']:.3f}, {report['iterations']} iterations |"
            if not is_close(report["final_cost"]):
                far.append(f"{name} from 1e{exponent}")
        print(row, flush=True)
    if far:
        raise SystemExit(f"not within {CLOSE} of {MINIMUM}: " + "; ".join(far))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    what = parser.add_mutually_exclusive_group()
    what.add_argument("--repeats", type=int, default=11)
    what.add_argument("--grid", action="store_true", help="only where ours ends from other initial dampings")
    arguments = parser.parse_args()
    if arguments.grid:
        play_grid()
    else:
        compare(arguments.repeats)
    return 0


if __name__ == "__main__":
    sys.exit(main())
