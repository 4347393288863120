#!/usr/bin/env bash
# Installs what is missing, builds inceres and compares it with stock Ceres on a bundle-adjustment problem that ships with the
# repository. From any directory, from a fresh clone. Arguments go to ab_compare; --problem replaces the bundled one:
#
#   tools/demo.sh [ab_compare options]
#   tools/demo.sh --problem bal:problem-49-7776-pre.txt --repeats 11
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)

if [[ ${1-} == --help ]]; then
  sed -n '2,/^set/{/^#/s/^# \{0,1\}//p}' "${BASH_SOURCE[0]}"
  exit 0
fi
"$root"/tools/build.sh --target ab_compare

arguments=("$@")
if [[ " $* " != *" --problem"[\ =]* ]]; then
  arguments=(--problem "bal:$root/bal_data/street-16-1200-pre.txt" --repeats 5 "$@")
fi
"$root"/build/bin/ab_compare "${arguments[@]}"
