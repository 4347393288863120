#!/usr/bin/env python3
"""vins_window and okvis_map as a user runs them, bare and with the drop-in preloaded.

Arguments: the folder of the executables, the folder of their sources, the drop-in library (or nothing, if it is not built).
"""

import json
import os
import pathlib
import re
import subprocess
import sys
import tempfile
import unittest

PROGRAMS, SOURCES = (pathlib.Path(argument) for argument in sys.argv[1:3])
DROPIN = sys.argv[3] if len(sys.argv) > 3 else ""
NAMES = ("vins_window", "okvis_map")


def run(name, *flags, **environment):
    return subprocess.run([str(PROGRAMS / name), *flags], capture_output=True, text=True, timeout=300, check=False,
                          # A library with a sanitizer's runtime, preloaded, comes before the program's own.
                          env={**os.environ, "ASAN_OPTIONS": "verify_asan_link_order=0", **environment})


class ExecutablesTest(unittest.TestCase):
    def setUp(self):
        directory = tempfile.TemporaryDirectory()
        self.addCleanup(directory.cleanup)
        self.json = pathlib.Path(directory.name) / "report.json"

    def report(self, name, *flags, **environment):
        result = run(name, "--frames", "25", "--json", str(self.json), *flags, **environment)
        self.assertEqual(result.returncode, 0, result.stderr)
        return json.loads(self.json.read_text(encoding="utf-8"))

    def test_report(self):
        for name in NAMES:
            with self.subTest(program=name):
                report = self.report(name)
                self.assertEqual(list(report), ["frames", "solve_ms", "ate_m", "position_rmse_m", "final_cost_sum"])
                self.assertEqual(report["frames"], 25)
                ms = report["solve_ms"]
                self.assertEqual(list(ms), ["median", "p95", "max", "total"])
                self.assertTrue(0.0 < ms["median"] <= ms["p95"] <= ms["max"] <= ms["total"])
                self.assertLess(report["ate_m"], 0.2)
                self.assertGreater(report["final_cost_sum"], 0.0)

    def test_same_arguments_same_result_and_each_flag_has_an_effect(self):
        for name in NAMES:
            plain = self.report(name)
            again = self.report(name, "--seed=1", "--ordering=auto", "--linear_solver=dense_schur")
            self.assertEqual([plain["ate_m"], plain["final_cost_sum"]], [again["ate_m"], again["final_cost_sum"]])
            changes = [["--seed", "2"], ["--features", "50"], ["--frames", "30"], ["--free_extrinsics"], ["--max_iterations", "3"],
                       ["--max_solver_time", "1e-6"], ["--ordering", "landmarks_first"], ["--linear_solver", "sparse_schur"],
                       ["--linear_solver", "sparse_normal_cholesky"], ["--kick", "1"], ["--realistic_costs"], ["--scene", "startup"],
                       ["--features", "50", "--scene", "startup"]]
            for flags in changes + ([["--newest_first"]] if name == "okvis_map" else []):
                with self.subTest(program=name, flags=flags):
                    self.assertNotEqual(self.report(name, *flags)["final_cost_sum"], plain["final_cost_sum"])

    def test_what_else_is_said_changes_the_scene_wherever_it_stands(self):
        for name in NAMES:
            before = self.report(name, "--features", "50", "--scene", "startup")
            after = self.report(name, "--scene", "startup", "--features", "50")
            self.assertEqual(before["final_cost_sum"], after["final_cost_sum"])
            self.assertNotEqual(before["final_cost_sum"], self.report(name, "--scene", "startup")["final_cost_sum"])

    def test_bad_arguments_are_named(self):
        bad = [("--frames", "abc"), ("--frames", "0"), ("--features", "7"), ("--ordering", "best"), ("--linear_solver", "qr"),
               ("--max_solver_time", "-1"), ("--seed",), ("--scene", "moon"), ("--kick", "-1"), ("--nonsense",), ("surplus",), ("--newest_first",)]
        for name in NAMES:
            for flags in bad if name == "vins_window" else bad[:-1]:
                with self.subTest(program=name, flags=flags):
                    result = run(name, *flags)
                    self.assertEqual(result.returncode, 2)
                    self.assertIn(flags[0], result.stderr)
                    self.assertEqual(result.stdout, "")
            result = run(name, "--frames", "20", "--json", "/no/such/folder/report.json")
            self.assertEqual(result.returncode, 1)
            self.assertIn("/no/such/folder/report.json", result.stderr)

    def test_help_lists_every_flag(self):
        for name in NAMES:
            result = run(name, "--help")
            self.assertEqual(result.returncode, 0)
            for flag in ("--scene", "--frames", "--features", "--seed", "--kick", "--free_extrinsics", "--realistic_costs", "--ordering", "--linear_solver", "--json"):
                self.assertIn(flag, result.stdout)

    def test_knows_nothing_of_inceres(self):
        sources = [path for path in SOURCES.rglob("*") if path.suffix in {".h", ".cc"}]
        self.assertGreater(len(sources), 20)
        for path in sources:
            self.assertIsNone(re.search(r'#include\s*[<"]inceres', path.read_text(encoding="utf-8")), path)

    @unittest.skipIf(not DROPIN, "the drop-in is not built")
    def test_with_the_drop_in_preloaded(self):
        for name in NAMES:
            stock = self.report(name)
            for mode, tolerance in (("stock", 0.0), ("exact", 1e-4), ("incremental", 0.1)):
                with self.subTest(program=name, mode=mode):
                    ours = self.report(name, LD_PRELOAD=DROPIN, INCERES_MODE=mode)
                    self.assertAlmostEqual(ours["ate_m"], stock["ate_m"], delta=tolerance * stock["ate_m"])
                    self.assertAlmostEqual(ours["final_cost_sum"], stock["final_cost_sum"], delta=tolerance * stock["final_cost_sum"])
                    if mode != "stock":  # it did solve: the last digits are its own
                        self.assertNotEqual(ours["final_cost_sum"], stock["final_cost_sum"])


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
