#!/usr/bin/env python3
"""Checks that every file that states the version states the same: check_versions.py ROOT VERSION"""

import pathlib
import re
import sys

PLACES = {
    "CMakeLists.txt": r"project\(inceres VERSION ([\d.]+)",
    "CITATION.cff": r"^version: ([\d.]+)",
    "pyproject.toml": r'^version = "([\d.]+)"',
    "python/inceres/__init__.py": r'^__version__ = "([\d.]+)"',
    "package.xml": r"<version>([\d.]+)</version>",
    "packaging/deb/changelog": r"\Ainceres \(([\d.]+)-",
    "CHANGELOG.md": r"^## ([\d.]+)",
}


def main(root, version):
    wrong = 0
    for file, pattern in PLACES.items():
        match = re.search(pattern, (root / file).read_text(encoding="utf-8"), re.MULTILINE)
        found = match.group(1) if match else "no version"
        if found != version:
            print(f"{file}: {found}, not {version}", file=sys.stderr)
            wrong += 1
    print(f"check_versions: {len(PLACES)} files, {wrong} wrong")
    return 1 if wrong else 0


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    sys.exit(main(pathlib.Path(sys.argv[1]), sys.argv[2]))
