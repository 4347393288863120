#!/usr/bin/env python3
"""Compares the table of docs/licenses.md with what ldd shows of built files.

    check_licenses.py PAGE COLUMN=FILE...    print each difference, exit with 1 if there is any
    check_licenses.py --self_test            see that each kind of difference is reported

COLUMN is "core", "io", "ceres and drop-in" or "tools". Every library that a FILE loads has a row
with "brings" or "may" in its column; what the page says it always brings is loaded by one of the
column's files; and no license with the GPL in it stands in the rows that core or io bring, but
those with GCC's exception and the LGPL.
"""

import collections
import pathlib
import re
import subprocess
import sys

HEADER = ["library", "of", "license"]
MARKS = {"brings", "may", "-"}
# The kernel's own page of code, and the loader, which is a part of the C library.
NOT_LIBRARIES = re.compile(r"linux-vdso|ld-linux|linux-gate|/ld")


def rows_of(page):
    """A dict for each row of the table: its cells by the names of their columns."""
    rows, header = [], None
    for line in page.splitlines():
        cells = []
        if line.startswith("|"):
            cells = [cell.strip().strip("`") for cell in line.strip().strip("|").split("|")]
        if cells[:3] == HEADER:
            header = cells
        elif header and not cells:
            header = None
        elif header and not set(line) <= set("|- "):
            rows.append(dict(zip(header, cells)))
    return rows


def stem(soname):
    return pathlib.PurePath(soname).name.partition(".so")[0]


def loaded_by(file):
    """Names of the libraries, without versions, that a program or library loads."""
    done = subprocess.run(["ldd", file], check=True, capture_output=True, text=True)
    lines = done.stdout.splitlines()
    missing = [line.strip() for line in lines if "not found" in line]
    if missing:
        sys.exit(f"{file}: {'; '.join(missing)}")
    return {stem(line.split()[0]) for line in lines if not NOT_LIBRARIES.search(line.split()[0])}


def is_gpl(license_text):
    text = re.sub(r"LGPL|GPL [\d+]+ with the runtime library exception", "", license_text)
    return "GPL" in text


def differences(rows, loaded):
    """loaded: of each column what its files load, a set for each file."""
    problems = []
    names = [row["library"] for row in rows]
    problems += [f"{name} has {count} rows" for name, count in collections.Counter(names).items()
                 if count > 1]
    for column, files in loaded.items():
        marks = {row["library"]: row.get(column) for row in rows}
        problems += [f'{name}: "{mark}" in column {column}' for name, mark in marks.items()
                     if mark not in MARKS]
        everything = set().union(*files)
        problems += [f"{column} loads {name}, which the page does not say"
                     for name in sorted(everything) if marks.get(name, "-") == "-"]
        problems += [f"{column} does not load {name}, which the page says it brings"
                     for name, mark in marks.items() if mark == "brings" and name not in everything]
    problems += [f"{row['library']} is under the GPL and in column {column}" for row in rows
                 for column in ("core", "io") if is_gpl(row["license"]) and row.get(column) != "-"]
    return problems


SAMPLE = """
| library | of | license | core | io |
|---|---|---|---|---|
| `libamd` | SuiteSparse | BSD | brings | - |
| `libspqr` | SuiteSparse | **GPL 2+** | - | - |
| `libgomp` | GCC | GPL 3+ with the runtime library exception | may | - |
| `libc` | glibc | LGPL 2.1+ | brings | brings |

libz | no row
"""


def self_test():
    rows = rows_of(SAMPLE)
    good = {"core": [{"libamd", "libc"}], "io": [{"libc"}]}
    cases = [
        ("nothing", rows, good, None),
        ("one that may be loaded", rows, {**good, "core": [{"libamd", "libc", "libgomp"}]}, None),
        ("an unknown library", rows, {**good, "io": [{"libc", "libz"}]}, "io loads libz"),
        ("one the page denies", rows, {**good, "core": [{"libamd", "libc", "libspqr"}]},
         "core loads libspqr"),
        ("one that is not loaded", rows, {**good, "core": [{"libc"}]}, "core does not load libamd"),
        ("the GPL in the core", rows_of(SAMPLE.replace("**GPL 2+** | -", "**GPL 2+** | may")), good,
         "libspqr is under the GPL"),
        ("a mark nobody knows", rows_of(SAMPLE.replace("brings | brings", "brings | some")), good,
         'libc: "some"'),
        ("a missing column", rows, {"tools": [{"libc"}]}, "in column tools"),
        ("two rows", rows + rows[:1], good, "libamd has 2 rows"),
        ("an empty page", [], good, "core loads libamd"),
    ]
    failures = 0
    for what, case_rows, loaded, message in cases:
        problems = differences(case_rows, loaded)
        as_expected = not problems if message is None else any(message in text for text in problems)
        if not as_expected:
            print(f"{what}: {problems}", file=sys.stderr)
            failures += 1
    print(f"check_licenses: {len(cases)} cases, {failures} failures")
    return 1 if failures else 0


def main(arguments):
    if arguments == ["--self_test"]:
        return self_test()
    if len(arguments) < 2 or not all("=" in argument for argument in arguments[1:]):
        print(__doc__.strip())
        return 0 if arguments == ["--help"] else 2
    loaded = collections.defaultdict(list)
    for argument in arguments[1:]:
        column, _, file = argument.partition("=")
        loaded[column].append(loaded_by(file))
    problems = differences(rows_of(pathlib.Path(arguments[0]).read_text(encoding="utf-8")), loaded)
    for problem in problems:
        print(f"{arguments[0]}: {problem}", file=sys.stderr)
    print(f"check_licenses: {len(arguments) - 1} files, {len(problems)} differences")
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
