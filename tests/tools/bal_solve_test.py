#!/usr/bin/env python3
"""bal_solve as a user runs it. Arguments: the executable, the folder of bundled problems."""

import json
import os
import re
import resource
import signal
import subprocess
import sys
import tempfile
import unittest
import xml.etree.ElementTree

from tool_test_support import bundled_problem, run, write_small_bal

TOOL, BAL_DATA = sys.argv[1:3]
SOLVERS = (["--solver", "inceres"], ["--solver", "ceres"], ["--solver", "inceres", "--builtin_factors"])


class BalSolveTest(unittest.TestCase):
    def setUp(self):
        self.directory = tempfile.TemporaryDirectory()
        self.addCleanup(self.directory.cleanup)
        self.small = self.file("small.txt")
        write_small_bal(self.small)

    def file(self, name):
        return os.path.join(self.directory.name, name)

    def solve(self, *flags, problem=None):
        """Solves and returns standard output and the JSON report."""
        report = self.file("report.json")
        output, _ = run(TOOL, "--input", problem or self.small, "--json", report, *flags)
        with open(report, encoding="utf-8") as file:
            return output, json.load(file)

    def fails(self, code, *flags):
        """Runs it to failure and returns the message."""
        _, message = run(TOOL, *flags, code=code)
        return message

    def test_all_solvers_agree(self):
        costs = []
        for solver in SOLVERS:
            _, report = self.solve(*solver)
            self.assertLess(report["final_cost"], 0.05 * report["initial_cost"])
            self.assertEqual(report["termination"], "CONVERGENCE")
            costs.append(report["final_cost"])
        for cost in costs[1:]:
            self.assertAlmostEqual(cost, costs[0], delta=1e-8 * costs[0])

    def test_written_problem_is_the_solved_one(self):
        for solver in SOLVERS:
            for name in ("solved.txt", "solved.txt.gz", "solved.txt.bz2"):
                _, solved = self.solve(*solver, "--output", self.file(name))
                _, reread = self.solve("--max_num_iterations", "0", problem=self.file(name))
                self.assertAlmostEqual(reread["initial_cost"], solved["final_cost"], delta=1e-11 * solved["final_cost"])
                self.assertAlmostEqual(reread["initial_rms_pixels"], solved["final_rms_pixels"], delta=1e-10)

    def test_bundled_problem(self):
        problem = bundled_problem(BAL_DATA)
        output, report = self.solve("--max_num_iterations", "4", "--num_threads", "2", problem=problem)
        self.assertLess(report["final_rms_pixels"], report["initial_rms_pixels"])
        self.assertIn(f"{report['num_cameras']} cameras", output)

    def test_rms_belongs_to_the_cost(self):
        _, report = self.solve()
        for when in ("initial", "final"):
            rms = (2 * report[when + "_cost"] / report["num_observations"]) ** 0.5
            self.assertAlmostEqual(report[when + "_rms_pixels"], rms, delta=1e-9 * rms)

    def test_progress_has_a_line_an_iteration_and_the_report_the_same_trace(self):
        for solver in SOLVERS:
            output, report = self.solve(*solver)
            header = "iter      cost      cost_change  |gradient|   |step|    tr_ratio  tr_radius  ls_iter  iter_time  total_time"
            self.assertIn(header, output.splitlines())
            rows = re.findall(r"^ +(\d+) +(\d\.\d{6}e[+-]\d\d) ", output, re.MULTILINE)
            self.assertEqual([int(row[0]) for row in rows], list(range(report["iterations"] + 1)))
            self.assertEqual(len(report["trace"]), len(rows))
            for row, sample in zip(rows, report["trace"]):
                self.assertAlmostEqual(float(row[1]), sample["cost"], delta=1e-6 * sample["cost"])

    def test_every_solver_flag_changes_something(self):
        _, plain = self.solve()
        changes = {
            "final_cost": (["--robust", "huber:0.1"], ["--robust", "cauchy:0.2"]),
            "iterations": (["--max_num_iterations", "2"], ["--initial_trust_region_radius", "1"], ["--function_tolerance", "0.5"], ["--gradient_tolerance", "1e7"],
                           ["--parameter_tolerance", "0.5"]),
            "linear_solver": (["--solver", "ceres", "--linear_solver", "sparse_schur"],
                              ["--solver", "ceres", "--linear_solver", "dense_normal_cholesky"],
                              ["--builtin_factors", "--linear_solver", "sparse_schur"],
                              ["--linear_solver", "dense_qr"]),
        }
        for field, flag_sets in changes.items():
            for flags in flag_sets:
                _, changed = self.solve(*flags)
                self.assertNotEqual(changed[field], plain[field], flags)
        for solver in SOLVERS:
            lm, _ = self.solve(*solver, "--max_num_iterations", "3")
            dogleg, _ = self.solve(*solver, "--max_num_iterations", "3", "--trust_region", "dogleg")
            radius = re.compile(r"^ +1 .*", re.MULTILINE)
            self.assertNotEqual(radius.search(lm)[0].split()[6], radius.search(dogleg)[0].split()[6], solver)

    def test_all_direct_linear_solvers_find_the_same_minimum(self):
        _, plain = self.solve()
        for linear_solver in ("dense_schur", "sparse_schur", "sparse_normal_cholesky", "dense_normal_cholesky", "dense_qr"):
            _, report = self.solve("--builtin_factors", "--linear_solver", linear_solver)
            self.assertAlmostEqual(report["final_cost"], plain["final_cost"], delta=1e-8 * plain["final_cost"])

    def test_landmarks_first_is_an_order_not_another_problem(self):
        for engine in SOLVERS[:2]:
            _, plain = self.solve(*engine)
            _, ordered = self.solve(*engine, "--landmarks_first")
            self.assertAlmostEqual(ordered["final_cost"], plain["final_cost"], delta=1e-8 * plain["final_cost"])
        self.assertIn("--landmarks_first", self.fails(2, "--input", self.small, "--builtin_factors", "--landmarks_first"))

    def test_incremental_mode_finds_the_same_minimum(self):
        _, exact = self.solve("--function_tolerance", "1e-12")
        for flags in ([], ["--builtin_factors"], ["--robust", "huber:0.5"], ["--builtin_factors", "--robust", "huber:0.5"]):
            output, report = self.solve("--mode", "incremental", *flags)
            if "--robust" not in flags:
                self.assertAlmostEqual(report["final_cost"], exact["final_cost"], delta=1e-6 * exact["final_cost"])
            self.assertEqual(report["linear_solver"], "incremental")
            self.assertEqual(report["termination"], "CONVERGENCE")
            self.assertEqual(report["iterations"], report["work"]["iterations"])
            self.assertGreaterEqual(report["work"]["relinearised_factors"], report["num_observations"])
            self.assertIn("relinearised_factors", output)
            rms = (2 * report["final_cost"] / report["num_observations"]) ** 0.5
            if "--robust" not in flags:
                self.assertAlmostEqual(report["final_rms_pixels"], rms, delta=1e-9 * rms)

    def test_incremental_mode_says_what_has_no_effect(self):
        for flags in ([], ["--builtin_factors"]):
            _, report = self.solve("--mode", "incremental", *flags, "--gradient_tolerance", "1e-3", "--parameter_tolerance", "1e-3")
            names = [name.lstrip("-") for name in report["options_without_effect"]]
            self.assertIn("gradient_tolerance", names)
            self.assertIn("parameter_tolerance", names)

    def test_picture_is_xml_with_every_camera_before_and_after(self):
        picture = self.file("picture.svg")
        _, report = self.solve("--picture", picture)
        root = xml.etree.ElementTree.parse(picture).getroot()
        groups = {element.get("id"): element for element in root.iter() if element.get("id")}
        for name in ("before", "after"):
            cameras = [element for element in groups[name].iter() if element.get("class") == "camera"]
            self.assertEqual(len(cameras), report["num_cameras"])
        samples = [element for element in root.iter() if element.get("class") in ("accepted", "rejected")]
        self.assertEqual(len(samples), report["iterations"] + 1)
        self.assertIn("6 cameras, 40 points, 240 observations", "".join(root.itertext()))

    def test_files_that_cannot_be_read_or_written(self):
        self.assertIn("nowhere.txt", self.fails(1, "--input", self.file("nowhere.txt")))
        with open(self.file("bad.txt"), "w", encoding="ascii") as file:
            file.write("1 1 1\n0 7 1.0 2.0\n")
        self.assertIn("bad.txt:2", self.fails(1, "--input", self.file("bad.txt")))
        for flag in ("--output", "--json", "--picture"):
            message = self.fails(1, "--input", self.small, flag, self.file("no/such/folder.txt"))
            self.assertIn("no/such/folder.txt", message)
            # Before anything is read, let alone solved.
            message = self.fails(1, "--input", self.file("nowhere.txt"), flag, self.file("no/such/folder.txt"))
            self.assertIn("no/such/folder.txt", message)

    def test_a_file_that_does_not_fit_leaves_nothing(self):
        def small_files_only():
            signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
            resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000))
        for flag in ("--output", "--json", "--picture"):
            result = subprocess.run([TOOL, "--input", self.small, flag, self.file("large.txt")], preexec_fn=small_files_only,
                                    capture_output=True, text=True, timeout=300, check=False)
            self.assertEqual(result.returncode, 1, result.stderr)
            self.assertIn("large.txt", result.stderr)
            self.assertEqual(os.listdir(self.directory.name), ["small.txt"], flag)

    def test_flags_that_make_no_sense(self):
        for flag, value in (("--trust_region", "newton"), ("--linear_solver", "magic"), ("--num_threads", "0"),
                            ("--max_num_iterations", "-1"),
                            ("--function_tolerance", "-1"), ("--gradient_tolerance", "nan"), ("--parameter_tolerance", "inf"),
                            ("--initial_trust_region_radius", "0"),
                            ("--robust", "huber:0"), ("--robust", "tukey:1"), ("--mode", "fast"), ("--solver", "g2o")):
            message = self.fails(2, "--input", self.small, flag, value)
            self.assertIn(flag, message)
        self.assertIn("illegal value 'many'", self.fails(2, "--input", self.small, "--max_num_iterations", "many"))
        self.assertIn("no_such_flag", self.fails(2, "--input", self.small, "--no_such_flag"))
        self.assertIn("missing its value", self.fails(2, "--input"))
        self.assertIn("--input", self.fails(2))
        self.assertIn("surplus", self.fails(2, self.small))

    def test_combinations_that_do_not_exist(self):
        self.assertIn("--mode", self.fails(2, "--input", self.small, "--solver", "ceres", "--mode", "incremental"))
        message = self.fails(2, "--input", self.small, "--mode", "incremental", "--builtin_factors", "--linear_solver", "dense_qr")
        self.assertIn("--linear_solver", message)
        self.assertIn("--builtin_factors", self.fails(2, "--input", self.small, "--solver", "ceres", "--builtin_factors"))
        self.assertIn("lagged_pcg", self.fails(2, "--input", self.small, "--linear_solver", "lagged_pcg"))
        two_level = ["--linear_solver", "iterative_schur", "--preconditioner", "two_level"]
        self.assertIn("two_level", self.fails(2, "--input", self.small, *two_level))
        self.assertIn("--max_memory", self.fails(2, "--input", self.small, "--max_memory", "-1"))
        self.assertIn("go together", self.fails(2, "--input", self.small, "--linear_solver", "cgnr", "--trust_region", "dogleg"))

    def test_flags_of_conjugate_gradients_need_some(self):
        direct = ([], ["--solver", "ceres"], ["--linear_solver", "sparse_schur", "--builtin_factors"], ["--mode", "incremental"],
                  ["--linear_solver", "lagged_pcg", "--builtin_factors"])
        iterative = ["--linear_solver", "iterative_schur"]
        for flag, value in (("--preconditioner", "jacobi"), ("--eta", "0.01"), ("--max_linear_solver_iterations", "7")):
            for flags in direct:
                self.assertIn(flag, self.fails(2, "--input", self.small, *flags, flag, value))
            for flags in (iterative, [*iterative, "--solver", "ceres"], ["--linear_solver", "cgnr"], [*iterative, "--builtin_factors"]):
                self.solve(*flags, flag, value)
        self.solve("--builtin_factors", "--eta", "0.01")  # which may take them
        self.assertIn("--preconditioner", self.fails(2, "--input", self.small, "--builtin_factors", "--preconditioner", "two_level"))
        self.solve("--mode", "incremental", "--preconditioner", "two_level", "--eta", "0.01")

    def test_preconditioners_of_a_ceres_problem(self):
        solved = self.file("solved.json")
        for mode, preconditioner in (("exact", "cluster_jacobi"), ("exact", "cluster_tridiagonal"), ("incremental", "two_level")):
            flags = ["--linear_solver", "iterative_schur", "--preconditioner", preconditioner, "--mode", mode, "--json", solved]
            run(TOOL, "--input", self.small, *flags)
            with open(solved, encoding="utf-8") as file:
                work = json.load(file)["work"]
            self.assertGreater(work["conjugate_gradients"], 0)

    def test_single_precision(self):
        iterative = ["--builtin_factors", "--linear_solver", "iterative_schur", "--max_num_iterations", "5"]
        reports = [self.solve(*iterative, *flags, problem=bundled_problem(BAL_DATA))[1] for flags in ([], ["--single_precision"])]
        self.assertAlmostEqual(reports[1]["final_cost"], reports[0]["final_cost"], delta=1e-3 * reports[0]["final_cost"])
        self.assertNotEqual(reports[1]["final_cost"], reports[0]["final_cost"])
        self.assertLess(reports[1]["work"]["bytes"], reports[0]["work"]["bytes"])
        for flags in ([], iterative[1:], ["--builtin_factors"], ["--mode", "incremental"]):
            self.assertIn("--single_precision", self.fails(2, "--input", self.small, "--single_precision", *flags))
        self.solve("--mode", "incremental", "--linear_solver", "iterative_schur", "--preconditioner", "two_level", "--single_precision")

    def test_jacobians_that_are_not_kept(self):
        direct = ["--builtin_factors", "--linear_solver", "sparse_schur", "--max_num_iterations", "5"]
        reports = [self.solve(*direct, *flags, problem=bundled_problem(BAL_DATA))[1] for flags in ([], ["--recompute_jacobians"])]
        self.assertAlmostEqual(reports[1]["final_cost"], reports[0]["final_cost"], delta=1e-9 * reports[0]["final_cost"])
        self.assertLess(reports[1]["work"]["bytes"], reports[0]["work"]["bytes"])
        for flags in ([], ["--builtin_factors", "--linear_solver", "iterative_schur"], ["--builtin_factors", "--mode", "incremental"]):
            self.assertIn("recompute_jacobians", self.fails(2, "--input", self.small, "--recompute_jacobians", *flags))
        command = [TOOL, "--input", self.small, *direct, "--recompute_jacobians"]
        self.assertIn("iter      cost", run(*command)[0])
        self.assertGreater(json.loads(run(*command, "--json", "-")[0])["final_cost"], 0.0)
        self.assertEqual(run(*command, "--quiet")[0], "")

    def test_a_solve_that_does_not_fit_is_refused(self):
        for flags in ([], ["--builtin_factors"], ["--mode", "incremental"]):
            message = self.fails(1, "--input", self.small, "--max_memory", "1e-6", *flags)
            self.assertIn("does not fit into memory", message)

    def test_a_failed_solve_writes_nothing(self):
        write_small_bal(self.small, num_cameras=2, num_points=3)
        with open(self.small, encoding="ascii") as file:
            lines = file.read().splitlines()
        lines[-9 - 18 + 5] = lines[-18 + 5] = "0.0"  # t_z of the first camera
        lines[-9:] = ["0.0"] * 9  # the points in the camera's plane: projections are not finite
        with open(self.small, "w", encoding="ascii") as file:
            file.write("\n".join(lines) + "\n")
        for solver in SOLVERS:
            message = self.fails(1, "--input", self.small, *solver, "--output", self.file("out.txt"))
            self.assertIn("not solved: FAILURE", message)
            if "ceres" not in solver:  # which names nothing
                self.assertRegex(message.splitlines()[-1], "not solved: .*(variable|parameter block) ")
            self.assertFalse(os.path.exists(self.file("out.txt")))


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
