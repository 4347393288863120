#!/usr/bin/env python3
"""Peak memory of whole processes that read and solve a BAL problem, ours beside stock Ceres, on Ladybug-49 and on a generated problem
of the size of a cathedral.

    benchmarks/memory_figures.py [--preset cathedral] [--build build] [--limit 1.2]

Needs the tools in the build directory and the data of INCERES_DATA_DIR (or ../shared/data beside the repository) for Ladybug; without
it that problem is skipped by name. Two iterations each: memory does not grow with more. One thread, stock's CHOLMOD too
(stock_environment.py). A minute. Exit code: 0 ours at most
`limit` times the leanest of stock's Schur solvers that factor, 1 more than that, 2 a problem could not be solved.
"""

import argparse
import os
import pathlib
import subprocess
import sys
import tempfile

from solve_once import SOLVERS, generate, solve

ROOT = pathlib.Path(__file__).resolve().parent.parent
DATA = pathlib.Path(os.environ.get("INCERES_DATA_DIR", ROOT.parent / "shared" / "data"))
STOCK = [name for name in SOLVERS if name.startswith(("stock, DENSE_SCHUR", "stock, SPARSE_SCHUR"))]  # in both orderings


def measure(build, name, path, limit):
    """Prints the rows of a problem; True if ours are within the limit."""
    peaks = {}
    for solver in SOLVERS:
        if solver.startswith("ours") or solver in STOCK:
            report = solve(build, path, solver, ["--max_num_iterations", "2"])
            if report is None:
                raise RuntimeError(f"{name}: {solver} could not solve it")
            peaks[solver] = report["peak_bytes"]
    leanest = min(peaks[solver] for solver in STOCK)
    for solver, peak in peaks.items():
        verdict = "" if solver in STOCK else "yes" if peak <= limit * leanest else "**no**"
        print(f"| {name} | {solver} | {peak / 2**20:.0f} | {peak / leanest:.2f} | {verdict} |", flush=True)
    return all(peak <= limit * leanest for solver, peak in peaks.items() if solver not in STOCK)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--build", type=pathlib.Path, default=ROOT / "build")
    parser.add_argument("--preset", default="cathedral", help="the generated problem, as bal_generate calls it")
    parser.add_argument("--limit", type=float, default=1.2, help="times the leanest stock")
    arguments = parser.parse_args()
    print(f"| problem | solver | peak, MiB | of the leanest stock | at most {arguments.limit:g} |\n|---|---|---|---|---|")
    fine = True
    try:
        ladybug = DATA / "bal/problem-49-7776-pre.txt"
        if ladybug.exists():
            fine = measure(arguments.build, "Ladybug-49", ladybug, arguments.limit)
        else:
            print(f"Ladybug-49: skipped, {ladybug} is missing")
        with tempfile.TemporaryDirectory() as folder:
            generated = pathlib.Path(folder) / "generated.txt"
            generate(arguments.build, ["--preset", arguments.preset], generated)
            fine = measure(arguments.build, arguments.preset, generated, arguments.limit) and fine
    except (OSError, RuntimeError, subprocess.CalledProcessError) as error:
        print(f"memory_figures.py: {error}", file=sys.stderr)
        return 2
    return 0 if fine else 1


if __name__ == "__main__":
    sys.exit(main())
