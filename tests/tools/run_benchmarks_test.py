#!/usr/bin/env python3
"""The benchmarks run, and their figures can be written and compared. Arguments: the folder of the scripts, the build."""

import json
import pathlib
import subprocess
import sys
import tempfile
import unittest

SCRIPTS, BUILD = pathlib.Path(sys.argv[1]), pathlib.Path(sys.argv[2])
# What every kernel and stage of ours reports beside its time.
COUNTERS = {"flops", "bytes", "share_of_peak", "share_of_bandwidth"}
NOT_OURS = ("BM_MachinePeaks", "BM_Cholmod")


def run(*command):
    return subprocess.run([str(part) for part in command], capture_output=True, text=True, timeout=300, check=False)


class RunBenchmarksTest(unittest.TestCase):
    def setUp(self):
        directory = tempfile.TemporaryDirectory()
        self.addCleanup(directory.cleanup)
        self.folder = pathlib.Path(directory.name)

    def benchmarks_of(self, program, regex="."):
        report = self.folder / "report.json"
        result = run(BUILD / "bin" / program, f"--benchmark_filter={regex}", f"--benchmark_out={report}", "--benchmark_min_time=1e-6")
        self.assertEqual(result.returncode, 0, result.stderr)
        return json.loads(report.read_text(encoding="utf-8"))["benchmarks"]

    def test_every_kernel_and_stage_runs_and_says_how_near_the_peak_it_is(self):
        for program in ("kernels_benchmark", "stages_benchmark"):
            benchmarks = self.benchmarks_of(program)
            self.assertGreater(len(benchmarks), 10)
            for benchmark in benchmarks:
                failed = benchmark.get("error_occurred", False)
                self.assertTrue(not failed or benchmark["error_message"] == "this processor lacks the instruction set", benchmark)
                self.assertTrue(failed or benchmark["name"].startswith(NOT_OURS) or benchmark.keys() >= COUNTERS, benchmark)

    def test_whole_solves_have_their_stages(self):
        for benchmark in self.benchmarks_of("phases_benchmark", "ladybug_like.*/1/"):
            self.assertNotIn("error_occurred", benchmark)
            self.assertGreater(benchmark["linear_ms"], 0.0, benchmark)

    def test_a_run_is_written_and_compared(self):
        output = self.folder / "now.json"
        result = run(sys.executable, SCRIPTS / "run_benchmarks.py", "--output", output, "--build", BUILD, "--only", "kernels",
                     "--filter", "BM_AddSquares", "--repetitions", "2", "--min_time", "0.0001")
        self.assertEqual(result.returncode, 0, result.stderr)
        report = json.loads(output.read_text(encoding="utf-8"))
        self.assertTrue(report["benchmarks"])
        result = run(sys.executable, SCRIPTS / "compare_runs.py", output, output, "--all")
        self.assertEqual(result.returncode, 0, result.stderr)
        self.assertIn("0 faster, 0 slower; only before: 0, only after: 0", result.stdout)

    def test_what_cannot_be_run_is_said(self):
        result = run(sys.executable, SCRIPTS / "run_benchmarks.py", "--output", self.folder / "now.json", "--build", self.folder)
        self.assertEqual(result.returncode, 2)
        self.assertIn("run_benchmarks.py: ", result.stderr)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
