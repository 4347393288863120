#!/usr/bin/env python3
"""Checks that classes are small: at most so many lines of code in their body and members together.

    check_class_sizes.py ROOT          print one line per class that is too large, exit with 1 if
                                       there is any
    check_class_sizes.py --self_test   plant classes in a small tree and see what is reported

Lines that are neither blank nor comment count, of src, include and adapters: the class's body and
its members outside of it, in whatever file they are, for a class cut into files is no smaller. A
class of a .cc file has its members there.
"""

import collections
import re
import sys

import checking

LIMIT = 350

FOLDERS = ("src", "include", "adapters")
SUFFIXES = {".cc", ".h", ".inc"}
BODY = re.compile(r"(?:class|struct)\s+(?:[A-Z_]+EXPORT\s+)?((?:\w+::)*\w+)\b[^;]*$")
# The head of a member outside of the class: the name before the last "::" that has a "(" behind it.
MEMBER = re.compile(r"[^=(]*?\b((?:\w+::)*\w+)(?:<[^()]*>)?::(?:~?\w+|operator\S+)\s*\(")
NO_DEFINITION = (" ", "#", "//", "}", "namespace", "using", "template")


def end_of_definition(lines, begin):
    """The last line of what begins there, a body or function in column 0; None if it has none."""
    head = begin
    while head < len(lines) and not lines[head].rstrip().endswith(("{", "}", ";", ":")):
        head += 1
    if head == len(lines) or lines[head].rstrip().endswith(";"):
        return None
    if "{" in lines[head] and lines[head].rstrip().endswith("}"):
        return head
    return next((k for k in range(head, len(lines)) if lines[k] in ("}", "};")), None)


def definitions(text):
    """(name of the class, whether it is the body, its lines of code) one after the other."""
    lines = text.split("\n")
    at = 0
    while at < len(lines):
        line = lines[at]
        last = None
        if line and not line.startswith(NO_DEFINITION):
            last = end_of_definition(lines, at)
        if last is None:
            at += 1
            continue
        head = " ".join(lines[at:last + 1])
        body = BODY.match(line)
        member = None if body else MEMBER.match(head[:head.find("{") + 1] or head)
        if body or member:
            code = [l for l in lines[at:last + 1] if l.strip() and not l.strip().startswith("//")]
            yield (body or member).group(1), body is not None, len(code)
        at = last + 1


def sizes_of(root):
    """Lines of code by class; of one in a .cc file the name has the file's before it."""
    found = []  # file, class, whether it is the body, lines
    for folder in FOLDERS:
        for path in sorted((root / folder).rglob("*")):
            if path.suffix in SUFFIXES and path.is_file():
                file = path.relative_to(root).as_posix()
                found += [(file, *each) for each in definitions(path.read_text(encoding="utf-8"))]
    local = {(file, name) for file, name, is_body, _ in found if is_body and file.endswith(".cc")}
    sizes = collections.Counter()
    for file, name, _, count in found:
        sizes[f"{file}: {name}" if (file, name) in local else name] += count
    return sizes


def large_classes(root):
    """(one line per problem, number of classes)."""
    sizes = sizes_of(root)
    problems = [f"{name} has {size} lines; at most {LIMIT}" for name, size in sorted(sizes.items()) if size > LIMIT]
    if not sizes:
        problems.append(f"{root} has no classes: not the top of an inceres tree")
    return problems, len(sizes)


def lines_of(count, indent="  "):
    return "".join(f"{indent}x();\n" for _ in range(count))


def body_of(name, count):
    return f"class {name} {{\n" + lines_of(count - 2) + "};\n"


def member_of(name, count):
    return f"void {name}::F() {{\n  // not counted\n\n" + lines_of(count - 2) + "}\n"


# What is planted, and what is reported.
PLANTED = [
    ({"src/a.h": body_of("A", 350)}, []),
    ({"src/a.h": body_of("A", 351)}, ["A has 351 lines; at most 350"]),
    ({"src/a.h": body_of("A", 50), "src/a.cc": member_of("A", 200), "src/b.cc": member_of("A", 101)},
     ["A has 351 lines; at most 350"]),
    ({"src/a.cc": body_of("A", 200), "src/b.cc": body_of("A", 200) + member_of("A", 100)}, []),
    ({"src/a.cc": "struct A::Impl {\n  int x;\n};\nint A::Impl::F() const {\n" + lines_of(346) + "}\n"},
     ["src/a.cc: A::Impl has 351 lines; at most 350"]),
    ({"include/a.h": body_of("INCERES_EXPORT A", 20) + "inline int A::F() { return 1; }\n",
      "adapters/a.cc": "A::A(int x,\n     int y)\n    : x_(x) {\n" + lines_of(330) + "}\n"},
     ["A has 355 lines; at most 350"]),
]


def self_test():
    failures = []
    for files, expected in PLANTED:
        problems = checking.in_tree(files, lambda root: large_classes(root)[0])
        if problems != expected:
            failures.append(f"{list(files)}: {problems or 'nothing'} was reported, not {expected}")
    if not checking.in_tree({}, lambda root: large_classes(root)[0]):
        failures.append("an empty folder is taken for the project")
    return checking.tell(failures, f"{len(PLANTED)} planted trees are told apart")


def check(root):
    problems, num_classes = large_classes(root)
    return problems, f"check_class_sizes: {num_classes} classes, {len(problems)} problems"


if __name__ == "__main__":
    sys.exit(checking.main(__doc__, self_test, check))
