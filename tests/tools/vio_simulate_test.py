#!/usr/bin/env python3
"""vio_simulate as a user runs it. Argument: the executable."""

import collections
import gzip
import os
import sys
import tempfile
import unittest

from tool_test_support import run

TOOL = sys.argv[1]


def read(path):
    """The bytes of a file, decompressed."""
    with (gzip.open if path.endswith(".gz") else open)(path, "rb") as file:
        return file.read()


def count(path):
    """How many records of each tag a file has."""
    return collections.Counter(line.split()[0] for line in read(path).decode().splitlines() if not line.startswith("#"))


class VioSimulateTest(unittest.TestCase):
    def setUp(self):
        self.directory = tempfile.TemporaryDirectory()
        self.addCleanup(self.directory.cleanup)

    def file(self, name):
        return os.path.join(self.directory.name, name)

    def test_cubic(self):
        output, _ = run(TOOL, "--preset", "cubic", "--output", self.file("cubic.vio"))
        self.assertIn("IMU factors   49, of 51 samples each\npoints        163\nobservations  789, of them 0 outliers\n", output)
        records = count(self.file("cubic.vio"))
        self.assertEqual((records["FRAME"], records["POINT"], records["OBS"], records["IMU"]), (50, 163, 789, 49 * 50 + 1))

    def test_flags_take_precedence_and_seeds_matter(self):
        outputs = {}
        for name, flags in {"a.vio": [], "b.vio": ["--seed", "2"], "a.vio.gz": []}.items():
            run(TOOL, "--preset", "cubic", "--frames", "40", "--points", "100", "--observations", "400", *flags, "--output", self.file(name))
            outputs[name] = read(self.file(name))
        self.assertEqual(outputs["a.vio"], outputs["a.vio.gz"])
        self.assertNotEqual(outputs["a.vio"], outputs["b.vio"])
        records = count(self.file("a.vio"))
        self.assertEqual((records["FRAME"], records["POINT"], records["OBS"]), (40, 100, 400))

    def test_every_flag_does_something(self):
        plain = ["--frames", "150", "--points", "60", "--imu_per_frame", "2"]
        run(TOOL, *plain, "--output", self.file("plain.vio"))
        reference = read(self.file("plain.vio"))
        others = {
            "trajectory": "ellipse", "radius": 6, "height": 1, "period": 12, "standing_start": 1, "stop_every": 2,
            "frame_rate": 8, "observations": 300, "max_track_length": 5, "max_depth": 9, "loop_fraction": 0.9,
            "dropout": 0.2, "pixel_noise": 2, "outlier_fraction": 0.1, "gyr_noise": 1e-3, "acc_noise": 1e-2,
            "gyr_bias_walk": 1e-3, "acc_bias_walk": 1e-2, "initial_gyr_bias": 0.1, "initial_acc_bias": 0.1,
            "position_drift": 0.1, "rotation_drift": 0.1, "point_noise": 0.3, "seed": 7,
        }
        for flag, value in others.items():
            run(TOOL, *plain, f"--{flag}", value, "--output", self.file("other.vio"))
            self.assertNotEqual(read(self.file("other.vio")), reference, flag)
        for base, flag, value in ((["--stop_every", "2"], "stop_duration", 3), (["--outlier_fraction", "0.1"], "outlier_pixels", 9)):
            run(TOOL, *plain, *base, "--output", self.file("base.vio"))
            run(TOOL, *plain, *base, f"--{flag}", value, "--output", self.file("other.vio"))
            self.assertNotEqual(read(self.file("other.vio")), read(self.file("base.vio")), flag)
        output, _ = run(TOOL, "--help")
        for flag in ("output", "preset", *plain[::2], *others, "stop_duration", "outlier_pixels"):
            self.assertIn(f"--{flag.lstrip('-')} ", output)

    def test_failures(self):
        out = ["--output", self.file("x.vio")]
        for code, message, flags in (
            (2, "--output FILE is required", ["--preset", "cubic"]),
            (2, "no preset 'atlantis'; known are cubic, figure_eight, ellipse", ["--preset", "atlantis", *out]),
            (2, "no trajectory 'square'; known are circle, figure_eight, ellipse", ["--trajectory", "square", *out]),
            (2, "num_frames is 1, not between 2 and 1000000", ["--frames", "1", *out]),
            (2, "dropout is 2, not between 0 and 0.95", ["--dropout", "2", *out]),
            (2, "fewer than two per point", ["--observations", "10", *out]),
            (2, "observations of the 1000000 asked for", ["--observations", "1000000", *out]),
            (2, "surplus argument 'extra'", [*out, "extra"]),
            (1, "No such file or directory", ["--output", self.file("no/such/x.vio")]),
        ):
            _, error = run(TOOL, *flags, code=code)
            self.assertIn(message, error)
        self.assertFalse(os.path.exists(self.file("x.vio")))


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
