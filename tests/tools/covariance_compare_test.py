#!/usr/bin/env python3
"""covariance_compare as a user runs it. Arguments: the executable."""

import json
import os
import sys
import tempfile
import unittest

from tool_test_support import run, write_small_bal

TOOL = sys.argv[1]


class CovarianceCompareTest(unittest.TestCase):
    def setUp(self):
        self.directory = tempfile.TemporaryDirectory()
        self.addCleanup(self.directory.cleanup)
        self.small = os.path.join(self.directory.name, "small.txt")
        write_small_bal(self.small)

    def compare(self, *flags):
        report = os.path.join(self.directory.name, "report.json")
        out, _ = run(TOOL, "--problem", f"bal:{self.small}", "--json", report, *flags)
        with open(report, encoding="utf-8") as file:
            return json.load(file), out

    def test_the_same_values_as_every_algorithm_of_stock(self):
        report, out = self.compare("--iterations", "20", "--points", "--algorithms",
                                      "sparse_qr,eigen_qr,dense_svd", "--repeats", "1")
        rows = {row["name"]: row for row in report["results"]}
        self.assertEqual(list(rows), ["inceres", "ceres sparse_qr", "ceres eigen_qr",
                                      "ceres dense_svd"])
        self.assertFalse(rows["inceres"]["used_stock"])
        self.assertEqual(report["blocks"], 5 + 40)
        self.assertTrue(all(row["computed"] or name == "ceres dense_svd"
                            for name, row in rows.items()), rows)
        for name in ("ceres sparse_qr", "ceres eigen_qr"):
            self.assertLess(rows[name]["largest_difference"], 1e-7)
            self.assertGreater(rows[name]["seconds"], 0.0)
        self.assertIn("computed", out)

    def test_a_free_gauge_is_false_in_both_and_told(self):
        report, _ = self.compare("--gauge", "free", "--iterations", "20", "--repeats", "1")
        ours, stock = report["results"]
        self.assertFalse(ours["computed"])
        self.assertFalse(stock["computed"])
        self.assertIn("7 directions are open", ours["message"])

    def test_control_points_and_intrinsics_that_are_held(self):
        flags = ("--iterations", "20", "--points", "--gauge", "points", "--hold_intrinsics", "--repeats", "1")
        report, _ = self.compare(*flags)
        ours, stock = report["results"]
        self.assertTrue(ours["computed"] and stock["computed"])
        self.assertLess(stock["largest_difference"], 1e-7)
        self.assertEqual(report["blocks"], 6 + 40)
        self.assertTrue(report["hold_intrinsics"])
        report, _ = self.compare(*flags, "--only_ours")
        self.assertEqual([row["name"] for row in report["results"]], ["inceres"])
        self.assertTrue(report["results"][0]["computed"])

    def test_inceres_autodiff(self):
        report, _ = self.compare("--iterations", "20", "--inceres_autodiff", "--repeats", "1")
        self.assertTrue(report["inceres_autodiff"])
        ours, stock = report["results"]
        self.assertTrue(ours["computed"] and stock["computed"])
        self.assertFalse(ours["used_stock"])
        # At the point that stock's solve has come to, with other roundings.
        self.assertLess(stock["largest_difference"], 1e-7)
        plain, _ = self.compare("--iterations", "20", "--repeats", "1")
        self.assertFalse(plain["inceres_autodiff"])

    def test_what_would_go_to_stock_has_no_result_without_it(self):
        report, _ = self.compare("--gauge", "free", "--iterations", "20", "--repeats", "1", "--only_ours")
        self.assertEqual(len(report["results"]), 1)
        self.assertFalse(report["results"][0]["computed"])
        self.assertIn("7 directions are open", report["results"][0]["message"])

    def test_bad_flags(self):
        for flags, message in ((("--algorithms", "qr"), "'qr' is unknown"),
                               (("--gauge", "loose"), "held, points or free"),
                               (("--repeats", "0"), "repeats 0: must be at least 1"),
                               (("--problem", "g2o:x"), "bal:FILE")):
            _, error = run(TOOL, "--problem", f"bal:{self.small}", *flags, code=2)
            self.assertIn(message, error)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
