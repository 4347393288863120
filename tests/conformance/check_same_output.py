#!/usr/bin/env python3
"""Checks that a program prints the same with a library preloaded as without, but for times.

    check_same_output.py PROGRAM LIBRARY [--differs] [VARIABLE=VALUE ...]

The program runs twice, bare and with LD_PRELOAD=LIBRARY and the variables. The times of Ceres's progress table and of its full
report are masked; every other character of standard output must be equal, or with --differs something must not. Exits with 1
otherwise, and with the differences.
"""

import difflib
import os
import re
import subprocess
import sys

# The last two columns of the trust-region table, the last three times of the line-search table, and the times of the full report.
ROW = re.compile(r"^( *\d+ .*?)( +\d\.\d\de[-+]\d\d){2}$", re.MULTILINE)
LINE_SEARCH_ROW = re.compile(r"\bit: *\d\.\d\de[-+]\d\d tt: *\d\.\d\de[-+]\d\d")
REPORT = re.compile(r" +\d+\.\d{6}( \(\d+\))?$", re.MULTILINE)


def run(program, changes):
    environment = {name: value for name, value in os.environ.items() if name != "LD_PRELOAD" and not name.startswith("INCERES_")}
    # A preloaded library with a sanitizer's runtime comes before the program's own: that is what is wanted here.
    environment["ASAN_OPTIONS"] = environment.get("ASAN_OPTIONS", "") + ":verify_asan_link_order=0"
    environment.update(changes)
    result = subprocess.run([program], env=environment, stdout=subprocess.PIPE, check=True, text=True)
    masked, rows = ROW.subn(r"\1 TIMES", result.stdout)
    masked, _ = LINE_SEARCH_ROW.subn("it: TIME tt: TIME", masked)
    masked, times = REPORT.subn(r" TIME\1", masked)
    return masked, rows, times


def main():
    program, library, *variables = sys.argv[1:]
    differs = "--differs" in variables
    variables = [variable for variable in variables if variable != "--differs"]
    bare, rows, times = run(program, {})
    changed, _, _ = run(program, {"LD_PRELOAD": library, **dict(pair.split("=", 1) for pair in variables)})
    if rows < 50 or times < 50:
        print(f"only {rows} rows and {times} times were printed: this is not the output meant")
        return 1
    difference = list(difflib.unified_diff(bare.splitlines(), changed.splitlines(), "bare", "preloaded", lineterm=""))
    print("\n".join(difference) if difference else f"{bare.count(chr(10))} lines agree ({rows} rows, {times} times masked)")
    return 0 if bool(difference) == differs else 1


if __name__ == "__main__":
    sys.exit(main())
