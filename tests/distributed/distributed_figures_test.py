#!/usr/bin/env python3
"""benchmarks/distributed_figures.py on a small street, and its verdicts on made-up figures. Arguments: the script, the build
directory."""

import contextlib
import importlib
import io
import json
import pathlib
import subprocess
import sys
import tempfile
import unittest

SCRIPT, BUILD = (pathlib.Path(argument) for argument in sys.argv[1:3])
sys.path.insert(0, str(SCRIPT.parent))
script = importlib.import_module(SCRIPT.stem)


def made_up(seconds, peak=100, partition=0.1, exchange=10, cost=1.0):
    rank = {"exchange_bytes_per_product": exchange, "shared_frame_bytes": 10}
    return {"seconds": seconds, "peak_bytes": peak, "stage_seconds": {"read": 0.9, "partition": partition}, "ranks": [rank],
            "partition": {"imbalance": 1.0}, "final_cost": cost, "iterations": 1}


class Verdicts(unittest.TestCase):
    def verdict(self, **worse):
        reports = {"1 rank": [made_up(10.0)], "2 ranks": [made_up(**{"seconds": 5.0, "peak": 55, **worse})], "1 thread": [made_up(10.0)],
                   "2 threads": [made_up(5.0)]}
        output = io.StringIO()
        with contextlib.redirect_stdout(output):
            fine = script.show("made up", script.figures_of(reports))
        return fine, output.getvalue()

    def test_within_limits(self):
        fine, output = self.verdict()
        self.assertTrue(fine, output)
        self.assertIn("| 2 ranks / 1 rank | 0.5 | 0.588 | within it |", output)

    def test_each_limit(self):
        for worse in ({"seconds": 6.0}, {"peak": 61}, {"partition": 0.3}, {"exchange": 16}, {"cost": 1.001}):
            fine, output = self.verdict(**worse)
            self.assertFalse(fine, worse)
            self.assertIn("**too much**", output)

    def test_ratios_are_those_of_each_round(self):
        rounds = lambda *seconds: [made_up(s) for s in seconds]
        figures = script.figures_of({"1 rank": rounds(10.0, 30.0, 10.0), "2 ranks": rounds(6.0, 15.0, 6.0),
                                     "1 thread": rounds(10.0, 30.0, 10.0), "2 threads": rounds(5.0, 15.0, 5.0)})
        self.assertAlmostEqual(figures["ratios"]["2 ranks / 1 rank"], 0.6)


class Played(unittest.TestCase):
    def test_a_small_street(self):
        with tempfile.TemporaryDirectory() as folder:
            figures = pathlib.Path(folder) / "figures.json"
            flags = ["--build", BUILD, "--problems", "ladybug-like", "--rounds", 1, "--max_num_iterations", 3, "--json", figures, "--keep",
                     folder]
            for _ in range(2):  # the second time the file is there
                done = subprocess.run([sys.executable, *map(str, [SCRIPT, *flags])], capture_output=True, text=True, timeout=200, check=False)
                self.assertIn(done.returncode, (0, 1), done.stderr)
                self.assertEqual(done.stderr, "")
                self.assertIn("| 2 ranks / 2 threads |", done.stdout)
            kept = json.loads(figures.read_text(encoding="utf-8"))["problems"]["ladybug-like"]
            self.assertLess(abs(kept["cost_excess"]), 1e-2)  # three inexact steps
            self.assertEqual({run: count for run, (count, _) in kept["iterations"].items()}["1 rank"], 3)

    def test_a_run_that_fails(self):
        done = subprocess.run([sys.executable, str(SCRIPT), "--build", str(BUILD), "--problems", "nowhere-7"], capture_output=True, text=True,
                              timeout=60, check=False)
        self.assertEqual(done.returncode, 2)
        self.assertIn("nowhere-7", done.stderr)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
