#!/usr/bin/env python3
"""Measures the three problems of the thesis's table, ours against stock Ceres, and prints each ratio beside its limit.

    benchmarks/thesis_table.py [--build build] [--repeats 11] [--only TEXT] [--keep FOLDER]

Cubic is vio:cubic, Venice and Cathedral are the presets of bal_generate of their sizes. All solve by Dog-Leg, with one thread, with the
same analytic factors, which stock calls as cost functions, from the same start, until Ceres's default tolerances end it. Ours is the
core with Cholesky, the core with PCG (steps right to 1e-4), and inceres::Solve on stock's own ceres::Problem, which has
no limit. Stock runs in both orderings of DENSE_SCHUR and SPARSE_SCHUR, its CHOLMOD on one thread too (stock_environment.py); rounds are
interleaved, figures are medians over the rounds of whole solve calls. Leave the machine alone meanwhile. Exit code: 0 all within limits, 1 something is not, 2 a problem could not be run.
"""

import argparse
import json
import pathlib
import subprocess
import sys
import tempfile

from stock_environment import stock_environment

ROOT = pathlib.Path(__file__).resolve().parent.parent
SPARSE = ("sparse_schur", "sparse_schur_points_first")
STOCK = ("dense_schur", "dense_schur_points_first", *SPARSE)
COST_EXCESS = 1e-6  # relative, at most

# Name, preset of bal_generate (None: vio:cubic), largest ratio to the faster SPARSE_SCHUR and to the fastest stock of all.
PROBLEMS = [
    ("Cubic", None, 0.50, 0.60),
    ("Venice", "venice11", 0.45, 0.50),
    ("Cathedral", "cathedral", 0.45, 0.50),
]
# Name, flags, whether it has limits.
SOLVERS = [
    ("Cholesky", ["--builtin_factors"], True),
    ("PCG", ["--builtin_factors", "--linear_solver", "lagged_pcg"], True),
    ("inceres::Solve, Cholesky", [], False),
]


def run(command):
    result = subprocess.run([str(part) for part in command], env=stock_environment(), stdout=subprocess.DEVNULL, stderr=subprocess.PIPE,
                            text=True, check=False)
    if result.returncode not in (0, 3):  # 3: a cost above --tolerance, which is judged here
        raise RuntimeError(f"{' '.join(str(part) for part in command)}: {result.stderr.strip()}")


def problem_flags(binaries, preset, folder):
    """What ab_compare is given; generates the problem."""
    if preset is None:
        return ["--problem", "vio:cubic"]
    path = folder / f"{preset}.txt"
    run([binaries / "bal_generate", "--preset", preset, "--output", path])
    return ["--problem", f"bal:{path}", "--analytic"]


def measure(binaries, problem, flags, repeats, folder):
    report = folder / "report.json"
    run([binaries / "ab_compare", *problem, *flags, "--trust_region", "dogleg", "--configurations", ",".join(STOCK), "--repeats", repeats,
         "--json", report])
    return json.loads(report.read_text(encoding="utf-8"))


def judge(report, sparse_limit, fastest_limit):
    """The cells of a row after the solver's name, and whether all is within limits. Limits are None where nothing is."""
    ours = next(entry for entry in report["runs"] if entry["solver"] == "inceres")
    stock = [entry for entry in report["runs"] if entry["solver"] == "ceres"]
    median = lambda entry: entry["seconds"]["median"]
    sparse = min((entry for entry in stock if entry["configuration"] in SPARSE), key=median)
    fastest = min(stock, key=median)
    excess = report["relative_cost_difference"]
    fine, cells = True, [f"{1e3 * median(ours):.3g}"]
    for reference, limit in ((sparse, sparse_limit), (fastest, fastest_limit)):
        ratio = median(ours) / median(reference)
        fine = fine and (limit is None or ratio <= limit)
        cells += [f"{1e3 * median(reference):.3g} ({reference['configuration']})", f"**{ratio:.3f}**", "" if limit is None else f"{limit:.2f}"]
    iterations = {ours["iterations"], *(entry["iterations"] for entry in stock)}
    fine = fine and (sparse_limit is None or (excess <= COST_EXCESS and len(iterations) == 1))
    cells += [str(ours["iterations"]), str(sparse["iterations"]), f"{excess:.0e}"]
    return cells + ["" if sparse_limit is None else "yes" if fine else "**no**"], fine


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--build", type=pathlib.Path, default=ROOT / "build", help="the build directory")
    parser.add_argument("--repeats", type=int, default=11, help="rounds, at least 1")
    parser.add_argument("--only", default="", help="only the problems whose name contains this")
    parser.add_argument("--keep", type=pathlib.Path, help="keep the JSON reports in this folder")
    arguments = parser.parse_args()
    if arguments.repeats < 1:
        parser.error("--repeats: at least 1")
    chosen = [problem for problem in PROBLEMS if arguments.only in problem[0]]
    if not chosen:
        parser.error(f"--only {arguments.only}: there are {', '.join(problem[0] for problem in PROBLEMS)}")
    print("| problem | ours | ms | SPARSE_SCHUR ms | ratio | at most | fastest stock ms | ratio | at most | iterations | stock's | cost excess "
          "| within limits |\n|---|---|---|---|---|---|---|---|---|---|---|---|---|", flush=True)
    all_fine = True
    try:
        with tempfile.TemporaryDirectory() as temporary:
            folder = pathlib.Path(temporary)
            for name, preset, sparse_limit, fastest_limit in chosen:
                problem = problem_flags(arguments.build / "bin", preset, folder)
                for number, (solver, flags, is_limited) in enumerate(SOLVERS):
                    report = measure(arguments.build / "bin", problem, flags, arguments.repeats, folder)
                    cells, fine = judge(report, *((sparse_limit, fastest_limit) if is_limited else (None, None)))
                    all_fine = all_fine and fine
                    print(f"| {name} | {solver} | {' | '.join(cells)} |", flush=True)
                    if arguments.keep is not None:
                        arguments.keep.mkdir(parents=True, exist_ok=True)
                        (arguments.keep / f"{name}-{number}.json").write_text(json.dumps(report, indent=1), encoding="utf-8")
    except (OSError, RuntimeError) as error:
        print(error, file=sys.stderr)
        return 2
    return 0 if all_fine else 1


if __name__ == "__main__":
    sys.exit(main())
