#!/usr/bin/env bash
# Builds the .deb packages, installs them in a clean root, builds and runs a consumer of each library
# there, and removes them again. 77, skipped, where that cannot be.
#
#   deb_in_clean_root.sh WORK_FOLDER [package_deb.sh options]
set -euo pipefail
source=$(cd "$(dirname "${BASH_SOURCE[0]}")/../.." && pwd)
work=${1:?a folder to work in}
shift
root=$work/root

if why=$("$source"/tools/clean_root.sh why_not); then
  echo "skipped: $why"
  exit 77
fi
"$source"/tools/package_deb.sh --no-install "$@"

rm -rf "$work"
mkdir -p "$work"
trap 'rm -rf "$root"' EXIT
"$source"/tools/clean_root.sh make "$root"
in_root() { "$source"/tools/clean_root.sh run "$root" "$@"; }
files_of_root() { (cd "$root" && find usr etc opt -path '*inceres*' | sort); }

mkdir -p "$root"/packages
cp "$source"/build-deb/packages/*.deb "$root"/packages/
cp -r "$source"/tests/package "$root"/consumers

# Programs first: they need nothing that only developers have.
in_root apt-get -qq update
install() { in_root bash -c "apt-get -qq -y --no-install-recommends install $* > /dev/null"; }
install '/packages/inceres-tools_*.deb' '/packages/inceres-dropin_*.deb'
in_root bash -c 'bal_generate --preset ladybug-like --output /street.txt &&
  bal_solve --input /street.txt'
brought=$(in_root dpkg-query --show --showformat '${db:Status-Status} ${Package}\n')
if grep -E '^installed .*-dev$' <<< "$brought"; then
  echo "programs bring these development files" >&2
  exit 1
fi

# Then what a developer installs, and nothing but that.
install '/packages/*.deb' g++ cmake make pkg-config
in_root bash -euc '
  build() {
    cmake -S /consumers/$1 -B /built/$1$2 -DCMAKE_BUILD_TYPE=Release \
      ${2:+-Dinceres_SHARED=ON} > /dev/null
    cmake --build /built/$1$2 > /dev/null
    /built/$1$2/consumer
  }
  build core "" && build core _shared && build ceres _shared && build dropin ""
  ! ldd /built/core_shared/consumer | grep -E "libceres|libcholmod"
  c++ -std=c++17 /consumers/core/main.cc -o /built/by_pkg_config \
    $(pkg-config --cflags --libs inceres-core)
  /built/by_pkg_config
  cat > /tmp/plain.cc <<PLAIN
#include <cstdio>
#include <ceres/ceres.h>
struct Offset {
  template <typename T>
  bool operator()(const T* x, T* r) const { r[0] = 10.0 - x[0]; return true; }
};
int main() {
  double x = 0.5;
  ceres::Problem problem;
  using Cost = ceres::AutoDiffCostFunction<Offset, 1, 1>;
  problem.AddResidualBlock(new Cost(new Offset), nullptr, &x);
  ceres::Solver::Summary summary;
  ceres::Solve(ceres::Solver::Options(), &problem, &summary);
  std::printf("x = %.6g\n", x);
}
PLAIN
  c++ -std=c++17 -I/usr/include/eigen3 /tmp/plain.cc -o /built/plain -l:libceres.so.3 -lglog
  LD_PRELOAD=libinceres_dropin.so /built/plain 2>&1 | tee /tmp/log
  grep -q "inceres" /tmp/log || { echo "the drop-in does not tell that it is at work"; exit 1; }'

# Gone without a trace.
in_root bash -c 'apt-get -qq -y purge "libinceres*" "inceres-*" > /dev/null'
left=$(files_of_root)
[[ -z $left ]] || { echo "left behind: $left" >&2; exit 1; }
if in_root /built/core_shared/consumer 2> /dev/null; then
  echo "the shared library is still found" >&2
  exit 1
fi
echo "deb_in_clean_root.sh: installed, used and removed"
