"""What the checks of the repository have in common: their command line, and small trees to try them on."""

import pathlib
import sys
import tempfile


def in_tree(files, check):
    """check(root) of a tree with these files, by their paths."""
    with tempfile.TemporaryDirectory() as folder:
        root = pathlib.Path(folder).resolve()
        for name, text in files.items():
            (root / name).parent.mkdir(parents=True, exist_ok=True)
            (root / name).write_text(text, encoding="utf-8")
        return check(root)


def tell(failures, success):
    """What a self test prints and returns."""
    print("\n".join(failures) or success)
    return 1 if failures else 0


def main(doc, self_test, check):
    """ROOT or --self_test; check(root) returns the problems, one line each, and what to say of them."""
    arguments = sys.argv[1:]
    if arguments == ["--self_test"]:
        return self_test()
    if len(arguments) != 1 or arguments[0].startswith("-"):
        print(doc.strip())
        return 0 if arguments == ["--help"] else 2
    problems, summary = check(pathlib.Path(arguments[0]).resolve())
    for problem in problems:
        print(problem, file=sys.stderr)
    print(summary)
    return 1 if problems else 0
