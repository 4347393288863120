#!/usr/bin/env python3
"""Judges the first seconds of an OKVIS-style estimator with the drop-in preloaded by what stock Ceres makes of them.

    benchmarks/startup_figures.py [--build build] [--seeds 1:20] [--modes exact,incremental] [--extrinsics free,held] [--jobs 2]

Needs bin/okvis_map and libinceres_dropin.so in the build directory. Every seed of the scene `startup` (see okvis_map --help) is played bare,
with SPARSE_SCHUR, DENSE_SCHUR and SPARSE_NORMAL_CHOLESKY and twice with every value that a solve starts from moved by one ulp, and
once with the drop-in in each mode. What a solve leaves undone there marginalization makes final, so that it shows in the trajectory:
the root mean square of the newest frame's position error, not aligned, for the first pose's position and yaw are the true ones.

A mode passes if on no seed its error is above 1.02 times the worst of stock's, and the median over the seeds of its error is at
most 1.05 times the median of stock's medians. `converged`, stock with 100 iterations a solve, shows what a solver gets that leaves
nothing undone; it has no part in the verdict, but how many seeds are above if it counts as one of stock's is told too. Exit code: 0 every mode passes, 1 one does not, 2 a run could not be played.
"""

import argparse
import concurrent.futures
import json
import math
import os
import pathlib
import statistics
import subprocess
import sys

from drop_in_figures import find_dropin
from stock_environment import program_environment

ROOT = pathlib.Path(__file__).resolve().parent.parent
STOCK = {
    "SPARSE_SCHUR": ["--linear_solver", "sparse_schur"],
    "DENSE_SCHUR": ["--linear_solver", "dense_schur"],
    "SPARSE_NORMAL_CHOLESKY": ["--linear_solver", "sparse_normal_cholesky"],
    "one ulp, 1": ["--kick", "1"],
    "one ulp, 2": ["--kick", "2"],
}
CONVERGED = {"converged": ["--max_iterations", "100"]}  # for comparison
MODES = ("exact", "incremental", "auto")
EXTRINSICS = {"free": ["--free_extrinsics"], "held": []}
WORST_FACTOR = 1.02   # of stock's worst, for each seed
MEDIAN_FACTOR = 1.05  # of stock's median, for the median over the seeds
ERROR = "position_rmse_m"


def play(command, mode, dropin):
    """The report of one run; bare if mode is None."""
    environment = program_environment(mode, dropin)
    command = [str(part) for part in command]
    result = subprocess.run(command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, check=False)
    if result.returncode != 0:
        raise RuntimeError(f"{' '.join(command)}: {result.stderr.strip()}")
    return json.loads(result.stdout)


def play_all(program, dropin, extrinsics, seeds, modes, flags, jobs):
    """{name of stock's variant or mode: [error of each seed]}"""
    def error(run):
        name, seed = run
        command = [program, "--scene", "startup", "--seed", seed, *EXTRINSICS[extrinsics], *bare.get(name, []), *flags]
        return play(command, None if name in bare else name, dropin)[ERROR]

    bare = {**STOCK, **CONVERGED}
    names = (*bare, *modes)
    runs = [(name, seed) for seed in seeds for name in names]
    with concurrent.futures.ThreadPoolExecutor(jobs) as executor:
        errors = dict(zip(runs, executor.map(error, runs)))
    return {name: [errors[name, seed] for seed in seeds] for name in names}


def of_stock(errors, what):
    """`what` (max, statistics.median, ...) of stock's variants, for each seed."""
    return [what(values) for values in zip(*(errors[name] for name in STOCK))]


def judge(errors, mode):
    """{figure: value} of a mode."""
    worst, typical = of_stock(errors, max), of_stock(errors, statistics.median)
    worst_or_converged = [max(values) for values in zip(worst, *(errors[name] for name in CONVERGED))]
    ratios = [ours / stock for ours, stock in zip(errors[mode], typical)]
    above = lambda stock: sum(ours > WORST_FACTOR * limit for ours, limit in zip(errors[mode], stock))
    return {
        "geometric_mean": math.exp(statistics.mean(math.log(ratio) for ratio in ratios)),
        "worst_ratio": max(ratios),
        "seeds_above": above(worst),
        "seeds_above_both": above(worst_or_converged),
        "median_ratio": statistics.median(errors[mode]) / statistics.median(typical),
    }


def passes(figures):
    return figures["seeds_above"] == 0 and figures["median_ratio"] <= MEDIAN_FACTOR


def print_figures(seeds, modes, errors):
    """Prints the errors of every seed and the verdicts; True if every mode passes."""
    best, worst = of_stock(errors, min), of_stock(errors, max)
    shown = (*CONVERGED, *modes)
    print(f"| seed | stock, best | stock, worst | {' | '.join(shown)} |\n|---|---|---|{'---|' * len(shown)}")
    for i, seed in enumerate(seeds):
        ours = (f"{errors[mode][i]:.5f}{' **above**' if errors[mode][i] > WORST_FACTOR * worst[i] else ''}" for mode in shown)
        print(f"| {seed} | {best[i]:.5f} | {worst[i]:.5f} | {' | '.join(ours)} |")
    print("\n| mode | geometric mean of the ratios to stock's median | largest ratio | seeds above 1.02 of stock's worst "
          "| converged counted as stock's | median over the seeds, ratio | verdict |\n|---|---|---|---|---|---|---|")
    fine = True
    for mode in shown:
        figures = judge(errors, mode)
        verdict = "for comparison" if mode in CONVERGED else "as good as stock" if passes(figures) else "**not** as good as stock"
        fine = fine and (passes(figures) or mode in CONVERGED)
        print(f"| {mode} | {figures['geometric_mean']:.3f} | {figures['worst_ratio']:.2f} | {figures['seeds_above']} of {len(seeds)} "
              f"| {figures['seeds_above_both']} of {len(seeds)} | {figures['median_ratio']:.3f} | {verdict} |",
              flush=True)
    return fine


def choices(known):
    """The type of an argument that lists some of `known`."""
    def parse(text):
        names = text.split(",")
        unknown = [name for name in names if name not in known]
        if unknown:
            raise argparse.ArgumentTypeError(f"'{unknown[0]}' is none of {', '.join(known)}")
        return names
    return parse


def seed_range(text):
    """FIRST:COUNT"""
    first, _, count = text.partition(":")
    if not (first.isdigit() and count.isdigit() and int(count) > 0):
        raise argparse.ArgumentTypeError(f"'{text}' is not FIRST:COUNT")
    return range(int(first), int(first) + int(count))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--build", type=pathlib.Path, default=ROOT / "build", help="the build directory")
    parser.add_argument("--seeds", type=seed_range, default="1:20", metavar="FIRST:COUNT")
    parser.add_argument("--modes", type=choices(MODES), default="exact,incremental", help=f"some of {','.join(MODES)}")
    parser.add_argument("--extrinsics", type=choices(EXTRINSICS), default="free,held", help="estimated, held, or both")
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), help="runs at a time")
    parser.add_argument("--flags", default="", help="more flags of okvis_map, in one argument")
    parser.add_argument("--keep", type=pathlib.Path, help="keep all errors in this JSON file")
    arguments = parser.parse_args()
    if arguments.jobs < 1:
        parser.error("--jobs: at least 1")
    fine, kept = True, {}
    try:
        dropin = find_dropin(arguments.build)
        for extrinsics in arguments.extrinsics:
            errors = play_all(arguments.build / "bin" / "okvis_map", dropin, extrinsics, arguments.seeds, arguments.modes,
                              arguments.flags.split(), arguments.jobs)
            kept[extrinsics] = errors
            print(f"\nExtrinsics {extrinsics}: {ERROR}\n")
            fine = print_figures(arguments.seeds, arguments.modes, errors) and fine
        if arguments.keep is not None:
            arguments.keep.write_text(json.dumps(kept, indent=1), encoding="utf-8")
    except (OSError, RuntimeError) as error:
        print(error, file=sys.stderr)
        return 2
    return 0 if fine else 1


if __name__ == "__main__":
    sys.exit(main())
