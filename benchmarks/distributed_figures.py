#!/usr/bin/env python3
"""The solver over MPI beside the one of one process, on one machine: bal_solve_mpi on one rank and on two, bal_solve on one thread and
on two, with the same solver and preconditioner.

    benchmarks/distributed_figures.py [--build build] [--problems collection-2000,city-5000] [--rounds 11]
        [--preconditioner two_level] [--eta 0.1] [--max_num_iterations 50] [--json FILE] [--keep FOLDER]

A problem is a preset of bal_generate, or a BAL file. It is written once in the binary form (into --keep, and found there again) and read
by all runs, which take turns: one of each a round. Seconds are those of the solve, set-up included, reading and partition not; medians
over the rounds, and ratios medians of the ratios of each round. Memory is the peak of a process. Leave the machine alone meanwhile, and
have a core for each rank: waiting ranks do not yield.

Limits: two ranks at least 1.7 times as fast as one; two ranks at most 1.1 times two threads, one rank 1.1 times one thread; peak
memory of a rank of two at most 0.6 of that of one; partition at most 3 % of reading, partition and solve; bytes that the worst rank sends
in a product at most 1.5 times its shared cameras; the cost within the function tolerance's reach of one process's (1e-4). Exit code: 0
all within limits, 1 something is not, 2 a run failed.
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
RUNS = {"1 rank": ("ranks", 1), "2 ranks": ("ranks", 2), "1 thread": ("threads", 1), "2 threads": ("threads", 2)}
MPI = {"OMPI_ALLOW_RUN_AS_ROOT": "1", "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1", "OMPI_MCA_btl_vader_single_copy_mechanism": "none"}
RATIOS = [("2 ranks", "1 rank", 1.0 / 1.7), ("2 ranks", "2 threads", 1.1), ("1 rank", "1 thread", 1.1)]
MOST_MEMORY, MOST_PARTITION, MOST_BYTES, MOST_COST = 0.6, 0.03, 1.5, 1e-4


class Player:
    def __init__(self, arguments, folder):
        self._bin = arguments.build.resolve() / "bin"
        self._folder = pathlib.Path(folder)
        self._common = ["--preconditioner", arguments.preconditioner, "--eta", str(arguments.eta), "--max_num_iterations",
                        str(arguments.max_num_iterations)]

    def write(self, problem):
        """The problem in the binary form."""
        name = pathlib.Path(problem).name if pathlib.Path(problem).exists() else problem
        binary = self._folder / f"{name}.balb"
        if binary.exists():
            return binary
        partial = self._folder / f"{name}.partial.balb"
        if pathlib.Path(problem).exists():
            self._run([self._bin / "bal_solve", "--input", problem, "--builtin_factors", "--max_num_iterations", "0", "--output", partial])
        else:
            self._run([self._bin / "bal_generate", "--preset", problem, "--output", partial])
        partial.rename(binary)
        return binary

    def play(self, run, binary):
        """The report of a run, with peak_bytes, of the largest of its processes."""
        kind, count = RUNS[run]
        report = self._folder / "report.json"
        flags = ["--input", binary, "--json", report, *self._common]
        if kind == "threads":
            usage = self._run([self._bin / "bal_solve", "--builtin_factors", "--linear_solver", "iterative_schur", "--num_threads", count,
                               *flags], count)
            result = json.loads(report.read_text(encoding="utf-8"))
            return {**result, "peak_bytes": usage.ru_maxrss * 1024}
        self._run(["mpiexec", "-n", count, self._bin / "bal_solve_mpi", "--linear_solver", "conjugate_gradients", *flags])
        result = json.loads(report.read_text(encoding="utf-8"))
        return {**result, "peak_bytes": max(rank["peak_resident_bytes"] for rank in result["ranks"])}

    @staticmethod
    def _run(command, num_threads=1):
        command = [str(part) for part in command]
        with tempfile.TemporaryFile("w+") as errors:
            process = subprocess.Popen(command, env=stock_environment(num_threads, **MPI), stdout=subprocess.DEVNULL, stderr=errors)
            _, status, usage = os.wait4(process.pid, 0)
            process.returncode = os.waitstatus_to_exitcode(status)
            if process.returncode != 0:
                errors.seek(0)
                raise RuntimeError(f"{' '.join(command)}: {errors.read().strip()}")
        return usage


def iterations_of(report):
    """(Of the outer loop, of conjugate gradients: None where the report does not say.)"""
    return report["iterations"], report.get("summary", {}).get("work", {}).get("num_conjugate_gradients")


def figures_of(reports):
    """The figures of a problem from {run: [report a round]}."""
    seconds = {run: statistics.median(report["seconds"] for report in rounds) for run, rounds in reports.items()}
    figures = {"seconds": seconds, "ratios": {}}
    for run, other, _ in RATIOS:
        figures["ratios"][f"{run} / {other}"] = statistics.median(
            a["seconds"] / b["seconds"] for a, b in zip(reports[run], reports[other]))
    peaks = {run: statistics.median(report["peak_bytes"] for report in rounds) for run, rounds in reports.items()}
    two = reports["2 ranks"]
    figures["peak_bytes"] = peaks
    figures["memory"] = peaks["2 ranks"] / peaks["1 rank"]
    figures["partition"] = statistics.median(partition_share(report) for report in two)
    figures["exchange"] = max(
        (rank["exchange_bytes_per_product"] / rank["shared_frame_bytes"] for rank in two[-1]["ranks"] if rank["shared_frame_bytes"]),
        default=0.0)
    figures["imbalance"] = two[-1]["partition"]["imbalance"]
    figures["costs"] = {run: rounds[-1]["final_cost"] for run, rounds in reports.items()}
    alone = figures["costs"]["1 thread"]
    figures["cost_excess"] = max(figures["costs"][run] / alone - 1.0 for run in ("1 rank", "2 ranks"))
    figures["iterations"] = {run: iterations_of(rounds[-1]) for run, rounds in reports.items()}
    return figures


def partition_share(report):
    stages = report["stage_seconds"]
    return stages["partition"] / (stages["read"] + stages["partition"] + report["seconds"])


def judge(figures):
    """[(what, value, limit)]."""
    rows = [(f"{run} / {other}", figures["ratios"][f"{run} / {other}"], limit) for run, other, limit in RATIOS]
    rows += [("peak memory a rank, 2 ranks / 1 rank", figures["memory"], MOST_MEMORY),
             ("partition of the whole", figures["partition"], MOST_PARTITION),
             ("bytes a product over shared cameras, worst rank", figures["exchange"], MOST_BYTES),
             ("cost over one process's", figures["cost_excess"], MOST_COST)]
    return rows


def show(problem, figures):
    """Prints a problem's table; True if all is within limits."""
    print(f"\n### {problem}\n\n| run | seconds | peak, MiB | cost | iterations | conjugate gradients |\n|---|---|---|---|---|---|")
    for run in RUNS:
        outer, inner = figures["iterations"][run]
        print(f"| {run} | {figures['seconds'][run]:.3f} | {figures['peak_bytes'][run] / 2**20:.0f} | {figures['costs'][run]:.8e} | "
              f"{outer} | {inner if inner is not None else ''} |")
    print("\n| figure | measured | at most | |\n|---|---|---|---|")
    rows = judge(figures)
    for what, value, limit in rows:
        print(f"| {what} | {value:.3g} | {limit:.3g} | {'within it' if value <= limit else '**too much**'} |", flush=True)
    return all(value <= limit for _, value, limit in rows)


def measure(player, problem, rounds):
    binary = player.write(problem)
    reports = {run: [] for run in RUNS}
    for _ in range(rounds):
        for run in RUNS:
            reports[run].append(player.play(run, binary))
    return figures_of(reports)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--build", type=pathlib.Path, default=ROOT / "build")
    parser.add_argument("--problems", default="collection-2000,city-5000", help="presets of bal_generate, or BAL files")
    parser.add_argument("--rounds", type=int, default=11)
    parser.add_argument("--preconditioner", default="two_level", choices=["identity", "jacobi", "schur_jacobi", "two_level"])
    parser.add_argument("--eta", type=float, default=0.1)
    parser.add_argument("--max_num_iterations", type=int, default=50)
    parser.add_argument("--json", type=pathlib.Path, help="write the figures to this file")
    parser.add_argument("--keep", type=pathlib.Path, help="where the binary files stay")
    arguments = parser.parse_args()
    if arguments.rounds < 1 or arguments.max_num_iterations < 0:
        parser.error("--rounds is at least 1, --max_num_iterations at least 0")
    fine, kept = True, {}
    try:
        with tempfile.TemporaryDirectory() as temporary:
            folder = arguments.keep or pathlib.Path(temporary)
            folder.mkdir(parents=True, exist_ok=True)
            player = Player(arguments, folder)
            for problem in arguments.problems.split(","):
                kept[problem] = measure(player, problem, arguments.rounds)
                fine = show(problem, kept[problem]) and fine
        if arguments.json:
            report = {"rounds": arguments.rounds, "preconditioner": arguments.preconditioner, "eta": arguments.eta, "problems": kept}
            arguments.json.write_text(json.dumps(report, indent=2) + "\n", encoding="utf-8")
    except (OSError, RuntimeError, KeyError, json.JSONDecodeError) as error:
        print(f"distributed_figures.py: {error}", file=sys.stderr)
        return 2
    return 0 if fine else 1


if __name__ == "__main__":
    sys.exit(main())
