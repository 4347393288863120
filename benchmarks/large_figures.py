#!/usr/bin/env python3
"""Which solver for a large problem: seconds a step in generated cities of several sizes and street widths, by a sparse factor, by conjugate
gradients with two levels, and by what the automatic choice takes.

    benchmarks/large_figures.py [--build build] [--sizes 300,1000,2000] [--widths 16,64] [--repeats 1] [--steps 5] [--json grid.json]
    benchmarks/large_figures.py --kind collection --sizes 300,1000     # photos of the same sights instead; they have no widths

Each problem is solved for the same number of steps, by built-in factors on one thread, by each solver in turn, `repeats` times; what is
shown is the median of the seconds that a solve takes for elimination, factorization or conjugate gradients, and back-substitution, set-up
apart, divided by its linear solves, and the iterations of conjugate gradients for each. The last column is the automatic choice over the
better of the two: at most 1.1 is what it is meant for. Below the table: for each width from which size on conjugate gradients are the
faster, as far as the sizes show it.

The problems are synthetic. Seconds want a machine that does nothing else; iterations do not depend on it. Exit code: 0 measured, 1 the
automatic choice was above its limit somewhere, 2 a solve failed.
"""

import argparse
import json
import pathlib
import statistics
import sys
import tempfile

from solve_once import generate, solve

LIMIT = 1.1
FACTOR, TWO_LEVEL, AUTOMATIC = "factor", "two levels", "automatic"
FLAGS = {
    FACTOR: ["--linear_solver", "sparse_schur"],
    TWO_LEVEL: ["--linear_solver", "iterative_schur", "--preconditioner", "two_level"],
    AUTOMATIC: [],
}
STAGES = ("elimination", "factorization", "back_substitution")


def seconds_a_step(report):
    return sum(report["stage_seconds"][stage] for stage in STAGES) / max(1, report["work"]["linear_solves"])


def iterations_a_step(report):
    return report["work"]["conjugate_gradients"] / max(1, report["work"]["linear_solves"])


def measure_problem(build, flags, arguments):
    """{solver: {seconds, iterations, linear_solver}}; None if one failed."""
    runs = {name: [] for name in FLAGS}
    with tempfile.TemporaryDirectory() as folder:
        path = pathlib.Path(folder) / "problem.bal"
        generate(build, flags, path)
        for _ in range(arguments.repeats):
            for name, solver_flags in FLAGS.items():
                report = solve(build, path, "ours, built-in factors",
                               [*solver_flags, "--max_num_iterations", str(arguments.steps), "--function_tolerance", "0"])
                if report is None:
                    print(f"{name} failed", file=sys.stderr)
                    return None
                runs[name].append(report)
    return {name: {"seconds": statistics.median(seconds_a_step(report) for report in reports),
                   "iterations": iterations_a_step(reports[0]), "linear_solver": reports[0]["linear_solver"]}
            for name, reports in runs.items()}


def ratio_of(row):
    return row[AUTOMATIC]["seconds"] / min(row[FACTOR]["seconds"], row[TWO_LEVEL]["seconds"])


def show(size, width, row):
    cells = [f"{row[name]['seconds']:.4f}" for name in FLAGS]
    print(f"| {size} | {width or ''} | {cells[0]} | {cells[1]} | {row[TWO_LEVEL]['iterations']:.1f} | {cells[2]} "
          f"| {row[AUTOMATIC]['linear_solver']} | {ratio_of(row):.2f} |", flush=True)


def print_crossovers(rows, widths):
    print("\n| width | conjugate gradients are the faster from … cameras on |\n|---|---|")
    for width in widths:
        sizes = sorted(row["size"] for row in rows if row["width"] == width)
        wins = {row["size"]: row[TWO_LEVEL]["seconds"] < row[FACTOR]["seconds"] for row in rows if row["width"] == width}
        first = next((size for size in sizes if all(wins[larger] for larger in sizes if larger >= size)), None)
        print(f"| {width or ''} | {first if first is not None else 'more than ' + str(sizes[-1])} |")


def numbers(text):
    return [int(word) for word in text.split(",")]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--build", type=pathlib.Path, default=pathlib.Path("build"), help="the folder that holds bin/bal_solve")
    parser.add_argument("--kind", choices=("city", "collection"), default="city", help="streets, or photos of the same sights")
    parser.add_argument("--sizes", type=numbers, default=[300, 1000, 2000], help="cameras")
    parser.add_argument("--widths", type=numbers, default=[16, 64], help="of streets, meters")
    parser.add_argument("--seed", type=int, default=1, help="of the generator")
    parser.add_argument("--repeats", type=int, default=1, help="solves of each")
    parser.add_argument("--steps", type=int, default=5, help="of a solve")
    parser.add_argument("--json", type=pathlib.Path, help="all figures, for programs")
    arguments = parser.parse_args()
    widths = arguments.widths if arguments.kind == "city" else [None]
    rows = []
    print("| cameras | street width, m | factor, s a step | two levels, s a step | iterations a step | automatic, s a step | it takes "
          "| over the better |\n|---|---|---|---|---|---|---|---|")
    for width in widths:
        for size in arguments.sizes:
            flags = ["--preset", f"{arguments.kind}-{size}", "--seed", str(arguments.seed)]
            row = measure_problem(arguments.build, flags + (["--street_width", str(width)] if width else []), arguments)
            if row is None:
                return 2
            show(size, width, row)
            rows.append({"size": size, "width": width, **row})
    print_crossovers(rows, widths)
    if arguments.json:
        arguments.json.write_text(json.dumps(rows, indent=2), encoding="utf-8")
    return 0 if all(ratio_of(row) <= LIMIT for row in rows) else 1


if __name__ == "__main__":
    sys.exit(main())
