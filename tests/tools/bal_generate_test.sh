#!/bin/sh
# bal_generate_test.sh BAL_GENERATE BAL_DATA: the command line of bal_generate, successes and failures.
set -u
generate=$1
bal_data=$2
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
failures=0

fail() {
  echo "FAIL: $*"
  failures=$((failures + 1))
}

run() { # arguments: leaves the exit code in $code and what was printed in out and err
  "$generate" "$@" > "$work/out" 2> "$work/err"
  code=$?
}

expect_success() {
  run "$@"
  [ $code -eq 0 ] || fail "exit code $code of: $*: $(cat "$work/err")"
}

expect_failure() { # exit code, text on standard error, arguments
  wanted=$1
  text=$2
  shift 2
  run "$@"
  [ $code -eq "$wanted" ] || fail "exit code $code instead of $wanted of: $*"
  grep -qF -- "$text" "$work/err" || fail "no '$text' in the message of: $*: $(cat "$work/err")"
}

expect_printed() { grep -q -- "$1" "$work/out" || fail "no '$1' in: $(cat "$work/out")"; }

plain() { # the text of a problem file
  case $1 in
    *.gz) gzip -dc "$1" ;;
    *.bz2) bzip2 -dc "$1" ;;
    *) cat "$1" ;;
  esac
}

# The bundled problems come out of the commands in their README again.
grep -o 'bal_generate --num_cameras [^`]*' "$bal_data/README.md" > "$work/commands"
[ "$(wc -l < "$work/commands")" -eq 2 ] || fail "expected two commands in $bal_data/README.md"
while read -r _ arguments; do
  name=${arguments##* }
  # shellcheck disable=SC2086  # the arguments are meant to be split
  (cd "$work" && "$generate" $arguments > /dev/null) || fail "failed: $arguments"
  plain "$work/$name" > "$work/again.txt"
  plain "$bal_data/$name" | cmp -s - "$work/again.txt" || fail "$name is not what its command makes"
  size=$(wc -c < "$bal_data/$name")
  [ "$size" -lt 400000 ] || fail "$name has $size bytes"
done < "$work/commands"

# Presets, seeds and compressions.
expect_success --preset venice11 --output "$work/venice.txt" --truth "$work/truth.txt" --outlier_fraction 0.01
expect_printed '^observations  20271, of them 203 outliers$'
[ "$(head -n 1 "$work/venice.txt")" = "11 8366 20271" ] || fail "wrong counts of venice11"
[ "$(head -n 1 "$work/truth.txt")" = "11 8366 20271" ] || fail "wrong counts of the truth"
cmp -s "$work/venice.txt" "$work/truth.txt" && fail "the truth is the problem"
expect_success --num_cameras 12 --output "$work/a.txt"
[ "$(head -n 1 "$work/a.txt")" = "12 1200 4800" ] || fail "wrong derived counts: $(head -n 1 "$work/a.txt")"
expect_success --num_cameras 12 --output "$work/a.txt.gz"
expect_success --num_cameras 12 --output "$work/b.txt" --seed 2
gzip -dc "$work/a.txt.gz" | cmp -s - "$work/a.txt" || fail "the .gz has other contents"
cmp -s "$work/a.txt" "$work/b.txt" && fail "another seed gave the same problem"
if command -v bzip2 > /dev/null; then
  expect_success --num_cameras 12 --output "$work/a.txt.bz2"
  bzip2 -dc "$work/a.txt.bz2" | cmp -s - "$work/a.txt" || fail "the .bz2 has other contents"
else
  echo "bzip2 is missing: .bz2 not compared"
fi
expect_success --preset ladybug-like --num_points 5000 --track_length 3 --output "$work/c.txt"
[ "$(head -n 1 "$work/c.txt")" = "49 5000 15000" ] || fail "flags do not take precedence over the preset"

# Cities and collections of photos.
expect_success --preset city-50 --output "$work/city.txt"
[ "$(head -n 1 "$work/city.txt" | cut -d' ' -f1,2)" = "50 1000" ] || fail "wrong counts of city-50"
expect_success --preset city-50 --street_width 40 --output "$work/wide.txt"
cmp -s "$work/city.txt" "$work/wide.txt" && fail "the width of the streets changes nothing"
expect_success --preset city-50 --true_start --output "$work/true.txt"
expect_printed 'RMS error  *\([0-9.]*\) px at the start values, \1 px at the truth'
observations() { awk 'NR > 1 && NF == 4' "$1"; }
observations "$work/city.txt" > "$work/city.obs"
observations "$work/true.txt" | cmp -s - "$work/city.obs" || fail "--true_start changed the observations"
expect_success --preset city-50 --by_photo --output "$work/by_photo.txt"
observations "$work/by_photo.txt" > "$work/by_photo.obs"
sort -s -n -k 1,1 "$work/city.obs" | cmp -s - "$work/by_photo.obs" || fail "--by_photo is another problem, or order"
cmp -s "$work/city.obs" "$work/by_photo.obs" && fail "--by_photo changes nothing"
expect_success --preset collection-20 --output "$work/photos.txt" --truth "$work/truth.txt"
[ "$(head -n 1 "$work/photos.txt")" = "20 6513 19663" ] || fail "wrong counts: $(head -n 1 "$work/photos.txt")"
[ "$(wc -l < "$work/photos.txt")" -eq "$(wc -l < "$work/truth.txt")" ] || fail "the truth has other counts"
expect_failure 2 "--laps is not for a city" --preset city-50 --laps 2 --output "$work/x.txt"
expect_failure 2 "--drift is not for a collection" --preset collection-50 --drift 2 --output "$work/x.txt"
expect_failure 2 "--drift is not for a street" --drift 2 --output "$work/x.txt"
expect_failure 2 "after city- comes a number of cameras" --preset city-big --output "$work/x.txt"
expect_failure 2 "street_width is 3, not between 8 and 200" --preset city-50 --street_width 3 --output "$work/x.txt"

# Help is a success and names every flag.
expect_success --help
for flag in output truth preset num_cameras num_points num_observations points_per_camera track_length laps loop_fraction \
  camera_spacing pixel_noise rotation_noise position_noise focal_noise distortion_noise point_noise outlier_fraction \
  outlier_pixels seed street_width drift true_start by_photo; do
  expect_printed "--$flag "
done

# Failures: 2 for what was asked, 1 for what could not be done.
expect_failure 2 "--output FILE is required" --preset venice11
expect_failure 2 "no preset 'atlantis'; known are ladybug-like, venice11, cathedral, path-400, path-1800, path-1000, path-10000" --preset atlantis --output "$work/x.txt"
expect_failure 2 "num_cameras is 1, not between 2 and 1000000" --num_cameras 1 --output "$work/x.txt"
expect_failure 2 "num_observations is 10, not between two per point" --num_observations 10 --output "$work/x.txt"
expect_failure 2 "outlier_fraction is 1.5, not between 0 and 1" --outlier_fraction 1.5 --output "$work/x.txt"
expect_failure 2 "observations of the" --num_cameras 20 --track_length 19.9 --output "$work/x.txt"
expect_failure 2 "would be" --points_per_camera 1e9 --output "$work/x.txt"
expect_failure 2 "both say the same" --num_points 9 --points_per_camera 3 --output "$work/x.txt"
expect_failure 2 "name the same file" --output "$work/x.txt" --truth "$work/x.txt"
expect_failure 2 "surplus argument 'extra'" --output "$work/x.txt" extra
expect_failure 2 "unknown command line flag 'bogus'" --bogus --output "$work/x.txt"
expect_failure 2 "illegal value 'many'" --num_cameras many --output "$work/x.txt"
expect_failure 1 "No such file or directory" --num_cameras 12 --output "$work/no/such/directory/x.txt"
expect_failure 1 "No such file or directory" --num_cameras 12 --output "$work/y.txt" --truth "$work/no/such/directory/x.txt"
[ ! -e "$work/x.txt" ] || fail "a failure left a file behind"

[ $failures -eq 0 ] && echo "all good"
exit $((failures > 0))
