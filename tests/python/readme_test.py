"""What the README says of Python runs: its block, on the bundled street in place of Ladybug-49."""

import pathlib
import re
import shutil
import subprocess
import sys
import tempfile
import unittest

from scene import STREET

ROOT = pathlib.Path(__file__).resolve().parents[2]


class ReadmeTest(unittest.TestCase):
    def test_block_runs(self):
        text = (ROOT / "README.md").read_text(encoding="utf-8")
        block = re.search(r"<!-- newcomer: python -->\n```python\n(.*?)```", text, re.DOTALL)
        self.assertIsNotNone(block, "README.md has no block of Python")
        name = re.search(r'read_bal\("([^"]+)"\)', block[1])
        self.assertIsNotNone(name, block[1])
        with tempfile.TemporaryDirectory() as folder:
            shutil.copy(STREET, pathlib.Path(folder) / name[1])
            done = subprocess.run([sys.executable, "-c", block[1]], cwd=folder, text=True,
                                  capture_output=True, timeout=300, check=False)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertIn(", 3)", done.stdout)


if __name__ == "__main__":
    unittest.main()
