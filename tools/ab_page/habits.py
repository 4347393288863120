"""What the command line of every tool has (docs/tools.md): help, version, quiet, progress, JSON and
exit codes, as the programs in C++ have them."""

import argparse
import json
import pathlib
import re
import sys
import time

FAILURE = 1
EXIT_CODES = """Exit codes:
  0  success
  1  failure: a file could not be read or written
  2  usage: a flag or its value makes no sense
"""
LICENSE = "License: BSD-3-Clause. There is no warranty, to the extent permitted by law."


def version():
    """The project's: installed it is in a file beside this one, in the source tree where CMake has
    it from."""
    here = pathlib.Path(__file__).resolve().parent
    installed = here / "version.txt"
    if installed.exists():
        return installed.read_text(encoding="utf-8").strip()
    project = (here.parents[1] / "CMakeLists.txt").read_text(encoding="utf-8")
    return re.search(r"^project\(inceres VERSION ([\d.]+)", project, re.MULTILINE)[1]


class Parser(argparse.ArgumentParser):
    """Its help begins as that of the programs, which is what help2man reads."""

    def format_usage(self):
        return f"Usage: {self.prog} [OPTION]... FILE\n"

    def format_help(self):
        return self.format_usage() + super().format_help()


def make_parser(tool, summary, details, examples):
    """A parser with the flags of every tool. `examples`: (purpose, command)."""
    shown = "\n\n".join(f"  # {purpose}\n  {command}" for purpose, command in examples)
    parser = Parser(prog=tool, usage=argparse.SUPPRESS,
                    description=f"{summary}\n\n{details}\n\nExamples:\n{shown}",
                    epilog=EXIT_CODES, formatter_class=argparse.RawDescriptionHelpFormatter,
                    add_help=False)
    parser._optionals.title = "Options"  # as in the other tools; argparse has no public name for it
    parser.add_argument("--help", "-h", action="help", help="print this and exit")
    parser.add_argument("--json", metavar="REPORT", default="",
                        help="write the report to this file as JSON; -: to standard output, which "
                             "then gets nothing else")
    parser.add_argument("--quiet", action="store_true", help="print nothing where all goes well")
    parser.add_argument("--progress", choices=("auto", "always", "never"), default="auto",
                        help="tell on standard error, once a second, how far work is that takes "
                             "more than one: always, never, or auto: if that is a terminal")
    parser.add_argument("--version", action="version", help="print the version and exit",
                        version=f"{tool} (inceres) {version()}\n\n{LICENSE}")
    return parser


class Output:
    """Where a tool tells what, by the flags of every tool."""

    def __init__(self, parser, options):
        if options.quiet and options.progress == "always":
            parser.error("--quiet and --progress always contradict each other")
        self._json = options.json
        self._warns = not options.quiet
        self._speaks = not options.quiet and options.json != "-"
        wanted = options.progress == "always" or (options.progress == "auto"
                                                  and sys.stderr.isatty())
        self._next = time.monotonic() + 1.0 if wanted and not options.quiet else float("inf")

    def say(self, text):
        if self._speaks:
            print(text)

    def warn(self, text):
        if self._warns:
            print(text, file=sys.stderr)

    def progress(self, make_text):
        """A line a second once work has taken a second; the text is made only then."""
        now = time.monotonic()
        if now >= self._next:
            self._next = now + 1.0
            print(make_text(), file=sys.stderr, flush=True)

    def report(self, report):
        """Writes the report to where --json says; raises OSError."""
        text = json.dumps(report, indent=2, allow_nan=False) + "\n"
        if self._json == "-":
            sys.stdout.write(text)
        elif self._json:
            pathlib.Path(self._json).write_text(text, encoding="utf-8")
