#!/usr/bin/env python3
"""Installs the Python package by pip into a virtual environment and runs its tests there.

    install_and_test.py SOURCE BUILD WORK

The module is compiled against `cmake --install BUILD`, so the core is not compiled again. The
Python is that of INCERES_PYTHON, else /usr/bin/python3, for which Debian's packages are. Exits with
77, for ctest's skipping, where something is not installed, and says what.
"""

import os
import pathlib
import shutil
import subprocess
import sys

SKIPPED = 77
# What the package needs, how to see it, and the Debian package that has it.
NEEDED = [
    ("NumPy", "import numpy", "python3-numpy"),
    ("setuptools", "import setuptools", "python3-setuptools"),
    ("wheel", "import wheel", "python3-wheel"),
    ("venv with pip", "import venv, ensurepip", "python3-venv"),
    ("Python's headers",
     "import os, sysconfig; os.stat(sysconfig.get_path('include') + '/Python.h')",
     "python3-dev"),
]


def interpreter():
    """The Python to test with."""
    given = os.environ.get("INCERES_PYTHON")
    return given or ("/usr/bin/python3" if os.path.exists("/usr/bin/python3") else sys.executable)


def missing(python):
    """The first thing that is not installed, as a sentence; None if all is there."""
    for what, code, package in NEEDED:
        if subprocess.run([python, "-c", code], stderr=subprocess.DEVNULL, check=False).returncode:
            return f"{what} is not installed for {python} (Debian: {package})"
    probe = subprocess.run(
        ["cmake", "--find-package", "-DNAME=pybind11", "-DCOMPILER_ID=GNU", "-DLANGUAGE=CXX",
         "-DMODE=EXIST"], capture_output=True, check=False)
    configs = [pathlib.Path("/usr/lib/cmake/pybind11"), pathlib.Path("/usr/share/cmake/pybind11")]
    if probe.returncode and not any(path.is_dir() for path in configs):
        return "pybind11 is not installed (Debian: pybind11-dev)"
    return None


def main():
    source, build, work = map(pathlib.Path, sys.argv[1:])
    python = interpreter()
    reason = missing(python)
    if reason:
        print(f"python.package skipped: {reason}")
        return SKIPPED
    shutil.rmtree(work, ignore_errors=True)
    prefix, environment = work / "prefix", work / "venv"
    log = work / "log"
    work.mkdir(parents=True)

    def run(*command, **more):
        with open(log, "a", encoding="utf-8") as to:
            code = subprocess.run(command, stdout=to, stderr=to, check=False, **more).returncode
        if code:
            print(log.read_text(encoding="utf-8"))
            sys.exit(f"failed: {' '.join(map(str, command))}")

    run("cmake", "--install", build, "--prefix", prefix)
    run(python, "-m", "venv", "--system-site-packages", environment)
    # pip builds where the sources are; the sources' own folder stays clean.
    copy = work / "source"
    for name in ("pyproject.toml", "setup.py", "README.md", "python", "cmake"):
        kind = shutil.copytree if (source / name).is_dir() else shutil.copy2
        copy.mkdir(exist_ok=True)
        kind(source / name, copy / name)
    run(environment / "bin" / "pip", "install", "--no-index", "--no-build-isolation", "--verbose",
        copy, env={**os.environ, "INCERES_PREFIX": str(prefix)})
    # From a folder without sources: what is imported is what was installed.
    code = "import inceres, pathlib; print(pathlib.Path(inceres.__file__).resolve())"
    where = subprocess.run([environment / "bin" / "python", "-c", code], cwd=work, text=True,
                           capture_output=True, check=True).stdout.strip()
    if environment.resolve() not in pathlib.Path(where).parents:
        sys.exit(f"imported from {where}")
    tests = subprocess.run(
        [environment / "bin" / "python", "-m", "unittest", "discover",
         "-s", source / "tests/python", "-p", "*_test.py"], cwd=work, env={**os.environ, "MPLBACKEND": "Agg"}, check=False)
    return tests.returncode


if __name__ == "__main__":
    sys.exit(main())
