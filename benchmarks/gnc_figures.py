#!/usr/bin/env python3
"""How many wrong loops graduated non-convexity finds in pose graphs: the table of docs/pose_graphs.md.

    benchmarks/gnc_figures.py build/bin/pose_graph_solve FILE.g2o… [--fractions 0.1,0.2,…]
                              [--seeds 10] [--first_seed 1] [--convention geodesic] [--flags "…"] [--json FILE]
    benchmarks/gnc_figures.py build/bin/replay FILE.g2o… --living [--steps 0] [--tolerance 1e-6]
                              [--fractions …] [--seeds …] [--first_seed …] [--flags "…"]

For each file and each share of wrong loops among all loops runs the tool with --gnc --outliers for
seeds 1, 2, … (or from another first), and prints a row: wrong loops found, right ones lost, the
RMS difference of positions to the solution without wrong loops, weighted problems and seconds; each as the worst seed's, and the
number of seeds in which every wrong loop was found. M3500 takes seconds a run, a sphere of 2500 poses
a minute.

With --living the graph grows pose by pose, and replay plays it with wrong loops and GNC, with GNC alone, and
with neither, one after the other: a row has what was found by the end, and the processor time of all Updates
over that of those with neither, median and largest of the seeds.
"""

import argparse
import json
import pathlib
import shlex
import statistics
import subprocess
import sys
import tempfile


def run(tool, path, fraction, seed, convention, flags):
    command = [tool, "--input", path, "--gnc", "--outliers", str(fraction), "--seed", str(seed),
               "--convention", convention, "--quiet", "--json", "-", *flags]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        sys.exit(f"{shlex.join(map(str, command))}\n{done.stderr}")
    return json.loads(done.stdout)


def row(path, fraction, reports):
    scores = [report["outliers"] for report in reports]
    missed = [score["num_wrong"] - score["num_wrong_found"] for score in scores]
    lost = max(100.0 * score["num_right_lost"] / score["num_right"] for score in scores)
    rms = max(100.0 * score["rms_difference"] / score["extent"] for score in scores)
    rounds = statistics.median(len(report["gnc"]["rounds"]) for report in reports)
    seconds = statistics.median(report["seconds"] for report in reports)
    return (f"| {pathlib.Path(path).stem} | {100.0 * fraction:.0f} % | {scores[0]['num_wrong']} | "
            f"{missed.count(0)} of {len(missed)} | {max(missed)} | {lost:.2f} % | {rms:.3f} % | "
            f"{rounds:g} | {seconds:.1f} |")


def play(tool, path, steps, tolerance, flags):
    """Processor milliseconds of all Updates, and the counts of the last one."""
    with tempfile.NamedTemporaryFile(suffix=".json") as report:
        command = [tool, "--problem", f"g2o:{path}", "--nostock", "--function_tolerance", str(tolerance), "--steps", str(steps),
                   "--print_every", "1000000", "--json", report.name, *flags]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode != 0:
            sys.exit(f"{shlex.join(map(str, command))}\n{done.stderr}")
        rows = json.load(report)["rows"]
        return sum(row["ours"]["processor_ms"] for row in rows), rows[-1]["ours"]["work"]


def living_row(arguments, path, fraction):
    ratios, alone, last = [], [], []
    for seed in range(arguments.first_seed, arguments.first_seed + arguments.seeds):
        runs = [play(arguments.tool, path, arguments.steps, arguments.tolerance, flags + shlex.split(arguments.flags))
                for flags in ([], ["--gnc"], ["--gnc", "--outliers", str(fraction), "--seed", str(seed)])]
        alone.append(runs[1][0] / runs[0][0])
        ratios.append(runs[2][0] / runs[0][0])
        last.append(runs[2][1])
    missed = [work["num_wrong"] - work["num_wrong_found"] for work in last]
    return (f"| {pathlib.Path(path).stem} | {100.0 * fraction:.0f} % | {last[0]['num_wrong']} | {missed.count(0)} of {len(missed)} | "
            f"{max(missed)} | {max(work['num_right_lost'] for work in last)} | {statistics.median(alone):.2f} ({max(alone):.2f}) | "
            f"{statistics.median(ratios):.2f} ({max(ratios):.2f}) |")


def print_living(arguments):
    print("| file | wrong of all loops | wrong loops | seeds that find all | most missed | right lost | GNC / without | "
          "with wrong loops / without |\n|---|---|---|---|---|---|---|---|", flush=True)
    for path in arguments.files:
        for fraction in map(float, arguments.fractions.split(",")):
            print(living_row(arguments, path, fraction), flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("tool")
    parser.add_argument("files", nargs="+")
    parser.add_argument("--fractions", default="0.1,0.2,0.3,0.4,0.5")
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--first_seed", type=int, default=1)
    parser.add_argument("--convention", default="geodesic")
    parser.add_argument("--flags", default="", help="more flags of the tool")
    parser.add_argument("--json", help="append the reports to this file, one a line")
    parser.add_argument("--living", action="store_true", help="the tool is replay: GNC on a graph that grows")
    parser.add_argument("--steps", type=int, default=0, help="with --living: only the first so many; 0: all")
    parser.add_argument("--tolerance", type=float, default=1e-6, help="with --living: function_tolerance")
    arguments = parser.parse_args()
    if arguments.living:
        for name in ("convention", "json"):
            if getattr(arguments, name) != parser.get_default(name):
                parser.error(f"--{name} is not for --living")
        print_living(arguments)
        return
    print("| file | wrong of all loops | wrong loops | seeds that find all | most missed | "
          "right lost | RMS | rounds | s |\n|---|---|---|---|---|---|---|---|---|", flush=True)
    for path in arguments.files:
        for fraction in map(float, arguments.fractions.split(",")):
            reports = [run(arguments.tool, path, fraction, seed, arguments.convention,
                           shlex.split(arguments.flags))
                       for seed in range(arguments.first_seed, arguments.first_seed + arguments.seeds)]
            print(row(path, fraction, reports), flush=True)
            if arguments.json:
                with open(arguments.json, "a", encoding="utf-8") as log:
                    for report in reports:
                        report["gnc"].pop("outliers")
                        log.write(json.dumps(report) + "\n")


if __name__ == "__main__":
    main()
