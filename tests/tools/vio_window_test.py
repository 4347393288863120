#!/usr/bin/env python3
"""The example vio_window and the script that plots it, as a user runs them. Arguments: vio_window, vio_simulate, the source directory."""

import pathlib
import re
import subprocess
import sys
import tempfile
import unittest
import xml.etree.ElementTree as ElementTree

WINDOW, SIMULATE = sys.argv[1:3]
SOURCE = pathlib.Path(sys.argv[3])


def run(*command):
    return subprocess.run([str(word) for word in command], check=False, capture_output=True, text=True)


def number(pattern, words):
    return float(re.search(pattern, words).group(1))


class VioWindowTest(unittest.TestCase):
    def setUp(self):
        directory = tempfile.TemporaryDirectory()
        self.addCleanup(directory.cleanup)
        self.folder = pathlib.Path(directory.name)

    def test_from_samples_to_a_plot(self):
        sequence, csv, svg = (self.folder / name for name in ("circle.vio", "circle.csv", "circle.svg"))
        self.assertEqual(run(SIMULATE, "--frames", "60", "--points", "200", "--output", sequence).returncode, 0)
        done = run(WINDOW, sequence, csv)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertIn("frames         59", done.stdout)
        self.assertLess(number(r"ATE +(\S+) m", done.stdout), 0.15)
        self.assertLess(number(r"RPE, 1 frame +(\S+) m", done.stdout), 0.02)
        self.assertLess(number(r"RPE, 1 m +\S+ m, (\S+) deg", done.stdout), 0.5)
        self.assertEqual(len(csv.read_text(encoding="utf-8").splitlines()), 60)
        drawn = run(sys.executable, SOURCE / "examples" / "plot_vio_window.py", csv)
        self.assertEqual(drawn.returncode, 0, drawn.stderr)
        lines = list(ElementTree.parse(svg).getroot().iter("{http://www.w3.org/2000/svg}polyline"))
        self.assertEqual([len(line.get("points").split()) for line in lines], [59, 59, 59])

    def test_presets(self):
        done = run(WINDOW, "cubic")
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertLess(number(r"ATE +(\S+) m", done.stdout), 0.3)

    def test_errors_are_told(self):
        self.assertEqual(run(WINDOW).returncode, 2)
        missing = run(WINDOW, self.folder / "missing.vio")
        self.assertEqual(missing.returncode, 1)
        self.assertIn("missing.vio", missing.stderr)
        self.assertEqual(run(WINDOW, "cubic", self.folder / "no" / "folder.csv").returncode, 1)
        wrong = self.folder / "wrong.csv"
        wrong.write_text("a,b\n1,2\n3,4\n", encoding="utf-8")
        drawn = run(sys.executable, SOURCE / "examples" / "plot_vio_window.py", wrong)
        self.assertEqual(drawn.returncode, 1)
        self.assertIn("not a trajectory of vio_window", drawn.stderr)

    def test_the_picture_of_the_consistency(self):
        report = self.folder / "report.json"
        curve = '{"name": "%s", "rms": 0.1, "nees": [6, 7, 5.5]}'
        report.write_text('{"runs": 5, "frames": 9, "size": 10, "rule": "okvis", "band": 3.0, "times": [0.2, 0.4, 0.6], '
                          + ", ".join(f'"{key}": ' + curve % key for key in ("with", "without", "exact")) + "}", encoding="utf-8")
        drawn = run(sys.executable, SOURCE / "docs" / "make_window_pictures.py", "--report", report, "--out", self.folder)
        self.assertEqual(drawn.returncode, 0, drawn.stderr)
        picture = ElementTree.parse(self.folder / "window_consistency.svg").getroot()
        self.assertEqual(len(list(picture.iter("{http://www.w3.org/2000/svg}polyline"))), 3)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
