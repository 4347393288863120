#!/usr/bin/env python3
"""What Python costs: Ladybug-49 from arrays beside the tool in C++, and a factor in NumPy beside the
built-in one.

    PYTHONPATH=build/python/package benchmarks/python_figures.py [--rounds 11] [--input FILE]
                                                                 [--json FILE]

Each round, in turn: build/bin/bal_solve --builtin_factors (its own figure: the call of Solve alone),
inceres.bundle_adjust (the whole call, arrays in and out), and the same graph with built-in factors and
with tests/python/bal_family.py (the calls of solve; and where the time of the latter goes). One thread.
Medians of the rounds' ratios; exits with 1 if one exceeds its limit: 1.05, and 2. All end at the
same cost in as many iterations, or the figures are worth nothing and the script fails.

Needs build/bin/bal_solve and the data of INCERES_DATA_DIR (or ../shared/data beside the repository).
Leave the machine alone meanwhile.
"""

import argparse
import json
import os
import pathlib
import statistics
import subprocess
import sys
import tempfile
import time

import numpy as np

from stock_environment import stock_environment

ROOT = pathlib.Path(__file__).resolve().parent.parent
DATA = pathlib.Path(os.environ.get("INCERES_DATA_DIR", ROOT.parent / "shared" / "data"))
LADYBUG = DATA / "bal" / "problem-49-7776-pre.txt"
LIMITS = {"bundle_adjust / tool": 1.05, "NumPy factor / built-in factor": 2.0}
sys.path.insert(0, str(ROOT / "tests" / "python"))

import inceres  # noqa: E402
from bal_family import BalEvaluator  # noqa: E402


class TimedEvaluator(BalEvaluator):
    """Knows how long it took, with and without Jacobians."""

    def __init__(self):
        super().__init__()
        self.seconds = {"residuals": 0.0, "jacobians": 0.0}

    def __call__(self, measurements, parameters, wanted):
        start = time.perf_counter()
        returned = super().__call__(measurements, parameters, wanted)
        self.seconds["jacobians" if wanted else "residuals"] += time.perf_counter() - start
        return returned


def run_tool(path):
    """Seconds of Solve, final cost and iterations, by the tool in C++."""
    with tempfile.TemporaryDirectory() as folder:
        report = pathlib.Path(folder) / "report.json"
        subprocess.run(
            [ROOT / "build/bin/bal_solve", "--input", path, "--builtin_factors", "--json", report],
            check=True, env=stock_environment(), stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL)
        solved = json.loads(report.read_text(encoding="utf-8"))
    return solved["seconds"], solved["final_cost"], len(solved["trace"])


def run_arrays(problem):
    """The same of bundle_adjust."""
    start = time.perf_counter()
    result = inceres.bundle_adjust(*problem.arrays())
    seconds = time.perf_counter() - start
    return seconds, result.summary["final_cost"], len(result.summary["iterations"])


def run_graph(problem, family):
    """The same of solve(), with the summary."""
    graph = inceres.FactorGraph()
    cameras = graph.add_variables(problem.cameras)
    points = graph.add_variables(problem.points, "landmark")
    pairs = np.column_stack([cameras[problem.camera_indices], points[problem.point_indices]])
    graph.add_factors(graph.add_family(family), pairs, problem.observations)
    start = time.perf_counter()
    summary = graph.solve()
    seconds = time.perf_counter() - start
    return (seconds, summary["final_cost"], len(summary["iterations"])), summary


def run_round(path, problem):
    """Seconds of each, and of the stages of the solve with the NumPy factor."""
    evaluator = TimedEvaluator()
    runs = {"tool": run_tool(path), "bundle_adjust": run_arrays(problem)}
    runs["built-in factor"], _ = run_graph(problem, inceres.BalReprojection())
    runs["NumPy factor"], summary = run_graph(
        problem, inceres.CustomFamily(2, [9, 3], 2, evaluator, shared=True))
    _, cost, iterations = runs["tool"]
    for name, (_, other_cost, other_iterations) in runs.items():
        if abs(other_cost / cost - 1.0) > 1e-9 or other_iterations != iterations:
            sys.exit(f"{name}: {other_cost:.10g} after {other_iterations} rows; the tool: "
                     f"{cost:.10g} after {iterations}")
    stages = {f"solver's {name}": summary["seconds"][name]
              for name in ("residuals", "jacobians", "hessian", "elimination", "factorization")}
    stages.update({f"in Python, {name}": s for name, s in evaluator.seconds.items()})
    return {name: run[0] for name, run in runs.items()}, stages


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=11)
    parser.add_argument("--input", type=pathlib.Path, default=LADYBUG)
    parser.add_argument("--json", type=pathlib.Path)
    arguments = parser.parse_args()
    problem = inceres.read_bal(arguments.input)
    run_round(arguments.input, problem)  # warms what is cold
    rounds, stages = zip(*(run_round(arguments.input, problem) for _ in range(arguments.rounds)))
    for name in rounds[0]:
        print(f"{name:24} {1e3 * statistics.median(r[name] for r in rounds):8.1f} ms")
    ratios = {
        "bundle_adjust / tool": [r["bundle_adjust"] / r["tool"] for r in rounds],
        "NumPy factor / built-in factor": [r["NumPy factor"] / r["built-in factor"] for r in rounds],
    }
    fine = True
    for name, values in ratios.items():
        ratio = statistics.median(values)
        fine = fine and ratio <= LIMITS[name]
        print(f"{name:32} {ratio:.3f}  at most {LIMITS[name]:.2f}  ({min(values):.3f} to "
              f"{max(values):.3f})  {'yes' if ratio <= LIMITS[name] else 'NO'}")
    print("the solve with the NumPy factor:")
    for name in stages[0]:
        print(f"  {name:24} {1e3 * statistics.median(s[name] for s in stages):8.1f} ms")
    if arguments.json:
        arguments.json.write_text(
            json.dumps({"rounds": rounds, "stages": stages}, indent=2), encoding="utf-8")
    return 0 if fine else 1


if __name__ == "__main__":
    sys.exit(main())
