#!/usr/bin/env python3
"""Programs and libraries that have nothing to do with inceres::distributed load neither MPI nor PETSc. Arguments: a program that does,
and all that do not."""

import re
import subprocess
import sys

FOREIGN = re.compile(r"lib(mpi|open-rte|open-pal|petsc|dmumps|ptscotch|pmix)[^ ]*", re.IGNORECASE)


def loaded(path):
    return sorted({match[0] for match in FOREIGN.finditer(subprocess.run(["ldd", path], capture_output=True, text=True, check=True).stdout)})


def main():
    program, *others = sys.argv[1:]
    if not {"libmpi", "libpetsc"} <= {re.match(r"lib[a-z]+", name)[0] for name in loaded(program)}:
        return f"{program} is to load MPI and PETSc, or this test sees nothing: {loaded(program)}"
    if len(others) < 3:
        return f"too few to look at: {others}"
    wrong = {path: names for path in others if (names := loaded(path))}
    return f"these load MPI or PETSc: {wrong}" if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
