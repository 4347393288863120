#!/usr/bin/env python3
"""Jets under several compilers and every optimization level: no warnings, and the same bits.

    compilers_test.py SOURCE_DIR COMPILER…

A compiler that is not installed is left out, and said so.
"""

import pathlib
import platform
import shutil
import subprocess
import sys
import tempfile
import unittest

WARNINGS = ["-Wall", "-Wextra", "-Wpsabi", "-Wshadow", "-Wconversion", "-Wno-sign-conversion", "-Werror"]
LEVELS = ["-O0", "-O1", "-O2", "-O3", "-Os"]
V3 = ["-march=x86-64-v3"]
NO_FMA = ["-ffp-contract=off"]
ARM64 = "aarch64-linux-gnu-g++"
EMULATOR = "qemu-aarch64"
SOURCE_DIR = pathlib.Path(".")
COMPILERS = []


class CompilersTest(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)

    def compile(self, compiler, *flags):
        """The program so compiled."""
        program = self.folder / "same_bits"
        subprocess.run([compiler, "-std=c++17", *WARNINGS, *flags, "-I", SOURCE_DIR / "include",
                        SOURCE_DIR / "tests/autodiff/compilers/same_bits.cc", "-o", program], check=True)
        return program

    def bits(self, compiler, *flags):
        """What the program prints, compiled so."""
        program = self.compile(compiler, *flags)
        return subprocess.run([program], check=True, capture_output=True, text=True).stdout.strip()

    def test_no_warnings_and_the_same_bits_at_every_level(self):
        for compiler in COMPILERS:
            expected = self.bits(compiler, "-O1", *NO_FMA)
            for level in LEVELS:
                with self.subTest(compiler=compiler, level=level):
                    self.assertEqual(self.bits(compiler, level, *NO_FMA), expected)

    def test_compilers_agree(self):
        found = {self.bits(compiler, "-O2", *NO_FMA) for compiler in COMPILERS}
        self.assertEqual(len(found), 1)

    def test_inlining_changes_no_bits(self):
        for compiler in COMPILERS:
            with self.subTest(compiler=compiler):
                self.assertEqual(self.bits(compiler, "-O2", *NO_FMA, "-DINCERES_AUTODIFF_FLATTEN="),
                                 self.bits(compiler, "-O2", *NO_FMA))

    @unittest.skipUnless(shutil.which(ARM64) and shutil.which(EMULATOR), f"{ARM64} and {EMULATOR} are not installed")
    def test_arm64_has_the_same_bits(self):
        for level in ("-O0", "-O2", "-O3"):
            with self.subTest(level=level):
                program = self.compile(ARM64, level, *NO_FMA, "-static")
                output = subprocess.run([EMULATOR, program], check=True, capture_output=True, text=True).stdout.strip()
                self.assertEqual(output, self.bits(COMPILERS[0], "-O2", *NO_FMA))

    @unittest.skipUnless(platform.machine() == "x86_64", "a switch of x86-64")
    def test_fused_operations_are_what_newer_instructions_change_and_can_be_switched_off(self):
        if " fma " not in pathlib.Path("/proc/cpuinfo").read_text(encoding="utf-8"):
            self.skipTest("this processor has no FMA")
        for compiler in COMPILERS:
            with self.subTest(compiler=compiler):
                baseline = self.bits(compiler, "-O3", *NO_FMA)
                self.assertEqual(self.bits(compiler, "-O3", *V3, *NO_FMA), baseline)
                self.assertNotEqual(self.bits(compiler, "-O3", *V3, "-ffp-contract=fast"), baseline)


if __name__ == "__main__":
    SOURCE_DIR = pathlib.Path(sys.argv[1]).resolve()
    for name in sys.argv[2:]:
        if shutil.which(name):
            COMPILERS.append(name)
        else:
            print(f"{name} is not installed: left out")
    if not COMPILERS:
        sys.exit("no compiler to test with")
    unittest.main(argv=sys.argv[:1])
