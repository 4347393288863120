#!/usr/bin/env python3
"""The scripts that measure and draw, on problems that take them a second each: each plays, and says what it cannot play.

    benchmarks_test.py REPOSITORY BUILD [TEST]...

Without names of tests runs all of them.
"""

import contextlib
import importlib
import io
import json
import os
import pathlib
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
import unittest
import xml.etree.ElementTree as ElementTree

sys.dont_write_bytecode = True
from tool_test_support import write_small_bal, write_small_pose_graph  # noqa: E402

ROOT, BUILD = (pathlib.Path(argument) for argument in sys.argv[1:3])
sys.path.insert(0, str(ROOT / "benchmarks"))

# What each script plays: its flags and a regular expression that its output matches.
PLAYED = {
    "ablation": [("--pose_graphs --only stop.share", r"\| as they are \|.*\n\| stop\.share .*\n\| stop\.share ")],
    "auto_figures": [("--times --repetitions 2 --only 'Ladybug-49, one' --keep {out}", r"auto / \w+: \*\*.*, limit 1\.05: "),
                     ("--times --repetitions 1 --only 'Ladybug-49, camera' --keep {out}", r"auto / \w+: \*\*.*, limit 1\.05: "),
                     ("--times --repetitions 1 --only intel --steps 7 --keep {out}", r"intel, pose by pose, --steps 7\n(.*\n)*auto / \w+: \*\*.*, limit 1\.05: "),
                     ("--only intel --steps 3", r"million instructions(.*\n)*auto / \w+: \*\*.*, limit 1\.03: ")],
    "beside_batch": [("{data}/pose_graph/intel.g2o --rounds 1", r"\| intel \| 13 \|")],
    "distributed_figures": 2 * [("--problems ladybug-like --rounds 1 --max_num_iterations 3 --json {out}/figures.json --keep {out}",
                                 r"\| 2 ranks / 2 threads \|")],  # the second time the problem's file is there
    # Whatever the time: not "**no**, another cost".
    "drop_in_figures": [("--repetitions 2 --frames 30 --only '1,000 features, extrinsics free' --keep {out}",
                         r"\| drop-in, exact \|.*\| (yes|\*\*no\*\*) \|")],
    "gnc_figures": [("{build}/bin/replay {data}/pose_graph/intel.g2o --living --seeds 1 --fractions 0.2", r"\| intel \| 20 % \| 3 \|"),
                    ("{build}/bin/pose_graph_solve {data}/pose_graph/intel.g2o --seeds 1 --fractions 0.2 --json {out}/runs.json",
                     r"\| intel \| 20 % \| 3 \|")],
    "golden_traces": [("--against {build} --only street", r"\A(.*: \d+ values, the same\n)+\Z")],
    "large_figures": [("--sizes 60,90 --widths 16 --steps 2 --json {out}/grid.json",
                       r"\| 60 \| 16 \|.*Cholesky.*\n\| 90 \| 16 \|.*Cholesky(.*\n)*.*faster from")],
    "live_covariance_figures": [("{data}/pose_graph/intel.g2o --repeats 1", r"\| intel \| newest pose \| 13 \|")],
    "make_incremental_pictures": [("--problem path:45 --structure_step 40 --out {out}", r"structure(.*\n)*.*work(.*\n)*.*latency")],
    "memory_figures": [("--limit 1000 --preset venice11", r"(\| Ladybug-49 \|.*\| yes \|\n){2}(.*\n)*(\| venice11 \|.*\| yes \|\n){2}"),
                       ("--limit 0.01 --preset venice11", r"\| venice11 \|.*\| \*\*no\*\* \|")],
    "pose_graph_figures": [("{data}/pose_graph/intel.g2o --repeats 1", r"\| intel \| 14, 26 \| dogleg \|(.*\n)*\| intel \| 14, 26 \| lm \|")],
    "replay_figures": [("--only 'intrinsics held' --keep {out}", r"\| our steps that failed \| 0 \| at most 0 \| yes \|"),
                       ("--only torture", r"\| steps of stock that failed \| \d+ \|")],
    "run_benchmarks": [("--output {out}/now.json --only kernels --filter BM_AddSquares --repetitions 2 --min_time 0.0001", r"\d+ runs at ")],
    "scale": [("--sizes 100,150,200 --solvers built-in,SPARSE --json {out}/scale.json --svg {out}/scale.svg",
               r"\| ours, built-in factors \| cameras\^-?\d\.\d\d \| cameras\^-?\d\.\d\d \|")],
    "startup_figures": [("--seeds 7:2 --modes exact --flags='--frames 20' --keep {out}/errors.json", r"\| exact \|.*\| as good as stock \|(.*\n)*\| exact \|.*\| as good as stock \|")],
    # As many iterations as stock, and its cost.
    "thesis_table": [("--only Cubic --repeats 2 --keep {out}", r"\| Cubic \| Cholesky \|.*\| (\d+) \| \1 \| (-|0e|\de-(0[7-9]|[1-9])).*\n\| Cubic \| PCG \|.*\| (\d+) \| \4 \| (-|0e|\de-(0[7-9]|[1-9]))")],
}
# What each refuses with exit code 2, all data being nonsense: the flags, and what its message names.
REFUSED = {
    "auto_figures": [("--times --only 'Trafalgar-21, one'", "problem-21-11315-pre.txt is missing"), ("--times --only intel", "intel.g2o"),
                     ("--times --build {out}", "{out}"), ("--times --repetitions 0", "--repetitions"), ("--repetitions 3", "--repetitions"),
                     ("--times --steps -1", "--steps")],
    "beside_batch": [("a.g2o --count --rounds 5", "--rounds")],
    "distributed_figures": [("--problems nowhere-7", "nowhere-7")],
    "drop_in_figures": [("--only 'no such figure'", ""), ("--frames 30 --build {out}", "{out}")],
    "gnc_figures": [("replay a.g2o --living --convention g2o", "--convention"), ("replay a.g2o --living --json a.json", "--json")],
    "golden_traces": [("--against {build} --only 'no such'", "")],
    "make_incremental_pictures": [("--problem path:3", "a path of 3 cameras"), ("--report {data}/no_stock.json", "--structure_step")],
    "replay_figures": [("--only fr3", "skipped, "), ("--only 'intrinsics held'", "problem-49-7776-pre.txt")],
    "run_benchmarks": [("--output {out}/now.json --build {out}", "run_benchmarks.py: ")],
    "scale": [("--build {out}", "scale.py: ")],
    "startup_figures": [("--seeds 7", "--seeds"), ("--seeds 1:0", "--seeds"), ("--modes fast", "--modes"),
                        ("--extrinsics loose", "--extrinsics"), ("--jobs 0", "--jobs"), ("--build {out}", "{out}")],
    "thesis_table": [("--only Venezia", "--only"), ("--repeats 0", "--repeats"), ("--only Cubic --build {out}", "{out}")],
}
# What is printed where something is not as asked; the exit code is then 1.
BAD = re.compile(r"\*\*(no|not|too much|another cost|differs|\d+ differ)\*\*")

PLANAR = ("M3500", "city10000", "intel", "kitti_05")
SPATIAL = ("parking-garage", "sphere")


def write_data(folder):
    """Small problems in the place of the large ones."""
    for name in ("bal", "pose_graph"):
        (folder / name).mkdir(parents=True)
    write_small_bal(folder / "bal" / "problem-49-7776-pre.txt")
    for name in PLANAR + SPATIAL:
        write_small_pose_graph(folder / "pose_graph" / f"{name}.g2o", 2 if name in PLANAR else 3)


def run(*command, **more):
    return subprocess.run([str(part) for part in command], capture_output=True, text=True, timeout=300, check=False, **more)


class Scripts(unittest.TestCase):
    """One test a script."""

    def setUp(self):
        directory = tempfile.TemporaryDirectory()
        self.addCleanup(directory.cleanup)
        self.data, self.out = pathlib.Path(directory.name, "data"), pathlib.Path(directory.name, "out")
        self.out.mkdir()
        write_data(self.data)

    def expand(self, text):
        return text.format(build=BUILD, data=self.data, out=self.out)

    def run_script(self, name, flags):
        path = ROOT / ("docs" if name.startswith("make_") else "benchmarks") / f"{name}.py"
        words = [self.expand(word) for word in shlex.split(flags)]
        build = [] if name == "gnc_figures" or "--build" in words else ["--build", BUILD]
        return run(sys.executable, path, *build, *words, env={**os.environ, "INCERES_DATA_DIR": str(self.data)})

    def check(self, name):
        for flags, pattern in PLAYED[name]:
            with self.subTest(flags=flags):
                if pattern.startswith("million instructions") and not can_count():
                    self.skipTest("no valgrind to count with")
                result = self.run_script(name, flags)
                self.assertEqual(result.stderr, "")
                self.assertIn(result.returncode, (0, 1))  # 1: not within a limit, on a machine that does other things
                if name != "large_figures":  # prints ratios alone
                    self.assertEqual(result.returncode, 1 if BAD.search(result.stdout) else 0, result.stdout)
                self.assertRegex(result.stdout, pattern)
        for written in self.out.glob("*.json"):
            self.assertTrue(json.loads(written.read_text(encoding="utf-8")), written)
        for picture in self.out.glob("*.svg"):
            self.assertGreater(len(list(ElementTree.parse(picture).iter())), 10, picture)
        shutil.rmtree(self.out)
        self.out.mkdir()
        for path in self.data.glob("*/*"):
            path.write_text("nonsense", encoding="ascii")
        (self.data / "no_stock.json").write_text('{"stock_ms": null}', encoding="ascii")
        for flags, culprit in REFUSED.get(name, []):
            with self.subTest(flags=flags):
                result = self.run_script(name, flags)
                self.assertEqual(result.returncode, 2, result.stdout + result.stderr)
                self.assertIn(self.expand(culprit), result.stdout + result.stderr)


for script in PLAYED:
    setattr(Scripts, f"test_{script}", lambda self, name=script: self.check(name))


def can_count():
    """Instructions: by valgrind, which does not go with a sanitizer."""
    return shutil.which("valgrind") is not None and "fsanitize" not in (BUILD / "CMakeCache.txt").read_text(encoding="utf-8")


class Programs(unittest.TestCase):
    """The benchmarks in C++."""

    # What every kernel and stage of ours reports beside its time.
    COUNTERS = {"flops", "bytes", "share_of_peak", "share_of_bandwidth"}
    NOT_OURS = ("BM_MachinePeaks", "BM_Cholmod")

    def benchmarks_of(self, program, regex="."):
        with tempfile.NamedTemporaryFile(suffix=".json") as report:
            result = run(BUILD / "bin" / program, f"--benchmark_filter={regex}", f"--benchmark_out={report.name}", "--benchmark_min_time=1e-6")
            self.assertEqual(result.returncode, 0, result.stderr)
            return json.load(report)["benchmarks"]

    def test_every_kernel_and_stage_runs_and_says_how_near_the_peak_it_is(self):
        for program in ("kernels_benchmark", "stages_benchmark"):
            benchmarks = self.benchmarks_of(program)
            self.assertGreater(len(benchmarks), 10)
            for benchmark in benchmarks:
                failed = benchmark.get("error_occurred", False)
                self.assertTrue(not failed or benchmark["error_message"] == "this processor lacks the instruction set", benchmark)
                self.assertTrue(failed or benchmark["name"].startswith(self.NOT_OURS) or benchmark.keys() >= self.COUNTERS, benchmark)

    def test_whole_solves_have_their_stages(self):
        for benchmark in self.benchmarks_of("phases_benchmark", "ladybug_like.*/1/"):
            self.assertNotIn("error_occurred", benchmark)
            self.assertGreater(benchmark["linear_ms"], 0.0, benchmark)


class CompareRuns(unittest.TestCase):
    """Made-up runs."""

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
        return run(sys.executable, ROOT / "benchmarks" / "compare_runs.py", *arguments)

    def test_slower_faster_and_unchanged(self):
        before = self.write("before.json", {"a": [1.0, 1.1, 1.2], "b": [2.0, 2.1, 2.2], "c": [3.0, 3.1, 3.2], "gone": [1.0]})
        after = self.write("after.json", {"a": [2.0, 2.2, 2.4], "b": [1.0, 1.05, 1.1], "c": [3.1, 3.15, 3.3], "new": [1.0]})
        result = self.compare(before, after)
        self.assertEqual(result.returncode, 1)
        self.assertIn("| a | 1.1 us | 2.2 us | 2.00 | **slower** |", result.stdout)
        self.assertIn("| b | 2.1 us | 1.05 us | 0.50 | faster |", result.stdout)
        self.assertNotIn("| c |", result.stdout)
        self.assertIn("3 compared: 1 faster, 1 slower; only before: 1, only after: 1", result.stdout)

    def test_runs_that_overlap_prove_nothing(self):
        before = self.write("before.json", {"a": [1.0, 1.1, 5.0]})
        after = self.write("after.json", {"a": [1.05, 2.2, 2.4]})
        self.assertEqual(self.compare(before, after).returncode, 0)

    def test_threshold_and_units(self):
        before = self.write("before.json", {"a": [1.0]}, "ms")
        after = self.write("after.json", {"a": [1080.0]}, "us")
        self.assertEqual(self.compare(before, after).returncode, 1)
        self.assertEqual(self.compare(before, after, "--threshold", "0.1").returncode, 0)

    def test_what_cannot_be_compared(self):
        one, broken = self.write("one.json", {"a": [1.0]}, label="Ladybug-49"), self.folder / "broken.json"
        broken.write_text("{", encoding="utf-8")
        for other in (self.write("other.json", {"b": [1.0]}), self.write("labeled.json", {"a": [9.0]}, label="generated street"), broken,
                      self.folder / "none.json"):
            result = self.compare(one, other)
            self.assertEqual(result.returncode, 2, other)
            self.assertIn("compare_runs.py: ", result.stderr)


class Laws(unittest.TestCase):
    """What the figures hang on, in functions of the scripts."""

    def test_thresholds_are_read_from_the_header(self):
        found = {name: count for name, _, count in importlib.import_module("ablation").thresholds()}
        self.assertGreater(len(found), 30)
        self.assertTrue(found["truncate.max_scalars"] and not found["stop.share"])

    def test_the_last_digit_of_golden_traces_counts_and_times_do_not(self):
        golden_traces = importlib.import_module("golden_traces")

        def compare(ours, theirs):
            with contextlib.redirect_stdout(io.StringIO()) as output:
                return golden_traces.compare("report", ours, theirs), output.getvalue()

        report = {"trace": [{"cost": 0.1, "seconds": 1.0}, {"cost": 0.3, "seconds": 2.0}], "solve_ms": {"total": 5.0}, "work": {"rows": 3}}
        other = {"trace": [{"cost": 0.1, "seconds": 9.0}, {"cost": 0.3, "seconds": 9.0}], "solve_ms": {"total": 9.0}, "work": {"rows": 3}}
        self.assertTrue(compare(report, other)[0])
        other["trace"][1]["cost"] = 0.30000000000000004
        same, text = compare(report, other)
        self.assertFalse(same)
        self.assertIn("/trace/1/cost", text)
        self.assertFalse(compare(report, {"trace": report["trace"]})[0], "less is not the same")
        self.assertFalse(compare({}, {})[0], "nothing compared")

    def test_speed_up(self):
        judge = importlib.import_module("scale").judge_speed_up
        times = {1: [1.7, 1.8, 1.7], 2: [1.0, 1.0, 2.0]}
        same = {1: [5.0, 5.0], 2: [5.0, 5.0]}
        self.assertEqual(judge(times, same, 5.0 + 1e-6), (1.7, []))
        self.assertEqual(judge(times, same, 5.1)[1], ["cost differs from the other solver's"])
        self.assertEqual(judge(times, {1: [5.0], 2: [5.0 + 1e-15]}, None)[1], ["costs differ between runs"])
        self.assertEqual(judge({1: [1.6], 2: [1.0]}, same, None), (1.6, ["slow"]))

    def test_the_readme_shows_rows_that_are_measured(self):
        readme_table = importlib.import_module("readme_table")
        rows = json.loads(readme_table.FIGURES.read_text(encoding="utf-8"))["rows"]
        measured = {row["row"] for row in rows if "row" in row}
        known = {row[0] for row in readme_table.ROWS}
        self.assertTrue(measured and measured <= known, measured)
        self.assertLessEqual(readme_table.LINEAR_LIMITS.keys(), known)
        for row in rows:
            self.assertLessEqual({"problem", "ceres_ms", "inceres_ms", "ratio", "command", "machine", "commit", "date"}, row.keys())
            self.assertAlmostEqual(row["inceres_ms"] / row["ceres_ms"], row["ratio"], delta=0.1 * row["ratio"])

    def test_the_users_functions_are_told_from_the_rest_of_a_profile(self):
        solve_costs = importlib.import_module("call_costs").solve_costs
        self.assertEqual(solve_costs(PROFILE.splitlines(True), "/p"), (300, 72))
        with self.assertRaisesRegex(ValueError, "/other"):
            solve_costs(PROFILE.splitlines(True), "/other")

    def test_shares_are_those_of_each_cost_function_counted_once(self):
        lines = ["1,000  PROGRAM TOTALS", "  900  ???:ceres::Solve(int) [x]",
                 "  400  a.cc:sliding_window::ImuFactor::Evaluate(double const* const*, double*, double**) const [x]",
                 "  100  a.cc:sliding_window::ImuFactor::Evaluate(double const* const*, double*, double**) const [x]",
                 "   50  b.cc:sliding_window::PoseError::Evaluate(double const* const*, double*, double**) const [x]",
                 "   70  b.cc:inceres::internal::Evaluator::Evaluate(int) [x]"]
        self.assertEqual(importlib.import_module("user_share").shares(lines),
                         (1000, {"sliding_window::ImuFactor": 400, "sliding_window::PoseError": 50}))


# Program /p calls ceres::Solve of /d (300), which calls /p's cost function (40, 2) and the copy of a template in /p (5), and stock's
# ceres::Solve in /c (100), which calls the cost function too (30). The program itself calls the cost function once (7).
PROFILE = """# callgrind format
events: Ir
ob=(1) /p
fn=(1) main
10 1
cob=(2) /d
cfn=(2) ceres::Solve(ceres::Solver::Options const&, ceres::Problem*, ceres::Solver::Summary*)
calls=3 0
11 300
cfn=(3) user::Cost::Evaluate(double const* const*, double*, double**) const
calls=1 5
* 7
fn=(3)
5 20
ob=(2)
fn=(2)
0 50
cob=(1)
cfn=(3)
calls=4 5
+1 40
cob=(1)
cfn=(3)
calls=1 5
+1 2
cob=(1)
cfn=(4) std::vector<int, std::allocator<int> >::push_back(int const&)
calls=1 5
+1 5
cob=(3) /c
cfn=(5) ceres::Solve(ceres::Solver::Options const&, ceres::Problem*, ceres::Solver::Summary*)
calls=1 0
* 100
ob=(3)
fn=(5)
0 70
cob=(1)
cfn=(3)
calls=1 5
* 30
"""


if __name__ == "__main__":
    unittest.main(argv=[sys.argv[0], *sys.argv[3:]])
