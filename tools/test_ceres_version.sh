#!/usr/bin/env bash
# Builds another release of Ceres and runs the tests that meet Ceres against it. By hand, not in CI: Debian 12 has Ceres 2.1, and
# one more Ceres takes as long to build as inceres does.
#
#   tools/test_ceres_version.sh 2.2|2.1|2.0 [--source ARCHIVE_OR_FOLDER] [--folders "NAME…"] [--without REGEX] [--jobs N]
#
# The source of 2.2 comes from the Debian mirror that this machine installs packages from, with its checksum. For any other, and
# where there is no such mirror, --source names an unpacked release of Ceres or its archive. --folders: of tests/; by default all
# that meet Ceres. --without leaves out tests by name.
#
# Everything goes to build-ceres-VERSION/ and stays there: a second run builds what has changed. Needs what
# tools/install_packages.sh installs; the installed Ceres is not touched.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

die() { echo "test_ceres_version.sh: $*" >&2; exit 2; }

version=
source=
folders="adapters conformance dropin sliding_window integration"
test_options=()
jobs=$(nproc)
while (($# > 0)); do
  case $1 in
    --source) source=$(cd "$OLDPWD" && realpath -e -- "${2:?--source needs a file or folder}"); shift ;;
    --folders) folders=${2:?--folders needs names}; shift ;;
    --without) test_options+=(--exclude-regex "${2:?--without needs a regular expression}"); shift ;;
    --jobs) jobs=${2:?--jobs needs a number}; shift ;;
    --help) sed -n '2,/^set/{/^#/s/^# \{0,1\}//p}' "${BASH_SOURCE[0]}"; exit 0 ;;
    2.0 | 2.1 | 2.2) version=$1 ;;
    *) die "cannot make sense of \"$1\" (see --help)" ;;
  esac
  shift
done
[[ -n $version ]] || die "which release? 2.0, 2.1 or 2.2 (see --help)"
work=$PWD/build-ceres-$version
prefix=$work/prefix
mkdir -p "$work"

# fetch ARCHIVE SHA256: from the pool of a Debian mirror into $work, unless it is there.
fetch() {
  local archive=$1 sha256=$2 site
  [[ -e $work/$archive ]] && sha256sum --status --check <<< "$sha256  $work/$archive" && return
  for site in $(apt-get indextargets --format '$(SITE)' 'Created-By: Packages' 2> /dev/null | sort -u); do
    curl --silent --fail --location --output "$work/$archive" "$site/pool/main/c/ceres-solver/$archive" || continue
    sha256sum --status --check <<< "$sha256  $work/$archive" && return
    die "$archive from $site is not the file it should be"
  done
  die "no Debian mirror of this machine has $archive; get that release of Ceres yourself and name it with --source"
}

# Leaves the source of Ceres in $source, a folder.
unpack() {
  if [[ -z $source ]]; then
    [[ $version == 2.2 ]] || die "Debian has no source of Ceres $version any more: name one with --source"
    local archive=ceres-solver_2.2.0+dfsg.orig.tar.xz
    fetch $archive fb22a61518dadb2cdfdbc698fbc9620d6d1e5e1b68a93b983086b668e39f395a
    source=$work/$archive
  fi
  if [[ ! -d $source ]]; then
    mkdir -p "$work/source"
    tar --extract --file "$source" --directory "$work/source" --strip-components 1
    source=$work/source
  fi
  local release
  release=$(sed -n 's/^#define CERES_VERSION_M[AI][JN]OR //p' "$source/include/ceres/version.h" | paste -sd.) ||
    die "$source is no source of Ceres"
  [[ $release == "$version" ]] || die "$source is Ceres $release, not $version"
}

# Shared, for the drop-in stands in front of a shared Ceres, and only what the tests need. Nearly all of the time goes into reading
# Eigen, so it is read once; without Schur specializations there is half as much to compile, and Ceres solves the same, more slowly.
# (One file of 2.2, for its benchmarks only, is made for one of those specializations and does not link without.)
build_ceres() {
  cat > "$work/inside_ceres.cmake" <<'CMAKE'
cmake_language(DEFER CALL cmake_language EVAL CODE [[
  if(TARGET ceres_internal)
    target_precompile_headers(ceres_internal PRIVATE
      <Eigen/Dense> <Eigen/SparseCore> <Eigen/SparseCholesky> <map> <memory> <string> <vector>)
    set_source_files_properties(${CMAKE_SOURCE_DIR}/internal/ceres/fake_bundle_adjustment_jacobian.cc
      TARGET_DIRECTORY ceres_internal PROPERTIES HEADER_FILE_ONLY ON)
  endif()]])
CMAKE
  cmake -S "$source" -B "$work/ceres" -G Ninja --no-warn-unused-cli -DCMAKE_BUILD_TYPE=Release "-DCMAKE_CXX_FLAGS_RELEASE=-O1 -DNDEBUG" \
    -DCMAKE_INSTALL_PREFIX="$prefix" -DCMAKE_INSTALL_LIBDIR=lib -DCMAKE_PROJECT_Ceres_INCLUDE="$work/inside_ceres.cmake" \
    -DBUILD_SHARED_LIBS=ON -DBUILD_TESTING=OFF -DBUILD_EXAMPLES=OFF -DBUILD_BENCHMARKS=OFF -DBUILD_DOCUMENTATION=OFF \
    -DSCHUR_SPECIALIZATIONS=OFF -DUSE_CUDA=OFF -DCUDA=OFF -DCXSPARSE=OFF -DEIGENMETIS=OFF -DPROVIDE_UNINSTALL_TARGET=OFF
  cmake --build "$work/ceres" --parallel "$jobs" --target install > "$work/ceres.log" || { tail -50 "$work/ceres.log" >&2; return 1; }
}

build_inceres() {
  local targets=()
  for folder in $folders; do
    targets+=("tests/$folder/all")
  done
  cmake -S . -B "$work/inceres" -G Ninja -DCMAKE_BUILD_TYPE=Release -DCeres_DIR="$prefix/lib/cmake/Ceres"
  cmake --build "$work/inceres" --parallel "$jobs" --target "${targets[@]}"
}

unpack
build_ceres
build_inceres
ctest --test-dir "$work/inceres" --output-on-failure --timeout 600 --no-tests=error --parallel "$jobs" \
  --label-regex "^(${folders// /|})$" "${test_options[@]}" ||
  { echo "test_ceres_version.sh: FAILED against Ceres $version: the failed tests are listed above" >&2; exit 1; }
echo "test_ceres_version.sh: all tests of $folders passed against Ceres $version in ${SECONDS} s"
