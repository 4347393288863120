#!/usr/bin/env python3
"""What the shared libraries export, compared with the lists beside this script or written there.

    tools/abi/exported_symbols.py check LIBRARY...    exit with 1 and a line for each difference
    tools/abi/exported_symbols.py update LIBRARY...   write the lists anew; no release loses symbols

LIBRARY is a built file such as build/src/libinceres_core.so; its list is libinceres_core.symbols, a
line for each symbol with the release it came in. A symbol of an earlier release may only go
together with the SONAME (docs/abi.md). --lists FOLDER and --release VERSION take the place of this
folder and of the version in CMakeLists.txt.
"""

import argparse
import pathlib
import re
import subprocess
import sys

HERE = pathlib.Path(__file__).resolve().parent


def run(*command, given=None):
    return subprocess.run(command, input=given, check=True, capture_output=True, text=True).stdout


def soname_of(library):
    match = re.search(r"\(SONAME\).*\[(.+)\]", run("readelf", "--dynamic", "--wide", str(library)))
    if not match:
        sys.exit(f"{library}: no shared library with a SONAME")
    return match.group(1)


def symbols_of(library):
    """Mangled names. Not those of weak functions, which a program instantiates itself, nor of the
    version node."""
    lines = run("nm", "--dynamic", "--defined-only", str(library)).splitlines()
    rows = [line.split() for line in lines]
    return {name.partition("@")[0] for *_, kind, name in rows if kind not in "AW"}


def project_version():
    text = (HERE.parents[1] / "CMakeLists.txt").read_text(encoding="utf-8")
    return re.search(r"project\(inceres VERSION ([\d.]+)", text).group(1)


def numbers(version):
    return tuple(int(part) for part in version.split("."))


def demangled(names):
    names = sorted(names)
    return dict(zip(names, run("c++filt", given="\n".join(names)).splitlines()))


class SymbolList:
    """The committed list of one library: its SONAME, and of each symbol the release it came in."""

    def __init__(self, path):
        self.path = path
        self.soname = None
        self.since = {}
        for line in path.read_text(encoding="utf-8").splitlines() if path.exists() else []:
            if match := re.match(r"# Exported by (\S+),", line):
                self.soname = match.group(1)
            elif line and not line.startswith("#"):
                name, release = line.split()
                self.since[name] = release

    def write(self):
        lines = [
            f"# Exported by {self.soname}, each with the release it came in.",
            "# Written by tools/abi/exported_symbols.py update; readable through c++filt.",
        ]
        lines += [f"{name} {release}" for name, release in sorted(self.since.items())]
        self.path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def list_of(library, folder):
    return SymbolList(folder / (soname_of(library).partition(".so")[0] + ".symbols"))


def lost_promises(symbols, listed, soname, release):
    """The symbols of earlier releases that are gone although the SONAME has stayed."""
    if listed.soname != soname:
        return set()
    gone = set(listed.since) - symbols
    return {name for name in gone if numbers(listed.since[name]) < numbers(release)}


def lost_text(symbol, release):
    return (f"{symbol} is gone, which release {release} had: programs linked to it no longer "
            "start; bring it back or raise the version that the SONAME is made of")


def differences(library, folder, release):
    soname, symbols, listed = soname_of(library), symbols_of(library), list_of(library, folder)
    if listed.soname != soname:
        return [
            f"{listed.path.name} is of {listed.soname}, the library is {soname}: update the list"
        ]
    lost = lost_promises(symbols, listed, soname, release)
    gone, new = set(listed.since) - symbols, symbols - set(listed.since)
    text = demangled(gone | new)
    problems = [lost_text(text[name], listed.since[name]) for name in sorted(lost)]
    problems += [f"{text[name]} is on the list and not exported: update it"
                 for name in sorted(gone - lost)]
    problems += [f"{text[name]} is exported and not on the list: update it" for name in sorted(new)]
    return [f"{soname}: {problem}" for problem in problems]


def update(library, folder, release):
    """Writes the list, or tells why not."""
    soname, symbols, listed = soname_of(library), symbols_of(library), list_of(library, folder)
    lost = lost_promises(symbols, listed, soname, release)
    if lost:
        text = demangled(lost)
        return [f"{soname}: {lost_text(text[name], listed.since[name])}" for name in sorted(lost)]
    since = listed.since if listed.soname == soname else {}
    listed.soname, listed.since = soname, {name: since.get(name, release) for name in symbols}
    listed.write()
    print(f"{listed.path}: {len(symbols)} symbols")
    return []


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("action", choices=["check", "update"])
    parser.add_argument("libraries", nargs="+", type=pathlib.Path, metavar="LIBRARY")
    parser.add_argument("--lists", type=pathlib.Path, default=HERE, metavar="FOLDER")
    parser.add_argument("--release", default=None, metavar="VERSION")
    arguments = parser.parse_args()
    release = arguments.release or project_version()
    action = {"check": differences, "update": update}[arguments.action]
    problems = []
    for library in arguments.libraries:
        if not library.exists():
            sys.exit(f"{library} does not exist: build the shared libraries first")
        problems += action(library, arguments.lists, release)
    for problem in problems:
        print(problem, file=sys.stderr)
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main())
