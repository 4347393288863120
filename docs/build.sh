#!/usr/bin/env bash
# Builds the site: pages by MkDocs, the reference of the public headers beside them by Doxygen.
# Fails on any warning of either, on an undocumented public symbol, and on a broken link, anchors
# included. Needs what tools/install_packages.sh --site installs; fetches nothing.
#
#   docs/build.sh [FOLDER]      build/site; what is in the folder is replaced
set -euo pipefail

if (($# > 1)) || [[ ${1:-} == -* ]]; then
  sed -n '2,6s/^# \{0,1\}//p' "$0"
  [[ ${1:-} == --help ]] && exit 0
  exit 2
fi
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
site=$(realpath --canonicalize-missing "${1:-$root/build/site}")
if [[ -e $site && ! -e $site/reference/index.html ]]; then
  echo "build.sh: $site exists and is no site of inceres: remove it, or name another folder" >&2
  exit 1
fi
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$root"

doxygen - << CONFIGURATION
@INCLUDE         = tools/site/Doxyfile
OUTPUT_DIRECTORY = $work
GENERATE_TAGFILE = $work/inceres.tag
CONFIGURATION
tools/site/check_enum_values.py "$work/xml"
export SITE_REFERENCE=$work/inceres.tag
mkdocs build --strict --site-dir "$work/site" 2> "$work/messages" || {
  grep -v INFO "$work/messages" >&2
  exit 1
}
grep 'left out' "$work/messages" || true
# Doxygen links to the list of a class's nested classes even if all are private, and it has no list.
grep -rl '#nested-classes' "$work/html" | xargs grep -L 'name="nested-classes"' |
  xargs --no-run-if-empty sed -i 's|<a href="#nested-classes">Classes</a> &#124;||'
mv "$work/html" "$work/site/reference"
tools/site/check_links.py "$work/site"
rm -rf "$site"
mkdir -p "$(dirname "$site")"
mv "$work/site" "$site"
chmod 755 "$site"
echo "build.sh: open $site/index.html"
