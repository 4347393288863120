"""The code of docs/python.md runs, block after block, and prints what the page says it prints."""

import contextlib
import io
import os
import pathlib
import re
import shutil
import tempfile
import unittest

from scene import STREET

PAGE = pathlib.Path(__file__).resolve().parents[2] / "docs" / "python.md"


class DocumentTest(unittest.TestCase):
    def test_its_code_runs(self):
        text = PAGE.read_text(encoding="utf-8")
        blocks = re.findall(r"^```python\n(.*?)^```$", text, re.DOTALL | re.MULTILINE)
        self.assertGreater(len(blocks), 6)
        self.addCleanup(os.chdir, os.getcwd())
        with tempfile.TemporaryDirectory() as folder:
            shutil.copy(STREET, folder)
            os.chdir(folder)
            names = {"__name__": "page"}
            for number, block in enumerate(blocks):
                with self.subTest(block=number), contextlib.redirect_stdout(io.StringIO()) as said:
                    exec(compile(block, f"{PAGE.name}, block {number}", "exec"), names)
                for line in re.findall(r"print\(.*\)  # (.*)$", block, re.MULTILINE):
                    self.assertIn(line, said.getvalue(), f"block {number}")
            os.chdir("/")


if __name__ == "__main__":
    unittest.main()
