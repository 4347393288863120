"""The stub of the C++ module has what the module has: classes, bases, functions, arguments; mypy,
where it is, finds nothing wrong in the package."""

import ast
import inspect
import pathlib
import re
import subprocess
import sys
import unittest

import inceres
from inceres import _core

PACKAGE = pathlib.Path(inceres.__file__).parent
IGNORED = {"__init__", "__enter__", "__exit__"}


def arguments_of(function):
    """Names and which have defaults, by the stub."""
    given = function.args
    positional = given.posonlyargs + given.args
    with_default = {a.arg for a in positional[len(positional) - len(given.defaults):]}
    with_default |= {a.arg for a, d in zip(given.kwonlyargs, given.kw_defaults) if d is not None}
    names = [a.arg for a in positional + given.kwonlyargs if a.arg != "self"]
    names += [given.kwarg.arg] if given.kwarg else []
    return names, with_default


def documented_arguments(function):
    """The same by the first line that pybind11 puts into a docstring."""
    line = function.__doc__.splitlines()[0]
    text = line[line.index("(") + 1:line.rindex(")")]
    text = re.sub(r"<[^>]*>", "", re.sub(r"\[[^\]]*\]", "", re.sub(r"\[[^\[\]]*\]", "", text)))
    names, with_default = [], set()
    for entry in text.split(", "):
        name = entry.split(":")[0].strip().lstrip("*")
        if name in ("self", "", "arg0"):
            continue
        names.append("options" if name == "kwargs" else name)
        if " = " in entry:
            with_default.add(name)
    return names, with_default


class StubTest(unittest.TestCase):
    def setUp(self):
        self.stub = ast.parse((PACKAGE / "_core.pyi").read_text(encoding="utf-8"))
        self.classes = {n.name: n for n in self.stub.body if isinstance(n, ast.ClassDef)}
        self.functions = {n.name: n for n in self.stub.body if isinstance(n, ast.FunctionDef)}

    def compare(self, stub, function):
        self.assertEqual(arguments_of(stub), documented_arguments(function), stub.name)

    def test_it_names_what_there_is(self):
        public = {name for name in dir(_core) if not name.startswith("_")}
        self.assertEqual(public, set(self.classes) | set(self.functions))
        for name, function in self.functions.items():
            self.compare(function, getattr(_core, name))

    def test_classes_have_their_members(self):
        for name, stub in self.classes.items():
            real = getattr(_core, name)
            self.assertEqual([base.id for base in stub.bases],
                             [base.__name__ for base in real.__bases__
                              if base.__module__ == _core.__name__], name)
            members = {n.name: n for n in stub.body if isinstance(n, ast.FunctionDef)}
            actual = {m for m in vars(real) if not m.startswith("_")}
            self.assertEqual(actual, set(members) - IGNORED, name)
            for member, function in members.items():
                value = inspect.getattr_static(real, member)
                is_property = any(
                    getattr(d, "id", "") == "property" for d in function.decorator_list)
                self.assertEqual(is_property, isinstance(value, property), f"{name}.{member}")
                if not is_property and member != "__exit__":
                    self.compare(function, getattr(real, member))

    def test_everything_public_is_documented(self):
        for name in inceres.__all__:
            value = getattr(inceres, name)
            self.assertTrue(value.__doc__ and value.__doc__.strip(), name)

    def test_mypy_agrees(self):
        try:
            import mypy  # noqa: F401
        except ImportError:
            self.skipTest("mypy is not installed (Debian: mypy)")
        run = subprocess.run(
            [sys.executable, "-m", "mypy", "--strict", "--cache-dir", "/dev/null", PACKAGE],
            capture_output=True, text=True, check=False)
        self.assertEqual(run.returncode, 0, run.stdout + run.stderr)


if __name__ == "__main__":
    unittest.main()
