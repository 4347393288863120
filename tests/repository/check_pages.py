#!/usr/bin/env python3
"""Checks that pages which list things of the code list all of them.

    check_pages.py ROOT           exit with 1 and one line for each thing that is missing
    check_pages.py --self_test    plant one omission of each kind and see that it is reported

1. docs/environment.md: every variable that the code reads, and none that nothing reads.
2. docs/json.md: every key of the summaries and of the tools' reports.
3. docs/api.md: every public header that users begin with (FOUNDATIONS are what those include).
4. mkdocs.yml: every page of docs/ has its place in the navigation.
"""

import fnmatch
import pathlib
import re
import sys

import checking

READS = re.compile(r'(?:getenv|secure_getenv|environ\.get|value_of)\(\s*"([A-Z][A-Z0-9_]+)"|'
                   r'environ\["([A-Z][A-Z0-9_]+)"\]|!ENV \[?([A-Z][A-Z0-9_]+)|'
                   r'\$\{?((?:INCERES|SITE)_[A-Z0-9_]+)')
OWN = re.compile(r"`((?:INCERES|SITE)_[A-Z_]+)`")
SUMMARY_KEY = re.compile(r'\.Add(?:String|Raw|Array)?\(\s*"([^"]+)"')
TOOL_KEY = re.compile(r'\{"([a-z0-9][a-z_0-9-]*)",\s*[^"\s]|\w+\["([a-z0-9_]+)"\]\s*=[^=]')
# Modes of the fuzzer, of replay and of living_problem, and what the fuzzer's processes tell each other.
NOT_KEYS = {"auto", "dropin", "dropin_incremental", "exact", "incremental", "plain", "rebuild", "counts", "defect"}
SUMMARIES = ("src/trust_region/summary.cc", "src/incremental/update_summary.cc")
FOUNDATIONS = {"inceres/export.h", "inceres/problem/rotation.h",
               "inceres/estimator/trajectory_error.h"}
SOURCE_FOLDERS = ("src", "adapters", "tools", "tests", "benchmarks", "examples", "docs", "bal_data")
SOURCE_SUFFIXES = (".cc", ".h", ".py", ".sh")


def sources(root, folders, suffixes):
    for folder in folders:
        for path in sorted((root / folder).rglob("*")):
            if path.suffix in suffixes:
                yield path


def text_of(path):
    return path.read_text(encoding="utf-8") if path.is_file() else ""


def words_of(page):
    return set(re.findall(r"`([^`]+)`", page))


def variables_read(root):
    found = {}
    for path in [*sources(root, SOURCE_FOLDERS, SOURCE_SUFFIXES), root / "mkdocs.yml",
                 root / "setup.py"]:
        if path.name == pathlib.Path(__file__).name:
            continue
        for match in READS.finditer(text_of(path)):
            name = match[match.lastindex]
            found.setdefault(name, path.relative_to(root).as_posix())
    return found


def check_environment(root):
    page = text_of(root / "docs/environment.md")
    listed, read = words_of(page), variables_read(root)
    for name, where in sorted(read.items()):
        if name not in listed:
            yield f"docs/environment.md does not have {name}, which {where} reads"
    for name in sorted(set(OWN.findall(page)) - set(read)):
        yield f"docs/environment.md has {name}, which nothing reads"


def check_json(root):
    listed = words_of(text_of(root / "docs/json.md"))
    for name in SUMMARIES:
        for key in sorted(set(SUMMARY_KEY.findall(text_of(root / name))) - listed):
            yield f"docs/json.md does not have the key {key} of {name}"
    for path in sources(root, ["tools"], [".cc"]):
        text = text_of(path)
        if "nlohmann::json" not in text:
            continue
        for key in sorted({a or b for a, b in TOOL_KEY.findall(text)} - listed - NOT_KEYS):
            yield f"docs/json.md does not have the key {key} of {path.relative_to(root)}"


def check_headers(root):
    page = text_of(root / "docs/api.md")
    for folder in ("include", "adapters/ceres/include"):
        for path in sources(root / folder, ["."], [".h"]):
            name = path.relative_to(root / folder).as_posix()
            if name not in FOUNDATIONS and f"{folder}/{name})" not in page:
                yield f"docs/api.md does not link to {folder}/{name}"


def check_navigation(root):
    navigation = re.findall(r"[\w/*]+\.md", text_of(root / "mkdocs.yml"))
    for path in sources(root, ["docs"], [".md"]):
        name = path.relative_to(root / "docs").as_posix()
        if not any(fnmatch.fnmatch(name, entry) for entry in navigation):
            yield f"mkdocs.yml has no entry for docs/{name}"


def problems_of(root):
    return [*check_environment(root), *check_json(root), *check_headers(root),
            *check_navigation(root)]


CLEAN = {
    "docs/environment.md": "`INCERES_MODE`, `SITE_URL`, `CMAKE_ARGS`\n",
    "docs/json.md": "`cost`, `seconds`, `ms`\n",
    "docs/api.md": "[a](../include/inceres/a.h)\n",
    "mkdocs.yml": "nav: [environment.md, json.md, api.md]\n",
    "src/a.cc": 'std::getenv("INCERES_MODE");\n',
    "bal_data/a.sh": "url=${SITE_URL:-here}\n",
    "setup.py": 'os.environ.get("CMAKE_ARGS", "")\n',
    "src/trust_region/summary.cc": 'x.Add("cost", cost).AddRaw("seconds", y);\n',
    "tools/a.cc": 'nlohmann::json j = {{"ms", 1}};\n',
    "include/inceres/a.h": "\n",
}
VIOLATIONS = [
    ("src/a.cc", "MODE", "MOOD", "does not have INCERES_MOOD"),
    ("src/a.cc", "getenv", "get", "has INCERES_MODE, which nothing reads"),
    ("bal_data/a.sh", "SITE_URL", "INCERES_URL", "does not have INCERES_URL"),
    ("setup.py", "CMAKE_ARGS", "CMAKE_FLAGS", "does not have CMAKE_FLAGS"),
    ("src/trust_region/summary.cc", "seconds", "minutes", "the key minutes"),
    ("tools/a.cc", '"ms"', '"us"', "the key us"),
    ("docs/api.md", "a.h", "b.h", "does not link to include/inceres/a.h"),
    ("mkdocs.yml", "json.md", "none", "no entry for docs/json.md"),
]


def self_test():
    failures = []
    for file, old, new, message in [("docs/api.md", "\n", "\n", None), *VIOLATIONS]:
        problems = checking.in_tree({**CLEAN, file: CLEAN[file].replace(old, new, 1)},
                                    problems_of)
        if (message is None and problems) or (message and message not in "\n".join(problems)):
            failures.append(f"{message or 'the clean tree'}: {problems or 'nothing'} was reported")
    return checking.tell(failures, f"{len(VIOLATIONS)} planted omissions are reported")


def check(root):
    return problems_of(root), (f"check_pages: {len(variables_read(root))} variables, and all keys, "
                               "headers and pages")


if __name__ == "__main__":
    sys.exit(checking.main(__doc__, self_test, check))
