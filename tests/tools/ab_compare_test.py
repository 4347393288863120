#!/usr/bin/env python3
"""ab_compare as a user runs it. Arguments: the executable, the folder of bundled problems."""

import json
import os
import sys
import tempfile
import unittest
import xml.etree.ElementTree

from tool_test_support import bundled_problem, run, write_small_bal

TOOL, BAL_DATA = sys.argv[1:3]
BAL_CONFIGURATIONS = {"dense_schur", "dense_schur_points_first", "sparse_schur", "sparse_schur_points_first"}
GRAPH = """VERTEX_SE2 0 0 0 0
VERTEX_SE2 1 1.1 0.1 1.5
VERTEX_SE2 2 1.0 1.1 3.1
VERTEX_SE2 3 0.1 0.9 -1.5
EDGE_SE2 0 1 1 0 1.57 10 0 0 10 0 50
EDGE_SE2 1 2 1 0 1.57 10 0 0 10 0 50
EDGE_SE2 2 3 1 0 1.57 10 0 0 10 0 50
EDGE_SE2 3 0 1 0.05 1.57 10 0 0 10 0 50
"""


class AbCompareTest(unittest.TestCase):
    def setUp(self):
        self.directory = tempfile.TemporaryDirectory()
        self.addCleanup(self.directory.cleanup)
        self.small = self.file("small.txt")
        write_small_bal(self.small)
        self.graph = self.file("square.g2o")
        with open(self.graph, "w", encoding="ascii") as file:
            file.write(GRAPH)

    def file(self, name):
        return os.path.join(self.directory.name, name)

    def compare(self, *flags, problem=None):
        """Compares and returns standard output and the checked JSON report."""
        report_file = self.file("report.json")
        output, _ = run(TOOL, "--problem", problem or "bal:" + self.small, "--json", report_file, "--repeats", "2", *flags)
        with open(report_file, encoding="utf-8") as file:
            report = json.load(file)
        self.check_fields(report)
        self.check_consistency(report)
        return output, report

    def check_fields(self, report):
        number = (int, float)
        for field, kind in (("problem", str), ("threads", int), ("runs", list), ("ratio_to_best_stock", dict),
                            ("relative_cost_difference", number), ("environment", dict)):
            self.assertIsInstance(report[field], kind, field)
        for run_report in report["runs"]:
            for field, kind in (("solver", str), ("configuration", str), ("seconds", dict), ("initial_cost", number),
                                ("final_cost", number), ("iterations", int), ("termination", str), ("time_to_gap", dict)):
                self.assertIsInstance(run_report[field], kind, field)
            self.assertEqual(set(run_report["time_to_gap"]), {"1e-2", "1e-3", "1e-4", "1e-5"})
        for spread in [report["ratio_to_best_stock"]] + [run_report["seconds"] for run_report in report["runs"]]:
            self.assertEqual(set(spread), {"median", "min", "max"})
            self.assertGreater(spread["min"], 0.0)
            self.assertLessEqual(spread["min"], spread["median"])
            self.assertLessEqual(spread["median"], spread["max"])
        for field in ("cpu", "compiler", "flags", "commit", "ceres", "blas"):
            self.assertTrue(report["environment"][field], field)
        self.assertTrue(report["environment"]["ceres"].startswith("2.1.0"))

    def check_consistency(self, report):
        """Fields that follow from each other."""
        ours, *stock = report["runs"]
        self.assertEqual([ours["solver"]] + [entry["solver"] for entry in stock], ["inceres"] + ["ceres"] * len(stock))
        lowest = min(entry["final_cost"] for entry in stock)
        self.assertAlmostEqual(report["relative_cost_difference"], (ours["final_cost"] - lowest) / lowest, delta=1e-12)
        fastest = min(stock, key=lambda entry: entry["seconds"]["median"])
        self.assertEqual(report["best_stock"], fastest["configuration"])
        ratio = report["ratio_to_best_stock"]
        self.assertLessEqual(ratio["min"], ours["seconds"]["max"] / fastest["seconds"]["min"])
        self.assertGreaterEqual(ratio["max"], ours["seconds"]["min"] / fastest["seconds"]["max"])
        for entry in report["runs"]:
            self.assertAlmostEqual(entry["initial_cost"], ours["initial_cost"], delta=1e-12 * ours["initial_cost"])
            times = [entry["time_to_gap"][gap] for gap in ("1e-2", "1e-3", "1e-4", "1e-5")]
            reached = [time for time in times if time is not None]
            self.assertEqual(reached, sorted(reached), "a smaller gap is not reached sooner")
            self.assertEqual(times[: len(reached)], reached, "a smaller gap is not reached without the larger")
            for time in reached:
                self.assertLessEqual(time, entry["seconds"]["max"])

    def test_small_bal_problem(self):
        output, report = self.compare("--configurations", ",".join(sorted(BAL_CONFIGURATIONS)), "--num_threads", "2")
        self.assertEqual({entry["configuration"] for entry in report["runs"][1:]}, BAL_CONFIGURATIONS)
        self.assertEqual(report["threads"], 2)
        self.assertEqual(report["repeats"], 2)
        self.assertEqual(report["runs"][0]["final_cost_spread"], 0.0, "the same bits in every round")
        self.assertLess(abs(report["relative_cost_difference"]), 1e-8)
        self.assertLess(report["parameter_difference"]["largest"], 1e-3)
        for entry in report["runs"]:
            self.assertIn(entry["configuration"], output)
            self.assertIsNotNone(entry["time_to_gap"]["1e-5"])
        self.assertIn("blas:", output)

    def test_default_configurations_are_run_or_dropped(self):
        _, report = self.compare()
        seen = {entry["configuration"] for entry in report["runs"][1:]} | {entry["configuration"] for entry in report["dropped"]}
        self.assertEqual(seen, BAL_CONFIGURATIONS)

    def test_builtin_factors(self):
        _, report = self.compare("--builtin_factors", "--robust", "huber:1", "--trust_region", "dogleg")
        self.assertTrue(report["builtin_factors"])
        self.assertIn("builtin_factors", report["runs"][0]["configuration"])
        self.assertLess(abs(report["relative_cost_difference"]), 1e-6)

    def test_incremental_mode(self):
        for flags in ([], ["--builtin_factors"]):
            _, report = self.compare("--mode", "incremental", "--robust", "huber:1", *flags)
            self.assertIn("incremental", report["runs"][0]["configuration"])
            self.assertLess(abs(report["relative_cost_difference"]), 1e-5)
            self.assertLess(report["parameter_difference"]["largest"], 1e-1)

    def test_analytic_cost_functions(self):
        _, autodiff = self.compare()
        for flags in ([], ["--builtin_factors"], ["--builtin_factors", "--linear_solver", "lagged_pcg"]):
            _, report = self.compare("--analytic", "--trust_region", "dogleg", *flags)
            self.assertLess(abs(report["relative_cost_difference"]), 1e-7)
            self.assertAlmostEqual(report["runs"][1]["initial_cost"] / autodiff["runs"][1]["initial_cost"], 1.0, delta=1e-12)
        _, message = run(TOOL, "--problem", "vio:cubic", "--analytic", code=2)
        self.assertIn("--analytic", message)

    def test_inceres_autodiff(self):
        _, report = self.compare("--inceres_autodiff")
        self.assertIn("inceres_autodiff", report["runs"][0]["configuration"])
        self.assertLess(abs(report["relative_cost_difference"]), 1e-9)
        for flags in (["--problem", "vio:cubic"], ["--problem", "bal:x", "--analytic"], ["--problem", "bal:x", "--builtin_factors"]):
            _, message = run(TOOL, "--inceres_autodiff", *flags, code=2)
            self.assertIn("--inceres_autodiff", message)

    def test_visual_inertial(self):
        for flags in ([], ["--builtin_factors"], ["--mode", "incremental", "--builtin_factors", "--robust", "huber:1"]):
            _, report = self.compare("--trust_region", "dogleg", *flags, problem="vio:cubic")
            self.assertEqual(report["description"], "50 frames, 163 points, 789 observations, 49 IMU factors")
            incremental = "--mode" in flags  # ends within the tolerance of the optimum, and so below where stock's rule stops
            self.assertLess(report["relative_cost_difference"], 1e-6 if incremental else 1e-11)
            self.assertGreater(report["relative_cost_difference"], -1e-5 if incremental else -1e-11)
            self.assertLess(report["parameter_difference"]["largest"], 1e-2 if incremental else 1e-9)
        _, message = run(TOOL, "--problem", "vio:cube", code=1)
        self.assertIn("cube", message)

    def test_zero_tolerances_run_all_iterations(self):
        zero = [part for name in ("function", "gradient", "parameter") for part in (f"--{name}_tolerance", "0")]
        _, report = self.compare(*zero, "--max_num_iterations", "3", "--configurations", "dense_schur")
        for entry in report["runs"]:
            self.assertEqual(entry["iterations"], 3)
            self.assertEqual(entry["termination"], "NO_CONVERGENCE")

    def test_pose_graph(self):
        for strategy in ("lm", "dogleg"):
            _, report = self.compare("--trust_region", strategy, problem="g2o:" + self.graph)
            self.assertEqual([entry["configuration"] for entry in report["runs"][1:]], ["sparse_normal_cholesky"])
            self.assertLess(abs(report["relative_cost_difference"]), 1e-8)
            self.assertLess(report["parameter_difference"]["rotations"], 1e-4)

    def test_bundled_problem(self):
        problem = bundled_problem(BAL_DATA)
        _, report = self.compare("--max_num_iterations", "3", problem="bal:" + problem)
        self.assertLess(abs(report["relative_cost_difference"]), 1e-8)

    def test_stock_in_disguise_is_no_measurement(self):
        with open(self.small, encoding="ascii") as file:
            *lines, _ = file.read().split("\n")[:-1]
        with open(self.small, "w", encoding="ascii") as file:
            file.write("\n".join(lines + ["1e302\n"]))  # a coordinate that Ceres takes for one that was not written
        _, message = run(TOOL, "--problem", "bal:" + self.small, "--json", self.file("report.json"), code=4)
        self.assertIn("NO MEASUREMENT", message)
        self.assertFalse(os.path.exists(self.file("report.json")))

    def test_conjugate_gradients_with_each_preconditioner_and_their_curves(self):
        curves = self.file("curves.svg")
        flags = ["--linear_solver", "iterative_schur", "--picture", curves, "--configurations", "sparse_schur,iterative_schur"]
        for mode, preconditioner in (("exact", "schur_jacobi"), ("exact", "cluster_jacobi"), ("exact", "cluster_tridiagonal"),
                                     ("incremental", "two_level")):
            output, report = self.compare(*flags, "--preconditioner", preconditioner, "--mode", mode, "--tolerance", "1e-3")
            self.assertEqual([entry["configuration"] for entry in report["runs"][1:]], ["sparse_schur", "iterative_schur"])
            self.assertIn("so near the lowest", output)
            drawn = xml.etree.ElementTree.parse(curves).getroot()
            labels = [path.get("data-label") for path in drawn.iter("{http://www.w3.org/2000/svg}path") if path.get("data-label")]
            self.assertEqual(labels, [f"{entry['solver']}, {entry['configuration']}" for entry in report["runs"]])
        self.compare("--configurations", "iterative_schur", "--preconditioner", "jacobi", "--tolerance", "1e-3")  # stock's alone
        _, message = run(TOOL, "--problem", "bal:" + self.small, "--preconditioner", "jacobi", code=2)
        self.assertIn("--preconditioner", message)

    def test_a_cost_above_the_tolerance_is_an_error_after_the_report(self):
        report = self.file("report.json")
        command = [TOOL, "--problem", "bal:" + self.small, "--repeats", "1", "--configurations", "dense_schur", "--json", report]
        output, message = run(*command, "--tolerance", "-0.5", code=3)  # nobody halves the minimum
        self.assertIn("final cost is higher", message)
        self.assertIn("ratio to the best stock", output)
        self.assertTrue(os.path.exists(report))
        run(*command, "--tolerance", "1e-6")

    def test_an_unsolvable_problem_is_an_error(self):
        with open(self.graph, "a", encoding="ascii") as file:
            file.write("EDGE_SE2 0 2 1 0 0 1 5 0 1 0 1\n")  # an indefinite information matrix
        _, message = run(TOOL, "--problem", "g2o:" + self.graph, code=1)
        self.assertIn("edge 4", message)

    def test_files_that_cannot_be_read(self):
        _, message = run(TOOL, "--problem", "bal:" + self.file("nowhere.txt"), code=1)
        self.assertIn("nowhere.txt", message)
        _, message = run(TOOL, "--problem", "g2o:" + self.small, code=1)
        self.assertIn("small.txt:1", message)

    def test_inner_iterations(self):
        """No more steps of the whole problem than without them, in both, and the same cost."""
        flags = ["--configurations", "dense_schur", "--function_tolerance", "1e-10"]
        _, plain = self.compare(*flags)
        output, report = self.compare(*flags, "--inner_iterations")
        self.assertIn("inner_iterations", output)
        self.assertLess(abs(report["relative_cost_difference"]), 1e-8)
        for before, after in zip(plain["runs"], report["runs"]):
            self.assertLessEqual(after["iterations"], before["iterations"])

    def test_flags_that_make_no_sense(self):
        bal = ["--problem", "bal:" + self.small]
        for flags in (["--problem", "toro:x"], [], bal + ["--configurations", "dense_schur,magic"],
                      ["--problem", "g2o:" + self.graph, "--configurations", "dense_schur"], bal + ["--repeats", "0"],
                      bal + ["--tolerance", "nan"], bal + ["--robust", "huber"], bal + ["--num_threads", "0"],
                      bal + ["--mode", "fast"], bal + ["--inner_iterations", "--builtin_factors"],
                      bal + ["--inner_iterations", "--mode", "incremental"], bal + ["--mode", "incremental", "--builtin_factors", "--linear_solver", "dense_qr"], ["--problem", "g2o:" + self.graph, "--builtin_factors"],
                      bal + ["--linear_solver", "lagged_pcg"], bal + ["surplus"],
                      bal + ["--linear_solver", "cgnr", "--trust_region", "dogleg"]):
            _, message = run(TOOL, *flags, code=2)
            self.assertTrue(message.startswith("ab_compare: "), message)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
