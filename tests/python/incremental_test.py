"""IncrementalSolver: problems that grow and shrink in batches end where a batch solve ends."""

import threading
import unittest

import numpy as np

import inceres
from bal_family import BalEvaluator
from scene import STREET

HUBER = inceres.HuberLoss(2.0)


class Growing:
    """A street, camera by camera: a point comes with the first camera that sees it."""

    def __init__(self, family=None, **options):
        self.bal = inceres.read_bal(STREET)
        self.solver = inceres.IncrementalSolver(function_tolerance=1e-9, max_num_iterations=100, **options)
        self.family = self.solver.add_family(family or inceres.BalReprojection())
        self.prior = self.solver.add_family(inceres.DiagonalPrior(9))
        self.cameras = np.full(len(self.bal.cameras), -1, np.int32)
        self.points = np.full(len(self.bal.points), -1, np.int32)
        self.factors = np.full((len(self.bal.observations), 3), -1, np.int32)

    def add_camera(self, i):
        bal = self.bal
        seen = np.flatnonzero(bal.camera_indices == i)
        points = np.unique(bal.point_indices[seen])
        new = points[self.points[points] < 0]
        with self.solver.edit() as edit:
            self.cameras[i] = edit.add_variables(bal.cameras[[i]])[0]
            self.points[new] = edit.add_variables(bal.points[new], "landmark")
            pairs = np.column_stack([
                np.full(len(seen), self.cameras[i]), self.points[bal.point_indices[seen]]])
            self.factors[seen] = edit.add_factors(self.family, pairs, bal.observations[seen], HUBER)
            weights = np.r_[np.full(6, 10.0), 0.1, 10.0, 10.0]
            edit.add_factors(self.prior, [[self.cameras[i]]], [np.r_[bal.cameras[i], weights]])

    def batch_cost(self, keep):
        """The minimum for the observations `keep`, from the same start."""
        bal, graph = self.bal, inceres.FactorGraph()
        cameras = graph.add_variables(bal.cameras)
        points = graph.add_variables(bal.points, "landmark")
        unseen = np.bincount(bal.point_indices[keep], minlength=len(points)) == 0
        graph.set_constant(points[unseen])
        pairs = np.column_stack([cameras[bal.camera_indices], points[bal.point_indices]])[keep]
        graph.add_factors(graph.add_family(inceres.BalReprojection()), pairs,
                          bal.observations[keep], HUBER)
        weights = np.tile(np.r_[np.full(6, 10.0), 0.1, 10.0, 10.0], (len(cameras), 1))
        graph.add_factors(graph.add_family(inceres.DiagonalPrior(9)), cameras[:, None],
                          np.hstack([bal.cameras, weights]))
        return graph.solve(function_tolerance=1e-12)["final_cost"]


class IncrementalTest(unittest.TestCase):
    def check_growth(self, family=None):
        street = Growing(family)
        for i in range(16):
            street.add_camera(i)
            summary = street.solver.update()
            self.assertEqual(summary["termination"], "CONVERGENCE")
        everything = np.arange(len(street.factors))
        expected = street.batch_cost(everything)
        self.assertAlmostEqual(street.solver.cost / expected, 1.0, delta=1e-5)
        self.assertEqual(street.solver.num_variables,
                         16 + len(np.unique(street.bal.point_indices)))

        gone = everything[::7]
        with street.solver.edit() as edit:
            edit.remove_factors(street.factors[gone])
        street.solver.update()
        expected = street.batch_cost(np.setdiff1d(everything, gone))
        self.assertAlmostEqual(street.solver.cost / expected, 1.0, delta=1e-5)
        return street

    def test_it_ends_where_a_batch_solve_does(self):
        street = self.check_growth()
        with self.assertRaisesRegex(ValueError, "factor|generation"):
            with street.solver.edit() as edit:
                edit.remove_factors(street.factors[:1])

    def test_with_factors_in_python_too(self):
        evaluator = BalEvaluator()
        self.check_growth(inceres.CustomFamily(2, [9, 3], 2, evaluator, shared=True))
        self.assertGreater(evaluator.num_calls, 100)

    def test_an_edit_is_all_or_nothing(self):
        street = Growing()
        street.add_camera(0)
        before = street.solver.num_factors, street.solver.num_variables
        with self.assertRaisesRegex(ValueError, "variable 5000"):
            with street.solver.edit() as edit:
                edit.add_variables(street.bal.cameras[[1]])
                edit.remove_variables([5000])
        with self.assertRaises(LookupError):
            with street.solver.edit() as edit:
                edit.add_variables(street.bal.cameras[[1]])
                raise LookupError
        self.assertEqual(before, (street.solver.num_factors, street.solver.num_variables))
        street.add_camera(1)
        self.assertEqual(street.solver.update()["termination"], "CONVERGENCE")

    def test_an_edit_that_is_refused_leaves_the_factors_of_another_alone(self):
        def offsets(measurements, parameters, wanted):
            (values, index), = parameters
            residuals = values[index] - measurements
            return (residuals, [np.ones((len(index), 1, 1))]) if wanted else residuals

        solver = inceres.IncrementalSolver(function_tolerance=1e-14)
        prior = solver.add_family(inceres.DiagonalPrior(1))
        custom = solver.add_family(inceres.CustomFamily(1, [1], 1, offsets, shared=True))
        with solver.edit() as edit:
            ids = edit.add_variables(np.zeros((2, 1)))
            edit.add_factors(prior, ids[:, None], [[2.0, 1.0], [4.0, 1.0]])
        first, second = solver.edit(), solver.edit()
        for edit, i, value in [(first, 0, 5.0), (second, 1, -8.0)]:  # at the same places
            edit.add_factors(custom, [ids[i:i + 1]], [[value]])
            edit.add_factors(prior, [ids[i:i + 1]], [[value, 1.0]])
        first.apply()
        with self.assertRaisesRegex(ValueError, "begin it anew"):
            second.apply()
        solver.update()
        np.testing.assert_allclose(solver.values(ids), [[4.0], [4.0]], atol=1e-6)
        second.restart()
        second.apply()
        self.assertEqual(solver.num_factors, 4)

    def test_an_edit_has_its_own_copy_of_measurements(self):
        solver = inceres.IncrementalSolver(function_tolerance=1e-14)
        prior = solver.add_family(inceres.DiagonalPrior(1))
        rows = np.array([[3.0, 1.0]])
        with solver.edit() as edit:
            ids = edit.add_variables([[0.0]])
            edit.add_factors(prior, [ids], rows)
            rows[:] = 7.0
        solver.update()
        np.testing.assert_allclose(solver.values(ids), [[3.0]], atol=1e-6)

    def test_edits_set_what_they_say(self):
        street = Growing()
        for i in range(3):
            street.add_camera(i)
        street.solver.update()
        factor, camera = street.factors[:1], street.cameras[:1]
        with street.solver.edit() as edit:
            edit.set_constant(camera)
            edit.set_values(street.points[street.bal.point_indices[:1]], [[1.0, 2.0, -3.0]])
            edit.set_measurements(factor, street.bal.observations[:1] + 0.5)
            edit.set_loss(factor, None)
        held = street.solver.values(camera)
        street.solver.update()
        np.testing.assert_array_equal(street.solver.values(camera), held)
        other = street.solver.edit()
        other.remove_variables(camera)
        other.restart()
        other.apply()
        self.assertEqual(street.solver.values(camera).shape, (1, 9))
        with street.solver.edit() as edit:
            edit.remove_variables(camera)
        with self.assertRaisesRegex(ValueError, f"ids: variable {camera[0]} was removed"):
            street.solver.values(camera)

    def test_a_marginalized_camera_leaves_a_prior(self):
        street = Growing()
        for i in range(4):
            street.add_camera(i)
        street.solver.update()
        seen = street.bal.camera_indices == 0
        points = street.points[np.unique(street.bal.point_indices[seen])]
        result = street.solver.marginalize(np.r_[street.cameras[:1], points], allow_rank_loss=True)
        self.assertGreater(result["rank"], 0)
        self.assertTrue(set(result["kept"]) <= set(street.cameras[1:4]))
        self.assertNotEqual(street.solver.update()["termination"], "FAILURE")

    def test_families_come_after_a_marginalization_too(self):
        def differences(measurements, parameters, wanted):
            residuals = parameters[1] - parameters[0] - measurements
            ones = np.ones((len(residuals), 1, 1))
            return (residuals, [-ones, ones]) if wanted else residuals

        solver = inceres.IncrementalSolver(function_tolerance=1e-14)
        prior = solver.add_family(inceres.DiagonalPrior(1))
        difference = solver.add_family(inceres.CustomFamily(1, [1, 1], 1, differences))
        with solver.edit() as edit:
            ids = edit.add_variables([[0.0], [0.0]])
            edit.add_factors(prior, ids[:1, None], [[0.0, 1.0]])
            edit.add_factors(difference, [ids], [[1.0]])
        solver.update()
        solver.marginalize(ids[:1])  # the solver's own prior: 1 with variance 2
        own = max(prior, difference) + 1
        edit = solver.edit()
        for family in (own, own + 1):
            with self.assertRaisesRegex(
                    ValueError, f"^family: {family} is none that add_family returned"):
                edit.add_factors(family, ids[1:, None], [[3.0, 1.0]])
        later = solver.add_family(inceres.DiagonalPrior(1))
        self.assertEqual(later, own + 1)
        with solver.edit() as edit:
            edit.add_factors(later, ids[1:, None], [[3.0, 1.0]])
            with self.assertRaisesRegex(ValueError, f"^family: {own} is none that"):
                edit.remove_factors([[own, 0, 0]])
        solver.update()
        np.testing.assert_allclose(solver.values(ids[1:]), [[7.0 / 3.0]], atol=1e-6)

    def test_covariances_shrink_with_views(self):
        street = Growing()
        traces = []
        for i in range(6):
            street.add_camera(i)
            street.solver.update()
            if i >= 3:  # without what one view alone does not determine
                views = np.bincount(street.bal.point_indices[street.bal.camera_indices <= i],
                                    minlength=len(street.points))
                with street.solver.edit() as edit:
                    edit.set_constant(street.points[views == 1])
                traces.append(np.trace(street.solver.covariance(street.cameras[:1])[0]))
        self.assertLess(traces[-1], traces[0])

    def test_live_covariances_are_those_of_all_linearized_anew(self):
        street = Growing()
        for i in range(4):
            street.add_camera(i)
        street.solver.update()
        views = np.bincount(street.bal.point_indices[street.bal.camera_indices <= 3],
                            minlength=len(street.points))
        with street.solver.edit() as edit:
            edit.set_constant(street.points[views == 1])
        street.solver.update()
        pair = street.cameras[:2]
        joint, staleness = street.solver.live_covariance(pair, accuracy="exact")
        self.assertEqual(joint.shape, (18, 18))
        self.assertIn("num_stale_factors", staleness)
        for algorithm in ("schur", "qr"):
            own = street.solver.covariance(pair, algorithm=algorithm)
            np.testing.assert_allclose(joint[:9, :9], own[0], rtol=0, atol=1e-6 * own[0].max())
            np.testing.assert_allclose(joint[9:, 9:], own[1], rtol=0, atol=1e-6 * own[1].max())
        with self.assertRaisesRegex(ValueError, "accuracy: 'rough' is none of as_factored"):
            street.solver.live_covariance(pair, accuracy="rough")
        with self.assertRaisesRegex(ValueError, "algorithm: 'lu' is none of schur, qr, dense_svd"):
            street.solver.covariance(pair, algorithm="lu")
        with self.assertRaisesRegex(ValueError, "null_space_rank"):
            street.solver.covariance(pair, algorithm="dense_svd", null_space_rank=-2)

    def test_bounds_hold_values(self):
        solver = inceres.IncrementalSolver(function_tolerance=1e-14)
        prior = solver.add_family(inceres.DiagonalPrior(2))
        with solver.edit() as edit:
            ids = edit.add_variables(np.zeros((3, 2)))
            edit.add_factors(prior, ids[:, None], np.tile([3.0, -3.0, 1.0, 1.0], (3, 1)))
        with solver.edit() as edit:
            edit.set_bounds(ids[:2], lower=[-1.0, -2.0], upper=np.full((2, 2), 2.5))
        solver.update()
        np.testing.assert_allclose(solver.values(ids), [[2.5, -2.0], [2.5, -2.0], [3.0, -3.0]])
        with self.assertRaisesRegex(ValueError, "not below"):
            with solver.edit() as edit:
                edit.set_bounds(ids, lower=[1.0, 1.0], upper=[0.0, 0.0])
        with solver.edit() as edit:
            edit.set_bounds(ids)
        solver.update()
        np.testing.assert_allclose(solver.values(ids), np.tile([3.0, -3.0], (3, 1)))

    def test_frames_are_put_into_groups(self):
        solver = inceres.IncrementalSolver()
        prior = solver.add_family(inceres.DiagonalPrior(2))
        with solver.edit() as edit:
            ids = edit.add_variables(np.zeros((3, 2)))
            edit.add_factors(prior, ids[:, None], np.tile([3.0, -3.0, 1.0, 1.0], (3, 1)))
            edit.set_elimination_group(ids[:1], 2)
        solver.update()
        np.testing.assert_allclose(solver.values(ids), np.tile([3.0, -3.0], (3, 1)), atol=1e-6)
        with self.assertRaisesRegex(ValueError, "is given the group -5"):
            with solver.edit() as edit:
                edit.set_elimination_group(ids, -5)

    def test_callbacks_read_values_and_stop(self):
        street = Growing(batch_share=1.0)
        for i in range(4):
            street.add_camera(i)
        rows = []

        def look(row):
            rows.append((row, street.solver.values(street.cameras[:4])))
            return len(rows) < 3

        summary = street.solver.update(look)
        self.assertEqual(summary["termination"], "USER_SUCCESS")
        self.assertEqual(len(rows), 3)
        np.testing.assert_array_equal(rows[-1][1], street.solver.values(street.cameras[:4]))
        street.solver.request_stop()
        self.assertLessEqual(street.solver.update()["num_iterations"], 2)

    def test_other_threads_are_kept_away(self):
        street = Growing()
        for i in range(4):
            street.add_camera(i)
        messages = []

        def look(row):
            def reach():
                try:
                    street.solver.values(street.cameras[:1])
                except RuntimeError as error:
                    messages.append(str(error))

            thread = threading.Thread(target=reach)
            thread.start()
            thread.join()
            return False

        street.solver.update(look)
        self.assertEqual(messages, ["values: it is being solved by another thread"])

    def test_callbacks_are_kept_away(self):
        street = Growing()
        for i in range(4):
            street.add_camera(i)
        edit = street.solver.edit()
        for name, call in [
            ("marginalize", lambda row: street.solver.marginalize([-1])),
            ("live_covariance", lambda row: street.solver.live_covariance([-1])),
            ("restart", lambda row: edit.restart()),
        ]:
            with self.subTest(name), self.assertRaisesRegex(
                    RuntimeError, f"^{name}: it is being solved; not in a callback"):
                street.solver.update(call)

    def test_an_exception_is_raised_once_though_others_were_raised_too(self):
        def failing(kind, is_due):
            def evaluate(measurements, parameters, wanted):
                if is_due():
                    raised.append(kind)
                    raise kind
                residuals = parameters[0] - measurements
                return (residuals, [np.ones((len(residuals), 1, 1))]) if wanted else residuals
            return evaluate

        raised = []
        solver = inceres.IncrementalSolver(function_tolerance=1e-14)
        families = [  # the second one raises, then the first
            solver.add_family(inceres.CustomFamily(1, [1], 1, failing(*arguments)))
            for arguments in [(LookupError, lambda: raised == [BufferError]),
                              (BufferError, lambda: not raised)]]
        with solver.edit() as edit:
            ids = edit.add_variables([[0.0]])
            for family in families:
                edit.add_factors(family, [ids], [[3.0]])
        with self.assertRaises(LookupError):
            solver.update(interruptible=False)
        self.assertEqual(raised, [BufferError, LookupError])
        self.assertEqual(solver.update()["termination"], "CONVERGENCE")
        np.testing.assert_allclose(solver.values(ids), [[3.0]], atol=1e-6)

    def test_options_are_checked(self):
        with self.assertRaisesRegex(TypeError, "unknown option 'tolerance'"):
            inceres.IncrementalSolver(tolerance=1.0)
        with self.assertRaisesRegex(ValueError, "min_damping"):
            inceres.IncrementalSolver(min_damping=0.0)
        self.assertEqual(inceres.incremental_options()["max_landmark_refinements"], 5)


if __name__ == "__main__":
    unittest.main()
