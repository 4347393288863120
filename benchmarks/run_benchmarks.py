#!/usr/bin/env python3
"""Runs the benchmarks and writes one JSON of it all, with machine, compiler, flags and commit.

    benchmarks/run_benchmarks.py --output now.json [--build build] [--only kernels,stages,phases,bal_reading] [--filter REGEX]
                                 [--repetitions 11] [--min_time 0.02]

Two such files are compared by compare_runs.py. By default kernels and stages, about three minutes. Needs a build with
-DINCERES_BUILD_BENCHMARKS=ON. Leave the machine alone meanwhile. Exit code: 0 written, 2 a benchmark could not be run.
"""

import argparse
import json
import pathlib
import re
import subprocess
import sys
import tempfile

from stock_environment import stock_environment

ROOT = pathlib.Path(__file__).resolve().parent.parent
NAMES = ("kernels", "stages", "phases", "bal_reading")


def run(program, arguments):
    """The report of one program: its context and its benchmarks."""
    with tempfile.TemporaryDirectory() as folder:
        report = pathlib.Path(folder) / "report.json"
        # Repetitions of different benchmarks in random order: a busy second of the machine does not hit one of them alone.
        command = [program, f"--benchmark_out={report}", "--benchmark_out_format=json", f"--benchmark_filter={arguments.filter}",
                   f"--benchmark_repetitions={arguments.repetitions}", f"--benchmark_min_time={arguments.min_time}",
                   "--benchmark_enable_random_interleaving=true"]
        subprocess.run([str(part) for part in command], env=stock_environment(), check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        text = report.read_text(encoding="utf-8")
        return json.loads(text) if text else {"context": {}, "benchmarks": []}  # nothing matched the filter


def build_settings(build):
    """Compiler and flags as CMake has them."""
    cache = (build / "CMakeCache.txt").read_text(encoding="utf-8")
    entries = dict(re.findall(r"^(\w+):\w+=(.*)$", cache, re.MULTILINE))
    build_type = entries.get("CMAKE_BUILD_TYPE", "")
    compiler = subprocess.run([entries["CMAKE_CXX_COMPILER"], "--version"], capture_output=True, text=True, check=True).stdout
    flags = f"{entries.get('CMAKE_CXX_FLAGS', '')} {entries.get('CMAKE_CXX_FLAGS_' + build_type.upper(), '')}".strip()
    return {"compiler": compiler.splitlines()[0], "flags": flags, "build_type": build_type}


def commit():
    result = subprocess.run(["git", "-C", str(ROOT), "describe", "--always", "--dirty", "--abbrev=12"], capture_output=True, text=True,
                            check=False)
    return result.stdout.strip() or "unknown"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--output", type=pathlib.Path, required=True)
    parser.add_argument("--build", type=pathlib.Path, default=ROOT / "build")
    parser.add_argument("--only", default="kernels,stages", help=f"some of {', '.join(NAMES)}")
    parser.add_argument("--filter", default=".", help="only the benchmarks whose name matches")
    parser.add_argument("--repetitions", type=int, default=11)
    parser.add_argument("--min_time", type=float, default=0.02, help="seconds of each repetition")
    arguments = parser.parse_args()
    names = arguments.only.split(",")
    unknown = [name for name in names if name not in NAMES]
    if unknown:
        parser.error(f"--only: no benchmarks {', '.join(unknown)}; there are {', '.join(NAMES)}")
    try:
        result = {"commit": commit(), **build_settings(arguments.build), "benchmarks": []}
        for name in names:
            report = run(arguments.build / "bin" / f"{name}_benchmark", arguments)
            result["context"] = report["context"] or result.get("context", {})
            result["benchmarks"] += [{**benchmark, "name": f"{name}: {benchmark['name']}"} for benchmark in report["benchmarks"]
                                     if benchmark["run_type"] == "iteration" and not benchmark.get("error_occurred", False)]
        if not result["benchmarks"]:
            raise RuntimeError(f"no benchmark matches {arguments.filter}")
        arguments.output.write_text(json.dumps(result, indent=1), encoding="utf-8")
    except (OSError, KeyError, RuntimeError, subprocess.CalledProcessError) as error:
        print(f"run_benchmarks.py: {error}", file=sys.stderr)
        return 2
    print(f"{len(result['benchmarks'])} runs at {result['commit']} in {arguments.output}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
