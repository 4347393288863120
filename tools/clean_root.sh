#!/usr/bin/env bash
# A root file system with nothing but Debian 12's base, to try in it what a stranger's machine would
# do. As root, on a machine with mmdebstrap or debootstrap; mounts are seen by the commands inside
# alone and end with them.
#
#   tools/clean_root.sh why_not               prints why it cannot work here, and succeeds then
#   tools/clean_root.sh make FOLDER           makes one, from the network
#   tools/clean_root.sh run FOLDER COMMAND…   runs COMMAND in it: as root, with the network, at /,
#                                             with a clean environment
#
# INCERES_DEBIAN_MIRROR is the mirror; INCERES_BASE_ARCHIVE a tar file of such a base, then taken.
set -euo pipefail

mirror=${INCERES_DEBIAN_MIRROR:-http://deb.debian.org/debian}

why_not() {
  if [[ $(id -u) != 0 ]]; then
    echo "clean_root.sh: needs root"
  elif ! unshare --mount true 2> /dev/null; then
    echo "clean_root.sh: may not mount here"
  elif [[ ! -e ${INCERES_BASE_ARCHIVE-} ]] && ! command -v mmdebstrap debootstrap > /dev/null; then
    echo "clean_root.sh: neither mmdebstrap nor debootstrap"
  else
    return 1
  fi
}

make() {
  local folder=$1
  mkdir -p "$folder"
  if [[ -e ${INCERES_BASE_ARCHIVE-} ]]; then
    tar --extract --file "$INCERES_BASE_ARCHIVE" --directory "$folder"
  elif command -v mmdebstrap > /dev/null; then
    mmdebstrap --quiet --variant=minbase bookworm - "$mirror" | tar --extract --directory "$folder"
  else
    debootstrap --variant=minbase bookworm "$folder" "$mirror" > /dev/null
  fi
  cp --dereference /etc/resolv.conf /etc/hosts "$folder/etc/"
  # Translations are not asked for, and no service is started.
  echo 'Acquire::Languages "none";' > "$folder/etc/apt/apt.conf.d/99clean-root"
  printf '#!/bin/sh\nexit 101\n' > "$folder/usr/sbin/policy-rc.d"
  chmod +x "$folder/usr/sbin/policy-rc.d"
}

run() {
  local folder=$1
  shift
  # shellcheck disable=SC2016 # expanded inside
  unshare --mount --propagation private bash -c '
    folder=$1; shift
    mount -t proc proc "$folder/proc" && mount --rbind /dev "$folder/dev" &&
      exec env --ignore-environment HOME=/root LC_ALL=C.UTF-8 DEBIAN_FRONTEND=noninteractive \
        PATH=/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin \
        chroot "$folder" "$@"' bash "$folder" "$@"
}

case ${1-} in
  why_not) why_not ;;
  make) make "${2:?make needs a folder}" ;;
  run) run "${2:?run needs a folder}" "${@:3}" ;;
  --help) sed -n '2,/^set/{/^#/s/^# \{0,1\}//p}' "${BASH_SOURCE[0]}" ;;
  *) echo "clean_root.sh: what is \"${1-}\"? (see --help)" >&2; exit 2 ;;
esac
