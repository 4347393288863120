#!/usr/bin/env python3
"""Builds the kernels and their tests for arm64 with a cross compiler and runs them under qemu.

    kernels_test.py BUILD_DIRECTORY

Exit code 77, with what is missing, where there is no cross compiler, emulator or source of GoogleTest. On Debian:
tools/install_packages.sh --arm64.
"""

import pathlib
import shutil
import subprocess
import sys

COMPILER = "aarch64-linux-gnu-g++"
EMULATOR = "qemu-aarch64"
GTEST = pathlib.Path("/usr/src/googletest/googletest/src/gtest-all.cc")
SKIPPED = 77


def main():
    build = pathlib.Path(sys.argv[1])
    missing = [tool for tool in (COMPILER, EMULATOR, "cmake", "ninja") if shutil.which(tool) is None]
    missing += [] if GTEST.exists() else [str(GTEST)]
    if missing:
        print(f"skipped, the kernels for arm64 were not tested: no {', '.join(missing)}")
        return SKIPPED
    here = pathlib.Path(__file__).resolve().parent
    subprocess.run(["cmake", "-S", here, "-B", build, "-G", "Ninja", "-DCMAKE_BUILD_TYPE=Release", "-DCMAKE_SYSTEM_NAME=Linux",
                    "-DCMAKE_SYSTEM_PROCESSOR=aarch64", f"-DCMAKE_CXX_COMPILER={COMPILER}"], check=True)
    subprocess.run(["cmake", "--build", build], check=True)
    program = build / "simd_test"
    neon = subprocess.run([EMULATOR, program, "--gtest_filter=*Neon*:Kernels.*"], check=True, capture_output=True, text=True).stdout
    print(neon)
    if "SKIPPED" in neon or "Sets/ProductKernels" not in neon:
        print("the NEON kernels are not in this build")
        return 1
    return subprocess.run([EMULATOR, program], check=False).returncode


if __name__ == "__main__":
    sys.exit(main())
