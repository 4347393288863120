#!/usr/bin/env python3
"""Measures batch solves of pose graphs: ours against stock Ceres, one row a file and strategy, interleaved.

    benchmarks/pose_graph_figures.py [FILE.g2o…] [--repeats 11] [--strategies dogleg,lm] [--chain 15000] [--build build]

Without files all of pose_graph/ below INCERES_DATA_DIR (or ../shared/data beside the repository). --chain adds odometry chains of so
many poses with 1 % loops (odometry_chain.py), planar and spatial. Each row is a run of ab_compare: the median of our time over stock's
of the same round, with the least and the largest; the iterations of both, and by how much our final cost is above stock's: the same
trace has the same of both. Exit code: 0 all traces the same, 1 one is not, 2 a row could not be measured.
"""

import argparse
import json
import os
import pathlib
import re
import subprocess
import sys
import tempfile

from odometry_chain import write_chain
from stock_environment import stock_environment

ROOT = pathlib.Path(__file__).resolve().parent.parent
DATA = pathlib.Path(os.environ.get("INCERES_DATA_DIR", ROOT.parent / "shared" / "data"))
SAME_COST = 1e-9  # relative


def measure(tool, path, strategy, repeats):
    with tempfile.TemporaryDirectory() as folder:
        report = pathlib.Path(folder) / "report.json"
        flags = ["--trust_region", strategy, "--repeats", str(repeats), "--json", str(report)]
        result = subprocess.run([tool, "--problem", f"g2o:{path}", *flags], env=stock_environment(1), stdout=subprocess.DEVNULL,
                                stderr=subprocess.PIPE, text=True, check=False)
        if result.returncode not in (0, 3):  # 3: our cost is above stock's, which is shown here
            raise RuntimeError(f"{path}: {result.stderr.strip()}")
        return json.loads(report.read_text(encoding="utf-8"))


def row(path, strategy, report):
    """The row, and whether both took the same steps."""
    ours = next(run for run in report["runs"] if run["solver"] == "inceres")
    stock = min((run for run in report["runs"] if run["solver"] == "ceres"), key=lambda run: run["seconds"]["median"])
    ratio, difference = report["ratio_to_best_stock"], report["relative_cost_difference"]
    same = ours["iterations"] == stock["iterations"] and abs(difference) <= SAME_COST
    counts = re.findall(r"\d+", report["description"])
    cells = [path.stem, f"{counts[0]}, {counts[2]}", strategy, f"{1e3 * ours['seconds']['median']:.1f}", f"{1e3 * stock['seconds']['median']:.1f}",
             f"**{ratio['median']:.2f}** ({ratio['min']:.2f}–{ratio['max']:.2f})", f"{ours['iterations']}, {stock['iterations']}",
             f"{difference:.0e}" + ("" if same else " **differs**")]
    return f"| {' | '.join(cells)} |", same


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("files", nargs="*", type=pathlib.Path)
    parser.add_argument("--repeats", type=int, default=11)
    parser.add_argument("--strategies", default="dogleg,lm")
    parser.add_argument("--chain", type=int, default=0, help="poses of the odometry chains; 0: none")
    parser.add_argument("--build", type=pathlib.Path, default=ROOT / "build", help="the build directory")
    arguments = parser.parse_args()
    files = list(arguments.files) or sorted((DATA / "pose_graph").glob("*.g2o"))
    all_same = True
    print("| file | poses, edges | strategy | ours, ms | stock, ms | ours / stock | iterations | cost difference |\n" + "|---" * 8 + "|", flush=True)
    with tempfile.TemporaryDirectory() as folder:
        for spatial in (False, True) if arguments.chain > 0 else ():
            files.append(pathlib.Path(folder) / f"chain_{'3d' if spatial else '2d'}.g2o")
            write_chain(files[-1], arguments.chain, 0.01, spatial, seed=1)
        try:
            for path in files:
                for strategy in arguments.strategies.split(","):
                    report = measure(arguments.build.resolve() / "bin" / "ab_compare", path, strategy, arguments.repeats)
                    line, same = row(path, strategy, report)
                    all_same = all_same and same
                    print(line, flush=True)
        except (OSError, RuntimeError, KeyError) as error:
            print(error, file=sys.stderr)
            return 2
    return 0 if all_same else 1


if __name__ == "__main__":
    sys.exit(main())
