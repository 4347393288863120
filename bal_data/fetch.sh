#!/bin/sh
# Downloads public bundle-adjustment problems (BAL, Agarwal et al. 2010) by name. See --help.
set -eu

base_url=${INCERES_BAL_BASE_URL:-https://grail.cs.washington.edu/projects/bal/data}
here=$(CDPATH= cd -- "$(dirname -- "$0")" && pwd)
public=$here/public
checksums=$here/checksums.sha256

usage() {
  cat <<TEXT
usage: fetch.sh NAME...      downloads problems into bal_data/public/
       fetch.sh --list       prints the names

A NAME is a data set and the number of cameras, such as ladybug-49, or in full ladybug-49-7776 (data set, cameras, points).
A broken download is resumed when the same command is given again. The SHA-256 of each file is recorded in
bal_data/checksums.sha256 when it is downloaded for the first time; later downloads must have the same.

INCERES_BAL_BASE_URL: where to download from, default https://grail.cs.washington.edu/projects/bal/data
TEXT
}

# cameras-points of every problem of the collection.
names() {
  case $1 in
    ladybug) echo 49-7776 73-11032 138-19878 318-41628 372-47423 412-52215 460-56811 539-65220 598-69218 646-73584 707-78455 \
      783-84444 810-88814 856-93344 885-97473 931-102699 969-105826 1031-110968 1064-113655 1118-118384 1152-122269 1197-126327 1235-129634 \
      1266-132593 1340-137079 1469-145199 1514-147317 1587-150845 1642-153820 1695-155710 1723-156502 ;;
    trafalgar) echo 21-11315 39-18060 50-20431 126-40037 138-44033 161-48126 170-49267 174-50489 193-53101 201-54427 206-54562 \
      215-55910 225-57665 257-65132 ;;
    dubrovnik) echo 16-22106 88-64298 135-90642 142-93602 150-95821 161-103832 173-111908 182-116770 202-132796 237-154414 \
      253-163691 262-169354 273-176305 287-182023 308-195089 356-226730 ;;
    venice) echo 52-64053 89-110973 245-198739 427-310384 744-543562 951-708276 1102-780462 1158-802917 1184-816583 1238-843534 \
      1288-866452 1350-894716 1408-912229 1425-916895 1473-930345 1490-935273 1521-939551 1544-942409 1638-976803 1666-983911 \
      1672-986962 1681-983415 1682-983268 1684-983269 1695-984689 1696-984816 1706-985529 1776-993909 1778-993923 ;;
    final) echo 93-61203 394-100368 871-527480 961-187103 1936-649673 3068-310854 4585-1324582 13682-4456117 ;;
  esac
}

fail() {
  echo "fetch.sh: $*" >&2
  exit 1
}

# The full name, data set-cameras-points, of a full or short one.
resolve() {
  dataset=${1%%-*}
  for size in $(names "$dataset"); do
    if [ "$1" = "$dataset-$size" ] || [ "$1" = "$dataset-${size%-*}" ]; then
      echo "$dataset-$size"
      return
    fi
  done
  fail "no problem '$1'; fetch.sh --list prints the names"
}

sha256() {
  if command -v sha256sum > /dev/null; then sha256sum "$1"; else shasum -a 256 "$1"; fi | cut -d ' ' -f 1
}

recorded() { # the checksum on record for a file name, or nothing
  [ -f "$checksums" ] && awk -v name="$1" '$2 == name { print $1 }' "$checksums" || true
}

download() { # URL FILE: continues what is there
  curl --fail --location --silent --show-error --connect-timeout 30 --continue-at - --output "$2" "$1"
}

# What is in the partial file may be all there is (the server then has no such range) or from a server that cannot resume:
# one more try from the start.
download_or_restart() {
  download "$1" "$2" && return
  code=$?
  if [ -s "$2" ] && { [ $code -eq 22 ] || [ $code -eq 33 ] || [ $code -eq 36 ]; }; then
    echo "cannot resume, starting again" >&2
    rm -f "$2"
    download "$1" "$2" && return
    code=$?
  fi
  return $code
}

verify() { # FILE NAME: against the record; what has none must at least be whole, and is recorded
  expected=$(recorded "$2")
  actual=$(sha256 "$1")
  if [ -n "$expected" ]; then
    [ "$actual" = "$expected" ]
    return
  fi
  [ "$(head -c 3 "$1")" = BZh ] || return 1
  if command -v bzip2 > /dev/null; then
    bzip2 -t "$1" 2> /dev/null || return 1
  fi
  echo "$actual  $2" >> "$checksums"
}

fetch() { # full name
  dataset=${1%%-*}
  file=problem-${1#*-}-pre.txt.bz2
  name=$dataset-$file
  if [ -f "$public/$name" ]; then
    verify "$public/$name" "$name" || fail "$public/$name does not have the recorded checksum: remove it and fetch it again"
    echo "$name: already here, checksum right"
    return
  fi
  echo "$name: downloading $base_url/$dataset/$file"
  download_or_restart "$base_url/$dataset/$file" "$public/$name.part" ||
    fail "$name: download failed, see above; the same command resumes it"
  if ! verify "$public/$name.part" "$name"; then
    rm -f "$public/$name.part"
    fail "$name: what was downloaded is damaged or is not the recorded file (checksum); it was removed, try again"
  fi
  mv "$public/$name.part" "$public/$name"
  echo "$name: done, checksum recorded in $checksums"
}

[ $# -gt 0 ] || { usage >&2; exit 2; }
case $1 in
  -h | --help) usage; exit 0 ;;
  --list)
    for dataset in ladybug trafalgar dubrovnik venice final; do
      for size in $(names $dataset); do echo "$dataset-$size"; done
    done
    exit 0 ;;
esac
command -v curl > /dev/null || fail "needs curl"
full_names=
for name in "$@"; do
  full_names="$full_names $(resolve "$name")" # set -e ends here if there is none
done
mkdir -p "$public"
for name in $full_names; do
  fetch "$name"
done
