#!/usr/bin/env python3
"""benchmarks/replay_figures.py on a small problem in the place of the large one. Arguments: the script, the build directory."""

import json
import os
import pathlib
import re
import subprocess
import sys
import tempfile
import unittest

from tool_test_support import write_small_bal

SCRIPT, BUILD = sys.argv[1:3]


class ReplayFiguresTest(unittest.TestCase):
    def setUp(self):
        directory = tempfile.TemporaryDirectory()
        self.addCleanup(directory.cleanup)
        self.data = pathlib.Path(directory.name)
        (self.data / "bal").mkdir()
        write_small_bal(self.data / "bal" / "problem-49-7776-pre.txt")

    def figures(self, *flags):
        command = [sys.executable, SCRIPT, "--build", BUILD, "--keep", str(self.data / "reports"), *flags]
        environment = {**os.environ, "INCERES_DATA_DIR": str(self.data)}
        return subprocess.run(command, capture_output=True, text=True, timeout=300, check=False, env=environment)

    def test_prints_what_the_report_says_beside_what_is_asked(self):
        result = self.figures("--only", "intrinsics held")
        self.assertEqual(result.stderr, "")
        report = json.loads((self.data / "reports" / "replay-0.json").read_text(encoding="utf-8"))
        self.assertEqual(report["steps"], 5)
        self.assertIn(f"| all steps, ours / stock | {report['ratio_total']:.3g} | at most 0.2 |", result.stdout)
        self.assertIn("| our steps that failed | 0 | at most 0 | yes |", result.stdout)
        verdicts = re.findall(r"\| (yes|\*\*no\*\*) \|$", result.stdout, re.MULTILINE)
        self.assertEqual(len(verdicts), 5)
        self.assertEqual(result.returncode, 0 if set(verdicts) == {"yes"} else 1)

    def test_torture_has_no_optimum(self):
        result = self.figures("--only", "torture")
        self.assertIn("steps of stock that failed", result.stdout)
        self.assertNotIn("not measured", result.stdout)

    def test_says_what_is_missing(self):
        result = self.figures("--only", "fr3")
        self.assertIn("skipped, ", result.stdout)
        self.assertEqual(result.returncode, 2, "nothing was played")
        (self.data / "bal" / "problem-49-7776-pre.txt").write_text("nonsense", encoding="ascii")
        result = self.figures("--only", "intrinsics held")
        self.assertEqual(result.returncode, 2)
        self.assertIn("problem-49-7776-pre.txt", result.stderr)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
