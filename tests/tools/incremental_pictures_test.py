#!/usr/bin/env python3
"""The pictures of docs/incremental.md can be drawn. Arguments: make_incremental_pictures.py, the build directory."""

import json
import pathlib
import subprocess
import sys
import tempfile
import unittest
import xml.etree.ElementTree as ElementTree

SCRIPT, BUILD = sys.argv[1:3]
NAMES = ("structure", "work", "latency")


class IncrementalPicturesTest(unittest.TestCase):
    def setUp(self):
        directory = tempfile.TemporaryDirectory()
        self.addCleanup(directory.cleanup)
        self.out = pathlib.Path(directory.name)

    def draw(self, *flags):
        return subprocess.run([sys.executable, SCRIPT, "--build", BUILD, "--out", self.out, *flags], check=False, capture_output=True,
                              text=True)

    def picture(self, name):
        return ElementTree.parse(self.out / f"incremental_{name}.svg").getroot()

    def words(self, name):
        return " ".join("".join(element.itertext()) for element in self.picture(name).iter("{http://www.w3.org/2000/svg}text"))

    def test_from_a_replay(self):
        done = self.draw("--problem", "path:45", "--structure_step", "40")
        self.assertEqual(done.returncode, 0, done.stderr)
        for name in NAMES:
            self.assertIn("path:45", self.words(name))
            self.assertLess((self.out / f"incremental_{name}.svg").stat().st_size, 200_000)
        self.assertIn("after step 40", self.words("structure"))
        lines = list(self.picture("work").iter("{http://www.w3.org/2000/svg}polyline"))
        self.assertEqual(len(lines), 6)
        self.assertTrue(all(len(line.get("points").split()) == 44 for line in lines))

    def test_from_a_report(self):
        work = dict.fromkeys(("visited_landmarks", "eliminated_landmarks", "evaluated_factors", "relinearised_factors"), 0)
        side = {"ms": 2.0, "iterations": 3, "work": work}
        report = {"problem": "a & b", "threads": 2, "ours": "we", "stock": "they", "ours_ms": {"median": 2.0},
                  "stock_ms": {"median": 2.0},
                  "rows": [{"step": step, "landmarks": 5, "factors": 9, "ours": side, "stock": side} for step in (1, 2, 3)],
                  "structure": {"step": 2, "frames": [0, -1, 4, 5], "blocks": [[2, 0], [3, 0], [3, 2]], "changed_rows": [2, 3]}}
        path = self.out / "report.json"
        path.write_text(json.dumps(report), encoding="utf-8")
        done = self.draw("--report", path)
        self.assertEqual(done.returncode, 0, done.stderr)
        # Three diagonal blocks and three others; those of rows 2 and 3 changed: two on the diagonal, one off it.
        self.assertIn("6 blocks in the lower triangle", self.words("structure"))
        self.assertIn("2 block rows, at most 3 blocks (50 %)", self.words("structure"))
        self.assertIn("a & b", self.words("latency"))

    def test_what_cannot_be_drawn(self):
        self.assertEqual(self.draw("--problem", "path:3").returncode, 2)
        path = self.out / "report.json"
        path.write_text('{"stock_ms": null}', encoding="utf-8")
        done = self.draw("--report", path)
        self.assertEqual(done.returncode, 2)
        self.assertIn("--structure_step", done.stderr)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
