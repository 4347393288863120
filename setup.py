"""Builds the Python package: setuptools takes the Python sources, CMake compiles the module.

    pip install --no-index --no-build-isolation .

needs CMake 3.25, a C++17 compiler, pybind11 2.10 and what the core needs (docs/python.md). Options:

    CMAKE_ARGS             further arguments of CMake
    INCERES_PREFIX         an installed inceres to build the module against, instead of compiling
                           the core
    CMAKE_BUILD_PARALLEL_LEVEL   how many compilers at once; by default one a processor
"""

import os
import pathlib
import shlex
import shutil
import subprocess
import sys

from setuptools import Extension, setup
from setuptools.command.build_ext import build_ext

ROOT = pathlib.Path(__file__).resolve().parent
WITHOUT = ["CERES_ADAPTER", "TESTS", "TOOLS", "EXAMPLES"]


class CMakeBuild(build_ext):
    """Configures and builds one target, whose file lands where setuptools wants it."""

    def build_extension(self, ext):
        package = pathlib.Path(self.get_ext_fullpath(ext.name)).resolve().parent
        build = pathlib.Path(self.build_temp).resolve()
        build.mkdir(parents=True, exist_ok=True)
        arguments = [
            f"-DPython_EXECUTABLE={sys.executable}",
            f"-DINCERES_PYTHON_PACKAGE={package}",
            "-DCMAKE_BUILD_TYPE=Release",
        ]
        prefix = os.environ.get("INCERES_PREFIX")
        if prefix:
            source = ROOT / "python"
            arguments.append(f"-DCMAKE_PREFIX_PATH={prefix}")
        else:
            source = ROOT
            arguments.append("-DINCERES_BUILD_PYTHON=ON")
            arguments += [f"-DINCERES_BUILD_{part}=OFF" for part in WITHOUT]
        if shutil.which("ninja"):
            arguments.append("-GNinja")
        arguments += shlex.split(os.environ.get("CMAKE_ARGS", ""))
        subprocess.run(["cmake", "-S", source, "-B", build, *arguments], check=True)
        parallel = os.environ.get("CMAKE_BUILD_PARALLEL_LEVEL", str(os.cpu_count() or 1))
        subprocess.run(
            ["cmake", "--build", build, "--target", "inceres_python", "--parallel", parallel],
            check=True)


setup(
    ext_modules=[Extension("inceres._core", sources=[])],
    cmdclass={"build_ext": CMakeBuild},
    options={"build": {"build_base": "build-python"}},  # build/ is CMake's
)
