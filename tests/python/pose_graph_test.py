"""Pose graphs from arrays: planar and spatial ones recover the poses their edges were made of;
files come back as they were written."""

import pathlib
import tempfile
import unittest

import numpy as np

import inceres
from scene import STREET, rotation


def multiply(p, q):
    """Quaternions x, y, z, w, row by row."""
    a, b = p[:, :3], q[:, :3]
    vector = p[:, 3:] * b + q[:, 3:] * a + np.cross(a, b)
    return np.column_stack([vector, p[:, 3] * q[:, 3] - np.einsum("ni,ni->n", a, b)])


def loop_edges(n):
    return np.array([(i, i + 1) for i in range(n - 1)] + [(i, i + 5) for i in range(n - 5)]
                    + [(n - 1, 0)])


def spatial_world(n=30, seed=4):
    random = np.random.default_rng(seed)
    q = random.standard_normal((n, 4))
    poses = np.hstack([random.uniform(-5, 5, (n, 3)), q / np.linalg.norm(q, axis=1)[:, None]])
    edges = loop_edges(n)
    a, b = poses[edges[:, 0]], poses[edges[:, 1]]
    position = np.einsum("nji,nj->ni", rotation(a[:, 3:]), b[:, :3] - a[:, :3])
    turned = multiply(a[:, 3:] * [-1, -1, -1, 1], b[:, 3:])
    weights = random.standard_normal((len(edges), 6, 6))
    information = np.einsum("nij,nkj->nik", weights, weights) + 6 * np.eye(6)
    return poses, edges, np.hstack([position, turned]), information


def planar_world(n=30, seed=5):
    random = np.random.default_rng(seed)
    poses = np.column_stack([random.uniform(-5, 5, (n, 2)), random.uniform(-3, 3, n)])
    edges = loop_edges(n)
    a, b = poses[edges[:, 0]], poses[edges[:, 1]]
    c, s = np.cos(a[:, 2]), np.sin(a[:, 2])
    d = b[:, :2] - a[:, :2]
    motion = np.column_stack([
        c * d[:, 0] + s * d[:, 1], c * d[:, 1] - s * d[:, 0], b[:, 2] - a[:, 2]])
    return poses, edges, motion, np.broadcast_to(np.diag([4.0, 4.0, 9.0]), (len(edges), 3, 3))


class PoseGraphTest(unittest.TestCase):
    def test_spatial_poses_are_recovered(self):
        poses, edges, motions, information = spatial_world()
        random = np.random.default_rng(1)
        start = poses.copy()
        start[1:, :3] += 0.1 * random.standard_normal((29, 3))
        start[1:, 3:] += 0.05 * random.standard_normal((29, 4))
        start[:, 3:] /= np.linalg.norm(start[:, 3:], axis=1)[:, None]
        result = inceres.optimize_pose_graph(start, edges, motions, information)
        self.assertLess(result.summary["final_cost"], 1e-12)
        np.testing.assert_allclose(result.poses[:, :3], poses[:, :3], atol=1e-6)
        np.testing.assert_allclose(rotation(result.poses[:, 3:]), rotation(poses[:, 3:]), atol=1e-6)

    def test_the_cost_is_that_of_g2o(self):
        """e' I e with e = (position, rotation vector) of measured^-1 (from^-1 to)."""
        poses, edges, motions, information = spatial_world()
        moved = poses.copy()
        moved[7, :3] += [0.3, -0.2, 0.1]
        angle = np.array([0.02, -0.03, 0.01])
        moved[8, 3:] = multiply(poses[8:9, 3:], np.r_[np.sin(0.5) * 0 + angle / 2, 1.0][None])[0]
        moved[8, 3:] /= np.linalg.norm(moved[8, 3:])
        a, b = moved[edges[:, 0]], moved[edges[:, 1]]
        position = np.einsum("nji,nj->ni", rotation(a[:, 3:]), b[:, :3] - a[:, :3]) - motions[:, :3]
        q = multiply(motions[:, 3:] * [-1, -1, -1, 1],
                     multiply(a[:, 3:] * [-1, -1, -1, 1], b[:, 3:]))
        q *= np.sign(q[:, 3:])
        norm = np.linalg.norm(q[:, :3], axis=1)
        angle = 2 * np.arctan2(norm, q[:, 3]) / np.where(norm > 0, norm, 1)
        e = np.hstack([position, q[:, :3] * angle[:, None]])
        expected = 0.5 * np.einsum("ni,nij,nj->", e, information, e)
        result = inceres.optimize_pose_graph(
            moved, edges, motions, information, max_num_iterations=0)
        self.assertAlmostEqual(result.summary["initial_cost"] / expected, 1.0, delta=1e-9)

    def test_quaternions_are_taken_at_length_1(self):
        poses, edges, motions, information = spatial_world()
        start = poses.copy()
        start[1:, :3] += 0.1 * np.random.default_rng(1).standard_normal((29, 3))
        stretch = np.array([1.0] * 3 + [0.9993] * 4)
        stretched = start * stretch
        with self.assertRaises(inceres.SolveError):
            inceres.optimize_pose_graph(stretched, edges, motions, information, in_place=True,
                                        max_memory_bytes=10000)
        np.testing.assert_array_equal(stretched, start * stretch)
        expected = inceres.optimize_pose_graph(start, edges, motions, information)
        result = inceres.optimize_pose_graph(stretched, edges, motions * stretch, information)
        self.assertLess(result.summary["final_cost"], 1e-12)
        np.testing.assert_allclose(result.poses, expected.poses, atol=1e-8)
        np.testing.assert_array_equal(expected.poses[0], start[0])

    def test_planar_poses_are_recovered(self):
        poses, edges, motions, information = planar_world()
        start = poses + np.r_[np.zeros((1, 3)),
                              0.1 * np.random.default_rng(2).standard_normal((29, 3))]
        for weights in (information, None):
            result = inceres.optimize_pose_graph(
                start, edges, motions, weights, strategy="dogleg", loss=inceres.CauchyLoss(1.0))
            self.assertLess(result.summary["final_cost"], 1e-10)
            np.testing.assert_allclose(result.poses, poses, atol=1e-5)
        inceres.optimize_pose_graph(start, edges, motions, information, in_place=True)
        np.testing.assert_allclose(start, poses, atol=1e-5)

    def test_wrong_arguments_are_named(self):
        poses, edges, motions, information = planar_world()
        for text, arguments in [
            (r"^poses: shape \(30, 2\), expected \(n, 3\) or \(n, 7\)",
             (poses[:, :2], edges, motions)),
            ("^edges: shape", (poses, edges[:, 0], motions)),
            ("^edges: entry 0 is 30", (poses, edges + 30, motions)),
            ("^edges: row 1 leads from pose 2 to itself",
             (poses, [[0, 1], [2, 2]], motions[:2])),
            ("^measurements: shape", (poses, edges, motions[:, :2])),
            ("^measurements: has masked entries",
             (poses, edges, np.ma.masked_greater(motions, 2.0))),
            ("^information: row 3 is not positive definite",
             (poses, edges, motions, information * np.where(
                 np.arange(len(edges)) == 3, -1, 1)[:, None, None])),
            ("^information: not symmetric",
             (poses, edges, motions, information + np.triu(np.ones((3, 3)), 1))),
        ]:
            with self.subTest(text), self.assertRaisesRegex(ValueError, text):
                inceres.optimize_pose_graph(*arguments)
        poses, edges, motions, _ = spatial_world()
        for length, wrong in [((2.0, 1.0), "poses"), ((1.0, 2.0), "measurements")]:
            of_poses, of_motions = (np.array([1.0] * 3 + [x] * 4) for x in length)
            text = f"^{wrong}: row 0: a quaternion of length 2"
            with self.subTest(text), self.assertRaisesRegex(ValueError, text):
                inceres.optimize_pose_graph(poses * of_poses, edges, motions * of_motions)


class FilesTest(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)

    def test_bal_comes_back(self):
        bal = inceres.read_bal(STREET)
        for name in ("a.txt", "a.txt.gz", "a.txt.bz2"):
            inceres.write_bal(self.folder / name, bal)
            again = inceres.read_bal(self.folder / name)
            for one, other in zip(bal.arrays(), again.arrays()):
                np.testing.assert_array_equal(one, other)

    def test_g2o_comes_back(self):
        for poses, edges, motions, information in (planar_world(), spatial_world()):
            graph = inceres.PoseGraph(
                poses, edges.astype(np.int32), motions, (information + np.swapaxes(
                    information, 1, 2)) / 2, np.array([2, 0], np.int32), np.arange(30)[::-1] * 3)
            inceres.write_g2o(self.folder / "graph.g2o", graph)
            again = inceres.read_g2o(self.folder / "graph.g2o")
            for name, value in vars(graph).items():
                np.testing.assert_allclose(getattr(again, name), value, rtol=1e-15, atol=1e-15)

    def test_keyframes_come_back(self):
        rows = 3
        random = np.random.default_rng(6)
        poses = spatial_world()[0][:rows]
        poses[:, 3:] *= np.where(poses[:, 6:] < 0, -1.0, 1.0)
        sequence = inceres.Keyframes(
            poses, np.array([[0, 0], [0, 1], [1, 0]], np.int32), random.uniform(-1, 1, (3, 2)),
            np.array([0.5, 0.0, 0.25]), np.array([[0, 1], [1, 2]], np.int32), np.array([0.3, 0.2]),
            np.array([[1, 0], [2, 1], [2, 2]], np.int32), random.uniform(-1, 1, (3, 2)),
            np.array([0.0, 0.4, 0.0]), np.tile(np.array([[2.0, 0.5], [0.5, 3.0]]), (3, 1, 1)),
            np.array([[2, 0, 2]], np.int32), np.hstack([poses[:1, 3:], poses[:1, :3]]),
            np.eye(6)[None] * 4)
        inceres.write_keyframes(self.folder / "a.kf", sequence)
        again = inceres.read_keyframes(self.folder / "a.kf")
        for name, value in vars(sequence).items():
            np.testing.assert_allclose(getattr(again, name), value, atol=1e-14, err_msg=name)

    def test_what_is_wrong_with_a_file_is_said(self):
        (self.folder / "bad.txt").write_text("1 1 1\n0 0 x 1\n")
        with self.assertRaisesRegex(OSError, "bad.txt:2:"):
            inceres.read_bal(self.folder / "bad.txt")
        with self.assertRaisesRegex(OSError, "none.g2o"):
            inceres.read_g2o(self.folder / "none.g2o")
        with self.assertRaisesRegex(OSError, "none"):
            inceres.write_bal(self.folder / "none" / "a.txt", inceres.read_bal(STREET))
        with self.assertRaises(OSError):
            poses, edges, motions, information = planar_world()
            inceres.write_g2o(self.folder / "none" / "a.g2o", inceres.PoseGraph(
                poses, edges, motions, information, np.zeros(0, np.int32), np.arange(30)))


if __name__ == "__main__":
    unittest.main()
