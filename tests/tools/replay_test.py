#!/usr/bin/env python3
"""replay as a user runs it. Arguments: the executable, the folder of bundled problems."""

import json
import math
import os
import re
import shutil
import subprocess
import sys
import tempfile
import unittest

from tool_test_support import (IDENTITY, run, write_small_bal, write_small_keyframes, write_small_pose_graph,
                               write_small_stereo)

TOOL, BAL_DATA = sys.argv[1:3]


class ReplayTest(unittest.TestCase):
    def setUp(self):
        self.directory = tempfile.TemporaryDirectory()
        self.addCleanup(self.directory.cleanup)
        self.bal = "bal:" + self.file("small.txt")
        write_small_bal(self.file("small.txt"))
        self.keyframes = "kf:" + self.file("small.kf")
        write_small_keyframes(self.file("small.kf"))

    def file(self, name):
        return os.path.join(self.directory.name, name)

    def play(self, problem, *flags):
        """Plays and returns standard output and the JSON report."""
        report = self.file("report.json")
        mode = () if "--mode" in flags else ("--mode", "exact")
        output, _ = run(TOOL, "--problem", problem, "--json", report, *mode, *flags)
        with open(report, encoding="utf-8") as file:
            return output, json.load(file)

    def test_finds_wrong_loops_as_they_come(self):
        for dimension in (2, 3):
            write_small_pose_graph(self.file("small.g2o"), dimension, num_poses=40)
            output, report = self.play("g2o:" + self.file("small.g2o"), "--mode", "incremental",
                                       "--nostock", "--gnc", "--outliers", "0.2", "--seed", "2")
            work = report["rows"][-1]["ours"]["work"]
            self.assertGreater(work["num_wrong"], 5)
            # a chain bends to a wrong loop that nothing contradicts
            self.assertGreaterEqual(work["num_wrong_found"], work["num_wrong"] - 2)
            self.assertLessEqual(work["num_right_lost"], 3)
            self.assertIn(f"wrong loops found: {work['num_wrong_found']} of {work['num_wrong']}",
                          output)
            plain = self.play("g2o:" + self.file("small.g2o"), "--mode", "incremental", "--nostock",
                              "--outliers", "0.2", "--seed", "2")[1]
            self.assertGreater(plain["rows"][-1]["ours"]["cost"],
                               10.0 * report["rows"][-1]["ours"]["cost"])

    def test_a_pose_along_the_odometry_costs_the_same_after_many(self):
        cache = os.path.join(os.path.dirname(TOOL), "..", "CMakeCache.txt")
        with open(cache, encoding="utf-8") as file:
            sanitized = "fsanitize" in file.read()
        if shutil.which("valgrind") is None or sanitized:
            self.skipTest("valgrind is not installed, or does not go with this build's sanitizer")
        instructions = {}
        for poses in (300, 600, 1800):
            with open(self.file("chain.g2o"), "w", encoding="utf-8") as file:
                for i in range(poses):
                    file.write(f"VERTEX_SE2 {i} {i} 0 0\n")
                for i in range(1, poses):
                    file.write(f"EDGE_SE2 {i - 1} {i} 1 {0.1 * math.sin(i)} {0.1 * math.cos(i)} 400 0 0 400 0 9e3\n")
            profile = self.file("profile")
            subprocess.run(["valgrind", "--tool=callgrind", f"--callgrind-out-file={profile}",
                            "--toggle-collect=*IncrementalReplaySolver::Solve()", TOOL, "--problem",
                            "g2o:" + self.file("chain.g2o"), "--mode", "incremental", "--nostock", "--nooptimum"],
                           check=True, capture_output=True)
            with open(profile, encoding="utf-8", errors="replace") as file:
                instructions[poses] = int(re.search(r"^totals: (\d+)", file.read(), re.MULTILINE)[1])
        early, late = instructions[600] - instructions[300], instructions[1800] - instructions[600]
        self.assertGreater(early, 300 * 1000)
        self.assertLess(late / 1200, 1.25 * early / 300, "a pass over all poses")

    def test_gnc_and_outliers_are_for_pose_graphs(self):
        write_small_pose_graph(self.file("small.g2o"), 2)
        graph = "g2o:" + self.file("small.g2o")
        self.assertIn("--nostock", self.fails(2, "--problem", graph, "--gnc"))
        self.assertIn("g2o:", self.fails(2, "--problem", self.bal, "--nostock", "--gnc"))
        self.assertIn("g2o:", self.fails(2, "--problem", self.bal, "--outliers", "0.2"))
        self.assertIn("below 1", self.fails(2, "--problem", graph, "--outliers", "1.5"))

    def fails(self, code, *flags):
        _, message = run(TOOL, *flags, code=code)
        return message

    def check(self, report, steps):
        self.assertEqual(report["steps"], steps)
        self.assertEqual([row["step"] for row in report["rows"]], list(range(1, steps + 1)))
        for side in ("ours", "stock"):
            times = sorted(row[side]["ms"] for row in report["rows"])
            self.assertAlmostEqual(report[side + "_ms"]["total"], sum(times), delta=1e-9 * sum(times))
            self.assertEqual(report[side + "_ms"]["max"], times[-1])
            self.assertEqual(report["failed_steps"][side], 0)
            growth = sum(row[side]["growth_ms"] for row in report["rows"])
            self.assertAlmostEqual(report[side + "_steps"]["growth_ms"]["total"], growth, delta=1e-9 * growth)
        self.assertAlmostEqual(report["ratio_total"], report["ours_ms"]["total"] / report["stock_ms"]["total"], delta=1e-9)
        self.assertAlmostEqual(report["ratio_median"], report["ours_ms"]["median"] / report["stock_ms"]["median"], delta=1e-9)

    def test_bal(self):
        for flags in ((), ("--autodiff",), ("--free_intrinsics",), ("--num_threads", "2"), ("--trust_region", "dogleg"),
                      ("--stock_linear_solver", "sparse_schur"), ("--nopresolve",)):
            output, report = self.play(self.bal, *flags)
            self.check(report, 5)
            self.assertLess(abs(report["max_relative_cost_excess"]), 1e-5, flags)
            self.assertIn("ours / stock", output)
            self.assertEqual(report["rows"][-1]["frames"], 6)
            self.assertEqual(report["rows"][-1]["landmarks"], 40)
            self.assertIsNone(report["worst_loop_ratio"])

    def test_keyframes(self):
        for flags in ((), ("--autodiff",), ("--trust_region", "lm")):
            output, report = self.play(self.keyframes, *flags)
            self.check(report, 13)
            self.assertLess(abs(report["max_relative_cost_excess"]), 1e-5, flags)
            self.assertEqual([row["step"] for row in report["rows"] if row["closes_loop"]], [12, 13])
            self.assertEqual(len(re.findall(r"  loop$", output, re.MULTILINE)), 2)
            self.assertGreater(report["worst_loop_ratio"], 0)

    def test_visual_inertial(self):
        for flags in ((), ("--mode", "incremental"), ("--trust_region", "lm")):
            output, report = self.play("vio:cubic", "--steps", "12", *flags)
            self.check(report, 12)
            self.assertIn("50 frames, 163 points, 789 observations, 49 IMU factors", output)
            self.assertEqual(report["rows"][0]["frames"], 5)  # with their velocities and biases, and the camera
            for row in report["rows"]:  # few frames tell little: where Dog-Leg ends short of the optimum, both do
                ours, stock = (row[side]["reported_cost"] for side in ("ours", "stock"))
                self.assertLess(ours, stock * (1 + 1e-5), (flags, row["step"]))
                self.assertTrue("incremental" in flags or ours > stock * (1 - 1e-5), (flags, row["step"]))
        self.assertIn("no AutoDiff version", self.fails(1, "--problem", "vio:cubic", "--autodiff"))
        self.assertIn("none.vio", self.fails(1, "--problem", "vio:" + self.file("none.vio")))
        self.assertIn("bal: and path: problems only", self.fails(2, "--problem", "vio:cubic", "--no_priors"))

    def test_incremental(self):
        for problem, steps in ((self.bal, 5), (self.keyframes, 13), ("path:25", 24)):
            for flags in ((), ("--autodiff",), ("--stock_autodiff",)):
                _, report = self.play(problem, "--mode", "incremental", *flags)
                self.check(report, steps)
                self.assertLess(abs(report["max_relative_cost_excess"]), 1e-6, (problem, flags))
                self.assertEqual("AutoDiff" in report["ours"], flags == ("--autodiff",))
                self.assertEqual("AutoDiff" in report["stock"], flags != ())

    def test_ours_is_incremental_unless_asked_otherwise(self):
        output, _ = run(TOOL, "--problem", self.bal)
        self.assertIn("ours:  inceres (incremental", output)
        self.assertRegex(output, r"ours, adding the step +\d")
        self.assertRegex(output, r"stock, adding the step +\d")

    def test_threads_do_not_change_what_incremental_finds(self):
        costs = []
        for threads in ("1", "2"):
            _, report = self.play(self.keyframes, "--mode", "incremental", "--num_threads", threads, "--nooptimum")
            costs.append([row["ours"]["reported_cost"] for row in report["rows"]])
        self.assertEqual(costs[0], costs[1])

    def test_structure(self):
        _, report = self.play("path:70", "--mode", "incremental", "--nostock", "--structure_step", "65")
        structure = report["structure"]
        self.assertEqual(structure["step"], 65)
        self.assertEqual(len(structure["frames"]), report["rows"][64]["frames"] - 1)  # the first camera is held
        rows = set(range(len(structure["frames"])))
        self.assertEqual(structure["blocks"], sorted([r, c] for r, c in structure["blocks"] if c < r and r in rows))
        self.assertIn(max(rows), structure["changed_rows"])
        self.assertLess(len(structure["changed_rows"]), len(rows))
        _, without = self.play("path:70", "--mode", "incremental", "--nostock", "--steps", "3")
        self.assertNotIn("structure", without)

    def test_torture(self):
        output, report = self.play(self.bal, "--mode", "incremental", "--no_priors", "--free_intrinsics")
        self.assertEqual(report["failed_steps"]["ours"], 0)
        self.assertEqual(report["failed_steps"]["stock"], len(report["stock_steps"]["failed"]))
        self.assertNotIn("Linear solver failure", output)

    def test_path_without_stock(self):
        output, report = self.play("path:360", "--nostock", "--flat", "--mode", "incremental")
        self.assertEqual(report["steps"], 359)
        for key in ("stock", "stock_ms", "ratio_total", "ratio_median", "max_relative_cost_excess"):
            self.assertIsNone(report[key], key)
        self.assertLess(report["ours_steps"]["max_report_error"], 1e-9)
        self.assertNotIn("stock:", output)
        flat = report["flat"]
        self.assertEqual([flat["early"]["first"], flat["early"]["last"], flat["late"]["first"], flat["late"]["last"]],
                         [150, 250, 260, 359])
        times = sorted(row["ours"]["ms"] for row in report["rows"][149:250])
        self.assertAlmostEqual(flat["early"]["ms"], times[50], delta=1e-9)
        self.assertIn("ours, median of steps", output)

    def test_stereo_odometry(self):
        write_small_stereo(self.file("stereo"))
        output, report = self.play("stereo:" + self.file("stereo"))
        self.check(report, 5)
        self.assertIn("LM", report["stock"])
        self.assertIn("dense_schur", report["stock"])
        self.assertLess(report["max_relative_cost_excess"], 1e-5)
        self.assertEqual(report["rows"][-1]["landmarks"], 20)
        self.assertIn("6 poses, 20 points, 120 stereo sightings", output)

    def test_pose_graph(self):
        for dimension in (2, 3):
            write_small_pose_graph(self.file("small.g2o"), dimension)
            for flags in ((), ("--autodiff",), ("--mode", "incremental")):
                output, report = self.play("g2o:" + self.file("small.g2o"), *flags)
                self.check(report, 13)
                self.assertIn("sparse_normal_cholesky", report["stock"])
                self.assertIn("Dog-Leg", report["stock"])
                self.assertLess(report["max_relative_cost_excess"], 1e-5)
                self.assertEqual(report["rows"][-1]["landmarks"], 0)
                self.assertEqual([row["step"] for row in report["rows"] if row["closes_loop"]], [12])
                self.assertIn(f"14 poses in {dimension}D, 26 edges", output)

    def test_path_with_loops_and_optimum(self):
        _, report = self.play("path:170", "--loops", "--nostock", "--mode", "exact")
        self.assertGreater(sum(row["closes_loop"] for row in report["rows"]), 3)
        self.assertIsNone(report["worst_loop_ratio"])
        _, judged = self.play("path:25", "--nostock", "--optimum")
        self.assertLess(judged["max_relative_cost_excess"], 1e-5)

    def test_flags_change_what_they_say(self):
        _, plain = self.play(self.bal)
        start = plain["rows"][0]["ours"]["initial_cost"]
        _, same = self.play(self.bal)
        self.assertEqual(same["rows"][0]["ours"]["initial_cost"], start)
        for flags in (("--seed", "2"), ("--nopresolve",)):
            _, other = self.play(self.bal, *flags)
            self.assertNotEqual(other["rows"][0]["ours"]["initial_cost"], start, flags)
        _, without = self.play(self.bal, "--no_priors")
        self.assertLess(without["rows"][0]["factors"], plain["rows"][0]["factors"])
        _, short = self.play(self.bal, "--steps", "2", "--nooptimum")
        self.check(short, 2)
        self.assertIsNone(short["max_relative_cost_excess"])
        self.assertIsNone(short["rows"][0]["optimum_cost"])
        for flags in (("--max_num_iterations", "1"), ("--function_tolerance", "0.5"), ("--parameter_tolerance", "0.5"),
                      ("--gradient_tolerance", "1e9")):
            _, early = self.play(self.bal, *flags)
            iterations = [sum(row["stock"]["iterations"] for row in report["rows"]) for report in (plain, early)]
            self.assertLess(iterations[1], iterations[0], flags)
        output, _ = self.play(self.bal, "--print_every", "1")
        self.assertEqual(len(re.findall(r"^ +\d+ +\d+ +\d+ +\d+ \|", output, re.MULTILINE)), 5)

    def test_flags_that_make_no_sense(self):
        for flag, value in (("--mode", "fast"), ("--trust_region", "newton"), ("--stock_linear_solver", "magic"), ("--seed", "-1"),
                            ("--steps", "-1"), ("--num_threads", "0"), ("--max_num_iterations", "0"), ("--print_every", "0"),
                            ("--function_tolerance", "-1"), ("--gradient_tolerance", "nan"), ("--parameter_tolerance", "inf")):
            self.assertIn(flag, self.fails(2, "--problem", self.bal, flag, value))
        for problem in ("", "bal:", "toro:x", "g2o:", "stereo:", "path:", "small.txt"):
            self.assertIn("--problem", self.fails(2, "--problem", problem))
        for flags in (("--no_priors",), ("--free_intrinsics",), ("--seed", "3")):
            self.assertIn("bal: and path: problems only", self.fails(2, "--problem", self.keyframes, *flags))
        for problem in (self.keyframes, "path:30"):
            self.assertIn("bal: problems only", self.fails(2, "--problem", problem, "--nopresolve"))
        for problem in (self.keyframes, self.bal):
            self.assertIn("path: problems only", self.fails(2, "--problem", problem, "--loops"))
        for size in ("x", "-3", "3x", "99999999999"):
            self.assertIn("a number of cameras", self.fails(2, "--problem", "path:" + size))
        self.assertIn("at least 20", self.fails(2, "--problem", "path:7"))
        self.assertIn("at least 165", self.fails(2, "--problem", "path:100", "--loops"))
        for flags in (("--mode", "exact"), ("--mode", "incremental")):
            self.assertIn("--structure_step", self.fails(2, "--problem", "path:30", *flags, "--structure_step", "3"))
        self.assertIn("there are 29 steps", self.fails(2, "--problem", "path:30", "--mode", "incremental", "--json",
                                                       self.file("x.json"), "--structure_step", "30"))
        self.assertIn("4 steps are too few", self.fails(2, "--problem", self.bal, "--flat", "--steps", "4"))
        for flag in ("--autodiff", "--nostock"):
            self.assertIn(flag, self.fails(2, "--problem", self.bal, "--stock_autodiff", flag))

    def test_files_that_cannot_be_played(self):
        self.assertIn("none.txt", self.fails(1, "--problem", "bal:" + self.file("none.txt")))
        with open(self.file("bad.kf"), "w", encoding="ascii") as file:
            file.write(f"KEYFRAME 0 {IDENTITY} 0 0 0\nFEATURE 0 0 x 0 0\n")
        self.assertIn("bad.kf:2: FEATURE: x", self.fails(1, "--problem", "kf:" + self.file("bad.kf")))
        write_small_keyframes(self.file("one.kf"), 1)
        self.assertIn("two or more keyframes", self.fails(1, "--problem", "kf:" + self.file("one.kf")))
        write_small_bal(self.file("one.txt"), num_cameras=1)
        self.assertIn("two or more cameras", self.fails(1, "--problem", "bal:" + self.file("one.txt")))
        for text, what in (("EDGE_SE2 0 1 1 0 0 -1 0 0 1 0 1\n", "bad.g2o:1: EDGE_SE2: information(0, 0)"),
                           ("VERTEX_SE2 0 0 0 0\n", "two or more poses"),
                           ("VERTEX_SE2 0 0 0 0\nVERTEX_SE2 1 1 0 0\n", "vertex 1 has no edge"),
                           ("EDGE_SE2 0 1 1 0 0 1 2 0 1 0 1\n", "not positive definite")):
            with open(self.file("bad.g2o"), "w", encoding="ascii") as file:
                file.write(text)
            message = self.fails(1, "--problem", "g2o:" + self.file("bad.g2o"))
            self.assertIn(what, message)
            self.assertIn("bad.g2o", message)
        self.assertIn("no calibration files", self.fails(1, "--problem", "stereo:" + self.directory.name))
        write_small_stereo(self.file("one"), 1)
        self.assertIn("two or more poses", self.fails(1, "--problem", "stereo:" + self.file("one")))
        self.assertIn("no/report.json", self.fails(1, "--problem", self.bal, "--json", self.file("no/report.json")))


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
