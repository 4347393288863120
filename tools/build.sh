#!/usr/bin/env bash
# Installs what is missing, configures a preset and builds it. From any directory, from a fresh clone.
#
#   tools/build.sh [--preset default|dev|asan|tsan] [--target NAME]... [--benchmarks] [--warnings-as-errors] [--unity] [--no-install]
#
# --unity compiles several sources at once, which is faster but inlines other functions, and tests for debugging (-Og), in
# half of their time: do not measure with it. The build directory keeps it.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

preset=default
targets=()
definitions=()
install=yes
while (($# > 0)); do
  case $1 in
    --preset) preset=${2:?--preset needs a name}; shift ;;
    --target) targets+=(--target "${2:?--target needs a name}"); shift ;;
    --benchmarks) definitions+=(-DINCERES_BUILD_BENCHMARKS=ON) ;;
    --warnings-as-errors) definitions+=(-DINCERES_WARNINGS_AS_ERRORS=ON) ;;
    --unity) definitions+=(-DCMAKE_UNITY_BUILD=ON -DINCERES_TEST_COMPILE_OPTIONS=-Og) ;;
    --no-install) install=no ;;
    --help) sed -n '2,/^set/{/^#/s/^# \{0,1\}//p}' "${BASH_SOURCE[0]}"; exit 0 ;;
    *) echo "build.sh: unknown option $1 (see --help)" >&2; exit 2 ;;
  esac
  shift
done

[[ $install == no ]] || tools/install_packages.sh
if command -v ccache > /dev/null; then
  export CMAKE_CXX_COMPILER_LAUNCHER=${CMAKE_CXX_COMPILER_LAUNCHER-ccache}
fi
cmake --preset "$preset" "${definitions[@]}"
cmake --build --preset "$preset" --parallel "$(nproc)" "${targets[@]}"
