#!/usr/bin/env python3
"""Halves and doubles each threshold of the incremental solver (src/incremental/tuning.h) and prints what that does.

    cmake -S . -B build-tuning -G Ninja -DCMAKE_BUILD_TYPE=Release -DINCERES_TUNING_FROM_ENVIRONMENT=ON
    cmake --build build-tuning --target replay
    benchmarks/ablation.py [--build build-tuning] [--only TEXT] [--pose_graphs] [--jobs 2]

Nothing is timed: a run is judged by the work it counts, residuals evaluated plus four times those evaluated with Jacobians plus rows
of S factored, over that with all thresholds as they are, and by the largest relative excess of a step's cost, in units of the function tolerance,
over that of a run with a thousandth of it; above a thousand tolerances it ended in another basin, which says nothing of either. So nothing is disturbed by what else the machine does.

With --pose_graphs it plays pose graphs in place of problems with landmarks: earlier_factor.* acts on those alone.
Prints a table as docs/tuning.md has it. Needs the data of INCERES_DATA_DIR (or ../shared/data beside the repository). Exit code:
0 played, 2 a run could not be played.
"""

import argparse
import concurrent.futures
import json
import os
import pathlib
import re
import subprocess
import sys
import tempfile

from stock_environment import stock_environment

ROOT = pathlib.Path(__file__).resolve().parent.parent
DATA = pathlib.Path(os.environ.get("INCERES_DATA_DIR", ROOT.parent / "shared" / "data"))
TUNING = ROOT / "src" / "incremental" / "tuning.h"
REPLAYS = {
    "Ladybug-49": ["--problem", f"bal:{DATA}/bal/problem-49-7776-pre.txt"],
    "Trafalgar-21": ["--problem", f"bal:{DATA}/bal/problem-21-11315-pre.txt"],
    "fr3_office": ["--problem", f"kf:{DATA}/keyframes/fr3_office.kf"],
    "path:250": ["--problem", "path:250", "--loops"],
    "KITTI stereo": ["--problem", f"stereo:{DATA}/stereo", "--steps", "40"],
    "VIO window": ["--problem", "vio:figure_eight", "--steps", "60"],
}
POSE_GRAPHS = {
    "M3500": ["--problem", f"g2o:{DATA}/pose_graph/M3500.g2o", "--steps", "2000"],
    "city10000": ["--problem", f"g2o:{DATA}/pose_graph/city10000.g2o", "--steps", "1500"],
    "sphere": ["--problem", f"g2o:{DATA}/pose_graph/sphere.g2o", "--steps", "600"],
    "intel": ["--problem", f"g2o:{DATA}/pose_graph/intel.g2o"],
    "parking-garage": ["--problem", f"g2o:{DATA}/pose_graph/parking-garage.g2o", "--steps", "800"],
    "kitti_05": ["--problem", f"g2o:{DATA}/pose_graph/kitti_05.g2o"],
}


def thresholds():
    """("group.field", value, whether a count) of each, in the order of the header."""
    text = TUNING.read_text(encoding="utf-8")
    groups = dict(re.findall(r"^  (\w+) (\w+);$", text, re.MULTILINE))
    group = None
    for line in text.splitlines():
        if match := re.match(r"  struct (\w+) \{", line):
            group = groups[match[1]]
        elif match := re.match(r"    (double|int) (\w+) = ([^;]+);", line):
            yield f"{group}.{match[2]}", float(match[3]), match[1] == "int"


TOLERANCE = 1e-6
OTHER_BASIN = 1e3  # tolerances


def play(build, flags, setting, folder, tolerance=TOLERANCE):
    """(work, cost of each step) of a replay with a setting of the thresholds."""
    with tempfile.NamedTemporaryFile(dir=folder, suffix=".json") as report:
        environment = stock_environment(INCERES_TUNING=setting)
        command = [str(build / "bin" / "replay"), *flags, "--stock=false", "--optimum=false", "--function_tolerance", str(tolerance),
                   "--json", report.name]
        result = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
        if result.returncode not in (0, 1) or not report.read(1):
            raise RuntimeError(f"INCERES_TUNING={setting} {' '.join(command)}: {result.stderr.strip()}")
        rows = json.loads(pathlib.Path(report.name).read_text(encoding="utf-8"))
    work = 0.0
    for row in rows["rows"]:
        counts = row["ours"]["work"]
        work += counts["evaluated_factors"] + 4.0 * counts["relinearised_factors"] + counts["factored_rows"]
    return work, [row["ours"]["cost"] for row in rows["rows"]]


def worst_excess(costs, least):
    """In tolerances. Where a step's cost is next to nothing its excess is nothing too."""
    floor = 1e-9 * max(least)
    return max((cost - best) / max(best, floor) for cost, best in zip(costs, least)) / TOLERANCE


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--build", type=pathlib.Path, default=ROOT / "build-tuning", help="the build directory")
    parser.add_argument("--only", default="", help="only thresholds with this in their name")
    parser.add_argument("--jobs", type=int, default=2, help="runs at a time")
    parser.add_argument("--pose_graphs", action="store_true", help="play pose graphs")
    parser.add_argument("--names", action="store_true", help="print the names as src/incremental/tuning.cc includes them, and play nothing")
    arguments = parser.parse_args()
    if arguments.names:
        print("\n".join(f"INCERES_THRESHOLD({name})" for name, _, _ in thresholds()))
        return 0
    replays = POSE_GRAPHS if arguments.pose_graphs else REPLAYS
    settings = [("as they are", "")]
    for name, value, count in thresholds():
        if arguments.only in name:
            factors = (0.5, 2.0)
            changed = [max(0, round(value * f)) if count else value * f for f in factors]
            settings += [(f"{name} {value:g} to {new:g}", f"{name}={new!r}") for new in changed if new != value]
    try:
        with tempfile.TemporaryDirectory() as folder, concurrent.futures.ThreadPoolExecutor(arguments.jobs) as pool:
            tight = {problem: pool.submit(play, arguments.build.resolve(), flags, "", folder, 1e-3 * TOLERANCE)
                     for problem, flags in replays.items()}
            runs = {(label, problem): pool.submit(play, arguments.build.resolve(), flags, setting, folder)
                    for label, setting in settings for problem, flags in replays.items()}
            base = {problem: runs[settings[0][0], problem].result()[0] for problem in replays}
            print(f"| threshold | {' | '.join(replays)} |\n|{'---|' * (len(replays) + 1)}")
            for label, _ in settings:
                cells = []
                for problem in replays:
                    work, costs = runs[label, problem].result()
                    share, excess = work / base[problem], worst_excess(costs, tight[problem].result()[1])
                    cell = f"{share:.2f}" if 0.98 <= share <= 1.02 else f"**{share:.2f}**"
                    cells.append(f"{cell} ({f'{excess:.1f}' if excess < OTHER_BASIN else 'other basin'})")
                print(f"| {label} | {' | '.join(cells)} |", flush=True)
    except (OSError, RuntimeError, ValueError) as error:
        print(error, file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
