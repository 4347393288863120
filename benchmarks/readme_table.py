#!/usr/bin/env python3
"""Measures whole solves: ours against stock Ceres on the problems named below, one row a run of ab_compare. docs/performance.md has
all of them; --record puts those that the README shows into benchmarks/readme_figures.json, with machine, commit and date, for
docs/make_readme_chart.py to draw.

    benchmarks/readme_table.py [--repeats 11] [--only TEXT] [--stages] [--record]

With --stages each row is followed by its parts: set-up, residuals, Jacobians, linear step, everything else. Needs build/bin/ab_compare and the data of INCERES_DATA_DIR (or ../shared/data beside the repository). In rows of one thread stock's CHOLMOD
is kept on one too (stock_environment.py); with two it is as packaged. Leave the machine alone meanwhile. Exit code: 0 all ratios within
their limits and no cost above stock's, 1 one is not, 2 a row could not be measured.
"""

import argparse
import datetime
import json
import os
import pathlib
import subprocess
import sys
import tempfile

from stock_environment import num_threads_in, stock_environment

ROOT = pathlib.Path(__file__).resolve().parent.parent
DATA = pathlib.Path(os.environ.get("INCERES_DATA_DIR", ROOT.parent / "shared" / "data"))
COST_EXCESS = 1e-6  # relative, at most
LINEAR_STEP = ("linear_solver", "hessian", "elimination", "factorization", "back_substitution")  # stock's name, ours
STAGES = {"set-up": ("preprocessor", "setup"), "residuals": ("residuals",), "Jacobians": ("jacobians",), "linear step": LINEAR_STEP}
FIFTY = ["--max_num_iterations", "50", "--function_tolerance", "0", "--gradient_tolerance", "0", "--parameter_tolerance", "0"]
LADYBUG = f"bal:{DATA}/bal/problem-49-7776-pre.txt"

# What the row says, the problem, the flags, and the largest ratio allowed (None: to be seen). LINEAR_LIMITS has those whose linear
# step has one of its own: it gets a row too.
ROWS = [
    ("Ladybug-49, LM, 50 iterations, AutoDiff, 1 thread", LADYBUG, FIFTY, 0.50),
    ("the same, 2 threads", LADYBUG, FIFTY + ["--num_threads", "2"], 0.36),
    ("the same, our built-in factors, 1 thread", LADYBUG, FIFTY + ["--builtin_factors"], 0.22),
    ("the same, our built-in factors, 2 threads", LADYBUG, FIFTY + ["--builtin_factors", "--num_threads", "2"], 0.17),
    ("the same, analytic cost functions for both, 1 thread", LADYBUG, FIFTY + ["--analytic"], 0.36),
    ("the same, analytic cost functions for both, 2 threads", LADYBUG, FIFTY + ["--analytic", "--num_threads", "2"], 0.28),
    ("Ladybug-49, Dog-Leg, 50 iterations, AutoDiff, 1 thread", LADYBUG, FIFTY + ["--trust_region", "dogleg"], None),
    ("bundled street, 16 cameras, LM, AutoDiff, 1 thread", f"bal:{ROOT}/bal_data/street-16-1200-pre.txt", [], None),
    ("sphere.g2o, Dog-Leg, AutoDiff, 1 thread", f"g2o:{DATA}/pose_graph/sphere.g2o", ["--trust_region", "dogleg"], None),
    ("M3500.g2o, LM, AutoDiff, 1 thread", f"g2o:{DATA}/pose_graph/M3500.g2o", [], None),
    ("M3500.g2o, Dog-Leg, AutoDiff, 1 thread", f"g2o:{DATA}/pose_graph/M3500.g2o", ["--trust_region", "dogleg"], None),
    ("sphere.g2o, incremental mode, Dog-Leg", f"g2o:{DATA}/pose_graph/sphere.g2o", ["--mode", "incremental", "--trust_region", "dogleg"], None),
    ("M3500.g2o, incremental mode, Dog-Leg", f"g2o:{DATA}/pose_graph/M3500.g2o", ["--mode", "incremental", "--trust_region", "dogleg"], None),
]
LINEAR_LIMITS = {ROWS[0][0]: 0.35}
FIGURES = ROOT / "benchmarks" / "readme_figures.json"


def measure(problem, flags, repeats):
    with tempfile.TemporaryDirectory() as folder:
        report = pathlib.Path(folder) / "report.json"
        command = [ROOT / "build/bin/ab_compare", "--problem", problem, "--repeats", str(repeats), "--json", report, *flags]
        result = subprocess.run(command, env=stock_environment(num_threads_in(flags)), stdout=subprocess.DEVNULL, stderr=subprocess.PIPE,
                                text=True, check=False)
        if result.returncode not in (0, 3):  # 3: our cost is above stock's, which is judged here
            raise RuntimeError(f"{problem}: {result.stderr.strip()}")
        return json.loads(report.read_text(encoding="utf-8"))


def contenders(report):
    """Our run and that of the fastest stock configuration."""
    ours = next(run for run in report["runs"] if run["solver"] == "inceres")
    return ours, min((run for run in report["runs"] if run["solver"] == "ceres"), key=lambda run: run["seconds"]["median"])


def cells_of(ours, stock, configuration, ratio, limit, last):
    return [f"{1e3 * ours:.0f} ms", f"{1e3 * stock:.0f} ms ({configuration.upper()})", f"**{ratio:.2f}**",
            "-" if limit is None else f"{limit:.2f}", last]


def verdict(limit, is_within):
    return "**no**" if not is_within else "" if limit is None else "yes"


def judge(report, limit):
    """The cells of a row after its text, and whether all is within its limits."""
    ours, stock = contenders(report)
    ratio, excess = report["ratio_to_best_stock"]["median"], report["relative_cost_difference"]
    is_within = (limit is None or ratio <= limit) and excess <= COST_EXCESS
    cells = cells_of(ours["seconds"]["median"], stock["seconds"]["median"], stock["configuration"], ratio, limit, f"{excess:.0e}")
    return [*cells, verdict(limit, is_within)], is_within


def seconds_in(run, stages):
    return sum(run["stage_seconds"].get(stage, 0.0) for stage in stages)


def judge_linear_step(report, limit):
    """As judge, of the linear step alone: of medians, as a round's are a few milliseconds an iteration."""
    ours, stock = contenders(report)
    ratio = seconds_in(ours, LINEAR_STEP) / seconds_in(stock, LINEAR_STEP)
    is_within = ratio <= limit
    cells = cells_of(seconds_in(ours, LINEAR_STEP), seconds_in(stock, LINEAR_STEP), stock["configuration"], ratio, limit, "")
    return [*cells, verdict(limit, is_within)], is_within


def parts(report):
    """Rows with the milliseconds of each stage, ours and stock's."""
    columns = []
    for run in contenders(report):
        times = {name: seconds_in(run, stages) for name, stages in STAGES.items()}
        times["everything else"] = run["seconds"]["median"] - sum(times.values())
        known = any(stage in run["stage_seconds"] for stages in STAGES.values() for stage in stages)  # not of incremental mode
        columns.append({name: f"{1e3 * time:.1f} ms" if known else "-" for name, time in times.items()})
    return [f"| – {name} | {columns[0][name]} | {columns[1][name]} | | | | |" for name in columns[0]]


def processor():
    """What the machine calls its processor."""
    for line in pathlib.Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
        if line.startswith("model name"):
            return line.partition(":")[2].strip()
    return "unknown processor"


def commit():
    command = ["git", "-C", ROOT, "rev-parse", "--short", "HEAD"]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()


def record(figures, text, report, repeats, provenance):
    """Puts a report into the rows of the README's figures that are of this row; returns how many they are."""
    ours, stock = contenders(report)
    rows = [row for row in figures["rows"] if row.get("row") == text]
    for row in rows:
        row.update(ceres_ms=1e3 * stock["seconds"]["median"], inceres_ms=1e3 * ours["seconds"]["median"],
                   ratio=report["ratio_to_best_stock"]["median"],
                   command=f"benchmarks/readme_table.py --repeats {repeats} --only '{text}'", **provenance)
    return len(rows)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repeats", type=int, default=11, help="rounds, at least 1")
    parser.add_argument("--only", default="", help="only the rows whose text contains this")
    parser.add_argument("--stages", action="store_true", help="each row's parts too")
    parser.add_argument("--record", action="store_true", help="put rows that the README shows into readme_figures.json")
    arguments = parser.parse_args()
    chosen = [row for row in ROWS if arguments.only in row[0]]
    if arguments.repeats < 1 or not chosen:
        parser.error("--repeats is below 1, or --only names no row")
    print("| problem | ours | fastest stock | ratio | limit | relative difference of final costs | within |\n"
          "|---|---|---|---|---|---|---|", flush=True)
    all_fine = True
    figures = json.loads(FIGURES.read_text(encoding="utf-8"))
    try:
        provenance = {"machine": f"{processor()}, {os.cpu_count()} threads", "commit": commit(),
                      "date": datetime.date.today().isoformat()} if arguments.record else {}
        for text, problem, flags, limit in chosen:
            report = measure(problem, flags, arguments.repeats)
            if arguments.record and record(figures, text, report, arguments.repeats, provenance) > 0:
                FIGURES.write_text(json.dumps(figures, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
            judged = [(text, *judge(report, limit))]
            if text in LINEAR_LIMITS:
                judged.append(("its linear step alone", *judge_linear_step(report, LINEAR_LIMITS[text])))
            all_fine = all_fine and all(fine for _, _, fine in judged)
            rows = [f"| {name} | {' | '.join(cells)} |" for name, cells, _ in judged] + (parts(report) if arguments.stages else [])
            print("\n".join(rows), flush=True)
    except (OSError, RuntimeError, subprocess.CalledProcessError, KeyError, TypeError, ValueError) as error:  # a report without what is read here
        print(f"readme_table.py: {error!r}", file=sys.stderr)
        return 2
    return 0 if all_fine else 1


if __name__ == "__main__":
    sys.exit(main())
