#!/usr/bin/env python3
"""What scripts that measure pose graphs make of their flags and of reports; nothing is played. Argument: the folder of the scripts."""

import pathlib
import subprocess
import sys
import tempfile
import unittest

SCRIPTS = pathlib.Path(sys.argv[1])
sys.path.insert(0, str(SCRIPTS))
sys.dont_write_bytecode = True
import pose_graph_figures  # noqa: E402

# In the place of replay: keeps its arguments.
REPLAY = """#!/usr/bin/env python3
import json, pathlib, sys
pathlib.Path(__file__).with_suffix(".log").open("a").write(" ".join(sys.argv) + "\\n")
work = {"num_wrong": 3, "num_wrong_found": 2, "num_right_lost": 1}
report = {"rows": [{"ours": {"processor_ms": 2.0, "work": work}}]}
pathlib.Path(sys.argv[sys.argv.index("--json") + 1]).write_text(json.dumps(report))
"""


def run(script, *flags, code=0):
    result = subprocess.run([sys.executable, SCRIPTS / script, *map(str, flags)], capture_output=True, text=True, timeout=300,
                            check=False)
    if result.returncode != code:
        raise AssertionError(f"{script} {flags}: exit code {result.returncode}, not {code}\n{result.stderr}")
    return result.stdout + result.stderr


class FiguresScriptsTest(unittest.TestCase):
    def test_a_pose_graph_has_as_many_poses_and_edges_as_its_description_says(self):
        runs = [{"solver": solver, "iterations": 5, "seconds": {"median": 0.5}} for solver in ("inceres", "ceres")]
        report = {"runs": runs, "description": "3500 poses in 2D, 5453 edges", "relative_cost_difference": 0.0,
                  "ratio_to_best_stock": {"median": 1.0, "min": 1.0, "max": 1.0}}
        line, same = pose_graph_figures.row(pathlib.Path("M3500.g2o"), "lm", report)
        self.assertIn("| M3500 | 3500, 5453 | lm |", line)
        self.assertTrue(same)

    def test_a_living_graph_is_played_with_the_flags_asked_for(self):
        with tempfile.TemporaryDirectory() as folder:
            replay = pathlib.Path(folder) / "replay.py"
            replay.write_text(REPLAY, encoding="utf-8")
            replay.chmod(0o755)
            output = run("gnc_figures.py", replay, "a.g2o", "--living", "--seeds", 1, "--fractions", 0.2, "--flags=--trust_region lm")
            played = replay.with_suffix(".log").read_text(encoding="utf-8").splitlines()
        self.assertIn("| a | 20 % | 3 | 0 of 1 | 1 | 1 | 1.00 (1.00) | 1.00 (1.00) |", output)
        self.assertEqual(len(played), 3)
        self.assertTrue(all("--trust_region lm" in line for line in played), played)

    def test_flags_that_change_nothing_are_refused(self):
        for script, flags in (("gnc_figures.py", ["replay", "a.g2o", "--living", "--convention", "g2o"]),
                              ("gnc_figures.py", ["replay", "a.g2o", "--living", "--json", "a.json"]),
                              ("beside_batch.py", ["a.g2o", "--count", "--rounds", "5"])):
            self.assertIn(flags[-2], run(script, *flags, code=2))


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
