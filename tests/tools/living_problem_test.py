#!/usr/bin/env python3
"""living_problem as a user runs it, bare and with the drop-in preloaded. Arguments: the executable, the drop-in."""

import json
import os
import subprocess
import sys
import tempfile
import unittest

from tool_test_support import run, write_small_bal, write_small_pose_graph, write_small_stereo

TOOL, DROPIN = sys.argv[1:3]


class LivingProblemTest(unittest.TestCase):
    def setUp(self):
        self.directory = tempfile.TemporaryDirectory()
        self.addCleanup(self.directory.cleanup)
        write_small_bal(self.file("small.txt"))
        write_small_pose_graph(self.file("small.g2o"), 2)
        write_small_stereo(self.file("stereo"))
        self.bal = "bal:" + self.file("small.txt")
        self.graph = "g2o:" + self.file("small.g2o")
        self.stereo = "stereo:" + self.file("stereo")

    def file(self, name):
        return os.path.join(self.directory.name, name)

    def play(self, problem, *flags):
        output, _ = run(TOOL, "--problem", problem, "--json", self.file("report.json"), *flags)
        with open(self.file("report.json"), encoding="utf-8") as file:
            return output, json.load(file)

    def preloaded(self, mode, problem, *flags):
        """(report, log) of a run with the drop-in."""
        environment = {**os.environ, "LD_PRELOAD": DROPIN, "INCERES_MODE": mode, "GLOG_logtostderr": "1"}
        result = subprocess.run([TOOL, "--problem", problem, "--json", self.file("ours.json"), *flags], env=environment,
                                capture_output=True, text=True, timeout=300, check=False)
        self.assertEqual(result.returncode, 0, result.stderr)
        with open(self.file("ours.json"), encoding="utf-8") as file:
            return json.load(file), result.stderr

    def fails(self, code, *flags):
        _, message = run(TOOL, *flags, code=code)
        return message

    def test_reports_every_solve(self):
        for problem, steps, solver, strategy in ((self.bal, 5, "dense_schur", "lm"), (self.stereo, 5, "dense_schur", "lm"),
                                                 (self.graph, 13, "sparse_normal_cholesky", "dogleg")):
            output, report = self.play(problem)
            self.assertEqual([solve["step"] for solve in report["solves"]], list(range(1, steps + 1)))
            self.assertTrue(all(solve["usable"] for solve in report["solves"]))
            times = [solve["ms"] for solve in report["solves"]]
            self.assertAlmostEqual(report["solve_ms"]["total"], sum(times), delta=1e-9 * sum(times))
            self.assertGreater(1e3 * report["total_s"], sum(times))
            self.assertAlmostEqual(report["final_cost_sum"], sum(solve["cost"] for solve in report["solves"]))
            self.assertEqual(report["final_cost"], report["solves"][-1]["cost"])
            self.assertEqual((report["mode"], report["trust_region"]), ("plain", strategy))
            self.assertIn(solver, report["linear_solver"])
            self.assertIn(f"{steps} solves", output)

    def test_rebuilding_gives_the_same_costs(self):
        _, plain = self.play(self.stereo)
        _, rebuilt = self.play(self.stereo, "--mode", "rebuild")
        self.assertEqual(rebuilt["mode"], "rebuild")
        for one, other in zip(plain["solves"], rebuilt["solves"]):
            self.assertAlmostEqual(other["cost"], one["cost"], delta=1e-9 * one["cost"])

    def test_flags_change_what_they_say(self):
        _, plain = self.play(self.bal)
        _, short = self.play(self.bal, "--steps", "2")
        self.assertEqual(len(short["solves"]), 2)
        iterations = lambda report: sum(solve["iterations"] for solve in report["solves"])
        for flags in (("--max_num_iterations", "1"), ("--function_tolerance", "0.5"), ("--parameter_tolerance", "0.5"),
                      ("--gradient_tolerance", "1e9")):
            _, early = self.play(self.bal, *flags)
            self.assertLess(iterations(early), iterations(plain), flags)
        for flag, value, key, shown in (("--trust_region", "dogleg", "trust_region", "dogleg"), ("--autodiff", "true", "autodiff", True),
                                        ("--linear_solver", "sparse_schur", "linear_solver", "sparse_schur, landmarks first"),
                                        ("--num_threads", "2", "mode", "plain")):
            _, other = self.play(self.bal, f"{flag}={value}")
            self.assertEqual(other[key], shown)
            self.assertAlmostEqual(other["final_cost"], plain["final_cost"], delta=1e-4 * plain["final_cost"])

    def test_one_solve(self):
        _, report = self.play(self.bal, "--oneshot")
        self.assertEqual((len(report["solves"]), report["mode"]), (1, "oneshot"))
        _, robust = self.play(self.bal, "--oneshot", "--robust", "huber:0.1")
        self.assertLess(robust["final_cost"], 0.9 * report["final_cost"])
        _, graph = self.play(self.graph, "--oneshot")
        _, grown = self.play(self.graph)
        self.assertAlmostEqual(graph["final_cost"], grown["final_cost"], delta=1e-5 * grown["final_cost"])
        _, whole = self.play(self.stereo, "--oneshot")
        self.assertEqual(len(whole["solves"]), 1)
        self.assertGreater(whole["final_cost"], 1.0)

    def test_the_drop_in_stands_in_front(self):
        for problem in (self.bal, self.graph, self.stereo):
            _, bare = self.play(problem)
            for mode in ("exact", "incremental", "auto"):
                report, log = self.preloaded(mode, problem)
                self.assertIn(f"the drop-in solves for Ceres, mode {mode}", log)
                for ours, stock in zip(report["solves"], bare["solves"]):
                    self.assertLess(ours["cost"], stock["cost"] * (1 + 1e-4) + 1e-9, (problem, mode, ours["step"]))

    def test_flags_that_make_no_sense(self):
        for flag, value in (("--mode", "fast"), ("--trust_region", "newton"), ("--linear_solver", "magic"), ("--steps", "-1"),
                            ("--num_threads", "0"), ("--max_num_iterations", "0"), ("--function_tolerance", "-1"),
                            ("--gradient_tolerance", "nan"), ("--parameter_tolerance", "inf"), ("--robust", "huber:1")):
            self.assertIn(flag, self.fails(2, "--problem", self.bal, flag, value))
        for flag in ("--steps=2", "--mode=rebuild"):
            self.assertIn("--oneshot has no steps", self.fails(2, "--problem", self.bal, "--oneshot", flag))
        for flag in ("--no_priors", "--seed=2", "--nopresolve", "--free_intrinsics"):
            self.assertIn("as it stands in the file", self.fails(2, "--problem", self.bal, "--oneshot", flag))
        self.assertIn("as it stands in the file", self.fails(2, "--problem", self.graph, "--oneshot", "--outliers=0.2"))
        self.assertIn("--robust", self.fails(2, "--problem", self.bal, "--oneshot", "--robust", "huber"))
        self.assertIn("--autodiff", self.fails(2, "--problem", "vio:cubic", "--autodiff"))
        self.assertIn("--problem", self.fails(2, "--problem", "toro:x"))

    def test_files_that_cannot_be_played(self):
        for flags in ((), ("--oneshot",)):
            self.assertIn("none.g2o", self.fails(1, "--problem", "g2o:" + self.file("none.g2o"), *flags))
        self.assertIn("no/report.json", self.fails(1, "--problem", self.bal, "--json", self.file("no/report.json")))


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
