#!/usr/bin/env python3
"""tools/check_includes.py accepts what the architecture allows and reports each kind of planted violation."""

import pathlib
import sys
import tempfile
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2] / "tools"))
sys.dont_write_bytecode = True
import check_includes  # noqa: E402  (the path is set above)

# A tree in miniature that follows every arrow.
CLEAN = {
    "include/inceres/status.h": "#include <string>\n",
    "include/inceres/problem/factor_graph.h": '#include "inceres/status.h"\n',
    "include/inceres/linear/reduced_solver.h": '#include "inceres/status.h"\n',
    "include/inceres/solver/options.h": '#include "inceres/linear/reduced_solver.h"\n#include "inceres/problem/factor_graph.h"\n',
    "include/inceres/io/bal.h": '#include "inceres/status.h"\n',
    "include/inceres/inceres.h": '#include "inceres/solver/options.h"\n#include "inceres/status.h"\n',
    "src/base/executor.h": "#include <memory>\n",
    "src/simd/kernels.h": "#include <cstddef>\n",
    "src/simd/kernels_avx2.cc": '#include <immintrin.h>\n#include "simd/kernels.h"\n',
    "src/simd/matrix.h": '#include <Eigen/Core>\n#include "base/executor.h"\n',
    "src/schur/schur.cc": '#include "simd/matrix.h"\n#include "inceres/problem/factor_graph.h"\n',
    "src/trust_region/solver.cc": '#include "schur/../simd/matrix.h"\n#include "inceres/solver/options.h"\n',
    "src/factors/bal.cc": '#include "inceres/problem/factor_graph.h"\n',
    "adapters/ceres/include/inceres/ceres/solve.h": '#include <ceres/solver.h>\n#include "inceres/solver/options.h"\n',
    "adapters/ceres/solve.cc": '#include "inceres/ceres/solve.h"\n',
    "tools/bal_solve.cc": '#include "inceres/ceres/solve.h"\n#include "inceres/io/bal.h"\n',
    "tests/schur/schur_test.cc": '#include <gtest/gtest.h>\n#include "simd/matrix.h"\n',
}

# What is planted: file, its whole text, and a part of the message that must name the reason.
VIOLATIONS = [
    ("src/simd/matrix.cc", '#include "inceres/problem/factor_graph.h"\n', "simd may not include problem"),
    ("src/problem/a.cc", '#include "schur/b.h"\n', "problem may not include schur"),
    ("src/linear/dense.cc", '#include "schur/b.h"\n', "linear may not include schur"),
    ("src/base/a.cc", '#include "simd/matrix.h"\n', "base may not include simd"),
    ("src/io/bal.cc", '#include "schur/b.h"\n', "io may not include schur"),
    ("src/trust_region/a.cc", '#include "inceres/io/bal.h"\n', "trust_region may not include io"),
    ("src/trust_region/b.cc", "#include <ceres/problem.h>\n", "the core may not include ceres"),
    ("src/trust_region/c.cc", '#  include "ceres/problem.h"\n', "the core may not include ceres"),
    ("include/inceres/problem/a.h", "#include <glog/logging.h>\n", "the core may not include glog"),
    ("src/trust_region/d.cc", "#include <inceres/ceres/solve.h>\n", "the core may not include adapters/"),
    ("src/trust_region/e.cc", '#include "tests/schur/schur_test.cc"\n', "the core may not include tests/"),
    ("include/inceres/solver/a.h", '#include "simd/matrix.h"\n', "a public header may not include an internal one"),
    ("include/inceres/all.h", '#include "inceres/solver/options.h"\n', "includes no module"),
    ("src/trust_region/g.cc", '#include "inceres/inceres.h"\n', "an umbrella header is for users"),
    ("include/inceres/eigen.h", '#include "simd/matrix.h"\n', "an umbrella header includes public headers only"),
    ("src/trust_region/f.cc", '#include "trust_region/no_such_file.h"\n', "no such file"),
    ("tools/b.cc", '#include "inceres/solver/no_such_file.h"\n', "no such file"),
    ("adapters/ceres/read/a.cc", '#include "adapters/ceres/plan/plan.h"\n', "read may not include plan"),
    ("src/attic/a.cc", "", "module attic is not in the architecture"),
    ("tools/a.cc", '#include "tests/schur/schur_test.cc"\n', "tools may not include tests"),
    ("src/simd/kernels_avx512.cc", "#include <Eigen/Core>\n", "no inline library code"),
    ("src/simd/kernels_neon.cc", "#include <algorithm>\n", "no inline library code"),
    # Through a header of our own.
    ("src/simd/kernels_sse.cc", '#include "simd/matrix.h"\n', "no inline library code"),
]
HELPERS = {"src/schur/b.h": "", "adapters/ceres/plan/plan.h": ""}


def write(root, files):
    for name, text in files.items():
        path = root / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")


class CheckIncludesTest(unittest.TestCase):
    def check(self, files):
        with tempfile.TemporaryDirectory() as folder:
            root = pathlib.Path(folder).resolve()
            write(root, files)
            problems, count = check_includes.check_tree(root)
            self.assertEqual(count, len(files))
            return problems

    def test_accepts_what_follows_the_arrows(self):
        self.assertEqual(self.check({**CLEAN, **HELPERS}), [])

    def test_reports_each_planted_violation(self):
        for name, text, reason in VIOLATIONS:
            with self.subTest(file=name):
                problems = self.check({**CLEAN, **HELPERS, name: text})
                self.assertTrue(problems)
                self.assertTrue(any(reason in problem for problem in problems), problems)
                if not name.startswith("src/simd/kernels_"):
                    self.assertTrue(all(problem.startswith(name + ":1:") for problem in problems), problems)

    def test_exit_code_says_whether_the_tree_is_clean(self):
        with tempfile.TemporaryDirectory() as folder:
            root = pathlib.Path(folder)
            self.assertEqual(check_includes.main([folder]), 1)  # nothing to check is no success
            write(root, CLEAN)
            self.assertEqual(check_includes.main([folder]), 0)
            write(root, {"src/simd/bad.cc": '#include "inceres/problem/factor_graph.h"\n'})
            self.assertEqual(check_includes.main([folder]), 1)
            self.assertEqual(check_includes.main(["--unknown"]), 2)


if __name__ == "__main__":
    unittest.main()
