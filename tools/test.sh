#!/usr/bin/env bash
# Installs what is missing, builds everything and runs all tests. From any directory, from a fresh clone. Exit code 0: all passed.
#
#   tools/test.sh [--preset default|dev|asan|tsan] [--target NAME]... [--tests REGEX] [--without REGEX] [--without-folders REGEX]
#                 [--benchmarks] [--warnings-as-errors] [--unity] [--no-install] [--together]
#
# --tests and --without choose among the names that `ctest --preset NAME --show-only` prints, --without-folders among the folders of
# tests/, which are the tests' labels; --target builds no more than these; --together runs many tests of a program in one process
# (tools/test_together.py), as a process, a sanitized one above all, takes longer to start than most tests do.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

preset=default
build_options=()
test_options=()
together=no
while (($# > 0)); do
  case $1 in
    --preset) preset=${2:?--preset needs a name}; shift ;;
    --target) build_options+=(--target "${2:?--target needs a name}"); shift ;;
    --tests) test_options+=(--tests-regex "${2:?--tests needs a regular expression}"); shift ;;
    --without) test_options+=(--exclude-regex "${2:?--without needs a regular expression}"); shift ;;
    --without-folders) test_options+=(--label-exclude "${2:?--without-folders needs a regular expression}"); shift ;;
    --together) together=yes ;;
    --benchmarks | --warnings-as-errors | --unity | --no-install) build_options+=("$1") ;;
    --help) sed -n '2,/^set/{/^#/s/^# \{0,1\}//p}' "${BASH_SOURCE[0]}"; exit 0 ;;
    *) echo "test.sh: unknown option $1 (see --help)" >&2; exit 2 ;;
  esac
  shift
done

if ! tools/build.sh --preset "$preset" "${build_options[@]}"; then
  echo "test.sh: FAILED to build preset $preset" >&2
  exit 1
fi
run=(ctest --preset "$preset" --parallel "$(nproc)")
[[ $together == no ]] || run=(tools/test_together.py "$preset")
if ! "${run[@]}" "${test_options[@]}"; then
  echo "test.sh: FAILED, preset $preset: the failed tests are listed above" >&2
  exit 1
fi
echo "test.sh: all tests of preset $preset passed in ${SECONDS} s"
