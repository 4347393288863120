#!/usr/bin/env python3
"""benchmarks/scale.py, memory_figures.py and large_figures.py: the arithmetic, and small runs. Arguments: the folder benchmarks/, the build directory."""

import json
import os
import pathlib
import re
import subprocess
import sys
import tempfile
import unittest

BENCHMARKS, BUILD = (pathlib.Path(argument) for argument in sys.argv[1:3])
sys.path.insert(0, str(BENCHMARKS))

import large_figures  # noqa: E402
import scale  # noqa: E402


class ArithmeticTest(unittest.TestCase):
    def test_exponent_of_powers(self):
        self.assertAlmostEqual(scale.exponent([(size, 3.0 * size**1.5) for size in (10, 100, 1000)]), 1.5)
        self.assertIsNone(scale.exponent([(10, 1.0), (100, 10.0)]), "two fit any power")
        self.assertIsNone(scale.exponent([(10, 1.0), (10, 2.0), (100, 10.0)]))

    def test_time_until_the_cost_is_reached(self):
        trace = [{"seconds": 0.1, "cost": 9.0, "accepted": True}, {"seconds": 0.2, "cost": 4.0, "accepted": False},
                 {"seconds": 0.3, "cost": 4.5, "accepted": True}]
        report = {"trace": trace, "final_cost": 4.0, "seconds": 0.5}
        self.assertEqual(scale.seconds_to(report, 5.0), 0.3)
        self.assertEqual(scale.seconds_to(report, 4.2), 0.5)  # by the last step, which ended the solve
        self.assertIsNone(scale.seconds_to(report, 3.0))

    def test_the_better_of_stocks_orderings_counts(self):
        rows = [{"cameras": size, "solver": name, "seconds": seconds}
                for size, name, seconds in ((10, "stock, A", 2.0), (10, "stock, A, landmarks first", 1.0), (20, "stock, A", 3.0),
                                            (20, "stock, A, landmarks first", None), (10, "ours", 0.5))]
        self.assertEqual(scale.series(rows, "seconds"), {"stock, A": [(10, 1.0), (20, 3.0)], "ours": [(10, 0.5)]})
        self.assertEqual(scale.least_of_stock({"stock, A": 2.0, "stock, B": None, "stock, C": 1.5, "ours": 0.5}), 1.5)
        self.assertIsNone(scale.least_of_stock({"ours": 0.5}))

    def test_speed_up(self):
        times = {1: [1.7, 1.8, 1.7], 2: [1.0, 1.0, 2.0]}
        same = {1: [5.0, 5.0], 2: [5.0, 5.0]}
        self.assertEqual(scale.judge_speed_up(times, same, 5.0 + 1e-6), (1.7, []))
        self.assertEqual(scale.judge_speed_up(times, same, 5.1)[1], ["cost differs from the other solver's"])
        self.assertEqual(scale.judge_speed_up(times, {1: [5.0], 2: [5.0 + 1e-15]}, None)[1], ["costs differ between runs"])
        self.assertEqual(scale.judge_speed_up({1: [1.6], 2: [1.0]}, same, None), (1.6, ["slow"]))


class LargeFiguresTest(unittest.TestCase):
    ROW = {"factor": {"seconds": 2.0}, "two levels": {"seconds": 1.0}, "automatic": {"seconds": 1.2}}

    def test_the_automatic_choice_is_held_against_the_better(self):
        self.assertEqual(large_figures.ratio_of(self.ROW), 1.2)

    def test_a_step_is_what_a_linear_solve_takes(self):
        report = {"stage_seconds": {"elimination": 1.0, "factorization": 2.0, "back_substitution": 1.0, "setup": 9.0},
                  "work": {"linear_solves": 4, "conjugate_gradients": 40}}
        self.assertEqual((large_figures.seconds_a_step(report), large_figures.iterations_a_step(report)), (1.0, 10.0))


class RunTest(unittest.TestCase):
    def run_script(self, name, *arguments):
        return subprocess.run([sys.executable, BENCHMARKS / name, "--build", BUILD, *map(str, arguments)], capture_output=True,
                              text=True, timeout=300, check=False, env={**os.environ, "INCERES_DATA_DIR": "/nowhere"})

    def test_small_paths(self):
        with tempfile.TemporaryDirectory() as folder:
            report, plot = pathlib.Path(folder) / "scale.json", pathlib.Path(folder) / "scale.svg"
            result = self.run_script("scale.py", "--sizes", "100,150,200", "--solvers", "built-in,SPARSE", "--json", report, "--svg", plot)
            self.assertEqual((result.returncode, result.stderr), (0, ""))
            rows = json.loads(report.read_text(encoding="utf-8"))
            self.assertEqual([(row["cameras"], row["solver"]) for row in rows],
                             [(size, name) for size in (100, 150, 200)
                              for name in ("ours, built-in factors", "stock, SPARSE_SCHUR", "stock, SPARSE_SCHUR, landmarks first")])
            self.assertTrue(all(row["peak_bytes"] > 1e6 and row["seconds_to_cost"] > 0.0 for row in rows))
            self.assertRegex(result.stdout, r"\| ours, built-in factors \| cameras\^-?\d\.\d\d \| cameras\^-?\d\.\d\d \|")
            self.assertEqual(len(re.findall("<polyline", plot.read_text(encoding="utf-8"))), 4)

    def test_a_small_city(self):
        with tempfile.TemporaryDirectory() as folder:
            figures = pathlib.Path(folder) / "grid.json"
            result = self.run_script("large_figures.py", "--sizes", "60,90", "--widths", "16", "--steps", "2", "--json", figures)
            self.assertIn(result.returncode, (0, 1))  # 1: not within the limit, on a machine that does other things
            self.assertEqual(result.stderr, "")
            self.assertEqual(len(re.findall(r"^\| (60|90) \| 16 \|.*Cholesky", result.stdout, re.MULTILINE)), 2)
            rows = json.loads(figures.read_text(encoding="utf-8"))
            self.assertTrue(all(row["two levels"]["iterations"] > 1 for row in rows))
            self.assertIn("faster from", result.stdout)

    def test_a_build_without_tools_is_an_error(self):
        result = subprocess.run([sys.executable, BENCHMARKS / "scale.py", "--build", "/nowhere"], capture_output=True, text=True,
                                timeout=60, check=False)
        self.assertEqual(result.returncode, 2)
        self.assertIn("scale.py: ", result.stderr)

    def test_memory_beside_stock(self):
        result = self.run_script("memory_figures.py", "--limit", "1000", "--preset", "venice11")
        self.assertEqual((result.returncode, result.stderr), (0, ""))
        self.assertIn("Ladybug-49: skipped", result.stdout)
        self.assertEqual(len(re.findall(r"^\| venice11 \|.*\| yes \|$", result.stdout, re.MULTILINE)), 2)
        self.assertEqual(self.run_script("memory_figures.py", "--limit", "0.01", "--preset", "venice11").returncode, 1)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
