#!/usr/bin/env python3
"""Checks that the C++ in a Markdown file is the code that the tests compile.

    check_quoted_code.py FILE.md ROOT

Every ```cpp block of the file must follow a line `<!-- quotes PATH -->` and equal, line by line, one of the stretches between
`// [quoted in …]` and `// [end of quote]` of ROOT/PATH; every such stretch must be quoted. Exits with 1 and a message otherwise.
"""

import difflib
import pathlib
import re
import sys

BLOCK = re.compile(r"<!-- quotes (?P<path>\S+) -->\n+```cpp\n(?P<code>.*?)^```$", re.DOTALL | re.MULTILINE)
STRETCH = re.compile(r"^// \[quoted in [^\]]*\]\n(.*?)^// \[end of quote\]$", re.DOTALL | re.MULTILINE)


def main():
    document = pathlib.Path(sys.argv[1])
    root = pathlib.Path(sys.argv[2])
    text = document.read_text(encoding="utf-8")
    blocks = list(BLOCK.finditer(text))
    problems = []
    if len(blocks) != text.count("```cpp") or not blocks:
        problems.append(f"{document}: {text.count('```cpp')} C++ blocks, {len(blocks)} of them say what they quote")
    quoted = {}
    for block in blocks:
        quoted.setdefault(block["path"], []).append(block["code"])
    for path, codes in quoted.items():
        stretches = STRETCH.findall((root / path).read_text(encoding="utf-8"))
        if sorted(stretches) != sorted(codes):
            problems.append(f"{document} does not quote {path} as it is:")
            problems += difflib.unified_diff("".join(stretches).splitlines(), "".join(codes).splitlines(), path, str(document), lineterm="")
    print("\n".join(problems) or f"{len(blocks)} quotes are exact")
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main())
