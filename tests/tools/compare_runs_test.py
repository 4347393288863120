#!/usr/bin/env python3
"""benchmarks/compare_runs.py on made-up runs. Argument: the script."""

import json
import pathlib
import subprocess
import sys
import tempfile
import unittest

SCRIPT = sys.argv[1]


class CompareRunsTest(unittest.TestCase):
    def setUp(self):
        directory = tempfile.TemporaryDirectory()
        self.addCleanup(directory.cleanup)
        self.folder = pathlib.Path(directory.name)

    def write(self, name, runs, unit="us", label=""):
        benchmarks = [{"name": benchmark, "run_type": "iteration", "real_time": time, "time_unit": unit, "label": label}
                      for benchmark, times in runs.items() for time in times]
        benchmarks.append({"name": "skipped", "run_type": "iteration", "error_occurred": True, "real_time": 0.0, "time_unit": "us"})
        benchmarks.append({"name": "a_mean", "run_type": "aggregate", "real_time": 1.0, "time_unit": "us"})
        path = self.folder / name
        path.write_text(json.dumps({"benchmarks": benchmarks}), encoding="utf-8")
        return path

    def compare(self, *arguments):
        return subprocess.run([sys.executable, SCRIPT, *map(str, arguments)], capture_output=True, text=True, timeout=60, check=False)

    def test_slower_faster_and_unchanged(self):
        before = self.write("before.json", {"a": [1.0, 1.1, 1.2], "b": [2.0, 2.1, 2.2], "c": [3.0, 3.1, 3.2], "gone": [1.0]})
        after = self.write("after.json", {"a": [2.0, 2.2, 2.4], "b": [1.0, 1.05, 1.1], "c": [3.1, 3.15, 3.3], "new": [1.0]})
        result = self.compare(before, after)
        self.assertEqual(result.returncode, 1)
        self.assertIn("| a | 1.1 us | 2.2 us | 2.00 | **slower** |", result.stdout)
        self.assertIn("| b | 2.1 us | 1.05 us | 0.50 | faster |", result.stdout)
        self.assertNotIn("| c |", result.stdout)
        self.assertIn("3 compared: 1 faster, 1 slower; only before: 1, only after: 1", result.stdout)
        self.assertIn("| c | 3.1 us | 3.15 us | 1.02 |  |", self.compare(before, after, "--all").stdout)

    def test_runs_that_overlap_prove_nothing(self):
        before = self.write("before.json", {"a": [1.0, 1.1, 5.0]})
        after = self.write("after.json", {"a": [1.05, 2.2, 2.4]})
        self.assertEqual(self.compare(before, after).returncode, 0)

    def test_threshold_and_units(self):
        before = self.write("before.json", {"a": [1.0]}, "ms")
        after = self.write("after.json", {"a": [1080.0]}, "us")
        self.assertEqual(self.compare(before, after).returncode, 1)
        self.assertEqual(self.compare(before, after, "--threshold", "0.1").returncode, 0)

    def test_other_labels_are_other_benchmarks(self):
        before = self.write("before.json", {"a": [1.0]}, label="Ladybug-49")
        after = self.write("after.json", {"a": [9.0]}, label="generated street")
        result = self.compare(before, after)
        self.assertEqual(result.returncode, 2)
        self.assertIn("no benchmark in common", result.stderr)
        self.assertIn("| a (Ladybug-49) | 1 us | 1 us |", self.compare(before, before, "--all").stdout)

    def test_unreadable_or_nothing_in_common(self):
        fine = self.write("fine.json", {"a": [1.0]})
        other = self.write("other.json", {"b": [1.0]})
        broken = self.folder / "broken.json"
        broken.write_text("{", encoding="utf-8")
        for after in (other, broken, self.folder / "none.json"):
            result = self.compare(fine, after)
            self.assertEqual(result.returncode, 2, after)
            self.assertIn("compare_runs.py: ", result.stderr)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
