#!/usr/bin/env python3
"""What vins_window and okvis_map say of themselves, and which numbers they take. Arguments: the executables."""

import pathlib
import subprocess
import sys
import unittest

PROGRAMS = {pathlib.Path(path).name: path for path in sys.argv[1:]}


def run(name, *flags):
    return subprocess.run([PROGRAMS[name], *flags], capture_output=True, text=True, timeout=300, check=False)


class SlidingWindowProgramsTest(unittest.TestCase):
    def test_each_describes_its_own_scene(self):
        for name, own, of_the_other in (("vins_window", "There is one camera", "two cameras"),
                                        ("okvis_map", "two cameras", "one camera")):
            text = " ".join(run(name, "--help").stdout.split())
            self.assertIn(own, text)
            self.assertNotIn(of_the_other, text)

    def test_a_seed_is_taken_as_it_is_or_refused(self):
        for name in PROGRAMS:
            for seed in ("-1", "99999999999999999999"):
                result = run(name, "--frames", "20", "--seed", seed)
                self.assertEqual((result.returncode, result.stdout), (2, ""))
                self.assertIn("--seed", result.stderr)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
