#!/usr/bin/env python3
"""bal_solve_mpi under mpiexec: the result of one process on 1, 2, 3 and 5 ranks, files, PETSc's
options, a rank that is killed. Arguments: mpiexec, bal_solve_mpi, bal_solve, the top of the source
tree."""

import json
import pathlib
import subprocess
import sys
import tempfile
import unittest

MPIEXEC, TOOL, SOLVE, ROOT = sys.argv[1:]
STREET = f"{ROOT}/bal_data/street-16-1200-pre.txt"
EXACT = ["--linear_solver", "conjugate_gradients", "--eta", "1e-12",
         "--max_linear_solver_iterations", "5000"]


class BalSolveMpiTest(unittest.TestCase):
    def setUp(self):
        directory = tempfile.TemporaryDirectory()
        self.addCleanup(directory.cleanup)
        self.folder = pathlib.Path(directory.name)

    def run_on(self, ranks, *flags, code=0, program=(TOOL,)):
        """(standard output, standard error); nothing may hang."""
        done = subprocess.run([MPIEXEC, "--map-by", ":OVERSUBSCRIBE", "-n", str(ranks), *program,
                               *map(str, flags)], cwd=self.folder, capture_output=True, text=True,
                              timeout=60, check=False)
        self.assertEqual(done.returncode, code, f"{flags}\n{done.stdout}\n{done.stderr}")
        return done.stdout, done.stderr

    def solve(self, ranks, *flags):
        self.run_on(ranks, *flags, "--json", "report.json")
        return json.loads((self.folder / "report.json").read_text(encoding="utf-8"))

    def alone(self, path, *flags):
        subprocess.run([SOLVE, "--builtin_factors", "--input", path, "--json", "alone.json",
                        "--linear_solver", "dense_schur", *flags], cwd=self.folder, check=True,
                       capture_output=True, timeout=60)
        return json.loads((self.folder / "alone.json").read_text(encoding="utf-8"))

    def check(self, report, alone, ranks):
        self.assertAlmostEqual(report["final_cost"] / alone["final_cost"], 1.0, delta=1e-10)
        self.assertAlmostEqual(report["initial_cost"] / alone["initial_cost"], 1.0, delta=1e-12)
        self.assertEqual(report["iterations"], alone["iterations"])
        self.assertEqual(len(report["ranks"]), ranks)
        self.assertEqual(sum(rank["num_factors"] for rank in report["ranks"]),
                         report["num_observations"])

    def test_any_number_of_ranks(self):
        alone = self.alone(STREET, "--robust", "huber:1")
        for ranks in (1, 2, 3, 5):
            for way in (EXACT, ["--linear_solver", "cholesky", "--partition", "ptscotch"]):
                report = self.solve(ranks, "--input", STREET, "--robust", "huber:1", *way)
                self.check(report, alone, ranks)
                self.assertLess(report["partition"]["imbalance"], 1.1)
                if ranks == 2 and way is EXACT:
                    for rank in report["ranks"]:
                        self.assertLessEqual(rank["exchange_bytes_per_product"],
                                             1.5 * rank["shared_frame_bytes"])
                        self.assertGreaterEqual(rank["bytes_sent"], rank["num_products"])

    def test_files(self):
        self.alone(STREET, "--output", "alone.balb", "--max_num_iterations", "0")
        subprocess.run(f"gzip -c {STREET} > street.txt.gz", shell=True, check=True,
                       cwd=self.folder)
        alone = self.alone(STREET)
        for name in ("alone.balb", "street.txt.gz"):
            report = self.solve(3, "--input", name, "--output", "solved.balb", *EXACT)
            self.check(report, alone, 3)
            again = self.alone("solved.balb")
            self.assertAlmostEqual(again["initial_cost"] / alone["final_cost"], 1.0, delta=1e-9)

    def test_generated(self):
        report = self.solve(2, "--generate", "venice11", "--max_num_iterations", "3")
        self.assertEqual((report["num_cameras"], report["num_points"]), (11, 8366))

    def test_petscs_options(self):
        alone = self.alone(STREET)
        report = self.solve(2, "--input", STREET, "--linear_solver", "ksp", "--eta", "1e-12",
                            "--form_schur_complement", "-inceres_ksp_type", "fcg",
                            "-inceres_pc_type", "bjacobi")
        self.assertIn("fcg, preconditioned by bjacobi", report["solver"])
        self.check(report, alone, 2)
        _, errors = self.run_on(2, "--input", STREET, "--linear_solver", "ksp",
                                "-inceres_pc_type", "ilu", code=1)
        self.assertIn("needs the entries of S", errors)
        text, _ = self.run_on(2, "--input", STREET, "-log_view", "--max_num_iterations", "2")
        for stage in ("inceres eliminate", "inceres reduced"):
            self.assertIn(stage, text)

    def test_what_makes_no_sense(self):
        for flags, code, why in ((["--input", "no/file"], 1, "no/file"),
                                 ([], 2, "--input FILE"),
                                 (["--input", STREET, "--linear_solver", "lu"], 2, "'lu'"),
                                 (["--input", STREET, "--nosuch"], 2, "nosuch"),
                                 (["--generate", "nowhere"], 2, "nowhere")):
            text, errors = self.run_on(3, *flags, code=code)
            self.assertEqual(text, "")
            self.assertEqual(errors.count("bal_solve_mpi: "), 1, errors)
            self.assertIn(why, errors)
        (self.folder / "cut.txt").write_bytes(pathlib.Path(STREET).read_bytes()[:-40])
        _, errors = self.run_on(3, "--input", "cut.txt", code=1)
        self.assertIn("bal_solve_mpi: cut.txt:", errors)

    def test_a_killed_rank_ends_all_and_the_checkpoint_is_whole(self):
        whole = self.solve(2, "--input", STREET, *EXACT)
        killer = ('if [ "$OMPI_COMM_WORLD_RANK" = 1 ]; then '
                  '(until [ -e state ]; do sleep 0.01; done; kill -9 $$) & fi; exec "$@"')
        # Goes on until it is killed.
        done = subprocess.run(
            [MPIEXEC, "--map-by", ":OVERSUBSCRIBE", "-n", "3", "bash", "-c", killer, "rank", TOOL,
             "--input", STREET, *EXACT, "--checkpoint", "state", "--checkpoint_every", "2",
             "--function_tolerance", "0", "--parameter_tolerance", "0", "--gradient_tolerance",
             "0", "--max_num_iterations", "100000"],
            cwd=self.folder, capture_output=True, text=True, timeout=60, check=False)
        self.assertNotEqual(done.returncode, 0)
        for ranks in (1, 2, 5):
            report = self.solve(ranks, "--input", STREET, *EXACT, "--resume", "state")
            self.assertGreaterEqual(report["summary"]["iterations"][0]["iteration"], 2)
            self.assertAlmostEqual(report["final_cost"] / whole["final_cost"], 1.0, delta=1e-6)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
