"""The lessons run as a reader runs them, say what they promise, and draw a picture."""

import os
import pathlib
import re
import subprocess
import sys
import tempfile
import unittest

LESSONS = pathlib.Path(__file__).resolve().parents[2] / "python" / "lessons"

try:
    import matplotlib  # noqa: F401
except ImportError:
    matplotlib = None


@unittest.skipIf(matplotlib is None, "matplotlib is not installed (Debian: python3-matplotlib)")
class LessonsTest(unittest.TestCase):
    def run_lesson(self, name, *arguments):
        with tempfile.TemporaryDirectory() as folder:
            picture = pathlib.Path(folder) / "lesson.png"
            run = subprocess.run(
                [sys.executable, LESSONS / name, *arguments, "--picture", picture],
                env={**os.environ, "MPLBACKEND": "Agg"}, cwd=folder, capture_output=True, text=True,
                check=False)
            self.assertEqual(run.returncode, 0, run.stdout + run.stderr)
            self.assertEqual(picture.read_bytes()[:8], b"\x89PNG\r\n\x1a\n")
            self.assertGreater(picture.stat().st_size, 10_000)
        return run.stdout

    def test_bundle_adjustment(self):
        said = self.run_lesson("01_bundle_adjustment.py")
        self.assertIn("16 cameras, 1200 points", said)
        self.assertEqual(len(re.findall(r"median error 0\.\d+ px", said)), 2, said)

    def test_pose_graph(self):
        said = self.run_lesson("02_pose_graph.py")
        errors = {name.strip(): float(error)
                  for name, error in re.findall(r"^(.*): ([\d.]+) m from", said, re.MULTILINE)}
        self.assertLess(errors["Cauchy's loss"], 0.5, said)
        self.assertGreater(errors["as measured"], 4 * errors["Cauchy's loss"], said)
        self.assertGreater(errors["least squares"], 4 * errors["Cauchy's loss"], said)

    def test_living_problem(self):
        said = self.run_lesson("03_living_problem.py")
        self.assertLess(max(map(float, re.findall(r"\d+e-\d+", said.splitlines()[0]))), 1e-6, said)
        self.assertLess(float(re.search(r"is ([\d.]+) m from", said)[1]), 2.0, said)
        touched, of = map(int, re.search(r"its iterations: (\d+) of (\d+)", said).groups())
        self.assertLess(touched, of, said)


if __name__ == "__main__":
    unittest.main()
