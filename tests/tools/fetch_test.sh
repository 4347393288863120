#!/bin/sh
# fetch_test.sh BAL_DATA: runs fetch_test.py, or says what is missing to run it.
for program in python3 curl; do
  if ! command -v $program > /dev/null; then
    echo "skipped: needs $program"
    exit 77
  fi
done
exec python3 "$(dirname -- "$0")/fetch_test.py" "$1"
