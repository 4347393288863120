"""One run of bal_solve in a process of its own: what it reports, and its peak memory. Shared by scale.py and memory_figures.py."""

import json
import os
import pathlib
import subprocess
import tempfile

from stock_environment import num_threads_in, stock_environment

LANDMARKS_FIRST = ", landmarks first"  # with an ordering of the user's, which spares stock looking for one and is not always the faster

# How each competitor is called. All solve the same file with 50 LM iterations at most and Ceres's default tolerances.
SOLVERS = {
    "ours, built-in factors": ["--solver", "inceres", "--builtin_factors"],
    "ours, exact, AutoDiff": ["--solver", "inceres", "--linear_solver", "sparse_schur"],
    **{
        f"stock, {linear_solver.upper()}{ordering}": ["--solver", "ceres", "--linear_solver", linear_solver, *flags]
        for linear_solver in ("dense_schur", "sparse_schur", "iterative_schur")
        for ordering, flags in (("", []), (LANDMARKS_FIRST, ["--landmarks_first"]))
    },
}


def generate(build, flags, path):
    """Writes a BAL file with bal_generate."""
    subprocess.run([str(build / "bin/bal_generate"), *flags, "--output", str(path)], check=True, stdout=subprocess.DEVNULL)


def solve(build, path, solver, flags=()):
    """The report of bal_solve with peak_bytes, that of the whole process with the problem it has read, or None if it failed."""
    with tempfile.TemporaryDirectory() as folder:
        report = pathlib.Path(folder) / "report.json"
        command = [str(build / "bin/bal_solve"), "--input", str(path), "--json", str(report), *SOLVERS[solver], *flags]
        process = subprocess.Popen(command, env=stock_environment(num_threads_in(flags)), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        if process.returncode != 0 or not report.exists():
            return None
        return {**json.loads(report.read_text(encoding="utf-8")), "peak_bytes": usage.ru_maxrss * 1024}
