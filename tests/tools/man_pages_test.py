#!/usr/bin/env python3
"""The man pages of the tools: made by help2man, they have their sections and groff has nothing to
warn of. Arguments: the script that makes one, the tools. Exit code 77, which CTest reports as
skipped, without help2man or groff."""

import pathlib
import shutil
import subprocess
import sys
import tempfile
import unittest

SCRIPT, *TOOLS = sys.argv[1:]
NEEDED = {name: shutil.which(name) for name in ("help2man", "groff", "cmake")}


class ManPagesTest(unittest.TestCase):
    def setUp(self):
        directory = tempfile.TemporaryDirectory()
        self.addCleanup(directory.cleanup)
        self.page = pathlib.Path(directory.name) / "page.1"

    def make(self, tool):
        subprocess.run([NEEDED["cmake"], "-D", f"HELP2MAN={NEEDED['help2man']}", "-D",
                        f"TOOL={tool}", "-D", f"OUTPUT={self.page}", "-P",
                        SCRIPT], check=True, timeout=60)

    def groff(self):
        """(text, warnings) of the page as man shows it."""
        done = subprocess.run([NEEDED["groff"], "-man", "-ww", "-rHY=0", "-Tascii", "-P-cbou",
                               self.page], capture_output=True, text=True, timeout=60,
                              check=True)
        return done.stdout, done.stderr

    def test_pages_render_without_warnings(self):
        for tool in TOOLS:
            self.make(tool)
            text, warnings = self.groff()
            self.assertEqual(warnings, "", tool)
            lines = text.splitlines()
            for section in ("NAME", "SYNOPSIS", "DESCRIPTION", "OPTIONS", "EXAMPLES", "EXIT CODES"):
                self.assertIn(section, lines, tool)
            name = pathlib.Path(tool).name
            summary = subprocess.run([tool, "--help"], capture_output=True, text=True, timeout=60,
                                     check=True).stdout.splitlines()[1]
            words = " ".join(text.split())
            self.assertIn(f"NAME {name} - {summary.rstrip('.')} SYNOPSIS {name} [OPTION]...", words)

    def test_examples_keep_their_lines(self):
        for tool in TOOLS:
            self.make(tool)
            shown = [line.strip() for line in self.groff()[0].splitlines()]
            text = subprocess.run([tool, "--help"], capture_output=True, text=True, timeout=60,
                                  check=True).stdout
            commands = text.partition("Examples:\n")[2].partition("\nOptions:")[0].splitlines()
            for line in filter(None, map(str.strip, commands)):
                if line.startswith(("#", pathlib.Path(tool).name)):
                    self.assertIn(line, shown, tool)

    def test_a_program_without_such_help_is_refused(self):
        done = subprocess.run([NEEDED["cmake"], "-D", f"HELP2MAN={NEEDED['help2man']}", "-D",
                               "TOOL=/bin/true", "-D", f"OUTPUT={self.page}",
                               "-P", SCRIPT], capture_output=True, text=True, timeout=60,
                              check=False)
        self.assertNotEqual(done.returncode, 0)
        self.assertIn("line of usage", done.stderr)
        self.assertFalse(self.page.exists())


if __name__ == "__main__":
    missing = [name for name, path in NEEDED.items() if path is None]
    if missing:
        print(f"SKIPPED: no {', '.join(missing)} on the PATH (tools/install_packages.sh)")
        sys.exit(77)
    unittest.main(argv=sys.argv[:1])
