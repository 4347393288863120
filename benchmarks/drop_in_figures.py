#!/usr/bin/env python3
"""Runs the sliding-window estimators bare and with the drop-in preloaded and prints each ratio beside its limit.

    benchmarks/drop_in_figures.py [--build build] [--repetitions 11] [--only TEXT] [--frames 300] [--keep FOLDER]

Needs bin/vins_window, bin/okvis_map and libinceres_dropin.so in the build directory. Bare runs are played in every configuration
of stock Ceres (both orderings, DENSE_SCHUR and SPARSE_SCHUR); the fastest counts. Configurations and drop-in take turns, one run
each per repetition; a figure is the median over the repetitions of the run's median solve call, set-up included. All solves are
on one thread, stock's CHOLMOD too (stock_environment.py). Leave the machine alone meanwhile. Exit code: 0 all ratios within their limits and
final costs stock's, 1 one is not, 2 a run could not be played.
"""

import argparse
import itertools
import json
import pathlib
import statistics
import subprocess
import sys
import tempfile

from stock_environment import program_environment

ROOT = pathlib.Path(__file__).resolve().parent.parent
DROPIN = "libinceres_dropin.so"
STOCK = {f"{linear_solver.upper()}, {ordering}": ["--linear_solver", linear_solver, "--ordering", ordering]
         for linear_solver, ordering in itertools.product(("dense_schur", "sparse_schur"), ("auto", "landmarks_first"))}
MODES = ("exact", "incremental")
COST_DIFFERENCE = 1e-3  # of the sums of final costs, at most: each solve starts where the one before ended, so that rounding grows

# What is played: program, flags, and the largest ratio by mode (None: to be seen).
VINS = {"exact": 0.30, "incremental": 0.25}
OKVIS = {"exact": None, "incremental": 0.25}
SEEN = {"exact": None, "incremental": None}
REALISTIC = ["--scene", "startup", "--free_extrinsics", "--realistic_costs"]
FIGURES = [
    ("VINS-style, 150 features", "vins_window", ["--features", "150"], VINS),
    ("VINS-style, 150 features, extrinsics free", "vins_window", ["--features", "150", "--free_extrinsics"], VINS),
    ("VINS-style, 1,000 features", "vins_window", ["--features", "1000"], VINS),
    ("VINS-style, 1,000 features, extrinsics free", "vins_window", ["--features", "1000", "--free_extrinsics"], VINS),
    ("OKVIS-style, 150 landmarks", "okvis_map", ["--features", "150"], OKVIS),
    # Cost functions that cost what those of VINS and OKVIS do, and a start that leaves much undetermined.
    ("VINS-style, realistic costs", "vins_window", [*REALISTIC, "--features", "150"], SEEN),
    ("OKVIS-style, realistic costs", "okvis_map", REALISTIC, SEEN),
]


def play(command, report, mode=None, dropin=None):
    """One run; the report it writes. With `dropin`, that library is preloaded."""
    result = subprocess.run([str(part) for part in [*command, "--json", report]], env=program_environment(mode, dropin),
                            stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, check=False)
    if result.returncode != 0:
        raise RuntimeError(f"{' '.join(str(part) for part in command)}: {result.stderr.strip()}")
    return json.loads(report.read_text(encoding="utf-8"))


def play_all(program, flags, dropin, repetitions, report):
    """The reports of every configuration and mode, interleaved: {name: [report of each repetition]}."""
    reports = {name: [] for name in (*STOCK, *MODES)}
    for _ in range(repetitions):
        for name, choice in STOCK.items():
            reports[name].append(play([program, *flags, *choice], report))
        for mode in MODES:
            reports[mode].append(play([program, *flags], report, mode, dropin))
    return reports


def median_ms(reports):
    return statistics.median(report["solve_ms"]["median"] for report in reports)


def print_figure(reports, limits):
    """Prints a table; True if every ratio is within its limit."""
    fastest = min(STOCK, key=lambda name: median_ms(reports[name]))
    stock_ms = median_ms(reports[fastest])
    fine = True
    print("| solves | median ms | ratio | limit | within it | trajectory error, m | sum of final costs |\n|---|---|---|---|---|---|---|")
    for name, runs in reports.items():
        ratio = median_ms(runs) / stock_ms
        limit = limits.get(name)
        same_cost = abs(runs[0]["final_cost_sum"] / reports[fastest][0]["final_cost_sum"] - 1.0) <= COST_DIFFERENCE
        is_within = same_cost and (limit is None or ratio <= limit)
        fine = fine and is_within
        shown = f"**{name}**" if name == fastest else f"drop-in, {name}" if name in MODES else name
        verdict = "**no**, another cost" if not same_cost else "" if limit is None else "yes" if is_within else "**no**"
        print(f"| {shown} | {median_ms(runs):.3g} | {ratio:.3f} | {'' if limit is None else f'at most {limit:g}'} | {verdict} "
              f"| {runs[0]['ate_m']:.5f} | {runs[0]['final_cost_sum']:.9g} |", flush=True)
    return fine


def find_dropin(build):
    found = sorted(build.rglob(DROPIN))
    if not found:
        raise RuntimeError(f"{build} has no {DROPIN}")
    return found[0].resolve()


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--build", type=pathlib.Path, default=ROOT / "build", help="the build directory")
    parser.add_argument("--repetitions", type=int, default=11, help="of every run, at least 1")
    parser.add_argument("--only", default="", help="only the figures whose name contains this")
    parser.add_argument("--frames", type=int, default=300, help="frames of a run")
    parser.add_argument("--keep", type=pathlib.Path, help="keep the JSON reports, one file per figure, in this folder")
    arguments = parser.parse_args()
    if arguments.repetitions < 1:
        parser.error("--repetitions: at least 1")
    fine, played = True, 0
    try:
        dropin = find_dropin(arguments.build)
        with tempfile.TemporaryDirectory() as temporary:
            for number, (name, program, flags, limits) in enumerate(FIGURES):
                if arguments.only not in name:
                    continue
                command_flags = [*flags, "--frames", arguments.frames]
                reports = play_all(arguments.build / "bin" / program, command_flags, dropin, arguments.repetitions,
                                   pathlib.Path(temporary) / "report.json")
                played += 1
                print(f"\n{name}: {arguments.frames} frames, {arguments.repetitions} repetitions\n")
                fine = print_figure(reports, limits) and fine
                if arguments.keep is not None:
                    arguments.keep.mkdir(parents=True, exist_ok=True)
                    (arguments.keep / f"drop-in-{number}.json").write_text(json.dumps(reports, indent=1), encoding="utf-8")
    except (OSError, RuntimeError) as error:
        print(error, file=sys.stderr)
        return 2
    return (0 if fine else 1) if played > 0 else 2


if __name__ == "__main__":
    sys.exit(main())
