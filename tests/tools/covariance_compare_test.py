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
        report, out = self.compare("--gauge", "free", "--iterations", "20", "--repeats", "1")
        ours, stock = report["results"]
        self.assertFalse(ours["computed"])
        self.assertFalse(stock["computed"])
        self.assertIn("7 directions are open", ours["message"])
        self.assertIn("not computed: 7 directions", out)

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

    def test_what_nobody_observes_is_left_out(self):
        with open(self.small, encoding="ascii") as file:
            head, *lines = file.read().splitlines()
        observations, cameras, points = lines[:240], lines[240:-120], lines[-120:]
        for first in (False, True):  # the camera that is held among them
            seen = [f"{int(line.split()[0]) + first} {line.split(' ', 1)[1]}" for line in observations]
            with open(self.small, "w", encoding="ascii") as file:
                file.write("\n".join(["7 41 240", *seen, *(cameras[:9] + cameras if first else cameras + cameras[:9]), *points,
                                      "1", "1", "1"]) + "\n")
            for gauge, blocks in (("held", 6 + 40 - (not first)), ("points", 6 + 40)):
                report, _ = self.compare("--points", "--gauge", gauge, "--repeats", "1", "--iterations", "5")
                self.assertEqual(report["blocks"], blocks)
        self.assertEqual(head, "6 40 240")

    def test_what_cannot_be_evaluated_and_what_goes_to_stock_is_no_comparison(self):
        with open(self.small, encoding="ascii") as file:
            lines = file.read().splitlines()
        for value, code, message in (("1e302", 4, "NO MEASUREMENT"), ("0.0", 1, "not finite")):
            # A point that is far out, or in the plane of the first camera.
            changed = lines[:-3] + ["0.0", "0.0", value]
            changed[241 + 5] = "0.0" if value == "0.0" else lines[241 + 5]
            with open(self.small, "w", encoding="ascii") as file:
                file.write("\n".join(changed) + "\n")
            for flags in ((), ("--only_ours",)):
                out, error = run(TOOL, "--problem", f"bal:{self.small}", "--json", os.path.join(self.directory.name, "no.json"),
                                 "--repeats", "1", "--gauge", "free", *flags, code=code)
                self.assertIn(message, error)
                self.assertNotIn("ratio", out)
            self.assertFalse(os.path.exists(os.path.join(self.directory.name, "no.json")))
        _, error = run(TOOL, "--problem", f"bal:{self.small}", "--iterations", "3", code=1)
        self.assertIn("not solved", error)

    def test_bad_flags(self):
        for flags, message in ((("--algorithms", "qr"), "'qr' is unknown"),
                               (("--gauge", "loose"), "held, points or free"),
                               (("--repeats", "0"), "repeats 0: must be at least 1"),
                               (("--problem", "g2o:x"), "bal:FILE")):
            _, error = run(TOOL, "--problem", f"bal:{self.small}", *flags, code=2)
            self.assertIn(message, error)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
