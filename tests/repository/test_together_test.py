#!/usr/bin/env python3
"""tools/test_together.py: what runs in one process, what is left to ctest, and that nothing that fails goes unseen.

    test_together_test.py REPOSITORY
"""

import pathlib
import sys
import tempfile
import unittest
import unittest.mock

SOURCE = pathlib.Path(sys.argv.pop(1)).resolve() if len(sys.argv) > 1 else pathlib.Path(__file__).resolve().parents[2]
sys.path.insert(0, str(SOURCE / "tools"))
import test_together  # noqa: E402  pylint: disable=wrong-import-position,import-error

# As GoogleTest: runs what the filter names; Dies ends the process, Hangs does not end, Fails fails; Leaks is told of at the end only.
PROGRAM = """#!/bin/sh
for word; do case $word in --gtest_filter=*) names=${word#*=} ;; esac; done
code=0
for name in $(echo "$names" | tr : ' '); do
  echo "[ RUN      ] $name"
  case $name in
    *Dies) echo "at $PLACE"; exit 3 ;;
    *Hangs) exec sleep 9 ;;
    *Fails) echo "[  FAILED  ] $name (0 ms)"; code=1 ;;
    *Skips) echo "[  SKIPPED ] $name (0 ms)" ;;
    *Forgotten) ;;
    *) echo "[       OK ] $name (0 ms)"; case $name in *Leaks) code=23 ;; esac ;;
  esac
done
exit $code
"""


def test_of(program, name, **properties):
    """A test in the words of ctest."""
    return {"name": name, "command": [program, f"--gtest_filter={name}", "--gtest_also_run_disabled_tests"],
            "properties": [{"name": key, "value": value} for key, value in properties.items()]}


class Together(unittest.TestCase):
    """Groups, verdicts and logs."""

    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)
        self.program = str(self.folder / "program")
        pathlib.Path(self.program).write_text(PROGRAM, encoding="ascii")
        pathlib.Path(self.program).chmod(0o755)

    def run_all(self, *names, size=2, **properties):
        """The tests that fail when all these are run."""
        parts, others = test_together.group([test_of(self.program, name, **properties) for name in names], size)
        self.assertEqual(others, [])
        return test_together.run_together(parts, self.folder / "logs")

    def test_groups_are_of_one_program_and_its_properties(self):
        tests = [test_of(self.program, f"A.{i}", LABELS=["x"]) for i in range(5)]
        tests += [test_of(self.program, "A.Else", ENVIRONMENT=["PLACE=here"]), test_of("other", "B.1")]
        parts, _ = test_together.group(tests, 3)
        self.assertEqual([names for _, names in parts], [["A.0", "A.1", "A.2"], ["A.3", "A.4"], ["A.Else"], ["B.1"]])

    def test_what_is_no_google_test_or_has_other_properties_is_left_to_ctest(self):
        script = {"name": "script", "command": ["python3", "x.py"]}
        limited = test_of(self.program, "A.1", TIMEOUT=3.0)
        self.assertEqual(test_together.group([script, limited], 9), ([], ["script", "A.1"]))

    def test_all_that_pass_or_are_skipped_pass(self):
        self.assertEqual(self.run_all("A.1", "A.2", "A.Skips"), [])
        self.assertFalse((self.folder / "logs/LastTestsFailed.log").exists())

    def test_failures_are_named_and_logged(self):
        self.assertEqual(self.run_all("A.1", "A.Fails", "A.2"), ["A.Fails"])
        self.assertEqual((self.folder / "logs/LastTestsFailed.log").read_text(encoding="utf-8"), "program:A.Fails\n")
        self.assertIn("[  FAILED  ] A.Fails", (self.folder / "logs/LastTest.log").read_text(encoding="utf-8"))

    def test_a_test_that_ends_its_process_is_named(self):
        self.assertEqual(self.run_all("A.1", "A.Dies", "A.2", size=9, ENVIRONMENT=["PLACE=here"]), ["A.Dies"])
        self.assertIn("at here", (self.folder / "logs/LastTest.log").read_text(encoding="utf-8"))

    def test_failures_before_the_end_of_a_process_do_not_hide_what_ended_it(self):
        self.assertEqual(self.run_all("A.1", "A.Fails", "A.Dies", "A.2", size=9), ["A.Fails", "A.Dies"])

    def test_a_test_that_does_not_end_is_stopped_and_named(self):
        with unittest.mock.patch.object(test_together, "TIMEOUT", 1):
            self.assertEqual(self.run_all("A.1", "A.Hangs", "A.2", size=9), ["A.Hangs"])
        self.assertIn("stopped after 1 s", (self.folder / "logs/LastTest.log").read_text(encoding="utf-8"))

    def test_a_process_that_fails_after_all_have_passed_has_failed(self):
        self.assertEqual(self.run_all("A.1", "A.Leaks", size=9), ["A.1", "A.Leaks"])

    def test_a_test_without_a_verdict_has_failed(self):
        self.assertEqual(self.run_all("A.Forgotten", "A.1"), ["A.Forgotten"])


if __name__ == "__main__":
    unittest.main()
