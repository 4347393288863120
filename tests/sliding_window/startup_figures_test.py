#!/usr/bin/env python3
"""benchmarks/startup_figures.py on a few frames, its verdicts on made-up errors, and user_share.py's reading of callgrind's lines.

Arguments: the folder of the scripts, the build directory.
"""

import contextlib
import importlib
import io
import json
import pathlib
import subprocess
import sys
import tempfile
import unittest

SCRIPTS, BUILD = (pathlib.Path(argument) for argument in sys.argv[1:3])
sys.path.insert(0, str(SCRIPTS))
startup_figures = importlib.import_module("startup_figures")
user_share = importlib.import_module("user_share")


def run(*flags):
    return subprocess.run([sys.executable, SCRIPTS / "startup_figures.py", *map(str, flags)], capture_output=True, text=True, check=False)


class Played(unittest.TestCase):
    def test_exact_mode_is_stock_on_a_few_frames(self):
        with tempfile.TemporaryDirectory() as folder:
            kept = pathlib.Path(folder) / "errors.json"
            result = run("--build", BUILD, "--seeds", "7:2", "--modes", "exact", "--flags", "--frames 20", "--keep", kept)
            self.assertEqual(result.returncode, 0, result.stdout + result.stderr)
            errors = json.loads(kept.read_text(encoding="utf-8"))
        self.assertEqual(list(errors), ["free", "held"])
        for of_extrinsics in errors.values():
            self.assertEqual(set(of_extrinsics), {*startup_figures.STOCK, *startup_figures.CONVERGED, "exact"})
            self.assertNotEqual(of_extrinsics["SPARSE_SCHUR"][0], of_extrinsics["SPARSE_SCHUR"][1])
            for name in startup_figures.STOCK:  # every variant is one
                self.assertEqual(name == "SPARSE_SCHUR", of_extrinsics[name] == of_extrinsics["SPARSE_SCHUR"], name)

    def test_bad_arguments_are_named(self):
        for flags in (["--seeds", "7"], ["--seeds", "1:0"], ["--modes", "fast"], ["--extrinsics", "loose"], ["--jobs", "0"]):
            result = run(*flags)
            self.assertEqual(result.returncode, 2)
            self.assertIn(flags[0], result.stderr)
        with tempfile.TemporaryDirectory() as empty:
            result = run("--build", empty)
            self.assertEqual(result.returncode, 2)
            self.assertIn(empty, result.stderr)


class Verdicts(unittest.TestCase):
    """Three seeds, on which stock's variants differ by a tenth."""

    def verdict(self, ours, converged=(1.0, 2.0, 3.0)):
        spread = dict(zip(startup_figures.STOCK, (0.95, 1.0, 1.05, 1.0, 0.98)))
        errors = {name: [factor * seed for seed in (1.0, 2.0, 3.0)] for name, factor in spread.items()}
        errors |= {"converged": list(converged), "exact": list(ours)}
        output = io.StringIO()
        with contextlib.redirect_stdout(output):
            fine = startup_figures.print_figures(range(3), ["exact"], errors)
        return fine, startup_figures.judge(errors, "exact"), output.getvalue()

    def test_within_the_spread(self):
        fine, figures, output = self.verdict([1.07, 2.0, 2.9])
        self.assertTrue(fine)
        self.assertEqual(figures["seeds_above"], 0)
        self.assertNotIn("**above**", output)

    def test_one_seed_above(self):
        fine, figures, output = self.verdict([1.08, 2.0, 2.9])
        self.assertFalse(fine)
        self.assertEqual(figures["seeds_above"], 1)
        self.assertIn("1.08000 **above**", output)

    def test_the_median_above_although_no_seed_is(self):
        fine, figures, _ = self.verdict([1.0, 2.12, 3.0])
        self.assertFalse(fine)
        self.assertEqual(figures["seeds_above"], 0)
        self.assertAlmostEqual(figures["median_ratio"], 1.06)

    def test_converged_has_no_part_in_the_verdict(self):
        fine, figures, _ = self.verdict([1.2, 2.0, 3.0], converged=[1.2, 9.0, 9.0])
        self.assertFalse(fine)
        self.assertEqual((figures["seeds_above"], figures["seeds_above_both"]), (1, 0))
        self.assertTrue(self.verdict([1.0, 2.0, 3.0], converged=[9.0, 9.0, 9.0])[0])


class Shares(unittest.TestCase):
    def test_of_each_cost_function_counted_once(self):
        lines = ["1,000  PROGRAM TOTALS", "  900  ???:ceres::Solve(int) [x]",
                 "  400  a.cc:sliding_window::ImuFactor::Evaluate(double const* const*, double*, double**) const [x]",
                 "  100  a.cc:sliding_window::ImuFactor::Evaluate(double const* const*, double*, double**) const [x]",
                 "   50  b.cc:sliding_window::PoseError::Evaluate(double const* const*, double*, double**) const [x]",
                 "   70  b.cc:inceres::internal::Evaluator::Evaluate(int) [x]"]
        self.assertEqual(user_share.shares(lines), (1000, {"sliding_window::ImuFactor": 400, "sliding_window::PoseError": 50}))


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
