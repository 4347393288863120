#!/usr/bin/env python3
"""Checks that #include lines follow the arrows of the architecture: who may know whom.

    tools/check_includes.py [ROOT]

Prints one line per violation (file:line: what and why) and exits with 1 if there is any. ROOT is the top of the source tree,
by default the one this script is in.
"""

import pathlib
import re
import sys

# Arrows between the modules of the core; a module may also include whatever its targets may. `base` (threads, timers) is below all.
# `solver` is public headers only: what trust_region, marginal and incremental implement.
ARROWS = {
    "base": [],
    "simd": ["base"],
    "problem": ["simd"],
    "autodiff": ["problem"],
    "factors": ["problem"],
    "linearize": ["problem", "linear"],
    "schur": ["linearize"],
    "linear": ["simd"],
    "solver": ["problem", "linear"],
    "trust_region": ["schur", "linear", "solver"],
    "marginal": ["schur", "linear", "solver"],
    "incremental": ["trust_region", "marginal"],
    "robust": ["incremental"],
    "estimator": ["incremental", "factors"],
    "io": ["factors", "problem", "solver"],
    "storage": ["io", "factors", "solver"],
    "distributed": ["trust_region", "solver"],
}
# The same within adapters/ceres, between what lies in a folder there; what lies beside them may include them all.
ADAPTER = "adapters/ceres"
ADAPTER_ARROWS = {
    "read": [],
    "fallback": ["read"],
    "plan": ["read"],
    "report": ["plan"],
    "exact": ["report"],
    "covariance": ["plan"],
    "compare": ["plan", "fallback"],
    "session": ["exact", "compare"],
}
# Folders above the core: they may include every module, and these of each other.
OUTER = {
    "adapters": ["adapters"],
    "tools": ["adapters", "tools"],
    "tests": ["adapters", "tools", "tests", "benchmarks", "examples"],
    "benchmarks": ["adapters", "tools", "tests", "benchmarks"],
    "examples": ["adapters", "tools", "examples"],
    "python": ["python"],
}
# Headers at the top of include/inceres that stand above all modules.
UMBRELLAS = {"inceres.h", "eigen.h"}
# Packages that the core must build without; logging and flags belong to the tools.
FORBIDDEN_IN_CORE = ("ceres", "glog", "gflags", "gtest", "gmock", "benchmark")
# All that a kernel translation unit may pull in: types and intrinsics, no inline library code (the linker could keep a copy
# built for a newer processor).
KERNEL_SYSTEM_HEADERS = {"cstddef", "cstdint", "immintrin.h", "arm_neon.h", "stddef.h", "stdint.h"}
KERNEL_PATTERN = "src/simd/kernels_*.cc"

SUFFIXES = {".h", ".cc", ".inc"}
INCLUDE = re.compile(r'^\s*#\s*include\s*([<"])([^>"]+)[>"]')


def reachable(module, arrows):
    """The modules that `module` may include: itself and everything along the arrows."""
    seen, todo = set(), [module]
    while todo:
        current = todo.pop()
        if current not in seen:
            seen.add(current)
            todo.extend(arrows[current])
    return seen


def includes_of(path):
    """(line number, "<" or '"', header) of each #include of a file."""
    for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1):
        match = INCLUDE.match(line)
        if match:
            yield number, match.group(1), match.group(2)


def owner_of(relative):
    """(kind, module) of a file by its path from the root: kind is "root", "umbrella", "public", "internal", or an outer folder's name."""
    parts = relative.parts
    if parts[:2] == ("include", "inceres"):
        if len(parts) > 3:
            return "public", parts[2]
        return ("umbrella" if parts[2] in UMBRELLAS else "root"), None
    if parts[0] == "src":
        return "internal", parts[1]
    return parts[0], None


def resolve(root, path, header):
    """The file of this project that a header names, or None."""
    places = [root / "include", root / "src", root, root / "tests", path.parent]
    places += [root / "adapters/ceres/include", root / "examples/sliding_window"]
    for place in places:
        candidate = place / header
        if candidate.is_file():
            return candidate.resolve()
    return None


def check_core_include(kind, module, target_kind, target_module):
    """Why a core file may not include another file of this project, or None."""
    if target_kind == "root":
        return None
    if target_kind in OUTER:
        return f"the core may not include {target_kind}/"
    if kind == "umbrella":
        return None if target_kind == "public" else "an umbrella header includes public headers only"
    if target_kind == "umbrella":
        return "an umbrella header is for users: include what is needed of it"
    if kind == "root":
        return "a header at the top of include/inceres includes no module"
    if kind == "public" and target_kind == "internal":
        return "a public header may not include an internal one: it is not installed"
    if target_module not in ARROWS:
        return f"module {target_module} is not in the architecture"
    allowed = reachable(module, ARROWS)
    if target_module not in allowed:
        return f"{module} may not include {target_module} (only {', '.join(sorted(allowed))})"
    return None


def adapter_module(relative):
    """The folder of adapters/ceres that a file lies in, None beside them and elsewhere."""
    parts = relative.parts
    inside = relative.parent != pathlib.PurePath(ADAPTER) and relative.is_relative_to(ADAPTER)
    return parts[2] if inside and parts[2] in ADAPTER_ARROWS else None


def check_adapter_include(module, target):
    """Why a file of a module of the adapter may not include another file of this project, or None."""
    target_module = adapter_module(target)
    if module is None or target_module is None:
        return None
    allowed = reachable(module, ADAPTER_ARROWS)
    return None if target_module in allowed else f"{module} may not include {target_module} (only {', '.join(sorted(allowed))})"


def check_file(root, path):
    """Violations of one file as (line, header, reason)."""
    kind, module = owner_of(path.relative_to(root))
    in_core = kind not in OUTER
    if in_core and kind not in ("root", "umbrella") and module not in ARROWS:
        yield 1, "", f"module {module} is not in the architecture"
        return
    for number, bracket, header in includes_of(path):
        package = header.split("/")[0]
        if in_core and package in FORBIDDEN_IN_CORE:
            yield number, header, f"the core may not include {package}"
            continue
        target = resolve(root, path, header)
        if target is None:
            # Above the core, quotes may also name a generated header.
            if package == "inceres" or (in_core and bracket == '"'):
                yield number, header, "no such file in this project (system headers go in <>)"
            continue
        if bracket == "<" and package != "inceres":
            continue
        target_kind, target_module = owner_of(target.relative_to(root))
        if in_core:
            reason = check_core_include(kind, module, target_kind, target_module)
        else:
            allowed = target_kind not in OUTER or target_kind in OUTER[kind]
            reason = f"{kind} may not include {target_kind}" if not allowed else None
            reason = reason or check_adapter_include(adapter_module(path.relative_to(root)), target.relative_to(root))
        if reason:
            yield number, header, reason


def check_kernel(root, kernel):
    """Violations of a kernel translation unit, through the project headers it includes, as (file, line, header, reason)."""
    seen, todo = set(), [kernel]
    while todo:
        path = todo.pop()
        if path in seen:
            continue
        seen.add(path)
        for number, bracket, header in includes_of(path):
            target = resolve(root, path, header) if bracket == '"' else None
            if target is not None:
                todo.append(target)
            elif header not in KERNEL_SYSTEM_HEADERS:
                yield path, number, header, f"kernel {kernel.name} may include no inline library code"


def source_files(root):
    for folder in ["include", "src", *OUTER]:
        for path in sorted((root / folder).rglob("*")):
            if path.suffix in SUFFIXES and path.is_file():
                yield path


def check_tree(root):
    """All violations below root, as printable lines, and the number of files looked at."""
    problems, count = set(), 0
    for path in source_files(root):
        count += 1
        for number, header, reason in check_file(root, path):
            problems.add((str(path.relative_to(root)), number, header, reason))
    for kernel in sorted(root.glob(KERNEL_PATTERN)):
        for path, number, header, reason in check_kernel(root, kernel):
            problems.add((str(path.relative_to(root)), number, header, reason))
    return [f"{file}:{number}: {header}: {reason}" for file, number, header, reason in sorted(problems)], count


def main(arguments):
    if len(arguments) > 1 or any(argument.startswith("-") for argument in arguments):
        print(__doc__.strip())
        return 0 if arguments == ["--help"] else 2
    root = pathlib.Path(arguments[0] if arguments else pathlib.Path(__file__).parent.parent).resolve()
    problems, count = check_tree(root)
    if count == 0:
        problems = [f"{root}: no source files: not the top of an inceres tree"]
    for problem in problems:
        print(problem, file=sys.stderr)
    print(f"check_includes: {count} files, {len(problems)} violations")
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
