#!/usr/bin/env python3
"""benchmarks/auto_figures.py on small problems in the place of the large ones, its verdicts on made-up measurements, and what
call_costs.py finds in a profile. Arguments: the script, the build directory."""

import contextlib
import importlib
import io
import json
import os
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile
import unittest

from tool_test_support import write_small_bal, write_small_pose_graph

SCRIPT, BUILD = (pathlib.Path(argument) for argument in sys.argv[1:3])
sys.path.insert(0, str(SCRIPT.parent))
script = importlib.import_module(SCRIPT.stem)

# Program /p calls ceres::Solve of /d (300), which calls /p's cost function (40, 2) and the copy of a template in /p (5), and stock's
# ceres::Solve in /c (100), which calls the cost function too (30). The program itself calls the cost function once (7).
PROFILE = """# callgrind format
events: Ir
ob=(1) /p
fn=(1) main
10 1
cob=(2) /d
cfn=(2) ceres::Solve(ceres::Solver::Options const&, ceres::Problem*, ceres::Solver::Summary*)
calls=3 0
11 300
cfn=(3) user::Cost::Evaluate(double const* const*, double*, double**) const
calls=1 5
* 7
fn=(3)
5 20
ob=(2)
fn=(2)
0 50
cob=(1)
cfn=(3)
calls=4 5
+1 40
cob=(1)
cfn=(3)
calls=1 5
+1 2
cob=(1)
cfn=(4) std::vector<int, std::allocator<int> >::push_back(int const&)
calls=1 5
+1 5
cob=(3) /c
cfn=(5) ceres::Solve(ceres::Solver::Options const&, ceres::Problem*, ceres::Solver::Summary*)
calls=1 0
* 100
ob=(3)
fn=(5)
0 70
cob=(1)
cfn=(3)
calls=1 5
* 30
"""


class Profiles(unittest.TestCase):
    def test_the_users_functions_are_told_from_the_rest(self):
        from call_costs import solve_costs
        self.assertEqual(solve_costs(PROFILE.splitlines(True), "/p"), (300, 72))

    def test_a_program_without_the_call_is_an_error(self):
        from call_costs import solve_costs
        with self.assertRaisesRegex(ValueError, "/other"):
            solve_costs(PROFILE.splitlines(True), "/other")


class Verdicts(unittest.TestCase):
    def verdict(self, values, ratio, auto_costs, times=False):
        report = lambda costs: {"final_cost_sum": sum(costs), "solves": [{"cost": cost} for cost in costs]}
        reports = {"exact": report([1.0, 2.0]), "incremental": report([1.0, 2.0]), "auto": report(auto_costs)}
        notes = {mode: "" for mode in reports}
        output = io.StringIO()
        with contextlib.redirect_stdout(output):
            fine = script.print_figure((dict(zip(reports, values)), ratio, reports, notes), report([1.0, 2.0]), times)
        return fine, output.getvalue()

    def test_as_asked(self):
        fine, output = self.verdict((2e6, 4e6, 2e6), 1.0, [1.0, 2.0])
        self.assertTrue(fine)
        self.assertIn("auto / exact: **1.000**, limit 1.03: within it", output)

    def test_too_much(self):
        fine, output = self.verdict((4e6, 2e6, 2.08e6), 1.04, [1.0, 2.0])
        self.assertFalse(fine)
        self.assertIn("auto / incremental: **1.040**, limit 1.03: **too much**", output)
        self.assertTrue(self.verdict((4.0, 2.0, 2.08), 1.04, [1.0, 2.0], times=True)[0])
        self.assertFalse(self.verdict((4.0, 2.0, 2.12), 1.06, [1.0, 2.0], times=True)[0])

    def test_another_cost_is_wrong_however_fast(self):
        fine, output = self.verdict((2e6, 4e6, 1e6), 0.5, [1.0, 2.1])
        self.assertFalse(fine)
        self.assertIn("**another cost**", output)
        self.assertIn("| +3.3e-02 | +5.0e-02 |", output)

    def test_what_is_as_good_as_zero_is_not_compared_with_zero(self):
        report = lambda *costs: {"solves": [{"cost": cost} for cost in costs]}
        self.assertLess(script.worst_excess(report(3e-20, 1.0), report(1e-26, 1.0)), 1e-9)
        self.assertIsNone(script.worst_excess({}, {}))

    def test_time_ratios_are_those_of_each_round(self):
        class Player:
            times = iter([8.0, 2.0, 2.2, 8.0, 20.0, 22.0, 8.0, 2.0, 2.2])  # the second round is disturbed

            def play(self, _command, _mode):
                return {"solve_ms": {"total": next(self.times)}}

        medians, ratio, _, notes = script.measure_times(Player(), [], 3)
        self.assertEqual(medians, {"exact": 8e-3, "incremental": 2e-3, "auto": 2.2e-3})
        self.assertAlmostEqual(ratio, 1.1)
        self.assertEqual(notes["auto"], "0.0022 to 0.022")


class Played(unittest.TestCase):
    def setUp(self):
        directory = tempfile.TemporaryDirectory()
        self.addCleanup(directory.cleanup)
        self.data = pathlib.Path(directory.name)
        (self.data / "bal").mkdir()
        (self.data / "pose_graph").mkdir()
        write_small_bal(self.data / "bal" / "problem-49-7776-pre.txt")
        write_small_pose_graph(self.data / "pose_graph" / "intel.g2o", 2)

    def figures(self, *flags, build=BUILD):
        command = [sys.executable, SCRIPT, "--build", build, "--keep", self.data / "kept", *flags]
        return subprocess.run([str(part) for part in command], capture_output=True, text=True, timeout=300, check=False,
                              env={**os.environ, "INCERES_DATA_DIR": str(self.data)})

    def check(self, result, figure, steps):
        self.assertEqual(result.stderr, "")
        kept = json.loads((self.data / "kept" / f"auto-{figure}.json").read_text(encoding="utf-8"))
        self.assertEqual({len(report["solves"]) for report in (*kept["reports"].values(), kept["stock"])}, {steps})
        self.assertIn(f": **{kept['ratio']:.3f}**, limit ", result.stdout)
        self.assertEqual(result.returncode, 0 if ": within it" in result.stdout else 1)
        return kept

    def test_times(self):
        self.check(self.figures("--times", "--repetitions", 2, "--only", "Ladybug-49, one"), 4, 1)
        self.check(self.figures("--times", "--repetitions", 1, "--only", "Ladybug-49, camera"), 6, 5)
        self.check(self.figures("--times", "--repetitions", 1, "--only", "intel", "--steps", 7), 10, 7)

    def test_instructions(self):
        sanitized = "fsanitize" in (BUILD / "CMakeCache.txt").read_text(encoding="utf-8")
        if shutil.which("valgrind") is None or sanitized:
            self.skipTest("valgrind is not installed, or does not go with this build's sanitizer")
        kept = self.check(self.figures("--only", "intel", "--steps", 3), 10, 3)
        self.assertGreater(min(kept["values"].values()), 10_000)

    def test_says_what_is_missing(self):
        result = self.figures("--times", "--only", "Trafalgar-21, one")
        self.assertRegex(result.stdout, "skipped, .*problem-21-11315-pre.txt is missing")
        self.assertEqual(result.returncode, 2, "nothing was played")
        (self.data / "pose_graph" / "intel.g2o").write_text("nonsense", encoding="ascii")
        result = self.figures("--times", "--only", "intel")
        self.assertEqual(result.returncode, 2)
        self.assertIn("intel.g2o", result.stderr)
        result = self.figures("--times", build=self.data)
        self.assertEqual(result.returncode, 2)
        self.assertRegex(result.stderr, re.escape(str(self.data)))
        for flags in (("--times", "--repetitions", 0), ("--repetitions", 3), ("--times", "--steps", -1)):
            self.assertEqual(self.figures(*flags).returncode, 2)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
