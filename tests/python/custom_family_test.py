"""Factors in Python: they come to what the built-in ones come to, one call an evaluation; and what
goes wrong in them comes back."""

import unittest

import numpy as np

import inceres
from bal_family import BalEvaluator
from scene import STREET, Scene, rotation


def street_graph(family, bal, **variables):
    graph = inceres.FactorGraph()
    cameras = graph.add_variables(bal.cameras, **variables)
    points = graph.add_variables(bal.points, "landmark")
    pairs = np.column_stack([cameras[bal.camera_indices], points[bal.point_indices]])
    graph.add_factors(graph.add_family(family), pairs, bal.observations, inceres.HuberLoss(2.0))
    return graph, cameras, points


def bal_custom(evaluate=None, **more):
    return inceres.CustomFamily(2, [9, 3], 2, evaluate or BalEvaluator(), shared=True, **more)


def ranges(measurements, parameters, wanted):
    """How far a beacon (3) is from the place of a pose (7)."""
    pose, beacon = parameters
    offset = beacon - pose[:, :3]
    distance = np.linalg.norm(offset, axis=1)
    if not wanted:
        return distance - measurements[:, 0]
    direction = (offset / distance[:, None])[:, None, :]
    by_pose = np.zeros((len(pose), 1, 7))
    by_pose[:, :, :3] = -direction
    return distance - measurements[:, 0], [by_pose, direction if wanted[1] else None]


class CustomFamilyTest(unittest.TestCase):
    def test_it_solves_as_the_built_in_one(self):
        bal = inceres.read_bal(STREET)
        for threads in (1, 2):
            evaluator = BalEvaluator()
            custom, cameras, _ = street_graph(bal_custom(evaluator), bal)
            builtin, _, _ = street_graph(inceres.BalReprojection(), bal)
            ours, theirs = (g.solve(num_threads=threads) for g in (custom, builtin))
            self.assertEqual(len(ours["iterations"]), len(theirs["iterations"]))
            for a, b in zip(ours["iterations"], theirs["iterations"]):
                self.assertAlmostEqual(a["cost"] / b["cost"], 1.0, delta=1e-9)
            work = ours["work"]
            self.assertEqual(
                evaluator.num_calls,
                work["num_residual_evaluations"] + work["num_jacobian_evaluations"])
            np.testing.assert_allclose(custom.values(cameras), builtin.values(cameras), atol=1e-5)

    def test_it_may_serve_two_families_with_one_set_of_arrays(self):
        bal = inceres.read_bal(STREET)
        half = len(bal.observations) // 2
        evaluator = BalEvaluator()
        summaries = []
        for make in (lambda: bal_custom(evaluator), inceres.BalReprojection):
            graph = inceres.FactorGraph()
            cameras = graph.add_variables(bal.cameras)
            points = graph.add_variables(bal.points, "landmark")
            pairs = np.column_stack([cameras[bal.camera_indices], points[bal.point_indices]])
            for some in (slice(0, half), slice(half, 2 * half)):
                graph.add_factors(graph.add_family(make()), pairs[some], bal.observations[some])
            summaries.append(graph.solve())
        for cost in ("initial_cost", "final_cost"):
            self.assertAlmostEqual(summaries[0][cost] / summaries[1][cost], 1.0, delta=1e-9)

    def test_its_jacobians_are_derivatives(self):
        bal = inceres.read_bal(STREET)
        some = slice(0, 200)
        parameters = [bal.cameras[bal.camera_indices[some]], bal.points[bal.point_indices[some]]]
        errors = inceres.check_jacobians(
            BalEvaluator(), bal.observations[some], parameters, shared=True)
        self.assertLess(max(errors), 1e-6)
        errors = inceres.check_jacobians(
            ranges, [[1.0]], [[[0.1, 0, 0, 0, 0, 0, 1]], [[1.0, 2.0, 3.0]]])
        self.assertLess(max(errors), 1e-8)

    def test_a_wrong_jacobian_is_seen(self):
        def wrong(measurements, parameters, wanted):
            returned = ranges(measurements, parameters, wanted)
            return (returned[0], [returned[1][0], -returned[1][1]]) if wanted else returned

        errors = inceres.check_jacobians(
            wrong, [[1.0]], [[[0.1, 0, 0, 0, 0, 0, 1]], [[1.0, 2.0, 3.0]]])
        self.assertGreater(errors[1], 0.1)

    def test_it_stands_beside_built_in_ones_on_manifolds(self):
        scene = Scene()
        graph = inceres.FactorGraph()
        poses, points = scene.disturbed()
        pose_ids = graph.add_variables(poses, manifold=inceres.PoseManifold(),
                                       constant=np.arange(5) < 2)
        point_ids = graph.add_variables(points, "landmark")
        mounted = graph.add_variables([[0, 0, 0, 0, 0, 0, 1]], manifold=inceres.PoseManifold(),
                                      constant=True)
        h = scene.in_cameras()
        family = graph.add_family(inceres.PointReprojection([400, 400, 0, 0]))
        graph.add_factors(
            family, np.column_stack([pose_ids[scene.camera_indices], np.repeat(mounted, len(h)),
                                     point_ids[scene.point_indices]]),
            400 * h[:, :2] / h[:, 2:])
        custom = graph.add_family(inceres.CustomFamily(1, [(7, 6), 3], 1, ranges, name="range"))
        distances = np.linalg.norm(h, axis=1, keepdims=True)
        graph.add_factors(
            custom, np.column_stack([pose_ids[scene.camera_indices],
                                     point_ids[scene.point_indices]]), distances)
        summary = graph.solve(function_tolerance=1e-16)
        self.assertLess(summary["final_cost"], 1e-10)
        np.testing.assert_allclose(graph.values(point_ids), scene.points, atol=1e-6)
        np.testing.assert_allclose(np.abs(rotation(graph.values(pose_ids)[:, 3:])
                                          - rotation(scene.poses[:, 3:])).max(), 0, atol=1e-7)
        covariance = graph.covariance(point_ids[:3])
        self.assertEqual(covariance.shape, (3, 3, 3))
        np.testing.assert_allclose(covariance, np.swapaxes(covariance, 1, 2), rtol=1e-9)
        self.assertTrue((np.linalg.eigvalsh(covariance) > 0).all())
        cross = graph.covariance(pose_ids[2:4], point_ids[:2])
        self.assertEqual(cross.shape, (2, 6, 3))

    def test_what_it_raises_comes_back_and_nothing_has_moved(self):
        bal = inceres.read_bal(STREET)
        good = BalEvaluator()
        for raise_at in (1, 2, 4, 5):
            calls = []

            def evaluate(*arguments):
                calls.append(1)
                if len(calls) == raise_at:
                    raise LookupError("no such beacon")
                return good(*arguments)

            graph, cameras, _ = street_graph(bal_custom(evaluate), bal)
            with self.assertRaisesRegex(LookupError, "no such beacon"):
                graph.solve()
            self.assertEqual(len(calls), raise_at, "nothing is called after a failure")
            np.testing.assert_array_equal(graph.values(cameras), bal.cameras)
            self.assertEqual(graph.solve()["termination"], "CONVERGENCE")

    def test_what_it_returns_is_checked(self):
        def returning(make):
            def evaluate(measurements, parameters, wanted):
                return make(len(measurements), wanted)
            return evaluate

        def all_of(n):
            return np.zeros((n, 2)), [np.zeros((n, 2, 9)), np.zeros((n, 2, 3))]

        bal = inceres.read_bal(STREET)
        for kind, text, make in [
            (ValueError, r"^lens: residuals: shape \(3,\)",
             lambda n, w: (np.zeros(3), all_of(n)[1])),
            (TypeError, "^lens: with Jacobians wanted", lambda n, w: all_of(n)[0]),
            (TypeError, "^lens: jacobians: expected a list of 2",
             lambda n, w: (all_of(n)[0], [all_of(n)[1][0]])),
            (ValueError, r"^lens: jacobian of slot 1: shape .* expected",
             lambda n, w: (all_of(n)[0], [all_of(n)[1][0]] * 2)),
            (TypeError, "^lens: residuals: not an array",
             lambda n, w: ([["a", "b"]] * n, all_of(n)[1])),
        ]:
            graph, _, _ = street_graph(bal_custom(returning(make), name="lens"), bal)
            with self.assertRaisesRegex(kind, text):
                graph.solve()

    def test_numbers_that_are_not_finite_name_the_factor(self):
        bal = inceres.read_bal(STREET)
        for slot in (None, 1):
            def evaluate(*arguments, good=BalEvaluator(), slot=slot):
                returned = good(*arguments)
                if arguments[2]:
                    broken = returned[0].copy() if slot is None else returned[1][slot].copy()
                    broken[17] = np.nan
                    return ((broken, returned[1]) if slot is None
                            else (returned[0], [returned[1][0], broken]))
                return returned

            graph, _, _ = street_graph(bal_custom(evaluate, name="lens"), bal)
            summary = graph.solve()
            self.assertEqual(summary["termination"], "FAILURE")
            self.assertIn("factor 17 of lens", summary["message"] + summary["detail"])


if __name__ == "__main__":
    unittest.main()
