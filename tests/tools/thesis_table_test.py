#!/usr/bin/env python3
"""benchmarks/thesis_table.py on Cubic, and its verdicts on made-up reports. Arguments: the script, the build directory."""

import importlib
import json
import pathlib
import subprocess
import sys
import tempfile
import unittest

SCRIPT, BUILD = (pathlib.Path(argument) for argument in sys.argv[1:3])
sys.path.insert(0, str(SCRIPT.parent))
script = importlib.import_module(SCRIPT.stem)


def run(*flags, build=BUILD):
    return subprocess.run([sys.executable, SCRIPT, "--build", build, *map(str, flags)], capture_output=True, text=True, check=False)


def rows(output):
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in output.splitlines()[2:]]


class Played(unittest.TestCase):
    def test_cubic(self):
        with tempfile.TemporaryDirectory() as folder:
            result = run("--only", "Cubic", "--repeats", 2, "--keep", folder)
            self.assertIn(result.returncode, (0, 1), result.stderr)
            reports = [json.loads(path.read_text(encoding="utf-8")) for path in sorted(pathlib.Path(folder).iterdir())]
        table = rows(result.stdout)
        self.assertEqual([row[1] for row in table], [solver[0] for solver in script.SOLVERS])
        for row, report in zip(table, reports):
            medians = {entry["configuration"]: entry["seconds"]["median"] for entry in report["runs"][1:]}
            self.assertEqual(set(medians), set(script.STOCK), "none is dropped")
            ratio = report["runs"][0]["seconds"]["median"] / min(medians[name] for name in script.SPARSE)
            self.assertEqual(row[4], f"**{ratio:.3f}**")
            self.assertEqual(row[9], row[10], "as many iterations as stock")
            self.assertLess(float(row[11]), 1e-6)

    def test_what_cannot_be_run(self):
        self.assertEqual(run("--only", "Venezia").returncode, 2)
        self.assertEqual(run("--repeats", 0).returncode, 2)
        with tempfile.TemporaryDirectory() as empty:
            result = run("--only", "Cubic", build=empty)
            self.assertEqual(result.returncode, 2)
            self.assertIn(empty, result.stderr)


class Verdicts(unittest.TestCase):
    """Made-up reports: stock's SPARSE_SCHUR takes 10 ms, its fastest 8."""

    def judge(self, ours_ms=3.9, iterations=7, excess=0.0, limits=(0.45, 0.50)):
        stock = {"dense_schur": 8.0, "dense_schur_points_first": 20.0, "sparse_schur": 11.0, "sparse_schur_points_first": 10.0}
        runs = [{"solver": "inceres", "configuration": "auto", "seconds": {"median": 1e-3 * ours_ms}, "iterations": iterations}]
        runs += [{"solver": "ceres", "configuration": name, "seconds": {"median": 1e-3 * ms}, "iterations": 7} for name, ms in stock.items()]
        return script.judge({"runs": runs, "relative_cost_difference": excess}, *limits)

    def test_as_asked(self):
        cells, fine = self.judge()
        self.assertTrue(fine)
        self.assertEqual(cells[1:7], ["10 (sparse_schur_points_first)", "**0.390**", "0.45", "8 (dense_schur)", "**0.487**", "0.50"])
        self.assertEqual(cells[-1], "yes")

    def test_not_as_asked(self):
        for change in ({"ours_ms": 4.1}, {"iterations": 8}, {"excess": 2e-6}, {"limits": (0.38, 0.50)}):
            cells, fine = self.judge(**change)
            self.assertFalse(fine, change)
            self.assertEqual(cells[-1], "**no**")

    def test_nothing_asked(self):
        cells, fine = self.judge(ours_ms=30.0, limits=(None, None))
        self.assertTrue(fine)
        self.assertEqual((cells[3], cells[6], cells[-1]), ("", "", ""))


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
