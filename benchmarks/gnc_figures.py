#!/usr/bin/env python3
"""How many wrong loops graduated non-convexity finds in pose graphs: the table of docs/pose_graphs.md.

    benchmarks/gnc_figures.py build/bin/pose_graph_solve FILE.g2o… [--fractions 0.1,0.2,…]
                              [--seeds 10] [--first_seed 1] [--convention geodesic] [--flags "…"] [--json FILE]

For each file and each share of wrong loops among all loops runs the tool with --gnc --outliers for
seeds 1, 2, … (or from another first), and prints a row: wrong loops found, right ones lost, the
RMS difference of positions to the solution without wrong loops, weighted problems and seconds; each as the worst seed's, and the
number of seeds in which every wrong loop was found. M3500 takes seconds a run, a sphere of 2500 poses
a minute.
"""

import argparse
import json
import pathlib
import shlex
import statistics
import subprocess
import sys


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
    arguments = parser.parse_args()
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
