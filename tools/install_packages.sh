#!/usr/bin/env bash
# Installs what building and testing inceres needs on Debian 12, and makes the serial OpenBLAS the BLAS and LAPACK that programs
# load. Does nothing, quickly, when all is there. Runs as root or through sudo; asks nothing.
#
#   tools/install_packages.sh [--browser] [--arm64] [--site] [--python] [--mpi]
#
# --browser adds Chromium, 300 MB, in which one test looks at the page of tools/ab_report; without
# it that test is skipped. --arm64 adds a cross compiler and an emulator, with which the kernels for
# arm64 are tested. --site adds what docs/build.sh builds the site with.
# --python adds what the Python package and its tests need; without it they are skipped.
# --mpi adds Open MPI and PETSc, with which inceres::distributed is built and tested.
set -euo pipefail

packages=(
  build-essential cmake ninja-build git pkg-config file curl python3 ca-certificates
  libceres-dev libeigen3-dev libsuitesparse-dev libmetis-dev libtbb-dev libopenblas0-serial libopenblas-serial-dev
  libgoogle-glog-dev libgflags-dev nlohmann-json3-dev zlib1g-dev libbz2-dev libspectra-dev
  libgtest-dev libgmock-dev libbenchmark-dev
  clang-format clang-tidy
  help2man groff-base
)
for option in "$@"; do
  case $option in
    --browser) packages+=(chromium) ;;
    --arm64) packages+=(g++-aarch64-linux-gnu qemu-user) ;;
    --site) packages+=(mkdocs python3-pygments doxygen graphviz) ;;
    --python)
      packages+=(
        pybind11-dev python3-dev python3-numpy python3-setuptools python3-wheel python3-venv
        python3-matplotlib mypy
      )
      ;;
    --mpi) packages+=(petsc-dev libopenmpi-dev openmpi-bin) ;;
    *) echo "install_packages.sh: unknown option $option" >&2; exit 2 ;;
  esac
done

# as_root COMMAND…: runs it with the rights to change the system.
as_root() {
  if [[ $(id -u) == 0 ]]; then
    "$@"
  elif command -v sudo > /dev/null; then
    sudo --non-interactive env DEBIAN_FRONTEND=noninteractive "$@"
  else
    echo "install_packages.sh: neither root nor sudo; run as root: $*" >&2
    return 1
  fi
}

is_installed() {
  [[ $(dpkg-query --show --showformat='${db:Status-Status}' "$1" 2> /dev/null) == installed ]]
}

install_missing() {
  local package missing=()
  for package in "${packages[@]}"; do
    is_installed "$package" || missing+=("$package")
  done
  if ((${#missing[@]} == 0)); then
    echo "install_packages.sh: all ${#packages[@]} packages are installed"
    return
  fi
  echo "install_packages.sh: installing ${missing[*]}"
  export DEBIAN_FRONTEND=noninteractive
  as_root apt-get -qq -o Acquire::Retries=3 -o DPkg::Lock::Timeout=300 update
  as_root apt-get -qq -y -o Acquire::Retries=3 -o DPkg::Lock::Timeout=300 -o Dpkg::Use-Pty=0 --no-install-recommends \
    install "${missing[@]}" > /dev/null
}

# use_serial LIBRARY: LIBRARY (libblas.so and liblapack.so for the linker, with .3 for running programs) is the serial OpenBLAS. A
# threaded BLAS would fight with the solver's own threads and make timings and last bits depend on the machine; Debian's Ceres
# brings ATLAS, to which programs would be linked by name if the linker's libraries were left alone.
use_serial() {
  local library=$1 triplet link wanted
  triplet=$(dpkg-architecture -qDEB_HOST_MULTIARCH 2> /dev/null || gcc -print-multiarch)
  link=/usr/lib/$triplet/$library
  wanted=/usr/lib/$triplet/openblas-serial/$library
  if [[ $(readlink -f "$link") != $(readlink -f "$wanted") ]]; then
    echo "install_packages.sh: $library was $(readlink -f "$link"); undo with: update-alternatives --auto $library-$triplet"
    as_root update-alternatives --quiet --set "$library-$triplet" "$wanted"
  fi
  if [[ $(readlink -f "$link") != $(readlink -f "$wanted") ]]; then
    echo "install_packages.sh: $link is $(readlink -f "$link"), not the serial OpenBLAS ($wanted)" >&2
    return 1
  fi
  echo "install_packages.sh: $library is the serial OpenBLAS"
}

install_missing
for library in libblas.so.3 liblapack.so.3 libblas.so liblapack.so; do
  use_serial "$library"
done
