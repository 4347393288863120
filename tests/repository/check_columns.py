#!/usr/bin/env python3
"""Checks that no line of C++ is longer than 100 columns.

    check_columns.py ROOT          print one line per long line (file:line: what), exit with 1 if there
                                   is any
    check_columns.py --self_test   plant long lines in a small tree and see that they are reported

A column is a character, not a byte: comments have formulas. The formatter wraps code; comments,
strings and what stands between "clang-format off" and "on" are for whoever writes them to wrap.
"""

import pathlib
import sys
import tempfile

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
    with tempfile.TemporaryDirectory() as folder:
        root = pathlib.Path(folder)
        for name, text in files.items():
            (root / name).parent.mkdir(parents=True, exist_ok=True)
            (root / name).write_text(text, encoding="utf-8")
        return long_lines(root)[0]


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
    print("\n".join(failures) or f"{len(PLANTED)} planted lines are told apart")
    return 1 if failures else 0


def main(arguments):
    if arguments == ["--self_test"]:
        return self_test()
    if len(arguments) != 1 or arguments[0].startswith("-"):
        print(__doc__.strip())
        return 0 if arguments == ["--help"] else 2
    problems, num_files = long_lines(pathlib.Path(arguments[0]).resolve())
    for problem in problems:
        print(problem, file=sys.stderr)
    print(f"check_columns: {num_files} files, {len(problems)} long lines")
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
