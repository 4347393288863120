#!/usr/bin/env python3
"""Writes docs/options.md: every option of the library, as the public headers say.

    options_page.py           write the page
    options_page.py --check   exit with 1 and a message if the page is not what it would write

An option is a field of a public struct whose name ends in Options, or of one that such a field has
(ImuNoise, ImuConventions). The page has its type, its default and its comment, and the values of
every enumeration that an option may have.
"""

import pathlib
import re
import sys

ROOT = pathlib.Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "options.md"
FOLDERS = ("include", "adapters/ceres/include")
# Structs in the order of the page; one that is in no section comes at its end.
SECTIONS = {
    "Solving a graph": ["SolverOptions", "GncOptions", "GaugeOptions", "JacobianCheckOptions"],
    "A graph that lives on": ["IncrementalOptions", "MarginalizationOptions", "CovarianceOptions"],
    "Solving a ceres::Problem": ["SolveOptions", "SessionOptions", "CrossCheckOptions"],
    "Visual-inertial estimation": ["SlidingWindowOptions", "ImuOptions", "ImuNoise",
                                   "ImuConventions"],
    "Files": ["ReadOptions", "GraphReadOptions", "PoseGraphOptions", "KeyframeGraphOptions"],
}
HEAD = """# Options

Every option of the library, with its type, its default and what its header says of it. This page is
written by `tools/site/options_page.py` from the headers; a test checks that it is up to date.
Options that cannot be are refused by whoever is given them, with a message that names the first
culprit; most structs have a `Validate()` that says the same beforehand.

The guides say which to touch: [tolerances](tolerances.md), [real-time budgets](real_time.md),
[what to do when it is slow](slow.md), and for an `IncrementalSolver`
[choosing thresholds](incremental.md#choosing-thresholds).
"""

STRUCT = re.compile(r"^struct (?:INCERES_EXPORT )?(\w+) \{\n(.*?)^\};", re.DOTALL | re.MULTILINE)
ENUM = re.compile(r"enum class (\w+)(?: : [\w ]+)? \{(.*?)\};", re.DOTALL)
COMMENT_BEFORE = r"((?:^[ \t]*///(?!<)[^\n]*\n)*)"
FIELD = re.compile(r"(?P<type>[A-Za-z_][\w:<>, *]*?[\w>*])\s+(?P<name>\w+(?:\[\d+\])?)"
                   r"(?:\s*(?P<braces>\{.*\})|\s*=\s*(?P<value>.*))?;$", re.DOTALL)


def comment_text(lines):
    words = " ".join(re.sub(r"^[ \t]*///<?", "", line) for line in lines).split()
    return " ".join(words)


def statements(body):
    """(comment, statement) of each declaration of a struct's body, methods and types left out."""
    before, after, code, depth = [], [], "", 0
    for line in body.splitlines() + [""]:
        text, mark, tail = line.partition("///")
        if not code and not text.strip() and mark and not tail.startswith("<"):
            before.append(line)
            continue
        text = text.split("//")[0].strip() if not mark else text.strip()
        if not code and not text:
            before = [] if not mark else before
            continue
        code = f"{code} {text}".strip()
        after += [mark + tail] if mark else []
        depth += text.count("{") + text.count("(") - text.count("}") - text.count(")")
        if depth == 0 and (code.endswith(";") or code.endswith("}")):
            yield comment_text(before) or comment_text(after), code
            before, after, code = [], [], ""


def fields_of(body):
    """(name, type, default, comment) of each field."""
    for comment, code in statements(body):
        if re.match(r"(using|enum|struct|static|friend|template)\b", code) or re.search(
                r"\)( const)?( \{.*\}|;)$", code) and "=" not in code.split("(")[0]:
            continue
        match = FIELD.match(code)
        if match is None:
            raise ValueError(f"cannot read the declaration: {code}")
        default = match["value"] or (match["braces"] if match["braces"] != "{}" else None) or ""
        yield match["name"], match["type"], " ".join(default.split()), comment


class Headers:
    """What the public headers define."""

    def __init__(self):
        self.structs, self.enums = {}, {}
        for folder in FOLDERS:
            for path in sorted((ROOT / folder).rglob("*.h")):
                self.read(path)

    def read(self, path):
        text = path.read_text(encoding="utf-8")
        where = path.relative_to(ROOT).as_posix()
        for match in STRUCT.finditer(text):
            comment = re.search(COMMENT_BEFORE + r"\Z", text[:match.start()], re.MULTILINE)[1]
            self.structs[match[1]] = (where, comment_text(first_paragraph(comment)), match[2])
        for match in ENUM.finditer(text):
            self.enums[match[1]] = list(values_of(match[2]))


def first_paragraph(comment):
    lines = []
    for line in comment.splitlines():
        if not line.strip().removeprefix("///").strip():
            break
        lines.append(line)
    return lines


def values_of(body):
    """(name, comment) of each value of an enumeration; a comment may go on in the next lines."""
    before = []
    found = []
    for line in body.splitlines() if "\n" in body else body.split(", "):
        text, mark, tail = line.partition("///")
        names = [name.strip() for name in text.split(",") if name.strip()]
        if mark and not names and not tail.startswith("<"):
            before.append(line)
            continue
        for name in names:
            comment = comment_text(before) or (comment_text([mark + tail]) if mark else "")
            found.append([name.split("=")[0].strip(), comment])
            before = []
    return found


def cell(text):
    return re.sub(r"(?<!\\)\|", r"\\|", text) or " "


def row(*cells):
    """A row of a table; the last cell, a comment, must say something."""
    if not cells[-1]:
        raise ValueError(f"{cells[0]} has no comment in its header")
    return "| " + " | ".join(cell(text) for text in cells) + " |"


def section_of(name, headers, used):
    """The table of a struct; adds the enumerations that it has to `used`."""
    where, about, body = headers.structs[name]
    header = where.partition("include/")[2]
    lines = [f"### {name}", "", f"[`{header}`](../{where}). {about}", "",
             "| option | type | default | meaning |", "|---|---|---|---|"]
    for field, kind, default, comment in fields_of(body):
        shown = f"[`{kind}`](#{kind.lower()})" if kind in headers.enums else f"`{kind}`"
        used += [kind] if kind in headers.enums and kind not in used else []
        default = default.replace(f"{kind}::", "")
        lines.append(row(f"`{field}`", shown, f"`{default}`" if default else "", comment))
    return lines + [""]


def enumeration(name, headers):
    values = [row(f"`{value}`", comment) for value, comment in headers.enums[name]]
    return [f"### {name}", "", "| value | meaning |", "|---|---|", *values, ""]


def page():
    headers = Headers()
    listed = [name for names in SECTIONS.values() for name in names]
    others = [name for name in sorted(headers.structs)
              if name.endswith("Options") and name not in listed]
    lines, used = [HEAD], []
    for title, names in [*SECTIONS.items(), *([("Others", others)] if others else [])]:
        lines += [f"## {title}", ""]
        for name in names:
            lines += section_of(name, headers, used)
    lines += ["## Values that options may have", ""]
    for name in sorted(used):
        lines += enumeration(name, headers)
    return "\n".join(lines).rstrip() + "\n"


def main(arguments):
    if arguments not in ([], ["--check"]):
        print(__doc__.strip())
        return 0 if arguments == ["--help"] else 2
    written = page()
    if not arguments:
        PAGE.write_text(written, encoding="utf-8")
    elif not PAGE.is_file() or PAGE.read_text(encoding="utf-8") != written:
        print(f"{PAGE} is not what the headers say: run tools/site/options_page.py")
        return 1
    print(f"docs/options.md: {sum(line.startswith('| `') for line in written.splitlines())} rows")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
