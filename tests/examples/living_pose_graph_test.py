#!/usr/bin/env python3
"""examples/living_pose_graph as it is and with the drop-in, in each of its modes: the same end.
Arguments: the example, the drop-in."""

import os
import re
import subprocess
import sys
import unittest

PROGRAM, DROPIN = sys.argv[1:3]


def drive(*flags, mode=None):
    """(number of solves, cost, largest error); with a mode, solved by the drop-in"""
    environment = dict(os.environ)
    environment.pop("INCERES_MODE", None)
    if mode is not None:
        environment.update(LD_PRELOAD=DROPIN, INCERES_MODE=mode)
        # A drop-in with the address sanitizer comes before the sanitizer's own library.
        environment["ASAN_OPTIONS"] = (environment.get("ASAN_OPTIONS", "") +
                                       ":verify_asan_link_order=0")
    done = subprocess.run([PROGRAM, *flags], env=environment, capture_output=True, text=True,
                          timeout=300, check=True)
    if mode is not None:
        assert "the drop-in solves for Ceres" in done.stderr, done.stderr
    found = re.search(r"(\d+) solves.*\ncost ([\d.]+), largest error ([\d.]+) m", done.stdout)
    return int(found[1]), float(found[2]), float(found[3])


class LivingPoseGraphTest(unittest.TestCase):
    def test_ends_where_ceres_does(self):
        for flags in ((), ("--one_block",)):
            solves, cost, error = drive(*flags)
            self.assertGreater(solves, 20)
            self.assertLess(error, 0.2)
            for mode in ("exact", "incremental", "auto"):
                with self.subTest(flags=flags, mode=mode):
                    ours = drive(*flags, mode=mode)
                    self.assertEqual(ours[0], solves)
                    self.assertAlmostEqual(ours[1], cost, delta=1e-4 * cost)
                    self.assertAlmostEqual(ours[2], error, delta=0.01)

    def test_scalar_blocks_and_whole_ones_agree(self):
        self.assertAlmostEqual(drive()[1], drive("--one_block")[1], delta=1e-4 * drive()[1])

    def test_refuses_other_arguments(self):
        done = subprocess.run([PROGRAM, "--blocks"], capture_output=True, text=True, check=False)
        self.assertEqual(done.returncode, 2)
        self.assertIn("usage", done.stderr)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
