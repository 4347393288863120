#!/usr/bin/env python3
"""Runs an example and holds what it prints, and draws, against the page that explains it.

    check_example.py PAGE PROGRAM [ARGUMENT]... [--picture FILE.svg] [--counts SHARE]

PAGE shows the output in the ```text block behind `<!-- output of PROGRAM -->`. Words must be the
same; numbers may differ by a hundredth, whole ones by another SHARE if given, or by one in the last
digit shown; times (a number before ms) are the machine's. With --picture the program gets a file
name as its last argument, and the drawing must have the elements of FILE.svg, up to a hundredth of
its width. Exits with 1 and what differs.
"""

import pathlib
import re
import subprocess
import sys
import tempfile
import xml.etree.ElementTree as ElementTree

NUMBER = re.compile(r"[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?")


def is_same_number(printed, shown, of_counts):
    is_count = "." not in shown and "e" not in shown
    decimals = len(shown.partition("e")[0].partition(".")[2])
    last_digit = 10.0 ** -decimals if "e" not in shown else 0.0
    share = of_counts if is_count else 0.01
    difference = abs(float(printed) - float(shown))
    return difference <= max(share * abs(float(shown)), 1.01 * last_digit)


def is_same_line(printed, shown, of_counts):
    """Whether a line says the same; runs of spaces count as one."""
    printed, shown = " ".join(printed.split()), " ".join(shown.split())
    if NUMBER.sub("#", printed) != NUMBER.sub("#", shown):
        return False
    return all(is_same_number(a.group(), b.group(), of_counts) or is_time(shown, b.end())
               for a, b in zip(NUMBER.finditer(printed), NUMBER.finditer(shown)))


def is_time(line, end_of_number):
    return line[end_of_number:].lstrip().startswith("ms")


def differences(printed, shown, of_counts=0.01):
    printed, shown = printed.splitlines(), shown.splitlines()
    found = [f"printed: {a}\n  shown: {b}" for a, b in zip(printed, shown)
             if not is_same_line(a, b, of_counts)]
    if len(printed) != len(shown):
        found.append(f"{len(printed)} lines are printed, {len(shown)} shown")
    return found


def shown_output(page, name):
    match = re.search(rf"^<!-- output of {re.escape(name)} -->\n+```text\n(.*?)^```$",
                      page.read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE)
    if match is None:
        sys.exit(f"{page} has no output of {name}")
    return match.group(1)


def picture_differences(drawn, committed):
    roots = [ElementTree.parse(path).getroot() for path in (drawn, committed)]
    width = float(roots[1].get("viewBox").split()[2])
    elements = [[(e.tag, sorted(e.attrib.items()), e.text or "") for e in root.iter()]
                for root in roots]
    if [tag for tag, *_ in elements[0]] != [tag for tag, *_ in elements[1]]:
        return [f"{drawn.name} has other elements than {committed}"]
    words = [str(element) for element in elements]
    if NUMBER.sub("#", words[0]) != NUMBER.sub("#", words[1]):
        return [f"{drawn.name} has other words than {committed}"]
    numbers = [[float(number) for number in NUMBER.findall(word)] for word in words]
    far = max(abs(a - b) for a, b in zip(*numbers))
    if far > 0.01 * width:
        return [f"{drawn.name}: a number is {far} from that of {committed}"]
    return []


def self_test():
    shown = "cost 12.50 to 3e-10\ntime  4.0 ms\n"
    assert not differences("cost 12.51 to 3e-10\ntime 99.0 ms\n", shown)
    for wrong in ("cost 12.7 to 3e-10\ntime 4 ms\n", "cost 12.50 to 4e-10\ntime 4.0 ms\n",
                  "costs 12.50 to 3e-10\ntime 4.0 ms\n", "cost 12.50 to 3e-10\n"):
        assert differences(wrong, shown), wrong
    assert not differences("130 rows, cost 5.00", "100 rows, cost 5.00", of_counts=0.5)
    assert differences("100 rows, cost 5.40", "100 rows, cost 5.00", of_counts=0.5)
    print("check_example.py finds what differs")


def main(arguments):
    if arguments == ["--self_test"]:
        return self_test()
    options = {"--picture": None, "--counts": "0.01"}
    while len(arguments) > 3 and arguments[-2] in options:
        options[arguments[-2]] = arguments[-1]
        arguments = arguments[:-2]
    committed = options["--picture"] and pathlib.Path(options["--picture"])
    page, program = pathlib.Path(arguments[0]), pathlib.Path(arguments[1])
    with tempfile.TemporaryDirectory() as folder:
        drawn = pathlib.Path(folder) / "picture.svg"
        command = arguments[1:] + ([str(drawn)] if committed else [])
        done = subprocess.run(command, check=False, capture_output=True, text=True)
        if done.returncode != 0:
            sys.exit(f"{program.name} ends with {done.returncode}: {done.stderr}")
        found = differences(done.stdout, shown_output(page, program.name),
                            float(options["--counts"]))
        found += picture_differences(drawn, committed) if committed else []
    print("\n".join(found) or f"{program.name} does as {page.name} says")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
