#!/usr/bin/env python3
"""benchmarks/drop_in_figures.py on a few frames, and its verdicts on made-up reports. Arguments: the script, the build directory."""

import contextlib
import importlib
import io
import json
import pathlib
import re
import subprocess
import sys
import tempfile
import unittest

SCRIPT, BUILD = (pathlib.Path(argument) for argument in sys.argv[1:3])
sys.path.insert(0, str(SCRIPT.parent))
script = importlib.import_module(SCRIPT.stem)


def run(*flags, build=BUILD):
    return subprocess.run([sys.executable, SCRIPT, "--build", build, *map(str, flags)], capture_output=True, text=True, check=False)


def row(output, name):
    """The cells of the table's row of that name."""
    line = next(line for line in output.splitlines() if line.startswith((f"| {name} ", f"| **{name}** ")))
    return [cell.strip() for cell in line.strip("|").split("|")]


class Played(unittest.TestCase):
    def test_ratios_are_those_of_the_reports(self):
        with tempfile.TemporaryDirectory() as folder:
            result = run("--repetitions", 2, "--frames", 30, "--only", "1,000 features, extrinsics free", "--keep", folder)
            self.assertIn(result.returncode, (0, 1), result.stderr)
            (kept,) = pathlib.Path(folder).iterdir()
            reports = json.loads(kept.read_text(encoding="utf-8"))
        self.assertEqual(set(reports), {*script.STOCK, *script.MODES})
        medians = {name: script.median_ms(runs) for name, runs in reports.items()}
        fastest = min(medians[name] for name in script.STOCK)
        for mode in script.MODES:
            self.assertEqual(float(row(result.stdout, f"drop-in, {mode}")[2]), round(medians[mode] / fastest, 3))
        self.assertEqual([len(runs) for runs in reports.values()], [2] * len(reports))

    def test_the_drop_in_solves_what_stock_solves(self):
        result = run("--repetitions", 1, "--frames", 30, "--only", "VINS-style, 150 features, extrinsics free")
        stock_cost = float(row(result.stdout, "DENSE_SCHUR, auto")[6])
        # Every solve starts where the one before ended, so that rounding grows from frame to frame.
        self.assertAlmostEqual(float(row(result.stdout, "drop-in, exact")[6]) / stock_cost, 1.0, delta=1e-3)

    def test_nothing_to_play_is_an_error(self):
        self.assertEqual(run("--only", "no such figure").returncode, 2)
        with tempfile.TemporaryDirectory() as empty:
            result = run("--frames", 30, build=empty)
            self.assertEqual(result.returncode, 2)
            self.assertRegex(result.stderr, re.escape(empty))


class Verdicts(unittest.TestCase):
    """Made-up medians: stock's fastest takes 10 ms."""

    def verdict(self, exact_ms, exact_cost=1.0):
        report = lambda ms, cost=1.0: [{"solve_ms": {"median": ms}, "ate_m": 0.1, "final_cost_sum": cost}]
        reports = {name: report(10.0 + k) for k, name in enumerate(script.STOCK)}
        reports |= {"exact": report(exact_ms, exact_cost), "incremental": report(1.0)}
        output = io.StringIO()
        with contextlib.redirect_stdout(output):
            fine = script.print_figure(reports, {"exact": 0.40, "incremental": None})
        return fine, output.getvalue()

    def test_as_asked(self):
        fine, output = self.verdict(4.0)
        self.assertTrue(fine)
        self.assertEqual(row(output, "drop-in, exact")[2:5], ["0.400", "at most 0.4", "yes"])

    def test_not_as_asked(self):
        fine, output = self.verdict(4.1)
        self.assertFalse(fine)
        self.assertEqual(row(output, "drop-in, exact")[4], "**no**")

    def test_another_cost_is_wrong_however_fast(self):
        fine, output = self.verdict(1.0, exact_cost=1.01)
        self.assertFalse(fine)
        self.assertEqual(row(output, "drop-in, exact")[4], "**no**, another cost")


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
