#!/usr/bin/env bash
# A workspace of colcon with this project and a package that depends on it: colcon takes the order
# from the package.xml files, builds both, and its setup script makes the consumer run. 77, skipped,
# without colcon or its extensions for CMake and package.xml.
#
#   colcon_workspace.sh WORK_FOLDER [-DNAME=VALUE]...
set -euo pipefail
source=$(cd "$(dirname "${BASH_SOURCE[0]}")/../.." && pwd)
work=${1:?a folder to work in}
shift

# Debian's colcon, whose extensions belong to Debian's Python.
colcon() { /usr/bin/python3 /usr/bin/colcon --log-base "$work/log" "$@"; }
if [[ ! -x /usr/bin/colcon ]] ||
  ! /usr/bin/python3 -c 'import colcon_cmake, colcon_ros' 2> /dev/null; then
  echo "skipped: no colcon with python3-colcon-cmake and python3-colcon-ros"
  exit 77
fi

rm -rf "$work"
mkdir -p "$work/source/inceres"
# What git has or would add: not build folders, whose packages colcon would find too.
(cd "$source" && git ls-files -z --cached --others --exclude-standard |
  tar --create --null --files-from - --ignore-failed-read 2> /dev/null) |
  tar --extract --directory "$work/source/inceres"
rm -rf "$work/source/inceres/tests/package"

# The core alone, compiled in the least time.
colcon build --base-paths "$work/source" --build-base "$work/build" --merge-install \
  --install-base "$work/install" --cmake-args --no-warn-unused-cli -DCMAKE_BUILD_TYPE=Debug \
  -DCMAKE_UNITY_BUILD=ON -DINCERES_BUILD_CERES_ADAPTER=OFF -DINCERES_BUILD_TESTS=OFF \
  -DINCERES_BUILD_EXAMPLES=OFF "$@"
set +u
# shellcheck disable=SC1091
source "$work/install/setup.sh"
# Who has sourced the workspace finds the package.
cmake -S "$source/tests/package/core" -B "$work/consumer"
cmake --build "$work/consumer"
"$work/consumer/consumer"
