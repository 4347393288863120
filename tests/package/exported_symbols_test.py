#!/usr/bin/env python3
"""Tests tools/abi/exported_symbols.py on small libraries: what it takes for a broken promise, and
what for news.

    exported_symbols_test.py COMPILER
"""

import pathlib
import subprocess
import sys
import tempfile
import unittest

SCRIPT = pathlib.Path(__file__).resolve().parents[2] / "tools/abi/exported_symbols.py"
COMPILER = sys.argv.pop()


class ExportedSymbolsTest(unittest.TestCase):
    def setUp(self):
        temporary = tempfile.TemporaryDirectory()
        self.addCleanup(temporary.cleanup)
        self.folder = pathlib.Path(temporary.name)

    def run_script(self, action, source, release="0.1.0", soversion="0.1"):
        """Exit code and messages of an action on a library made of source."""
        library = self.folder / "libsample.so"
        subprocess.run(
            [COMPILER, "-shared", "-fPIC", "-x", "c++", "-", "-o", library,
             f"-Wl,-soname,libsample.so.{soversion}"],
            input=source, text=True, check=True)
        done = subprocess.run(
            [sys.executable, SCRIPT, action, library, "--lists", self.folder, "--release", release],
            capture_output=True, text=True, check=False)
        return done.returncode, done.stderr

    def update(self, *arguments, **named):
        self.assertEqual(self.run_script("update", *arguments, **named), (0, ""))

    def test_the_same_library_agrees_with_its_list(self):
        self.update("int First() { return 1; }")
        self.assertEqual(self.run_script("check", "int First() { return 2; }"), (0, ""))

    def test_a_released_symbol_that_is_gone_is_a_broken_promise(self):
        self.update("void First() {} void Second(int) {}")
        code, messages = self.run_script("check", "void First() {}", release="0.1.1")
        self.assertEqual(code, 1)
        self.assertIn("Second(int) is gone, which release 0.1.0 had", messages)
        code, messages = self.run_script("update", "void First() {}", release="0.1.1")
        self.assertEqual(code, 1)
        self.assertIn("Second(int) is gone", messages)

    def test_another_type_of_argument_is_another_symbol(self):
        self.update("void First(int) {}")
        code, messages = self.run_script("check", "void First(long) {}", release="0.1.1")
        self.assertEqual(code, 1)
        self.assertIn("First(int) is gone", messages)
        self.assertIn("First(long) is exported and not on the list", messages)

    def test_it_may_go_with_the_soname(self):
        self.update("void First() {} void Second() {}")
        later = {"release": "0.2.0", "soversion": "0.2"}
        code, messages = self.run_script("check", "void First() {}", **later)
        self.assertEqual(code, 1)
        self.assertIn("is of libsample.so.0.1, the library is libsample.so.0.2", messages)
        self.update("void First() {}", **later)
        self.assertEqual(self.run_script("check", "void First() {}", **later), (0, ""))

    def test_before_its_release_a_symbol_may_go(self):
        self.update("void First() {} void Second() {}")
        code, messages = self.run_script("check", "void First() {}")
        self.assertEqual(code, 1)
        self.assertIn("Second() is on the list and not exported", messages)
        self.update("void First() {}")
        self.assertEqual(self.run_script("check", "void First() {}"), (0, ""))

    def test_a_symbol_keeps_the_release_it_came_in(self):
        self.update("void First() {}")
        self.update("void First() {} void Second() {}", release="0.1.1")
        lines = (self.folder / "libsample.symbols").read_text(encoding="utf-8").splitlines()
        self.assertEqual(lines[2:], ["_Z5Firstv 0.1.0", "_Z6Secondv 0.1.1"])

    def test_what_is_no_library_is_named(self):
        done = subprocess.run([sys.executable, SCRIPT, "check", "missing.so"],
                              capture_output=True, text=True, check=False)
        self.assertEqual(done.returncode, 1)
        self.assertIn("missing.so does not exist", done.stderr)


if __name__ == "__main__":
    unittest.main()
