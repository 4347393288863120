"""A small world for tests: cameras on an arc that look at a cloud of points, and what they see."""

import pathlib

import numpy as np

STREET = pathlib.Path(__file__).resolve().parents[2] / "bal_data" / "street-16-1200-pre.txt"


def rotation(q):
    """The matrices (n, 3, 3) of unit quaternions (n, 4) x, y, z, w."""
    x, y, z, w = np.moveaxis(q, -1, 0)
    return np.moveaxis(np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]), -1, 0)


class Scene:
    """poses (n, 7), points (m, 3); camera i sees point j with all pairs in camera_indices, …"""

    def __init__(self, num_cameras=5, num_points=40, seed=3):
        random = np.random.default_rng(seed)
        angles = np.linspace(-0.4, 0.4, num_cameras)
        half = -angles / 2
        self.poses = np.zeros((num_cameras, 7))
        self.poses[:, 0] = 6 * np.sin(angles)
        self.poses[:, 2] = 6 - 6 * np.cos(angles)
        self.poses[:, 4], self.poses[:, 6] = np.sin(half), np.cos(half)
        self.points = random.uniform(-1, 1, (num_points, 3)) * [2, 1.5, 1] + [0, 0, 6]
        self.camera_indices, self.point_indices = (
            grid.ravel() for grid in np.meshgrid(np.arange(num_cameras), np.arange(num_points)))
        self.random = random

    def in_cameras(self):
        """Each seen point in its camera (k, 3)."""
        pose = self.poses[self.camera_indices]
        offset = self.points[self.point_indices] - pose[:, :3]
        return np.einsum("kji,kj->ki", rotation(pose[:, 3:]), offset)

    def disturbed(self, poses=0.02, points=0.1):
        """Start values: all but the first two poses, and all points, are moved."""
        start = self.poses.copy()
        start[2:, :3] += poses * self.random.standard_normal((len(start) - 2, 3))
        turned = start[2:, 3:] + poses / 2 * self.random.standard_normal((len(start) - 2, 4))
        start[2:, 3:] = turned / np.linalg.norm(turned, axis=1)[:, None]
        return start, self.points + points * self.random.standard_normal(self.points.shape)


def pixels(model, intrinsics, h):
    """What a camera of the model sees of points h (k, 3) of its frame."""
    a, b = h[:, 0] / h[:, 2], h[:, 1] / h[:, 2]
    f_x, f_y, c_x, c_y = intrinsics[:4]
    r2 = a * a + b * b
    if model == "pinhole":
        return np.column_stack([f_x * a + c_x, f_y * b + c_y])
    if model == "brown":
        k1, k2, p1, p2 = intrinsics[4:]
        s = 1 + k1 * r2 + k2 * r2 ** 2
        return np.column_stack([
            f_x * (s * a + 2 * p1 * a * b + p2 * (r2 + 2 * a * a)) + c_x,
            f_y * (s * b + p1 * (r2 + 2 * b * b) + 2 * p2 * a * b) + c_y])
    if model == "equidistant":
        rho = np.hypot(h[:, 0], h[:, 1])
        theta = np.arctan2(rho, h[:, 2])
        d = theta * (1 + sum(k * theta ** (2 * i + 2) for i, k in enumerate(intrinsics[4:])))
        return np.column_stack([f_x * d * h[:, 0] / rho + c_x, f_y * d * h[:, 1] / rho + c_y])
    baseline = intrinsics[4]
    return np.column_stack([
        f_x * a + c_x, f_y * b + c_y, f_x * (h[:, 0] - baseline) / h[:, 2] + c_x])
