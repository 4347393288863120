#!/usr/bin/env python3
"""Runs the tests of a preset as ctest would, but GoogleTest's many to a process.

    tools/test_together.py PRESET [--tests-regex REGEX] [--exclude-regex REGEX] [--label-exclude REGEX] [--size N]

A process, a sanitized one above all, takes longer to start than most tests do. Tests of one program run in one process, --size of them
at most; all others are left to ctest. What a process that failed printed is printed, and is added to ctest's LastTest.log, the
names of its failed tests to LastTestsFailed.log. Exit code 0: all passed.
"""

import argparse
import concurrent.futures
import json
import os
import pathlib
import re
import subprocess
import sys
import time

FILTER = "--gtest_filter="
LEFT_OUT = {"LABELS", "SKIP_REGULAR_EXPRESSION"}  # properties that do not change how a test runs
KEPT = {"ENVIRONMENT", "WORKING_DIRECTORY"}
TIMEOUT = 1500  # seconds of a process: ctest's own for a test


def tests_of(preset, choice):
    """What ctest would run with these options, in its own words."""
    command = ["ctest", "--preset", preset, "--show-only=json-v1", *choice]
    return json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)["tests"]


def group(tests, size):
    """Groups ((command without its filter, properties), names in gtest's words) of at most `size`, and the names of all others."""
    groups, others = {}, []
    for test in tests:
        properties = {p["name"]: p["value"] for p in test.get("properties", [])}
        filters = [word for word in test["command"][1:] if word.startswith(FILTER)]
        if len(filters) != 1 or set(properties) - LEFT_OUT - KEPT:
            others.append(test["name"])
            continue
        command = tuple(word for word in test["command"] if not word.startswith(FILTER))
        key = command, tuple(properties.get("ENVIRONMENT", ())), properties.get("WORKING_DIRECTORY")
        groups.setdefault(key, []).append(filters[0][len(FILTER):])
    parts = [(key, names[i:i + size]) for key, names in groups.items() for i in range(0, len(names), size)]
    return parts, others


def failed_tests(names, code, output):
    """Those of `names` that did not pass: all without a verdict, or those that had begun where the process failed; all where none had."""
    left = [name for name in names if not re.search(rf"\[ +(OK|SKIPPED) +\] {re.escape(name)}\b", output)]
    if not code:
        return left
    begun = set(re.findall(r"\[ +RUN +\] (\S+)", output))
    return [name for name in left if name in begun] or names


def run(part):
    """Runs one group: its names, what failed of them, what was printed, and the seconds it took."""
    (command, environment, folder), names = part
    began = time.monotonic()
    try:
        done = subprocess.run([*command, FILTER + ":".join(names)], cwd=folder, stdin=subprocess.DEVNULL, timeout=TIMEOUT, check=False,
                              env={**os.environ, **dict(e.split("=", 1) for e in environment)},
                              stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
        code, printed, end = done.returncode, done.stdout, ""
    except subprocess.TimeoutExpired as timeout:
        code, printed, end = 1, timeout.stdout or b"", f"\nstopped after {TIMEOUT} s\n"
    output = printed.decode(errors="replace") + end
    return names, failed_tests(names, code, output), output, time.monotonic() - began


def run_together(parts, logs):
    """Runs all groups, as many at once as there are processors; the names of the tests that failed."""
    failed, count, done = [], sum(len(names) for _, names in parts), 0
    logs.mkdir(parents=True, exist_ok=True)
    with concurrent.futures.ThreadPoolExecutor(os.cpu_count() or 1) as pool:
        for part, (names, bad, output, seconds) in zip(parts, pool.map(run, parts)):
            done += len(names)
            program = pathlib.Path(part[0][0][0]).name
            print(f"{done:5}/{count} {program} {names[0]} … {len(names)} tests: {'***Failed' if bad else 'passed'} in {seconds:.2f} s", flush=True)
            if bad:
                print(output, flush=True)
                failed += bad
                with open(logs / "LastTest.log", "a", encoding="utf-8") as log:
                    log.write(output)
                with open(logs / "LastTestsFailed.log", "a", encoding="utf-8") as log:
                    log.writelines(f"{program}:{name}\n" for name in bad)
    return failed


def main():
    """What the head of this file says."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("preset")
    choices = {"--tests-regex": "only tests whose names match", "--exclude-regex": "without tests whose names match",
               "--label-exclude": "without tests that have a label that matches"}
    for option, what in choices.items():
        parser.add_argument(option, help=what)
    parser.add_argument("--size", type=int, default=40, help="tests of a process, at most")
    options = parser.parse_args()
    given = ((option, getattr(options, option[2:].replace("-", "_"))) for option in choices)
    choice = [word for option, value in given if value for word in (option, value)]
    parts, others = group(tests_of(options.preset, choice), options.size)
    if not parts and not others:
        sys.exit(f"no test of preset {options.preset} was chosen")
    code = 0
    if others:
        pattern = "^(" + "|".join(re.sub(r"([.+*?|()\[\]^$\\])", r"\\\1", name) for name in others) + ")$"
        code = subprocess.run(["ctest", "--preset", options.preset, "--parallel", str(os.cpu_count() or 1),
                               "--tests-regex", pattern], check=False).returncode
    failed = run_together(parts, pathlib.Path(f"build-{options.preset}" if options.preset != "default" else "build") / "Testing/Temporary")
    for name in failed:
        print(f"failed: {name}")
    return 1 if failed or code else 0


if __name__ == "__main__":
    sys.exit(main())
