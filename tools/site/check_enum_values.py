#!/usr/bin/env python3
"""Checks that every value of a public enumeration has a comment, which Doxygen does not warn of.

    check_enum_values.py FOLDER    of Doxygen's XML; one line for each value without a comment, and
                                   exit code 1 if there is any, or no enumeration at all
"""

import pathlib
import sys
import xml.etree.ElementTree as ElementTree


def is_documented(element):
    return any("".join(element.find(kind).itertext()).strip()
               for kind in ("briefdescription", "detaileddescription"))


def main(arguments):
    if len(arguments) != 1 or arguments[0].startswith("-"):
        print(__doc__.strip())
        return 0 if arguments == ["--help"] else 2
    problems, count = set(), 0
    for path in sorted(pathlib.Path(arguments[0]).glob("*.xml")):
        for member in ElementTree.parse(path).getroot().iter("memberdef"):
            if member.get("prot") == "private":
                continue
            for value in member.iter("enumvalue"):
                count += 1
                if not is_documented(value):
                    problems.add(f"{member.find('location').get('file')}: "
                                 f"{member.findtext('name')}::{value.findtext('name')} has no comment")
    if count == 0:
        problems.add(f"{arguments[0]}: no enumeration")
    print("\n".join(sorted(problems)), file=sys.stderr, end="\n" if problems else "")
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
