#!/usr/bin/env python3
"""cmake --install --component tools: the tools run where they are put, each with its man page where
there is help2man, below DESTDIR as well. Arguments: the build directory, the tools that it
installs."""

import pathlib
import os
import shutil
import subprocess
import sys
import tempfile
import unittest

BUILD, *TOOLS = sys.argv[1:]


class InstallToolsTest(unittest.TestCase):
    def setUp(self):
        directory = tempfile.TemporaryDirectory()
        self.addCleanup(directory.cleanup)
        self.folder = pathlib.Path(directory.name)

    def install(self, prefix, **environment):
        subprocess.run(["cmake", "--install", BUILD, "--component", "tools", "--prefix", prefix],
                       env={**os.environ, **environment},
                       check=True, capture_output=True, timeout=120)

    def check(self, prefix):
        for tool in [*TOOLS, "ab_report"]:
            done = subprocess.run([prefix / "bin" / tool, "--version"], capture_output=True,
                                  text=True, timeout=60, check=True)
            self.assertTrue(done.stdout.startswith(f"{tool} (inceres) "), done.stdout)
            if shutil.which("help2man"):
                self.assertTrue((prefix / "share/man/man1" / f"{tool}.1").exists(), tool)
        self.assertFalse((prefix / "share/inceres/ab_page/__pycache__").exists())

    def test_below_a_prefix(self):
        self.install(self.folder / "prefix")
        self.check(self.folder / "prefix")

    def test_below_destdir(self):
        self.install("/opt/somewhere", DESTDIR=str(self.folder / "stage"))
        moved = self.folder / "moved"  # a package is unpacked elsewhere than it was staged
        (self.folder / "stage/opt/somewhere").rename(moved)
        self.check(moved)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
