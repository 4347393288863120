#!/usr/bin/env python3
"""Checks that docs/thread_safety.md and the public headers name the same classes.

    check_thread_safety.py ROOT

Every class with INCERES_EXPORT stands, in code marks, in the first column of a row; what stands
there is a name that some public header has.
"""

import pathlib
import re
import sys

PAGE = "docs/thread_safety.md"
HEADERS = ["include/inceres", "adapters/ceres/include/inceres"]


def check(root):
    text = "\n".join(path.read_text(encoding="utf-8")
                     for folder in HEADERS for path in sorted((root / folder).rglob("*.h")))
    exported = set(re.findall(r"^class INCERES_EXPORT (\w+)", text, re.MULTILINE))
    rows = re.findall(r"^\| ([^|]+) \|", (root / PAGE).read_text(encoding="utf-8"), re.MULTILINE)
    named = {name.rpartition("::")[2] for row in rows for name in re.findall(r"`([\w:]+)`", row)}
    problems = [f"{name} is exported and has no row" for name in sorted(exported - named)]
    problems += [f"{name} is in no public header" for name in sorted(named)
                 if not re.search(rf"\b{name}\b", text)]
    if not exported:
        problems.append(f"{root} has no exported classes: not the top of an inceres tree")
    return problems, len(exported)


def main(arguments):
    if len(arguments) != 1:
        sys.exit(__doc__)
    problems, count = check(pathlib.Path(arguments[0]))
    for problem in problems:
        print(f"{PAGE}: {problem}", file=sys.stderr)
    print(f"check_thread_safety: {count} exported classes, {len(problems)} problems")
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
