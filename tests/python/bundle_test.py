"""bundle_adjust: each camera model recovers a world it saw without noise; what it is told to hold
it holds; and every wrong argument is named."""

import unittest

import numpy as np

import inceres
from scene import STREET, Scene, pixels

INTRINSICS = {
    "pinhole": [460.0, 455.0, 320.0, 240.0],
    "brown": [460.0, 455.0, 320.0, 240.0, -0.28, 0.07, 2e-4, -1.8e-3],
    "equidistant": [285.0, 286.0, 424.0, 400.0, -0.007, 0.043, -0.041, 0.0075],
    "stereo": [435.0, 437.0, 367.0, 252.0, 0.11],
}


def street():
    return inceres.read_bal(STREET)


class ModelsTest(unittest.TestCase):
    def check_recovers(self, model, scene, intrinsics, **more):
        poses, points = scene.disturbed()
        per_camera = np.broadcast_to(intrinsics, (len(poses), np.shape(intrinsics)[-1]))
        h = scene.in_cameras()
        z = np.vstack([pixels(model, per_camera[c], h[i:i + 1])
                       for i, c in enumerate(scene.camera_indices)])
        result = inceres.bundle_adjust(
            poses, points, scene.camera_indices, scene.point_indices, z, model=model,
            intrinsics=intrinsics, fixed={"cameras": [0, 1]}, function_tolerance=1e-16,
            gradient_tolerance=1e-16, parameter_tolerance=1e-14, **more)
        self.assertEqual(result.summary["termination"], "CONVERGENCE")
        self.assertLess(result.summary["final_cost"], 1e-10)
        np.testing.assert_allclose(result.cameras, scene.poses, atol=1e-8)
        np.testing.assert_allclose(result.points, scene.points, atol=1e-7)
        np.testing.assert_array_equal(result.cameras[:2], poses[:2])

    def test_models_recover_the_world(self):
        for model, intrinsics in INTRINSICS.items():
            with self.subTest(model):
                self.check_recovers(model, Scene(), intrinsics)
                self.check_recovers(model, Scene(), intrinsics, sigma=0.5)

    def test_cameras_may_differ(self):
        sets = np.array([INTRINSICS["brown"]] * 5)
        sets[2:, 0] = 510.0
        losses = [inceres.HuberLoss(1.0), None] * 100
        self.check_recovers("brown", Scene(), sets, loss=losses)

    def test_inverse_depths(self):
        scene = Scene()
        poses, _ = scene.disturbed()
        h = scene.in_cameras().reshape(len(scene.points), len(poses), 3)
        anchors = np.arange(len(scene.points)) % 2
        own = h[np.arange(len(anchors)), anchors]
        others = scene.camera_indices != anchors[scene.point_indices]
        seen = h.reshape(-1, 3)[others]
        result = inceres.bundle_adjust(
            poses, np.full(len(anchors), 0.1), scene.camera_indices[others],
            scene.point_indices[others], seen[:, :2] / seen[:, 2:], model="inverse_depth",
            anchors=anchors, bearings=own[:, :2] / own[:, 2:], fixed={"cameras": [0, 1]},
            sigma=1 / 460, function_tolerance=1e-16)
        np.testing.assert_allclose(result.points, 1 / own[:, 2], atol=1e-7)
        np.testing.assert_allclose(result.cameras, scene.poses, atol=1e-7)

    def test_a_body_carries_the_camera(self):
        scene = Scene()
        poses, points = scene.disturbed()
        shift = np.array([0.3, -0.2, 0.1])
        z = pixels("pinhole", INTRINSICS["pinhole"], scene.in_cameras())
        result = inceres.bundle_adjust(
            poses, points, scene.camera_indices, scene.point_indices, z, model="pinhole",
            intrinsics=INTRINSICS["pinhole"], extrinsics=[*shift, 0, 0, 0, 1],
            function_tolerance=1e-14)
        self.assertLess(result.summary["final_cost"], 1e-8)

    def test_quaternions_are_taken_at_length_1(self):
        scene = Scene()
        poses, points = scene.disturbed()
        place = np.array([0.3, -0.2, 0.1, 0, 0, 0, 1])
        z = pixels("pinhole", INTRINSICS["pinhole"], scene.in_cameras())

        def solve(poses, points, place, **more):
            return inceres.bundle_adjust(
                poses, points, scene.camera_indices, scene.point_indices, z, model="pinhole",
                intrinsics=INTRINSICS["pinhole"], extrinsics=place, fixed={"cameras": [0, 1]},
                max_num_iterations=3, **more)

        stretch = np.array([1.0] * 3 + [1.0008] * 4)
        stretched, start = poses * stretch, points.copy()
        with self.assertRaises(inceres.SolveError):
            solve(stretched, start, place, in_place=True, max_memory_bytes=10000)
        np.testing.assert_array_equal(stretched, poses * stretch)
        np.testing.assert_array_equal(start, points)
        expected = solve(poses, points, place)
        np.testing.assert_array_equal(expected.cameras[:2], poses[:2])
        for found in (solve(stretched, points, place), solve(poses, points, place * stretch)):
            self.assertAlmostEqual(
                found.summary["final_cost"] / expected.summary["final_cost"], 1.0, delta=1e-9)
            np.testing.assert_allclose(found.cameras, expected.cameras, atol=1e-9)
            np.testing.assert_allclose(found.points, expected.points, atol=1e-9)

    def test_bal_holds_what_it_is_told_to(self):
        bal = street()
        result = inceres.bundle_adjust(
            *bal.arrays(), fixed={"intrinsics": True, "points": np.arange(len(bal.points)) < 5})
        np.testing.assert_array_equal(result.cameras[:, 6:], bal.cameras[:, 6:])
        np.testing.assert_array_equal(result.points[:5], bal.points[:5])
        self.assertGreater(np.abs(result.cameras - bal.cameras).max(), 1e-6)
        self.assertLess(result.summary["final_cost"], result.summary["initial_cost"])

    def test_inputs_stay_as_they_are_unless_in_place(self):
        bal = street()
        cameras, points = bal.cameras.copy(), bal.points.copy()
        result = inceres.bundle_adjust(*bal.arrays())
        np.testing.assert_array_equal(bal.cameras, cameras)
        np.testing.assert_array_equal(bal.points, points)
        again = inceres.bundle_adjust(cameras, points, *bal.arrays()[2:], in_place=True)
        self.assertIs(again.cameras, cameras)
        np.testing.assert_array_equal(cameras, result.cameras)
        np.testing.assert_array_equal(points, result.points)

    def test_other_types_and_strides_come_to_the_same(self):
        bal = street()
        expected = inceres.bundle_adjust(*bal.arrays())
        result = inceres.bundle_adjust(
            np.asfortranarray(bal.cameras), bal.points.tolist(), bal.camera_indices.astype("u2"),
            bal.point_indices.astype(np.int64), np.repeat(bal.observations, 2, axis=1)[:, ::2])
        np.testing.assert_array_equal(result.points, expected.points)

    def test_threads_change_no_bit(self):
        bal = street()
        one, two = (inceres.bundle_adjust(*bal.arrays(), num_threads=n) for n in (1, 2))
        np.testing.assert_array_equal(one.cameras, two.cameras)


class MessagesTest(unittest.TestCase):
    def expect(self, kind, text, **changes):
        bal = street()
        arguments = {
            "cameras": bal.cameras, "points": bal.points, "camera_indices": bal.camera_indices,
            "point_indices": bal.point_indices, "observations": bal.observations, **changes}
        with self.assertRaisesRegex(kind, text):
            inceres.bundle_adjust(**arguments)

    def test_wrong_arguments_are_named(self):
        bal = street()
        bad = bal.points.copy()
        bad[7, 1] = np.nan
        self.expect(ValueError, r"^cameras: shape \(16, 8\), expected \(n, 9\)$",
                    cameras=bal.cameras[:, :8])
        self.expect(ValueError, r"^points: entry \(7, 1\) is not finite$", points=bad)
        self.expect(TypeError, "^points: dtype", points=np.array([["a", "b", "c"]]))
        self.expect(TypeError, "^camera_indices: dtype float64", camera_indices=bal.points[:, 0])
        self.expect(ValueError, "^camera_indices: shape", camera_indices=bal.camera_indices[:-1])
        self.expect(ValueError, r"^point_indices: entry 0 is -1, not in \[0, 1200\)",
                    point_indices=bal.point_indices - bal.point_indices[0] - 1)
        self.expect(ValueError, "^observations: shape", observations=bal.observations[:, :1])
        self.expect(ValueError, "^model: 'fish', expected one of bal", model="fish")
        self.expect(ValueError, "^intrinsics: of no use to model 'bal'", intrinsics=[1, 1, 0, 0])
        self.expect(ValueError, "^sigma: of no use", sigma=2.0)
        self.expect(ValueError, "^fixed: .*'poses'", fixed={"poses": [0]})
        self.expect(ValueError, r"^fixed\['cameras'\]: entry 1 is 16", fixed={"cameras": [0, 16]})
        self.expect(ValueError, "^loss: 2 losses for", loss=[None, None])
        self.expect(TypeError, "^loss: expected None", loss=3.0)
        self.expect(TypeError, "unknown option 'max_iterations'; there are .*max_num_iterations",
                    max_iterations=3)
        self.expect(ValueError, "max_num_iterations", max_num_iterations=-1)
        self.expect(TypeError, "^num_threads: 'two', expected a whole number", num_threads="two")
        self.expect(ValueError, "^strategy: 'newton', expected one of levenberg", strategy="newton")
        self.expect(TypeError, "^cameras: in_place needs a float64 array",
                    cameras=bal.cameras.tolist(), in_place=True)

    def test_wrong_arguments_of_other_models(self):
        scene = Scene()
        arguments = (scene.poses, scene.points, scene.camera_indices, scene.point_indices,
                     np.zeros((200, 2)))
        for text, more in [
            ("^intrinsics: model 'pinhole' needs it", {"model": "pinhole"}),
            ("^intrinsics: shape", {"model": "brown", "intrinsics": [1.0, 1.0, 0.0, 0.0]}),
            ("^intrinsics: entry 1", {"model": "pinhole", "intrinsics": [1.0, 0.0, 0.0, 0.0]}),
            ("^sigma: 0", {"model": "pinhole", "intrinsics": [1, 1, 0, 0], "sigma": 0.0}),
            ("^observations: row 0 is by the anchor", {
                "model": "inverse_depth", "anchors": np.zeros(40, int),
                "bearings": np.zeros((40, 2))}),
        ]:
            points = np.ones(40) if more["model"] == "inverse_depth" else scene.points
            with self.assertRaisesRegex(ValueError, text):
                inceres.bundle_adjust(arguments[0], points, *arguments[2:], **more)
        with self.assertRaisesRegex(ValueError, "^cameras: row 0: a quaternion of length 2"):
            inceres.bundle_adjust(scene.poses * 2, *arguments[1:], model="pinhole",
                                  intrinsics=[1, 1, 0, 0])
        with self.assertRaisesRegex(ValueError, "^extrinsics: row 0: a quaternion of length 2"):
            inceres.bundle_adjust(*arguments, model="pinhole", intrinsics=[1, 1, 0, 0],
                                  extrinsics=[0, 0, 0, 0, 0, 0, 2])

    def test_losses_are_one_an_observation(self):
        scene = Scene()
        for model, intrinsics in {**INTRINSICS, "inverse_depth": None}.items():
            inverse = model == "inverse_depth"
            more = {"anchors": np.zeros(40, int), "bearings": np.zeros((40, 2))} if inverse else {
                "intrinsics": intrinsics}
            some = np.flatnonzero(scene.camera_indices > 0)
            arguments = (
                scene.poses, np.ones(40) if inverse else scene.points, scene.camera_indices[some],
                scene.point_indices[some], np.zeros((len(some), 3 if model == "stereo" else 2)))
            for count in (1, len(some) - 1, len(some) + 1):
                with self.subTest(model), self.assertRaisesRegex(
                        ValueError, f"^loss: {count} losses for {len(some)} factors"):
                    inceres.bundle_adjust(*arguments, model=model, loss=[None] * count, **more)
            for wrong in (3.0, "huber"):
                with self.subTest(model), self.assertRaisesRegex(TypeError, "^loss: expected None"):
                    inceres.bundle_adjust(*arguments, model=model, loss=wrong, **more)

    def test_a_solve_that_fails_says_why(self):
        bal = street()
        cameras = bal.cameras.copy()
        cameras[0, :6] = 0
        points = bal.points.copy()
        first = bal.point_indices[np.flatnonzero(bal.camera_indices == 0)[0]]
        points[first, 2] = 0
        before = points.copy()
        with self.assertRaisesRegex(inceres.SolveError, "BAL reprojection") as caught:
            inceres.bundle_adjust(cameras, points, *bal.arrays()[2:], in_place=True)
        self.assertEqual(caught.exception.summary["termination"], "FAILURE")
        np.testing.assert_array_equal(points, before)


if __name__ == "__main__":
    unittest.main()
