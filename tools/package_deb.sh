#!/usr/bin/env bash
# Builds the libraries, the tools and the Python package and makes .deb packages of them, in build-deb/packages/, for the
# Debian it runs on. From any directory, from a fresh clone.
#
#   tools/package_deb.sh [--no-install] [-DNAME=VALUE]...
#
# --no-install: do not install missing packages first. Definitions go to CMake,
# -DINCERES_PACKAGE_MAINTAINER="Name <address>" among them. The packages are looked through by
# lintian, if it is there; its errors are errors here.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

definitions=()
install=yes
for option in "$@"; do
  case $option in
    --no-install) install=no ;;
    -D?*=*) definitions+=("$option") ;;
    --help) sed -n '2,/^set/{/^#/s/^# \{0,1\}//p}' "${BASH_SOURCE[0]}"; exit 0 ;;
    *) echo "package_deb.sh: unknown option $option (see --help)" >&2; exit 2 ;;
  esac
done

[[ $install == no ]] || tools/install_packages.sh --python
if command -v ccache > /dev/null; then
  export CMAKE_CXX_COMPILER_LAUNCHER=${CMAKE_CXX_COMPILER_LAUNCHER-ccache}
fi
cmake --preset deb "${definitions[@]}"
cmake --build --preset deb --parallel "$(nproc)"
rm -rf build-deb/packages
umask 022
(cd build-deb && cpack > cpack.log 2>&1) || { cat build-deb/cpack.log >&2; exit 1; }
rm -rf build-deb/packages/_CPack_Packages
if command -v lintian > /dev/null; then
  lintian --fail-on error --tag-display-limit 0 build-deb/packages/*.deb
fi
ls build-deb/packages/*.deb
