#!/usr/bin/env python3
"""Asks whether INCERES_MODE=auto takes the better of the two modes: runs programs that know Ceres only with the drop-in in exact,
incremental and auto mode.

    benchmarks/auto_figures.py [--build build] [--only TEXT] [--steps N] [--keep FOLDER]
    benchmarks/auto_figures.py --times [--repetitions 11] [--build build] [--only TEXT] [--steps N] [--keep FOLDER]

Without --times it counts instructions under valgrind: those of the calls of ceres::Solve but for what they spend in the program's own
cost functions and manifolds, over the whole run (call_costs.py). The runs are shortened for that, --steps says otherwise. Nothing
else on the machine disturbs the counts; but a mode that decides by the clock decides on a valgrind's clock. With --times it takes the time
in ceres::Solve over the whole run, the user's functions included; the modes take turns, and a figure is the median over the
repetitions. Leave the machine alone meanwhile.

The ratio is that of auto to the better of the other two in the same measure; its limits are 1.03 in instructions and 1.05 in
time. A bare run, stock Ceres, gives the costs to compare with: the excess over it of the sum of all final costs, which is to be at
most 1e-3 for auto, and the worst of a single solve, to be seen, as each run goes on from where it got to. All on one thread, stock's
CHOLMOD too (stock_environment.py).

Needs bin/vins_window, bin/okvis_map, bin/living_problem, bin/bal_solve and libinceres_dropin.so in the build directory and the data of
INCERES_DATA_DIR (or ../shared/data beside the repository); what needs a file that is missing is skipped by name. Exit code: 0 all
within limits, 1 something is not, 2 a run could not be played.
"""

import argparse
import collections
import json
import os
import pathlib
import shutil
import statistics
import subprocess
import sys
import tempfile

from call_costs import solve_costs
from drop_in_figures import find_dropin
from stock_environment import program_environment

ROOT = pathlib.Path(__file__).resolve().parent.parent
DATA = pathlib.Path(os.environ.get("INCERES_DATA_DIR", ROOT.parent / "shared" / "data"))
MODES = ("exact", "incremental", "auto")
MOST_INSTRUCTIONS = 1.03
MOST_TIME = 1.05
MOST_EXCESS = 1e-3  # of the sum of auto's final costs over stock's
NEGLIGIBLE = 1e-9  # of the largest final cost of a run, or of 1: what ends lower is judged as if it ended there

# A program to play: its flags; the flag that shortens it, and how many steps are played under valgrind and by the clock (None: the
# flag is not given); the file it needs (None: none), and whether that is solved first, so that cameras start near the solution.
Figure = collections.namedtuple("Figure", "name program flags limit counted timed file solved")


def window(name, program, *flags, counted):
    return Figure(name, program, list(flags), "--frames", counted, 300, None, False)


def living(name, kind, file, *flags, counted=None, timed=None, solved=False):
    limit = None if "--oneshot" in flags else "--steps"
    return Figure(name, "living_problem", ["--problem", f"{kind}:{{file}}", *flags], limit, counted, timed, DATA / file, solved)


LADYBUG, TRAFALGAR = "bal/problem-49-7776-pre.txt", "bal/problem-21-11315-pre.txt"
FIGURES = [
    window("VINS-style, 150 features", "vins_window", "--features", "150", counted=60),
    window("VINS-style, 150 features, extrinsics free", "vins_window", "--features", "150", "--free_extrinsics", counted=60),
    window("VINS-style, 1,000 features", "vins_window", "--features", "1000", counted=30),
    window("OKVIS-style, 150 landmarks", "okvis_map", "--features", "150", counted=60),
    living("Ladybug-49, one solve", "bal", LADYBUG, "--oneshot", "--autodiff"),
    living("Trafalgar-21, one solve", "bal", TRAFALGAR, "--oneshot", "--autodiff"),
    living("Ladybug-49, camera by camera", "bal", LADYBUG, "--nopresolve", counted=24, timed=0, solved=True),
    living("Trafalgar-21, camera by camera", "bal", TRAFALGAR, "--nopresolve", counted=0, timed=0, solved=True),
    living("KITTI stereo odometry, pose by pose", "stereo", "stereo", counted=10, timed=0),
    living("M3500, pose by pose", "g2o", "pose_graph/M3500.g2o", counted=300, timed=1000),
    living("intel, pose by pose", "g2o", "pose_graph/intel.g2o", counted=300, timed=0),
]


class Player:
    """Runs a figure's program bare or in a mode of the drop-in."""

    def __init__(self, build, folder):
        self._build = build.resolve()
        self._dropin = find_dropin(build)
        self._folder = pathlib.Path(folder)
        self._solved = {}

    def command(self, figure, steps):
        file = self._solve_first(figure.file) if figure.solved else figure.file
        flags = [str(flag).format(file=file) for flag in figure.flags]
        return [str(self._build / "bin" / figure.program), *flags, *([figure.limit, str(steps)] if figure.limit else [])]

    def play(self, command, mode=None):
        """The report of a run; without a mode of stock Ceres."""
        report = self._folder / "report.json"
        self._run([*command, "--json", str(report)], mode)
        return json.loads(report.read_text(encoding="utf-8"))

    def count(self, command, mode):
        """(report, instructions in ceres::Solve but for the user's functions, those of these)."""
        profile = self._folder / "callgrind.out"
        report = self.play(["valgrind", "--quiet", "--tool=callgrind", f"--callgrind-out-file={profile}", *command], mode)
        with profile.open(encoding="utf-8") as lines:
            solves, user = solve_costs(lines, command[0])
        return report, solves - user, user

    def _solve_first(self, file):
        if file not in self._solved:
            self._solved[file] = self._folder / f"solved-{file.name}"
            self._run([self._build / "bin" / "bal_solve", "--input", file, "--output", self._solved[file], "--builtin_factors",
                       "--robust", "huber:1.0", "--max_num_iterations", "400"], None)
        return self._solved[file]

    def _run(self, command, mode):
        result = subprocess.run([str(part) for part in command], env=program_environment(mode, self._dropin), stdout=subprocess.DEVNULL, stderr=subprocess.PIPE,
                                text=True, check=False)
        if result.returncode != 0:
            raise RuntimeError(f"{' '.join(str(part) for part in command)}: {result.stderr.strip()}")


def worst_excess(report, stock):
    """The largest relative excess of a solve's final cost over stock's; None where the program does not say."""
    if "solves" not in stock:
        return None
    costs = [solve["cost"] for solve in stock["solves"]]
    least = NEGLIGIBLE * max(1.0, *costs)
    return max((solve["cost"] - cost) / max(cost, least) for solve, cost in zip(report["solves"], costs))


def measure_instructions(player, command, _repetitions):
    """({mode: instructions}, auto's ratio, {mode: report}, {mode: what else there is to say})."""
    reports, outside, notes = {}, {}, {}
    for mode in MODES:
        reports[mode], outside[mode], user = player.count(command, mode)
        notes[mode] = f"{user / 1e6:.4g}"
    return outside, outside["auto"] / min(outside["exact"], outside["incremental"]), reports, notes


def measure_times(player, command, repetitions):
    """The same in seconds; the ratio is the median of the repetitions' ratios to the mode whose median is the better."""
    reports, seconds = {}, {mode: [] for mode in MODES}
    for _ in range(repetitions):
        for mode in MODES:
            reports[mode] = player.play(command, mode)
            seconds[mode].append(1e-3 * reports[mode]["solve_ms"]["total"])
    medians = {mode: statistics.median(seconds[mode]) for mode in MODES}
    better = min(("exact", "incremental"), key=medians.get)
    ratio = statistics.median(auto / other for auto, other in zip(seconds["auto"], seconds[better]))
    notes = {mode: f"{min(seconds[mode]):.4g} to {max(seconds[mode]):.4g}" for mode in MODES}
    return medians, ratio, reports, notes


def print_figure(measured, stock, times):
    """Prints a table; True if auto is within its limit."""
    values, ratio, reports, notes = measured
    limit = MOST_TIME if times else MOST_INSTRUCTIONS
    what = ("seconds in ceres::Solve", "least to most") if times else ("million instructions in ceres::Solve", "of the user's functions")
    scale = 1.0 if times else 1e-6
    print(f"| mode | {what[0]} | {what[1]} | sum of final costs over stock's | worst solve over stock's |\n|---|---|---|---|---|")
    excess = {}
    for mode in MODES:
        excess[mode] = (reports[mode]["final_cost_sum"] - stock["final_cost_sum"]) / max(stock["final_cost_sum"], NEGLIGIBLE)
        worst = worst_excess(reports[mode], stock)
        print(f"| {mode} | {scale * values[mode]:.5g} | {notes[mode]} | {excess[mode]:+.1e} "
              f"| {'' if worst is None else f'{worst:+.1e}'} |", flush=True)
    fine = ratio <= limit and excess["auto"] <= MOST_EXCESS
    verdict = "within it" if fine else "**another cost**" if ratio <= limit else "**too much**"
    better = min(("exact", "incremental"), key=values.get)
    print(f"\nauto / {better}: **{ratio:.3f}**, limit {limit:g}: {verdict}", flush=True)
    return fine


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--build", type=pathlib.Path, default=ROOT / "build", help="the build directory")
    parser.add_argument("--times", action="store_true", help="measure times, not instructions")
    parser.add_argument("--repetitions", type=int, help="with --times: of every run, at least 1; 11")
    parser.add_argument("--steps", type=int, help="frames of windows, steps of other runs, for all; 0: all there are (not of windows)")
    parser.add_argument("--only", default="", help="only the figures whose name contains this")
    parser.add_argument("--keep", type=pathlib.Path, help="keep the JSON reports, one file per figure, in this folder")
    arguments = parser.parse_args()
    if arguments.repetitions is not None and (arguments.repetitions < 1 or not arguments.times):
        parser.error("--repetitions: at least 1, and with --times")
    if arguments.steps is not None and arguments.steps < 0:
        parser.error("--steps: at least 0")
    if not arguments.times and shutil.which("valgrind") is None:
        parser.error("valgrind is not installed: there are --times")
    measure = measure_times if arguments.times else measure_instructions
    fine, played = True, 0
    try:
        with tempfile.TemporaryDirectory() as temporary:
            player = Player(arguments.build, temporary)
            for number, figure in enumerate(FIGURES):
                if arguments.only not in figure.name:
                    continue
                if figure.file is not None and not figure.file.exists():
                    print(f"\n{figure.name}: skipped, {figure.file} is missing")
                    continue
                usual = figure.timed if arguments.times else figure.counted
                steps = usual if arguments.steps is None else arguments.steps
                command = player.command(figure, steps)
                measured = measure(player, command, arguments.repetitions or 11)
                stock = player.play(command)
                played += 1
                print(f"\n{figure.name}{f', {figure.limit} {steps}' if figure.limit else ''}\n")
                fine = print_figure(measured, stock, arguments.times) and fine
                if arguments.keep is not None:
                    arguments.keep.mkdir(parents=True, exist_ok=True)
                    kept = {"values": measured[0], "ratio": measured[1], "reports": measured[2], "stock": stock}
                    (arguments.keep / f"auto-{number}.json").write_text(json.dumps(kept, indent=1), encoding="utf-8")
    except (OSError, RuntimeError, ValueError) as error:
        print(error, file=sys.stderr)
        return 2
    return (0 if fine else 1) if played > 0 else 2


if __name__ == "__main__":
    sys.exit(main())
