#!/usr/bin/env python3
"""Time and memory against size: generated paths of cameras with local visibility and some loops, ours beside stock Ceres.

    benchmarks/scale.py [--build build] [--sizes 250,500,1000,2000] [--solvers TEXT,…] [--json scale.json] [--svg docs/scale.svg]
    benchmarks/scale.py --sizes 1000,10000 --solvers ours,SPARSE     # the large ones: about six minutes
    benchmarks/scale.py --speed_up [--repetitions 5]                     # ours with one thread and with two

Time is that of the solve call, set-up included, until the cost is within 1e-6 of the best final one (of this problem); memory the
peak of a whole process with the problem it has read; all on one thread, stock's CHOLMOD too (stock_environment.py). Stock plays each
linear solver with the ordering it finds itself and with an explicit one, landmarks first; ratios are to the fastest, and to the
leanest, of all that were played. (At 10,000 cameras the limits are 0.5 and 0.8.) The exponent e of each is fitted to
time = c · cameras^e, of stock to the better ordering at each size; it needs three sizes. ITERATIVE_SCHUR takes many times the time of
the others here and runs up to --iterative_up_to cameras.

--speed_up solves the cathedral and a path of 1,000 cameras, ten iterations at most, with one thread and with two in turn, and prints the
ratio of the medians beside its limit, 1.7. Final costs must be the same to the last bit with one thread and with two, and
those of our solvers within 1e-6 of each other.

Leave the machine alone meanwhile. Exit code: 0 measured, and with --speed_up all within limits; 1 --speed_up, and something is not; 2 one of
ours failed.
"""

import argparse
import json
import math
import pathlib
import statistics
import subprocess
import sys
import tempfile

from solve_once import LANDMARKS_FIRST, SOLVERS, generate, solve

ROOT = pathlib.Path(__file__).resolve().parent.parent
TOLERANCE = 1e-6  # relative, between costs
SPEED_UP = 1.7    # at least
COLORS = {"ours, built-in factors": "#0b6e4f", "ours, exact, AutoDiff": "#3a86c8", "stock, SPARSE_SCHUR": "#c1440e",
           "stock, ITERATIVE_SCHUR": "#8d6e63", "stock, DENSE_SCHUR": "#999999"}


def path_flags(num_cameras):
    """As the presets path-1000 and path-10000 of bal_generate."""
    return ["--preset", "path-1000", "--num_cameras", str(num_cameras), "--num_points", str(40 * num_cameras), "--num_observations",
            str(200 * num_cameras)]


def seconds_to(report, cost):
    """When the solve reached this cost; None if it did not."""
    if report["final_cost"] > cost:
        return None
    reached = [sample["seconds"] for sample in report["trace"] if sample["accepted"] and sample["cost"] <= cost]
    return reached[0] if reached else report["seconds"]


def exponent(points):
    """The slope of log(value) against log(size), by least squares; None with fewer than three sizes: two fit any power."""
    if len({size for size, _ in points}) < 3:
        return None
    logs = [(math.log(size), math.log(value)) for size, value in points]
    mean_x, mean_y = (statistics.fmean(values) for values in zip(*logs))
    return sum((x - mean_x) * (y - mean_y) for x, y in logs) / sum((x - mean_x) ** 2 for x, _ in logs)


def least_of_stock(values):
    """The least of stock's values; None if it has none."""
    return min((value for name, value in values.items() if name.startswith("stock") and value is not None), default=None)


def show_ratio(value, reference):
    return "" if value is None or reference is None else f"{value / reference:.2f}"


def measure(build, sizes, solvers, iterative_up_to):
    """[{cameras, solver, seconds, peak_bytes, …}], printed as they come."""
    rows = []
    print("| cameras | solver | s to the cost | of the fastest stock's | s in all | peak, MiB | of the leanest stock's | iterations | final cost |\n"
          "|---|---|---|---|---|---|---|---|---|")
    for size in sizes:
        with tempfile.TemporaryDirectory() as folder:
            problem = pathlib.Path(folder) / "path.txt"
            generate(build, path_flags(size), problem)
            reports = {name: solve(build, problem, name) for name in solvers if "ITERATIVE" not in name or size <= iterative_up_to}
        played = {name: report for name, report in reports.items() if report is not None}
        best = min((report["final_cost"] for report in played.values()), default=None)
        seconds_to_cost = {name: seconds_to(report, best * (1.0 + TOLERANCE)) for name, report in played.items()}
        fastest = least_of_stock(seconds_to_cost)
        leanest = least_of_stock({name: report["peak_bytes"] for name, report in played.items()})
        for name, report in reports.items():
            if report is None:
                if name.startswith("ours"):
                    raise RuntimeError(f"{size} cameras: {name} failed")
                print(f"| {size} | {name} | failed | | | | | | |", flush=True)
                continue
            seconds = seconds_to_cost[name]
            rows.append({"cameras": size, "solver": name, "seconds_to_cost": seconds, "seconds": report["seconds"],
                         "peak_bytes": report["peak_bytes"], "iterations": report["iterations"], "final_cost": report["final_cost"],
                         "linear_solver": report["linear_solver"], "stage_seconds": report["stage_seconds"]})
            shown = "not reached" if seconds is None else f"{seconds:.3g}"
            print(f"| {size} | {name} | {shown} | {show_ratio(seconds, fastest)} | {report['seconds']:.3g} "
                  f"| {report['peak_bytes'] / 2**20:.0f} | {show_ratio(report['peak_bytes'], leanest)} "
                  f"| {report['iterations']} | {report['final_cost']:.9g} |", flush=True)
    return rows


def series(rows, field):
    """{solver: [(cameras, value)]} where there is one; of stock's two orderings the better at each size."""
    result = {}
    for row in rows:
        if row[field] is not None:
            values = result.setdefault(row["solver"].removesuffix(LANDMARKS_FIRST), {})
            values[row["cameras"]] = min(row[field], values.get(row["cameras"], math.inf))
    return {name: sorted(values.items()) for name, values in result.items()}


def print_exponents(rows):
    print("\n| solver | time grows with | memory grows with |\n|---|---|---|")
    memory = series(rows, "peak_bytes")
    for name, points in series(rows, "seconds_to_cost").items():
        fitted = [exponent(points), exponent(memory[name])]
        print(f"| {name} | " + " | ".join("fewer than three sizes" if value is None else f"cameras^{value:.2f}" for value in fitted) + " |")


def panel(rows, field, unit, scale, left):
    """One log-log plot as SVG elements, 420 wide, from x = left on."""
    data = {name: [(size, value / scale) for size, value in points] for name, points in series(rows, field).items()}
    sizes = sorted({size for points in data.values() for size, _ in points})
    values = [value for points in data.values() for _, value in points]
    low, high = math.floor(math.log10(min(values))), math.ceil(math.log10(max(values)))
    span_x = max(math.log(sizes[-1] / sizes[0]), 1e-9)

    def x(size):
        return left + 60 + 330 * math.log(size / sizes[0]) / span_x

    def y(value):
        return 250 - 200 * (math.log10(value) - low) / max(high - low, 1)

    parts = [f'<text x="{left + 225}" y="24" text-anchor="middle" font-size="14">{unit}</text>']
    for power in range(low, high + 1):
        parts.append(f'<line x1="{left + 60}" x2="{left + 390}" y1="{y(10.0**power):.1f}" y2="{y(10.0**power):.1f}" stroke="#ddd"/>'
                     f'<text x="{left + 54}" y="{y(10.0**power) + 4:.1f}" text-anchor="end">{10.0**power:g}</text>')
    parts += [f'<text x="{x(size):.1f}" y="268" text-anchor="middle">{size:,}</text>' for size in sizes]
    parts.append(f'<text x="{left + 225}" y="286" text-anchor="middle">cameras</text>')
    for row, (name, points) in enumerate(data.items()):
        line = " ".join(f"{x(size):.1f},{y(value):.1f}" for size, value in points)
        slope = exponent(points)
        text = name + ("" if slope is None else f" ~ n^{slope:.2f}")
        parts.append(f'<polyline points="{line}" fill="none" stroke="{COLORS[name]}" stroke-width="2"/>')
        parts += [f'<circle cx="{x(size):.1f}" cy="{y(value):.1f}" r="3" fill="{COLORS[name]}"/>' for size, value in points]
        parts.append(f'<text x="{left + 66}" y="{306 + 16 * row}" fill="{COLORS[name]}">{text}</text>')
    return parts


def picture(rows):
    parts = panel(rows, "seconds_to_cost", "seconds to the same cost", 1.0, 0)
    parts += panel(rows, "peak_bytes", "peak memory, MiB", 2.0**20, 420)
    return ('<svg xmlns="http://www.w3.org/2000/svg" width="840" height="380" font-family="sans-serif" font-size="11">\n'
            '<rect width="840" height="380" fill="white"/>\n' + "\n".join(parts) + "\n</svg>\n")


def judge_speed_up(times, costs, reference):
    """The speed-up and a list of what is not within limits. times, costs: {threads: [of each run]}; reference: another solver's cost or None."""
    ratio = statistics.median(times[1]) / statistics.median(times[2])
    cost = costs[1][0]
    wrong = [] if ratio >= SPEED_UP else ["slow"]
    if any(other != cost for values in costs.values() for other in values):
        wrong.append("costs differ between runs")
    if reference is not None and abs(cost - reference) > TOLERANCE * abs(reference):
        wrong.append("cost differs from the other solver's")
    return ratio, wrong


def print_speed_up(build, repetitions):
    """Prints the table; True if all is within limits."""
    fine = True
    print("| problem | solver | 1 thread, s | 2 threads, s | speed-up | at least | within limits | final cost |\n|---|---|---|---|---|---|---|---|")
    for name, flags in (("cathedral", ["--preset", "cathedral"]), ("path of 1,000 cameras", ["--preset", "path-1000"])):
        with tempfile.TemporaryDirectory() as folder:
            problem = pathlib.Path(folder) / "problem.txt"
            generate(build, flags, problem)
            reference = None
            for solver in (solver for solver in SOLVERS if solver.startswith("ours")):
                times, costs = {1: [], 2: []}, {1: [], 2: []}
                for _ in range(repetitions):
                    for threads, seconds in times.items():
                        report = solve(build, problem, solver, ["--num_threads", str(threads), "--max_num_iterations", "10"])
                        if report is None:
                            raise RuntimeError(f"{name}: {solver} failed")
                        seconds.append(report["seconds"])
                        costs[threads].append(report["final_cost"])
                ratio, wrong = judge_speed_up(times, costs, reference)
                reference = costs[1][0]
                fine = fine and not wrong
                verdict = f"**no**: {', '.join(wrong)}" if wrong else "yes"
                print(f"| {name} | {solver} | {statistics.median(times[1]):.3g} | {statistics.median(times[2]):.3g} | {ratio:.2f} "
                      f"| at least {SPEED_UP:g} | {verdict} | {reference!r} |", flush=True)
    return fine


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--build", type=pathlib.Path, default=ROOT / "build", help="the build directory")
    parser.add_argument("--sizes", default="250,500,1000,2000", help="cameras of each problem, 100 at least")
    parser.add_argument("--solvers", default="ours,SPARSE,ITERATIVE", help="those whose name contains one of these texts: " + "; ".join(SOLVERS))
    parser.add_argument("--iterative_up_to", type=int, default=500, help="the largest problem that ITERATIVE_SCHUR is given, in cameras")
    parser.add_argument("--json", type=pathlib.Path, help="write all figures to this file")
    parser.add_argument("--svg", type=pathlib.Path, help="write the plot of time and memory to this file")
    parser.add_argument("--speed_up", action="store_true", help="measure ours with one thread and with two instead")
    parser.add_argument("--repetitions", type=int, default=5, help="runs of each with --speed_up, at least 1")
    arguments = parser.parse_args()
    if arguments.repetitions < 1:
        parser.error("--repetitions: at least 1")
    try:
        if arguments.speed_up:
            return 0 if print_speed_up(arguments.build, arguments.repetitions) else 1
        sizes = [int(size) for size in arguments.sizes.split(",")]
        wanted = arguments.solvers.split(",")
        solvers = [name for name in SOLVERS if any(text in name for text in wanted)]
        if not solvers or min(sizes) < 100:
            parser.error("--solvers names none, or --sizes has one below 100")
        rows = measure(arguments.build, sizes, solvers, arguments.iterative_up_to)
        print_exponents(rows)
        if arguments.json is not None:
            arguments.json.write_text(json.dumps(rows, indent=1), encoding="utf-8")
        if arguments.svg is not None:
            arguments.svg.write_text(picture(rows), encoding="utf-8")
    except (OSError, RuntimeError, subprocess.CalledProcessError) as error:
        print(f"scale.py: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
