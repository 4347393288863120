#!/usr/bin/env python3
"""Asks whether two builds do the same, bit by bit: what a change that is to move code only must not change.

    benchmarks/golden_traces.py --build build --against ../before/build [--only TEXT]

Plays solves, replays and windows with both builds and compares their JSON reports, all but times and names: in exact mode the cost
of every iteration, in incremental mode the counts and costs of every Update, of windows the sum of all final costs
and the trajectory's error. Numbers are written so that they read back exactly; they are the same or they are not. Both builds run on
this machine, for another processor rounds elsewhere.

Needs bin/ and libinceres_dropin.so in both build directories and the data of INCERES_DATA_DIR (or ../shared/data beside the
repository); what needs a file that is missing is skipped by name. Exit code: 0 all the same, 1 something differs, 2 a run could not
be played.
"""

import argparse
import os
import pathlib
import re
import sys
import tempfile

from drop_in_figures import ROOT, find_dropin, play

DATA = pathlib.Path(os.environ.get("INCERES_DATA_DIR", ROOT.parent / "shared" / "data"))
# What differs from run to run, or says where and when: times, memory, and the description of the build.
NOT_COMPARED = re.compile(r"(^|_)(ms|seconds|second|time|times|bytes|date|commit|compiler|flags|build|machine|environment|ratio|median|p95|speed_up)(_|$)")


def bal(file):
    return DATA / "bal" / file


def traces():
    """(name, file it needs or None, program, flags, mode of the drop-in or None)."""
    for file in (ROOT / "bal_data" / "street-16-1200-pre.txt", bal("problem-49-7776-pre.txt"), bal("problem-21-11315-pre.txt")):
        short = file.name.removesuffix("-pre.txt")
        for flags in ([], ["--builtin_factors"], ["--trust_region", "dogleg"], ["--robust", "huber:1.0"],
                      ["--robust", "cauchy:1.0", "--builtin_factors", "--mode", "incremental"], ["--mode", "incremental"]):
            yield f"{short} {' '.join(flags)}", file, "bal_solve", ["--input", file, *flags], None
    for name, problem, file, flags in (
            ("Ladybug-49 camera by camera", "bal:{}", bal("problem-49-7776-pre.txt"), []),
            ("fr3_office", "kf:{}", DATA / "keyframes" / "fr3_office.kf", []),
            ("path of 250", "path:250", None, ["--loops"]),
            ("KITTI stereo", "stereo:{}", DATA / "stereo", ["--steps", "40"]),
            ("M3500", "g2o:{}", DATA / "pose_graph" / "M3500.g2o", ["--steps", "400"]),
            ("sphere", "g2o:{}", DATA / "pose_graph" / "sphere.g2o", ["--steps", "200"])):
        flags = ["--problem", problem.format(file), "--stock=false", "--optimum=false", *flags]
        yield name, file, "replay", flags, None
    yield "M3500, exact", DATA / "pose_graph" / "M3500.g2o", "replay", \
        ["--problem", f"g2o:{DATA / 'pose_graph' / 'M3500.g2o'}", "--mode", "exact", "--stock=false", "--optimum=false", "--steps", "150"], None
    for mode in ("exact", "incremental", "auto"):
        yield f"VINS window, {mode}", None, "vins_window", ["--frames", "60"], mode
        yield f"VINS window from the start, {mode}", None, "vins_window", ["--scene", "startup"], mode
        yield f"OKVIS map, {mode}", None, "okvis_map", ["--frames", "60", "--free_extrinsics"], mode


def values(report, path=""):
    """{path: number or text} of a report, but for what is not compared."""
    if isinstance(report, dict):
        pairs = ((key, value) for key, value in report.items() if not NOT_COMPARED.search(key))
    elif isinstance(report, list):
        pairs = enumerate(report)
    else:
        return {path: report}
    found = {}
    for key, value in pairs:
        found.update(values(value, f"{path}/{key}"))
    return found


def compare(name, ours, theirs):
    """Prints a line; True if all is the same."""
    ours, theirs = values(ours), values(theirs)
    differing = [path for path in {**ours, **theirs} if ours.get(path) != theirs.get(path)]
    verdict = "the same" if not differing else f"**{len(differing)} differ**, the first: {differing[0]}: " \
        f"{ours.get(differing[0])!r}, against {theirs.get(differing[0])!r}"
    print(f"{name}: {len(ours)} values, {verdict}", flush=True)
    return not differing and bool(ours)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--build", type=pathlib.Path, default=ROOT / "build", help="the build directory")
    parser.add_argument("--against", type=pathlib.Path, required=True, help="the other one")
    parser.add_argument("--only", default="", help="only what has this in its name")
    arguments = parser.parse_args()
    same, played = True, 0
    try:
        with tempfile.TemporaryDirectory() as folder:
            for name, file, program, flags, mode in traces():
                if arguments.only not in name:
                    continue
                if file is not None and not file.exists():
                    print(f"{name}: skipped, {file} is missing")
                    continue
                report = pathlib.Path(folder) / "report.json"
                reports = [play([build.resolve() / "bin" / program, *flags], report, mode, find_dropin(build))
                           for build in (arguments.build, arguments.against)]
                same = compare(name, *reports) and same
                played += 1
    except (OSError, RuntimeError, ValueError) as error:
        print(error, file=sys.stderr)
        return 2
    return (0 if same else 1) if played > 0 else 2


if __name__ == "__main__":
    sys.exit(main())
