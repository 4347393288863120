#!/usr/bin/env python3
"""What benchmarks/readme_table.py says of made-up reports. Argument: the folder of the scripts."""

import importlib
import sys
import unittest

sys.path.insert(0, sys.argv[1])
readme_table = importlib.import_module("readme_table")


def report(ours=4.0, stock=10.0, difference=0.0, linear=(1.0, 5.0)):
    """Ours beside a stock configuration that takes so long, and a slower one."""
    return {
        "runs": [
            {"solver": "inceres", "configuration": "dense_schur", "seconds": {"median": ours},
             "stage_seconds": {"setup": 0.5, "residuals": 0.25, "hessian": 0.5 * linear[0], "elimination": 0.5 * linear[0]}},
            {"solver": "ceres", "configuration": "slow", "seconds": {"median": 2.0 * stock}, "stage_seconds": {"linear_solver": 100.0}},
            {"solver": "ceres", "configuration": "fast", "seconds": {"median": stock},
             "stage_seconds": {"preprocessor": 1.0, "linear_solver": linear[1]}},
        ],
        "ratio_to_best_stock": {"median": ours / stock},
        "relative_cost_difference": difference,
    }


class ReadmeTableTest(unittest.TestCase):
    def test_the_ratio_is_judged(self):
        cells, fine = readme_table.judge(report(), 0.4)
        self.assertEqual((cells, fine), (["4000 ms", "10000 ms (FAST)", "**0.40**", "0.40", "0e+00", "yes"], True))
        cells, fine = readme_table.judge(report(), 0.39)
        self.assertEqual((cells[-1], fine), ("**no**", False))
        self.assertEqual(readme_table.judge(report(), None)[0][-1], "")

    def test_a_higher_cost_is_wrong_however_fast(self):
        cells, fine = readme_table.judge(report(difference=2e-6), None)
        self.assertEqual((cells[-1], fine), ("**no**", False))
        self.assertTrue(readme_table.judge(report(difference=-2e-6), None)[1])

    def test_the_linear_step_is_all_its_stages(self):
        cells, fine = readme_table.judge_linear_step(report(), 0.2)
        self.assertEqual((cells, fine), (["1000 ms", "5000 ms (FAST)", "**0.20**", "0.20", "", "yes"], True))
        self.assertFalse(readme_table.judge_linear_step(report(linear=(1.1, 5.0)), 0.2)[1])

    def test_parts_add_up_and_are_blank_where_there_are_none(self):
        rows = readme_table.parts(report())
        self.assertIn("| – set-up | 500.0 ms | 1000.0 ms | | | | |", rows)
        self.assertIn("| – everything else | 2250.0 ms | 4000.0 ms | | | | |", rows)
        incremental = report()
        incremental["runs"][0]["stage_seconds"] = {"update": 4.0}
        self.assertIn("| – set-up | - | 1000.0 ms | | | | |", readme_table.parts(incremental))

    def test_a_report_is_recorded_in_the_rows_that_are_of_it(self):
        figures = {"rows": [{"problem": "p", "row": "this", "note": "n"}, {"problem": "q", "row": "that", "ratio": 1.0}]}
        self.assertEqual(readme_table.record(figures, "this", report(), 11, {"commit": "c"}), 1)
        row = figures["rows"][0]
        self.assertEqual((row["ceres_ms"], row["inceres_ms"], row["ratio"], row["commit"], row["note"]), (1e4, 4e3, 0.4, "c", "n"))
        self.assertEqual(figures["rows"][1], {"problem": "q", "row": "that", "ratio": 1.0})
        self.assertEqual(readme_table.record(figures, "neither", report(), 11, {}), 0)

    def test_the_readme_shows_rows_that_are_measured(self):
        rows = readme_table.json.loads(readme_table.FIGURES.read_text(encoding="utf-8"))["rows"]
        measured = {row["row"] for row in rows if "row" in row}
        self.assertTrue(measured and measured <= {row[0] for row in readme_table.ROWS}, measured)
        for row in rows:
            self.assertTrue({"problem", "ceres_ms", "inceres_ms", "ratio", "command", "machine", "commit", "date"} <= row.keys(), row)
            self.assertAlmostEqual(row["inceres_ms"] / row["ceres_ms"], row["ratio"], delta=0.1 * row["ratio"])

    def test_every_limit_has_its_row(self):
        self.assertTrue(readme_table.LINEAR_LIMITS.keys() <= {row[0] for row in readme_table.ROWS})


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
