#!/usr/bin/env python3
"""What every tool has (docs/tools.md): --help with examples that run, --version, --json, --quiet,
--progress, exit codes. Arguments: the drop-in, or "none", and the tools."""

import json
import os
import pathlib
import pty
import re
import subprocess
import sys
import tempfile
import unittest

sys.dont_write_bytecode = True
from ab_log_maker import window_run, write  # noqa: E402
from tool_test_support import (  # noqa: E402
    write_small_bal, write_small_keyframes, write_small_pose_graph)

DROPIN = sys.argv[1]
TOOLS = {pathlib.Path(path).name: pathlib.Path(path).resolve() for path in sys.argv[2:]}
ROOT = pathlib.Path(__file__).resolve().parents[2]

# What keeps an example that would take long short, and has it parsed all the same.
SHORTENED = {"differential_fuzzer": "--lives 1 --edits 10", "ab_compare": "--repeats 2"}
# The shortest run of each tool that succeeds.
SHORT = {"bal_solve": ["--input", "problem.txt"],
         "bal_solve_mpi": ["--input", "problem.txt"],
         "pose_graph_solve": ["--input", "M3500.g2o"],
         "ab_compare": ["--problem", "bal:problem.txt", "--repeats", "1"],
         "covariance_compare": ["--problem", "bal:problem.txt", "--repeats", "1"],
         "replay": ["--problem", "bal:problem.txt"],
         "living_problem": ["--problem", "bal:problem.txt"],
         "bal_generate": ["--num_cameras", "12", "--output", "made.txt"],
         "vio_simulate": ["--preset", "cubic", "--output", "made.vio"],
         "differential_fuzzer": ["--mode", "session", "--lives", "1", "--edits", "10"],
         "ab_report": ["run.jsonl"]}
# A file that is not there.
MISSING = {"bal_solve": ["--input", "no/file"],
           "bal_solve_mpi": ["--input", "no/file"],
           "pose_graph_solve": ["--input", "no/file"],
           "ab_compare": ["--problem", "bal:no/file"],
           "covariance_compare": ["--problem", "bal:no/file"],
           "replay": ["--problem", "bal:no/file"],
           "living_problem": ["--problem", "bal:no/file"],
           "bal_generate": ["--num_cameras", "12", "--output", "no/file"],
           "vio_simulate": ["--preset", "cubic", "--output", "no/file"],
           "differential_fuzzer": [*SHORT["differential_fuzzer"], "--json", "no/file"],
           "ab_report": ["no/file"]}


def examples(help_text):
    """[(purpose, command)] of the section of examples."""
    section = re.search(r"^Examples:\n(.*?)^\S", help_text, re.MULTILINE | re.DOTALL)[1]
    return re.findall(r"^  # (.+)\n  (\S.*)$", section, re.MULTILINE)


class ToolHabitsTest(unittest.TestCase):
    def setUp(self):
        directory = tempfile.TemporaryDirectory()
        self.addCleanup(directory.cleanup)
        self.folder = pathlib.Path(directory.name)
        for name in ("problem.txt", "problem-49-7776-pre.txt"):
            write_small_bal(self.folder / name)
        subprocess.run(["bzip2", "-k", self.folder / "problem.txt"], check=True)
        write_small_keyframes(self.folder / "fr3_office.kf")
        write_small_pose_graph(self.folder / "M3500.g2o", 2)
        write_small_pose_graph(self.folder / "sphere.g2o", 3)
        write(self.folder / "run.jsonl", window_run(40))
        (self.folder / "bin").mkdir()
        for name, path in TOOLS.items():
            (self.folder / "bin" / name).symlink_to(path)
        self.environment = {**os.environ, "PATH": f"{self.folder / 'bin'}:{os.environ['PATH']}",
                            "LD_LIBRARY_PATH": str(pathlib.Path(DROPIN).parent)}

    def run_tool(self, name, *flags, code=0):
        """(standard output, standard error)"""
        done = subprocess.run([TOOLS[name], *flags], cwd=self.folder, capture_output=True,
                              text=True, timeout=300, check=False)
        self.assertEqual(done.returncode, code, f"{name} {flags}\n{done.stdout}\n{done.stderr}")
        return done.stdout, done.stderr

    def test_help_has_the_habits_of_all(self):
        for name in TOOLS:
            text, errors = self.run_tool(name, "--help")
            self.assertEqual(errors, "")
            self.assertRegex(text, rf"\AUsage: {name} \[OPTION\]\.\.\.[^\n]*\n[A-Z][^\n]+\.\n")
            for part in ("\nExamples:\n", "\nOptions:\n", "--json", "--quiet", "--progress",
                         "--version", "--help", "\nExit codes:\n  0  success\n"):
                self.assertIn(part, text, name)
            self.assertTrue(examples(text), name)
            self.assertNotIn("stderrthreshold", text, "a flag of a library's")
            for line in text.splitlines():
                self.assertLessEqual(len(line), 80 if not line.startswith(f"  {name}")
                                     and "=" not in line else 200, (name, line))

    def test_version(self):
        version = re.search(r"^project\(inceres VERSION ([\d.]+)",
                            (ROOT / "CMakeLists.txt").read_text(encoding="utf-8"), re.MULTILINE)[1]
        for name in TOOLS:
            text, errors = self.run_tool(name, "--version")
            self.assertEqual((text.splitlines()[0], errors), (f"{name} (inceres) {version}", ""))

    def test_every_example_runs_and_is_silent_if_quiet(self):
        for name in TOOLS:
            for _, command in examples(self.run_tool(name, "--help")[0]):
                self.assertIn(f"{name} ", command)
                for more in ("", " --quiet"):
                    command = command.replace("path:2000", "path:400")
                    if "|" in command:
                        full, more = command, ""
                    else:
                        full = f"{command} {SHORTENED.get(name, '')}{more}"
                    done = subprocess.run(["bash", "-o", "pipefail", "-c", full], cwd=self.folder,
                                          env=self.environment,
                                          capture_output=True, text=True, timeout=300, check=False)
                    self.assertEqual(done.returncode, 0, f"{full}\n{done.stdout}\n{done.stderr}")
                    if more:
                        self.assertEqual((done.stdout, done.stderr), ("", ""), full)
                    else:
                        self.assertNotEqual(done.stdout, "", full)
        for written in ("solved.txt", "solved.html", "solved.json", "ab.json", "report.json",
                        "venice11.txt", "truth.txt.bz2", "cubic.vio",
                        "night.jsonl", "run.html", "figures.json"):
            self.assertTrue((self.folder / written).exists(), written)

    def test_json_goes_to_a_file_or_alone_to_standard_output(self):
        for name in TOOLS:
            plain, _ = self.run_tool(name, *SHORT[name], "--json", "report.json")
            self.assertNotEqual(plain, "", name)
            in_file = json.loads((self.folder / "report.json").read_text(encoding="utf-8"))
            (self.folder / "report.json").unlink()
            for more in ([], ["--quiet"], ["--progress", "always"]):
                text, _ = self.run_tool(name, *SHORT[name], "--json", "-", *more)
                self.assertEqual(set(json.loads(text)), set(in_file), name)
            _, message = self.run_tool(name, *SHORT[name], "--json", "no/such/folder.json", code=1)
            self.assertIn("no/such/folder.json", message)

    def test_json_of_a_file_whose_name_is_not_utf8(self):
        strange = os.fsdecode(b"\xff")
        (self.folder / strange).mkdir()
        for name in ("problem.txt", "M3500.g2o", "run.jsonl"):
            (self.folder / strange / name).symlink_to(self.folder / name)
        for name in TOOLS:
            flags = [re.sub(r"(\w+\.(txt|g2o|vio|jsonl))$", rf"{strange}/\1", flag)
                     for flag in SHORT[name]]
            self.assertTrue(json.loads(self.run_tool(name, *flags, "--json", "-")[0]), name)

    def test_a_folder_that_is_not_there_is_told_before_work(self):
        for name in TOOLS.keys() & {"bal_solve", "bal_solve_mpi", "pose_graph_solve",
                                    "covariance_compare", "replay", "living_problem"}:
            _, message = self.run_tool(name, *MISSING[name], "--json", "not/there.json", code=1)
            self.assertIn("--json not/there.json", message)
            self.assertNotIn("no/file", message)

    def test_exit_codes(self):
        for name in TOOLS:
            _, message = self.run_tool(name, *MISSING[name], code=1)
            self.assertIn("no/file", message)
            self.assertIn(f"{name}: ", message)
            _, message = self.run_tool(name, *MISSING[name], "--quiet", code=1)
            self.assertIn("no/file", message)
            for flags, culprit in ((["--no_such_flag"], "no_such_flag"),
                                   (["--progress", "sometimes"], "sometimes"),
                                   (["--quiet", "--progress", "always"], "--quiet"),
                                   (["--json"], "json")):
                _, message = self.run_tool(name, *SHORT[name], *flags, code=2)
                self.assertIn(culprit, message, name)

    def test_files_to_write_have_names_of_their_own(self):
        for name, flags in (("bal_solve", ("--output", "--picture")),
                            ("pose_graph_solve", ("--output", "--json")),
                            ("ab_compare", ("--picture", "--json"))):
            both = [word for flag in flags for word in (flag, "twice.txt")]
            _, message = self.run_tool(name, *SHORT[name], *both, code=2)
            self.assertIn(" and ".join(flags) + " name the same file", message)
            self.assertFalse(os.path.exists("twice.txt"))

    def test_progress_is_on_standard_error_if_wanted(self):
        long_run = ("--problem", "path:2000", "--nostock", "--steps", "800")
        for more, seen in ((["--progress", "always"], True), ([], False)):
            output, errors = self.run_tool("replay", *long_run, *more)
            self.assertEqual(bool(re.search(r"^step \d+ of 800$", errors, re.MULTILINE)), seen,
                             (more, errors))
            self.assertNotIn(" of 800", output)
        for name in TOOLS:
            self.assertEqual(self.run_tool(name, *SHORT[name])[1], "", name)

    def test_progress_is_told_on_a_terminal(self):
        terminal, end = pty.openpty()
        with subprocess.Popen([TOOLS["replay"], "--problem", "path:2000", "--nostock", "--steps",
                               "800"], stdout=subprocess.PIPE, stderr=end) as replay:
            os.close(end)
            output, _ = replay.communicate(timeout=300)
        self.assertEqual(replay.returncode, 0)
        self.assertRegex(os.read(terminal, 65536).decode(), r"step \d+ of 800\r\n")
        os.close(terminal)
        self.assertNotIn(b" of 800", output)

    def test_verbose_lives_are_not_quiet(self):
        _, message = self.run_tool("differential_fuzzer", *SHORT["differential_fuzzer"],
                                   "--verbose", "--quiet", code=2)
        self.assertIn("--verbose", message)

    def test_a_limit_of_time_is_a_number(self):
        for seconds in ("nan", "inf", "-1"):
            _, message = self.run_tool("differential_fuzzer", *SHORT["differential_fuzzer"],
                                       "--seconds", seconds, code=2)
            self.assertIn("--seconds", message)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
