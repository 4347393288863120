#!/usr/bin/env python3
"""Checks that no line of C++ is longer than 100 columns.

    check_columns.py ROOT          print one line per long line (file:line: what), exit with 1 if there
                                   is any
    check_columns.py --self_test   plant long lines in a small tree and see that they are reported

A column is a character, not a byte: comments have formulas. The formatter wraps code; comments,
strings and what stands between "clang-format off" and "on" are for whoever writes them to wrap.
"""

import sys

import checking

COLUMNS = 100
SUFFIXES = {".cc", ".h", ".inc"}
NOT_OURS = ("build", ".git")  # what is built, and what belongs to git


def sources_below(root):
    for path in sorted(root.rglob("*")):
        relative = path.relative_to(root)
        ours = not relative.parts[0].startswith(NOT_OURS)
        if ours and path.suffix in SUFFIXES and path.is_file():
            yield relative


def long_lines(root):
    """(one line per problem, number of files looked at)."""
    problems = []
    files = list(sources_below(root))
    for file in files:
        lines = (root / file).read_text(encoding="utf-8").split("\n")
        for number, line in enumerate(lines, 1):
            if len(line) > COLUMNS:
                problems.append(f"{file}:{number}: {len(line)} columns; at most {COLUMNS}")
    if not files:
        problems.append(f"{root} has no C++: not the top of an inceres tree")
    return problems, len(files)


def problems_of(files):
    return checking.in_tree(files, long_lines)[0]


# Lines that fit: the second has 100 characters in 200 bytes, the third ends its file.
CLEAN = {"src/a.cc": "x" * 100 + "\n" + "ρ" * 100 + "\n", "src/b.h": "x" * 100}
# What is planted, and the message; none where the file is not looked at.
PLANTED = [
    ("src/c.cc", "//\n" + "x" * 101 + "\n", "src/c.cc:2: 101 columns; at most 100"),
    ("tests/d.h", "x" * 150, "tests/d.h:1: 150 columns; at most 100"),
    ("src/e.inc", "ρ" * 101 + "\n", "src/e.inc:1: 101 columns; at most 100"),
    ("build/f.cc", "x" * 101, None),
    ("docs/g.txt", "x" * 101, None),
]


def self_test():
    failures = [f"lines that fit: {problem}" for problem in problems_of(CLEAN)]
    for file, text, message in PLANTED:
        problems = problems_of({**CLEAN, file: text})
        if problems != ([] if message is None else [message]):
            failures.append(f"{file}: {problems or 'nothing'} was reported, not {message}")
    if not problems_of({}):
        failures.append("an empty folder is taken for the project")
    return checking.tell(failures, f"{len(PLANTED)} planted lines are told apart")


def check(root):
    problems, num_files = long_lines(root)
    return problems, f"check_columns: {num_files} files, {len(problems)} long lines"


if __name__ == "__main__":
    sys.exit(checking.main(__doc__, self_test, check))
