#!/usr/bin/env python3
"""Checks that the C++ in Markdown files is the code that the tests compile.

    check_quoted_code.py ROOT            README.md and every page of docs/
    check_quoted_code.py FILE.md ROOT    one file
    check_quoted_code.py --self_test     plant one violation of each kind: it must be reported

Every block of C++ must follow a line `<!-- quotes PATH -->` and equal, line by line, one of the
stretches between `// [quoted in FILE.md, …]` and `// [end of quote]` of ROOT/PATH, taken out of the
indentation that all its lines share; and every stretch must be quoted in each of the files that it
names. Exits with 1 and a message otherwise.
"""

import difflib
import pathlib
import re
import sys
import tempfile
import textwrap

FENCE = re.compile(r"^```(?:cpp|c\+\+|cc|cxx|C\+\+)\s", re.MULTILINE)
BLOCK = re.compile(r"<!-- quotes (?P<path>\S+) -->\n+```cpp\n(?P<code>.*?)^```$",
                   re.DOTALL | re.MULTILINE)
STRETCH = re.compile(r"^ *// \[quoted in ([^\]]*)\]\n(.*?)^ *// \[end of quote\]$",
                     re.DOTALL | re.MULTILINE)
SOURCE_FOLDERS = ("tests", "examples")


def stretches_of(source, document):
    """The stretches of a source that name the document, by its path or its name alone."""
    text = source.read_text(encoding="utf-8") if source.is_file() else ""
    return [textwrap.dedent(code) for names, code in STRETCH.findall(text)
            if any(document.endswith(name.strip()) for name in names.split(","))]


def problems_of(path, root):
    """What is wrong with the quotes of one Markdown file, and how many it has."""
    document = path.resolve().relative_to(root).as_posix()
    text = path.read_text(encoding="utf-8")
    blocks = list(BLOCK.finditer(text))
    problems = []
    if len(blocks) != len(FENCE.findall(text)):
        problems.append(f"{document}: {len(FENCE.findall(text))} C++ blocks, {len(blocks)} of them "
                        "say what they quote")
    quoted = {}
    for block in blocks:
        quoted.setdefault(block["path"], []).append(block["code"])
    for source, codes in quoted.items():
        stretches = stretches_of(root / source, document)
        if sorted(stretches) != sorted(codes):
            problems.append(f"{document} does not quote {source} as it is:")
            problems += difflib.unified_diff("".join(stretches).splitlines(),
                                             "".join(codes).splitlines(), source, document,
                                             lineterm="")
    return problems, len(blocks)


def unquoted(root):
    """Stretches that name a document which does not name their file."""
    for folder in SOURCE_FOLDERS:
        for source in sorted((root / folder).rglob("*.*")):
            if source.suffix not in (".cc", ".h"):
                continue
            where = source.relative_to(root).as_posix()
            for names, _ in STRETCH.findall(source.read_text(encoding="utf-8")):
                for name in names.split(","):
                    document = root / name.strip()
                    if not document.is_file() or (
                            f"<!-- quotes {where} -->" not in document.read_text(encoding="utf-8")):
                        yield f"{where}: {name.strip()} does not quote it"


def check_all(root):
    pages = [root / "README.md", *sorted((root / "docs").rglob("*.md"))]
    problems, count = list(unquoted(root)), 0
    for page in pages:
        found, blocks = problems_of(page, root)
        problems += found
        count += blocks
    return problems, count


# The name of a page that does not exist is put together: this file, which is looked at too, is not
# to cite it.
PAGE = "docs/a" + ".md"
CLEAN = {
    "README.md": "Text.\n",
    PAGE: "<!-- quotes tests/a_test.cc -->\n```cpp\nint x;\n```\n",
    "tests/a_test.cc": f"  // [quoted in {PAGE}]\n  int x;\n  // [end of quote]\n",
}
VIOLATIONS = [
    (PAGE, "int x;", "int y;", "does not quote tests/a_test.cc as it is"),
    ("README.md", "Text.", "```c++\nint z;\n```", "say what they quote"),
    ("tests/a_test.cc", PAGE, "README.md", "README.md does not quote it"),
    ("tests/a_test.cc", "// [quoted", f"// [quoted in {PAGE}]\n// [end of quote]\n// [quoted",
     "as it is"),
]


def self_test():
    failures = []
    for file, old, new, message in [("README.md", "", "", None), *VIOLATIONS]:
        with tempfile.TemporaryDirectory() as folder:
            root = pathlib.Path(folder).resolve()
            for name, text in CLEAN.items():
                (root / name).parent.mkdir(exist_ok=True)
                written = text.replace(old, new, 1) if name == file and old else text
                (root / name).write_text(written, encoding="utf-8")
            problems = check_all(root)[0]
        if (message is None and problems) or (message and message not in "\n".join(problems)):
            failures.append(f"{message or 'the clean tree'}: {problems or 'nothing'} was reported")
    print("\n".join(failures) or f"{len(VIOLATIONS)} planted violations are reported")
    return 1 if failures else 0


def main(arguments):
    if arguments == ["--self_test"]:
        return self_test()
    if len(arguments) not in (1, 2) or arguments[0].startswith("-"):
        print(__doc__.strip())
        return 0 if arguments == ["--help"] else 2
    root = pathlib.Path(arguments[-1]).resolve()
    if len(arguments) == 1:
        problems, count = check_all(root)
    else:
        problems, count = problems_of(pathlib.Path(arguments[0]), root)
    if not count and not problems:
        problems = ["no quotes: not what this checks"]
    print("\n".join(problems) or f"{count} quotes are exact")
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
