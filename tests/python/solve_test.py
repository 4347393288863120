"""Around a solve: callbacks, Ctrl-C, threads and the GIL, bounds, and what graphs refuse."""

import os
import signal
import threading
import time
import unittest

import numpy as np

import inceres
from custom_family_test import bal_custom, street_graph
from bal_family import BalEvaluator
from scene import STREET, Scene


def street(family=None):
    return street_graph(family or inceres.BalReprojection(), inceres.read_bal(STREET))


class ConjugateGradientsTest(unittest.TestCase):
    def test_they_go_where_a_factor_goes(self):
        expected = street()[0].solve(function_tolerance=1e-12)["final_cost"]
        for preconditioner in ("jacobi", "schur_jacobi", "two_level", "cluster_jacobi", "cluster_tridiagonal"):
            summary = street()[0].solve(linear_model="iterative_schur", function_tolerance=1e-12,
                                        max_num_iterations=200,
                                        conjugate_gradients={"preconditioner": preconditioner, "eta": 1e-6})
            self.assertAlmostEqual(summary["final_cost"] / expected, 1.0, places=6)

    def test_a_solve_that_does_not_fit_is_refused(self):
        graph, cameras, _ = street()
        start = graph.values(cameras)
        summary = graph.solve(max_memory_bytes=10000)
        self.assertEqual(summary["termination"], "FAILURE")
        self.assertIn("max_memory_bytes is", summary["message"])
        self.assertTrue((graph.values(cameras) == start).all())

    def test_defaults_are_listed(self):
        defaults = inceres.solver_options()["conjugate_gradients"]
        self.assertEqual(defaults["preconditioner"], "jacobi")
        self.assertEqual(defaults["max_iterations"], 500)

    def test_what_is_wrong_is_named(self):
        graph = street()[0]
        with self.assertRaisesRegex(TypeError, "conjugate_gradients: unknown option 'etta'; there are eta"):
            graph.solve(conjugate_gradients={"etta": 0.1})
        with self.assertRaisesRegex(TypeError, "conjugate_gradients: 3, expected a dict"):
            graph.solve(conjugate_gradients=3)
        with self.assertRaisesRegex(ValueError, "expected one of identity, jacobi, schur_jacobi"):
            graph.solve(conjugate_gradients={"preconditioner": "ilu"})
        with self.assertRaisesRegex(ValueError, "max_iterations"):
            graph.solve(linear_model="iterative_schur", conjugate_gradients={"max_iterations": 0})


class CallbackTest(unittest.TestCase):
    def test_it_sees_every_iteration(self):
        rows = []
        summary = street()[0].solve(callback=rows.append)
        self.assertEqual(rows, summary["iterations"])
        self.assertEqual([row["iteration"] for row in rows], list(range(len(rows))))

    def test_false_stops_and_keeps(self):
        graph, cameras, _ = street()
        start = graph.values(cameras)
        summary = graph.solve(callback=lambda row: row["iteration"] < 3)
        self.assertEqual(summary["termination"], "USER_SUCCESS")
        self.assertEqual(len(summary["iterations"]), 4)
        self.assertGreater(np.abs(graph.values(cameras) - start).max(), 0)
        self.assertAlmostEqual(graph.cost(), summary["final_cost"])

    def test_what_it_raises_comes_back_and_nothing_has_moved(self):
        graph, cameras, _ = street()
        start = graph.values(cameras)

        def fail(row):
            if row["iteration"] == 2:
                raise LookupError("enough")

        with self.assertRaisesRegex(LookupError, "enough"):
            graph.solve(callback=fail)
        np.testing.assert_array_equal(graph.values(cameras), start)
        with self.assertRaisesRegex(TypeError, "callback: returned 7"):
            graph.solve(callback=lambda row: 7)

    def test_the_graph_is_out_of_reach_meanwhile(self):
        graph, cameras, _ = street()
        for name, call in [
            ("values", lambda row: graph.values(cameras) is None),
            ("validate", lambda row: graph.validate()),
            ("num_factors", lambda row: graph.num_factors() is None),
            ("num_variables", lambda row: graph.num_variables is None),
        ]:
            with self.subTest(name), self.assertRaisesRegex(
                    RuntimeError, f"^{name}: it is being solved; not in a callback"):
                graph.solve(callback=call)


class InterruptTest(unittest.TestCase):
    """Ctrl-C, as the operating system delivers it, at iteration 3."""

    @staticmethod
    def press(row):
        if row["iteration"] == 3:
            os.kill(os.getpid(), signal.SIGINT)

    def test_it_keeps_the_best_state(self):
        graph, cameras, _ = street()
        initial = graph.cost()
        with self.assertRaises(inceres.Interrupted) as caught:
            graph.solve(callback=self.press)
        summary = caught.exception.summary
        self.assertLess(summary["final_cost"], initial)
        self.assertAlmostEqual(graph.cost(), summary["final_cost"])
        self.assertIsInstance(caught.exception, KeyboardInterrupt)

    def test_in_a_factors_function_too(self):
        for at in (8, 9):
            good = BalEvaluator()

            def evaluate(*arguments):
                if good.num_calls == at:
                    good.num_calls += 1
                    raise KeyboardInterrupt
                return good(*arguments)

            graph, cameras, _ = street(bal_custom(evaluate))
            initial = graph.cost()
            good.num_calls = 0
            with self.assertRaises(inceres.Interrupted):
                graph.solve()
            self.assertLess(graph.cost(), initial)

    def test_in_a_factors_function_that_is_asked_for_the_cost(self):
        presses = [KeyboardInterrupt]
        good = BalEvaluator()

        def evaluate(*arguments):
            if presses:
                raise presses.pop()
            return good(*arguments)

        graph, _, _ = street(bal_custom(evaluate))
        with self.assertRaises(inceres.Interrupted):
            graph.cost()
        expected = street()[0].cost()
        self.assertAlmostEqual(graph.cost() / expected, 1.0, delta=1e-9)

    def test_bundle_adjust_has_the_result(self):
        bal = inceres.read_bal(STREET)
        with self.assertRaises(inceres.Interrupted) as caught:
            inceres.bundle_adjust(*bal.arrays(), callback=self.press)
        result = caught.exception.result
        self.assertEqual(result.cameras.shape, bal.cameras.shape)
        self.assertGreater(np.abs(result.cameras - bal.cameras).max(), 0)


class ThreadTest(unittest.TestCase):
    def test_others_run_while_it_solves_and_are_kept_away(self):
        graph, cameras, _ = street()
        inside, refused = threading.Event(), []
        outside = threading.Event()

        def hold(row):
            inside.set()
            self.assertTrue(outside.wait(30))

        def other():
            self.assertTrue(inside.wait(30))
            try:
                graph.set_constant(cameras)
            except RuntimeError as error:
                refused.append(str(error))
            outside.set()

        thread = threading.Thread(target=other)
        thread.start()
        graph.solve(callback=hold)
        thread.join()
        self.assertEqual(refused, ["set_constant: it is being solved by another thread"])

    def test_the_gil_is_free_between_callbacks(self):
        """A thread that counts gets on while the main thread is inside one solve."""
        bal = inceres.read_bal(STREET)
        steps, done = [0], threading.Event()

        def count():
            while not done.is_set():
                steps[0] += 1
                time.sleep(0)

        thread = threading.Thread(target=count)
        thread.start()
        # A busy machine may leave the thread hardly any time in one solve. Of a lock that is held it would get on by a step or two
        # in each of them, as the call begins and ends.
        most = 0
        for _ in range(30):
            before = steps[0]
            inceres.bundle_adjust(*bal.arrays(), function_tolerance=0, max_num_iterations=100)
            most = max(most, steps[0] - before)
            if most > 10:
                break
        done.set()
        thread.join()
        self.assertGreater(most, 10)

    def test_two_graphs_at_once(self):
        results = []
        bal = inceres.read_bal(STREET)
        expected = inceres.bundle_adjust(*bal.arrays())
        threads = [threading.Thread(
            target=lambda: results.append(inceres.bundle_adjust(*bal.arrays()))) for _ in range(3)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        for result in results:
            np.testing.assert_array_equal(result.points, expected.points)
        self.assertEqual(len(results), 3)


class GraphTest(unittest.TestCase):
    def test_bounds_are_kept(self):
        graph = inceres.FactorGraph()
        ids = graph.add_variables([[1.0, 1.0]])
        prior = graph.add_family(inceres.DiagonalPrior(2))
        graph.add_factors(prior, [ids], [[5.0, -5.0, 1.0, 1.0]])
        graph.set_bounds(ids, lower=[-np.inf, -2.0], upper=[3.0, np.inf])
        graph.solve()
        np.testing.assert_allclose(graph.values(ids), [[3.0, -2.0]], atol=1e-6)

    def test_the_cost_is_that_of_the_values_and_moves_none(self):
        graph = inceres.FactorGraph()
        ids = graph.add_variables([[4.0, 1.0], [4.0, 0.0]], constant=[False, True])
        prior = graph.add_family(inceres.DiagonalPrior(2))
        graph.add_factors(prior, ids[:, None], np.tile([5.0, 1.0, 1.0, 1.0], (2, 1)))
        graph.set_bounds(ids[:1], upper=[3.0, 3.0])
        self.assertEqual(graph.cost(), 1.5)
        np.testing.assert_array_equal(graph.values(ids), [[4.0, 1.0], [4.0, 0.0]])
        graph.solve()  # what is held and bounded still is
        np.testing.assert_allclose(graph.values(ids), [[3.0, 1.0], [4.0, 0.0]], atol=1e-6)
        self.assertAlmostEqual(graph.cost(), 3.0)

    def test_an_order_of_elimination_changes_no_result(self):
        plain, cameras, _ = street()
        expected = plain.solve()["final_cost"]
        graph, cameras, _ = street()
        graph.set_elimination_group(cameras[:1], 3)
        self.assertAlmostEqual(graph.solve()["final_cost"], expected)
        graph.set_elimination_group(cameras[:1], -1)
        with self.assertRaisesRegex(ValueError, "elimination group -1; groups are 0 or above"):
            graph.solve()

    def test_wrong_arguments_are_named(self):
        graph, cameras, points = street()
        for kind, text, call in [
            (ValueError, "^role: 'pose'", lambda: graph.add_variables([[1.0]], "pose")),
            (ValueError, r"^values: shape \(1, 3\), expected \(n, 7\)",
             lambda: graph.add_variables([[1, 2, 3]], manifold=inceres.PoseManifold())),
            (ValueError, "^family: 4 is none that add_family returned",
             lambda: graph.add_factors(4, [[0, 1]], [[0, 0]])),
            (ValueError, r"^variables: shape \(1, 3\)",
             lambda: graph.add_factors(0, [[0, 1, 2]], [[0, 0]])),
            (ValueError, "^variables: entry 1 is 9999999",
             lambda: graph.add_factors(0, [[0, 9999999]], [[0, 0]])),
            (ValueError, r"^measurements: shape \(1, 3\), expected \(1, 2\) for 'BAL repr",
             lambda: graph.add_factors(0, [[0, 16]], [[0, 0, 0]])),
            (ValueError, "^measurements: row 0, column 1 is not finite",
             lambda: graph.add_factors(0, [[0, 16]], [[0, np.nan]])),
            (ValueError, "^ids: variable 16 has 3 values, variable 0 has 9",
             lambda: graph.values([0, 16])),
            (TypeError, "^ids: not an array of whole", lambda: graph.values([0.5])),
            (ValueError, "^a: a positive|a", lambda: inceres.HuberLoss(-1.0)),
            (ValueError, "^constant: entry|constant: 3", lambda: inceres.SubsetManifold(3, [3])),
            (ValueError, "^a: variables|b: 1 ids", lambda: graph.covariance([0, 1], [0])),
        ]:
            with self.subTest(text), self.assertRaisesRegex(kind, text):
                call()
        self.assertEqual(graph.solve()["termination"], "CONVERGENCE", "nothing was added")

    def test_a_family_belongs_to_one_graph(self):
        family = inceres.BalReprojection()
        inceres.FactorGraph().add_family(family)
        with self.assertRaisesRegex(ValueError, "'BAL reprojection', has been added before"):
            inceres.IncrementalSolver().add_family(family)

    def test_none_is_no_family_and_no_manifold(self):
        for target in (inceres.FactorGraph(), inceres.IncrementalSolver()):
            with self.assertRaisesRegex(TypeError, "^add_family"):
                target.add_family(None)
        with self.assertRaisesRegex(TypeError, "^components: None is no Manifold"):
            inceres.ProductManifold([inceres.SphereManifold(3), None])
        with self.assertRaisesRegex(TypeError, "^edit"):
            inceres.IncrementalSolver.edit(None)

    def test_a_square_root_information_is_upper_triangular(self):
        planar = inceres.EuclideanManifold(3)
        pose, body = inceres.PoseManifold(), [0, 0, 0, 0, 0, 0, 1]
        for family, variables, measured, size in [
            (inceres.StereoReprojection([400, 400, 0, 0, 0.1]),
             [(body, pose), (body, pose), ([0, 0, 5], None)], [0, 0, 0], 3),
            (inceres.RelativePose(), [(body, pose)] * 2, [0, 0, 0, 1, 0, 0, 0], 6),
            (inceres.PlanarRelativePose(), [([0, 0, 0], planar)] * 2, [0, 0, 0], 3),
            (inceres.PosePrior(), [(body, pose)], body, 6),
            (inceres.SpeedBiasPrior(), [([0] * 9, None)], [0] * 9, 9),
        ]:
            with self.subTest(family.name):
                graph = inceres.FactorGraph()
                ids = [graph.add_variables([x], manifold=on)[0] for x, on in variables]
                known = graph.add_family(family)
                upper = np.triu(np.ones((size, size)))
                lower = upper.copy()
                lower[size - 1, 0] = 1e-9
                good, bad = (np.r_[measured, U.ravel()] for U in (upper, lower))
                with self.assertRaisesRegex(
                        ValueError, f"^measurements: row 1, column {len(good) - size} is 1e-09, "
                        "below the diagonal of a square root information"):
                    graph.add_factors(known, [ids, ids], [good, bad])
                self.assertEqual((family.size, graph.num_factors()), (0, 0))
                graph.add_factors(known, [ids], [good])
                self.assertEqual(graph.num_factors(), 1)

    def test_what_cannot_be_solved_is_named(self):
        graph = inceres.FactorGraph()
        ids = graph.add_variables(np.zeros((1, 3)))
        family = graph.add_family(inceres.BalReprojection())
        graph.add_factors(family, [[ids[0], ids[0]]], [[0, 0]])
        with self.assertRaisesRegex(ValueError, "factor 0 of BAL reprojection"):
            graph.solve()

    def test_summaries_are_ready_for_a_table(self):
        summary = street()[0].solve()
        keys = summary["iterations"][0].keys()
        self.assertTrue(all(row.keys() == keys for row in summary["iterations"]))
        self.assertTrue(all(np.isscalar(value) for value in summary["iterations"][0].values()))

    def test_manifolds_go_there_and_back(self):
        scene = Scene()
        for manifold in (inceres.PoseManifold(), inceres.LeftPoseManifold(), inceres.SE3Manifold()):
            delta = 0.1 * np.arange(30).reshape(5, 6) / 30
            moved = manifold.plus(scene.poses, delta)
            np.testing.assert_allclose(manifold.minus(moved, scene.poses), delta, atol=1e-12)

    def test_losses_are_what_they_say(self):
        self.assertEqual(inceres.HuberLoss(1.0).evaluate(4.0)[:2], (3.0, 0.5))
        self.assertEqual(inceres.ScaledLoss(None, 3.0).evaluate(4.0), (12.0, 3.0, 0.0))


if __name__ == "__main__":
    unittest.main()
