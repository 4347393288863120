#!/usr/bin/env python3
"""benchmarks/ablation.py and golden_traces.py: what they compare, and small runs. Arguments: the folder benchmarks/, the build
directory."""

import contextlib
import io
import pathlib
import subprocess
import sys
import unittest

BENCHMARKS, BUILD = (pathlib.Path(argument) for argument in sys.argv[1:3])
sys.path.insert(0, str(BENCHMARKS))

import ablation  # noqa: E402
import golden_traces  # noqa: E402


class AblationTest(unittest.TestCase):
    def test_thresholds_are_read_from_the_header(self):
        found = dict((name, (value, count)) for name, value, count in ablation.thresholds())
        self.assertGreater(len(found), 30)
        self.assertIn("stop.share", found)
        self.assertFalse(found["stop.share"][1])
        self.assertTrue(found["truncate.max_scalars"][1])

    def test_a_replay_is_judged_by_work_and_excess(self):
        work, costs = ablation.play(BUILD, ["--problem", "path:20"], "", None)
        self.assertGreater(work, 0.0)
        self.assertEqual(len(costs), 19)
        self.assertAlmostEqual(ablation.worst_excess([1.0, 2.000002], [1.0, 2.0]), 1.0, places=5)
        with self.assertRaises(RuntimeError):
            ablation.play(BUILD, ["--problem", "no:such"], "", None)


class GoldenTracesTest(unittest.TestCase):
    def compare(self, ours, theirs):
        with contextlib.redirect_stdout(io.StringIO()) as output:
            return golden_traces.compare("report", ours, theirs), output.getvalue()

    def test_the_last_digit_counts_and_times_do_not(self):
        report = {"trace": [{"cost": 0.1, "seconds": 1.0}, {"cost": 0.3, "seconds": 2.0}], "solve_ms": {"total": 5.0}, "work": {"rows": 3}}
        other = {"trace": [{"cost": 0.1, "seconds": 9.0}, {"cost": 0.3, "seconds": 9.0}], "solve_ms": {"total": 9.0}, "work": {"rows": 3}}
        self.assertTrue(self.compare(report, other)[0])
        other["trace"][1]["cost"] = 0.30000000000000004
        same, text = self.compare(report, other)
        self.assertFalse(same)
        self.assertIn("/trace/1/cost", text)
        self.assertFalse(self.compare(report, {"trace": report["trace"]})[0], "less is not the same")
        self.assertFalse(self.compare({}, {})[0], "nothing compared")

    def test_a_build_is_like_itself(self):
        command = [sys.executable, str(BENCHMARKS / "golden_traces.py"), "--build", str(BUILD), "--against", str(BUILD), "--only", "street"]
        result = subprocess.run(command, capture_output=True, text=True, check=False)
        self.assertEqual(result.returncode, 0, result.stdout + result.stderr)
        self.assertIn("the same", result.stdout)

    def test_nothing_played_is_no_success(self):
        command = [sys.executable, str(BENCHMARKS / "golden_traces.py"), "--build", str(BUILD), "--against", str(BUILD), "--only", "no such"]
        self.assertEqual(subprocess.run(command, capture_output=True, check=False).returncode, 2)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
