#!/usr/bin/env python3
"""Checks that what documents and comments refer to exists, and that a stranger finds the mathematics.

    check_documents.py ROOT          print one line per dead reference (file:line: what), exit with 1 if there is any
    check_documents.py --self_test   plant one violation of each kind in a small tree and see that it is reported

1. Paths that Markdown files name (src/..., include/..., docs/..., `inceres/....h`) exist; so do their links, with anchors.
2. Markdown files that any source names exist, and so do the sections it names: docs/algorithms.md, "Schur complement". Files
   that comments of C++ name by their path (src/....h) exist.
3. docs/algorithms.md: its first table names one file a topic, with a phrase that this file has; its table of constants gives the
   values of the code; each section says in which file it is computed.
"""

import pathlib
import posixpath
import re
import sys

import checking

# What somebody who does not know the project looks for: each is the first cell of exactly one row of the table.
TOPICS = ["S = C − W P⁻¹ Wᵀ", "Huber weight", "dog-leg point", "wildfire truncation", "LM damping", "stopping rule"]
ALGORITHMS = "docs/algorithms.md"
TOPIC_TABLE = ["what", "file", "what to look for"]
CONSTANT_TABLE = ["in the rule", "constant", "value", "file"]
SECTIONS_WITHOUT_FILE = {"Where to look", "Notation", "Constants", "Sources"}

FOLDERS = "src|include|adapters|tools|benchmarks|docs|tests|examples|cmake"
SOURCE_SUFFIXES = {".h", ".cc", ".inc", ".in", ".py", ".sh", ".cmake", ".txt", ".js", ""}
PLACEHOLDERS = {"FILE.md"}  # in usage texts

PATH = re.compile(rf"(?<![\w/.<>$}}-])(?:{FOLDERS})/[\w./*-]*[\w/*]")
HEADER = re.compile(r"(?<![\w/.-])inceres/[\w/]+\.h\b")
DOCUMENT = re.compile(r"[\w./-]*\w\.md\b")
SECTION = re.compile(r'([\w./-]*\w\.md),\s+(?:from\s+)?"([^"]+)"')
LINK = re.compile(r"!?\[[^\]]*\]\(([^)\s]+)\)")
COMMENT_BREAK = re.compile(r"\n[ \t]*(?:///?|#)[ \t]?")


def files_below(root):
    """The project's files, relative to the root; not what is built or fetched."""
    for path in sorted(root.rglob("*")):
        relative = path.relative_to(root)
        first = relative.parts[0]
        if path.is_file() and not first.startswith(("build", ".git")) and relative.parts[:2] != ("bal_data", "public"):
            yield relative


def line_of(text, position):
    return text.count("\n", 0, position) + 1


def unbroken(code):
    """The code with comments joined to one line each, for what they say may go on in the next one."""
    return COMMENT_BREAK.sub(" ", code)


def without_code(text):
    """The text with code blanked out, line by line as long as before."""
    blank = lambda match: re.sub(r"[^\n]", " ", match.group())
    return re.sub(r"`[^`\n]*`", blank, re.sub(r"^```.*?^```", blank, text, flags=re.DOTALL | re.MULTILINE))


def headings_of(text):
    return re.findall(r"^#+ +(.*?) *$", re.sub(r"^```.*?^```", "", text, flags=re.DOTALL | re.MULTILINE), re.MULTILINE)


def anchors_of(text):
    """As GitHub makes them: lower case, spaces to hyphens, no punctuation; a number for the second of a name."""
    anchors = set()
    for heading in headings_of(text):
        name = re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-")
        number = 1
        while (anchor := name if number == 1 else f"{name}-{number - 1}") in anchors:
            number += 1
        anchors.add(anchor)
    return anchors


class Tree:
    """A source tree and what was found wrong with it."""

    def __init__(self, root):
        self.root = root
        self.files = list(files_below(root))
        self.documents = {path.as_posix(): self.read(path) for path in self.files if path.suffix == ".md"}
        self.problems = []

    def read(self, relative):
        return (self.root / relative).read_text(encoding="utf-8", errors="replace")

    def report(self, file, line, what):
        self.problems.append(f"{file}:{line}: {what}")

    def exists(self, path):
        return any(True for _ in self.root.glob(path.rstrip("/"))) if "*" in path else (self.root / path).exists()

    def find_document(self, name, citing):
        """The document of this name, from the root, from the folder of who cites it, or wherever it is; None if there is none."""
        name = name.lstrip("/")
        beside = posixpath.normpath(pathlib.PurePosixPath(citing).parent / name)
        for path in [name, beside]:
            if path in self.documents:
                return path
        elsewhere = [path for path in self.documents if "/" not in name and path.endswith("/" + name)]
        return elsewhere[0] if elsewhere else None

    def check_paths(self, file, text):
        for match in PATH.finditer(text):
            if not self.exists(match.group()):
                self.report(file, line_of(text, match.start()), f"{match.group()} does not exist")
        headers = {path.as_posix() for path in self.files if path.suffix == ".h"}
        for match in HEADER.finditer(text):
            if not any(header.endswith("include/" + match.group()) for header in headers):
                self.report(file, line_of(text, match.start()), f"no public header {match.group()}")

    def check_comments(self, file, text):
        names = {path.as_posix() for path in self.files}
        for number, line in enumerate(text.splitlines(), 1):
            for match in PATH.finditer(line.partition("//")[2]):
                path = match.group()
                is_file = re.search(r"\.\w+$", path) and "*" not in path
                if is_file and path not in names and not any(name.endswith("/" + path) for name in names):
                    self.report(file, number, f"{path} does not exist")

    def check_links(self, file, text):
        for match in LINK.finditer(without_code(text)):
            target, _, anchor = match.group(1).partition("#")
            if re.match(r"[a-z]+:", target):
                continue
            path = (self.root / file).parent / target if target else self.root / file
            where = line_of(text, match.start())
            if not path.exists():
                self.report(file, where, f"the link to {match.group(1)} leads nowhere")
            elif anchor and anchor not in anchors_of(path.read_text(encoding="utf-8")):
                self.report(file, where, f"{target or file} has no section #{anchor}")

    def check_cited_documents(self, file, text):
        for match in DOCUMENT.finditer(text):
            if match.group() not in PLACEHOLDERS and self.find_document(match.group(), file) is None:
                self.report(file, line_of(text, match.start()), f"{match.group()} does not exist")
        # A title may go on in the next line of a comment: joined, the text has other line numbers.
        for match in SECTION.finditer(unbroken(text)):
            document = self.find_document(match.group(1), file)
            if document is not None and match.group(2) not in headings_of(self.documents[document]):
                self.report(file, line_of(text, text.find(match.group(1))), f'{document} has no section "{match.group(2)}"')

    def rows_of(self, header):
        """(line, cells) of the rows of the table of algorithms.md that begins with these cells; code marks taken off."""
        rows = []
        for number, line in enumerate(self.documents[ALGORITHMS].splitlines(), 1):
            cells = [cell.strip().strip("`") for cell in line.strip().strip("|").split(" | ")] if line.startswith("|") else []
            if [cell.strip() for cell in cells] == header:
                rows = [None]  # what follows belongs to it
            elif rows and not cells:
                break
            elif rows and len(cells) == len(header) and not set(line) <= set("|- "):
                rows.append((number, cells))
        return rows[1:]

    def check_topics(self):
        rows = self.rows_of(TOPIC_TABLE)
        for topic in TOPICS:
            count = sum(cells[0] == topic for _, cells in rows)
            if count != 1:
                self.report(ALGORITHMS, 1, f'"{topic}" has {count} rows in the table of where to look')
        for number, (_, file, phrase) in rows:
            if not self.exists(file):
                self.report(ALGORITHMS, number, f"{file} does not exist")
            elif phrase not in (code := self.read(file)) and phrase not in unbroken(code):
                self.report(ALGORITHMS, number, f'{file} does not have "{phrase}"')

    def check_constants(self):
        for number, (_, name, value, file) in self.rows_of(CONSTANT_TABLE):
            code = self.read(file) if self.exists(file) else ""
            group, _, field = name.rpartition(".")  # of a threshold: the struct it stands in, as the code names its member
            if group:
                begin = code.find(f"struct {group.title().replace('_', '')} {{")
                code = code[begin:code.find("  };", begin)] if begin >= 0 else ""
            if not re.search(rf"\b{field} = {re.escape(value)};", code):
                self.report(ALGORITHMS, number, f"{file} does not say {name} = {value}")

    def check_sections(self):
        for part in re.split(r"^## ", self.documents[ALGORITHMS], flags=re.MULTILINE)[1:]:
            title = part.partition("\n")[0]
            if title not in SECTIONS_WITHOUT_FILE and not re.search(r"^Computed in `", part, re.MULTILINE):
                self.report(ALGORITHMS, 1, f'section "{title}" does not say in which file it is computed')

    def check(self):
        for file, text in self.documents.items():
            self.check_paths(file, text)
            self.check_links(file, text)
        for path in self.files:
            if path.suffix == ".md" or path.suffix in SOURCE_SUFFIXES:
                self.check_cited_documents(path.as_posix(), self.read(path))
            if path.suffix in {".h", ".cc", ".inc"}:
                self.check_comments(path.as_posix(), self.read(path))
        if ALGORITHMS in self.documents:
            self.check_topics()
            self.check_constants()
            self.check_sections()
        else:
            self.report(ALGORITHMS, 1, "is missing: not the top of an inceres tree")
        return self.problems


# A tree in miniature in which everything is as it should be. (Names that do not exist are put together, so that this file, which
# is looked at too, does not cite them.)
CLEAN = {
    "README.md": "See [the mathematics](docs/algorithms.md#schur-complement), `src/a.cc` and `inceres/a.h`.\n",
    "include/inceres/a.h": "",
    "src/a.cc": f'// {ALGORITHMS}, "Schur\n// complement"\nconstexpr double kShare = 0.5;\n' +
                "".join(f"// {topic}\n" for topic in TOPICS).replace("wildfire ", "wildfire\n  // "),
    ALGORITHMS: "# Algorithms\n\n| what | file | what to look for |\n|---|---|---|\n" +
                "".join(f"| {topic} | `src/a.cc` | `{topic}` |\n" for topic in TOPICS) +
                "\n## Schur complement\n\nComputed in `src/a.cc`.\n\n## Constants\n\n| in the rule | constant | value | file |\n" +
                "|---|---|---|---|\n| half | `kShare` | 0.5 | `src/a.cc` |\n",
}
# What is planted: file, what stands there, what takes its place, and a part of the message.
VIOLATIONS = [
    ("README.md", "`src/a.cc`", "`src/b" + ".cc`", "b.cc does not exist"),
    ("README.md", "inceres/a.h", "inceres/b" + ".h", "no public header"),
    ("README.md", "#schur-complement", "#" + "nowhere", "has no section #nowhere"),
    ("README.md", "(docs/algorithms.md", "(docs/missing" + ".md", "leads nowhere"),
    ("src/a.cc", "docs/algorithms", "secret/design", "secret/design"),
    ("src/a.cc", "complement", "supplement", 'has no section "Schur supplement"'),
    ("src/a.cc", "// stopping rule", "// stopping rule, see src/b" + ".cc", "b.cc does not exist"),
    ("src/a.cc", "// Huber weight", "", 'does not have "Huber weight"'),
    ("src/a.cc", "  // truncation", "  truncation", 'does not have "wildfire truncation"'),
    ("src/a.cc", "kShare = 0.5", "kShare = 0.6", "does not say kShare = 0.5"),
    (ALGORITHMS, "| LM damping |", "| something else |", '"LM damping" has 0 rows'),
    (ALGORITHMS, "| stopping rule |", "| LM damping |", '"LM damping" has 2 rows'),
    (ALGORITHMS, "Computed in", "Somewhere in", "does not say in which file"),
]


def problems_of(files):
    return checking.in_tree(files, lambda root: Tree(root).check())


def self_test():
    failures = [f"the clean tree: {problem}" for problem in problems_of(CLEAN)]
    for file, old, new, message in VIOLATIONS:
        assert old in CLEAN[file], old
        problems = problems_of({**CLEAN, file: CLEAN[file].replace(old, new, 1)})
        if not any(message in problem for problem in problems):
            failures.append(f"{file} with {new or 'nothing'} for {old}: {problems or 'nothing'} was reported")
    if not problems_of({}):
        failures.append("an empty folder is taken for the project")
    return checking.tell(failures, f"{len(VIOLATIONS)} planted violations are reported")


def check(root):
    tree = Tree(root)
    problems = tree.check()
    return problems, (f"check_documents: {len(tree.documents)} documents, {len(tree.files)} files, "
                      f"{len(problems)} dead references")


if __name__ == "__main__":
    sys.exit(checking.main(__doc__, self_test, check))
