#!/usr/bin/env python3
"""Which share of a solve the user's own cost functions are, in instructions, with the drop-in preloaded in exact mode.

    benchmarks/user_share.py [--build build] vins_window --realistic_costs --frames 40
    benchmarks/user_share.py [--build build] okvis_map --realistic_costs --scene startup --frames 20
    benchmarks/user_share.py --baseline /tmp/old/build vins_window --realistic_costs --frames 40
    benchmarks/user_share.py curve_fits 101

Everything after the program's name goes to it. Needs valgrind, and in the build directory bin/<program> and libinceres_dropin.so. Counts
what callgrind sees within ceres::Solve, and of that the cost functions' Evaluate with all that they call; a program's own calls of
Evaluate between two solves do not count. With --baseline the same program runs with the drop-in of another build directory too, of an
older commit for one, and what lies outside the cost functions, and all of it, are told as ratios. Exit code: 0, or 2 if a run could not
be played.
"""

import argparse
import pathlib
import re
import subprocess
import sys
import tempfile

from drop_in_figures import find_dropin
from stock_environment import stock_environment

ROOT = pathlib.Path(__file__).resolve().parent.parent
EVALUATE = re.compile(r"(sliding_window::\w+|AutoDiffCostFunction<.*>)::Evaluate\(")


def count(program, flags, dropin, folder):
    """Callgrind's lines of inclusive counts, within ceres::Solve."""
    profile = pathlib.Path(folder) / "callgrind.out"
    environment = stock_environment(INCERES_MODE="exact", LD_PRELOAD=str(dropin))
    command = ["valgrind", "--tool=callgrind", f"--callgrind-out-file={profile}", "--toggle-collect=ceres::Solve(*", str(program), *flags]
    result = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    if result.returncode != 0:
        raise RuntimeError(f"{' '.join(command)}: {result.stderr.strip()[-400:]}")
    annotate = ["callgrind_annotate", "--inclusive=yes", "--threshold=100", "--show-percs=no", str(profile)]
    return subprocess.run(annotate, capture_output=True, text=True, check=True).stdout.splitlines()


def instructions(line):
    return int(line.split()[0].replace(",", ""))


def shares(lines):
    """(instructions of all, {cost function: its instructions})"""
    total = next(instructions(line) for line in lines if "PROGRAM TOTALS" in line)
    of_function = {}
    for line in lines:
        match = EVALUATE.search(line)
        if match and match[1] not in of_function:
            of_function[match[1]] = instructions(line)
    return total, of_function


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--build", type=pathlib.Path, default=ROOT / "build", help="the build directory")
    parser.add_argument("--baseline", type=pathlib.Path, help="the build directory of another drop-in, to compare with")
    parser.add_argument("program", choices=("vins_window", "okvis_map", "curve_fits"))
    parser.add_argument("flags", nargs=argparse.REMAINDER, help="of the program")
    arguments = parser.parse_args()
    program = arguments.build / "bin" / arguments.program
    try:
        with tempfile.TemporaryDirectory() as folder:
            total, of_function = shares(count(program, arguments.flags, find_dropin(arguments.build), folder))
            baseline = arguments.baseline and shares(count(program, arguments.flags, find_dropin(arguments.baseline), folder))
    except (OSError, RuntimeError, subprocess.CalledProcessError) as error:
        print(error, file=sys.stderr)
        return 2
    for name, value in sorted(of_function.items(), key=lambda item: -item[1]):
        print(f"{name}: {value / total:.3f}")
    print(f"all cost functions: {sum(of_function.values()) / total:.3f} of {total} instructions")
    outside = total - sum(of_function.values())
    print(f"outside them: {outside}")
    if baseline:
        before = baseline[0] - sum(baseline[1].values())
        print(f"outside them with the baseline's drop-in: {before}, ratio {outside / before:.3f}")
        print(f"in all with the baseline's drop-in: {baseline[0]}, ratio {total / baseline[0]:.3f}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
