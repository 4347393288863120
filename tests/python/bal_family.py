"""The BAL camera as a user's family in NumPy: what the built-in one computes, for comparison.

Written over columns, which NumPy takes in runs, and in pieces that stay in the cache.
"""

import numpy as np

PIECE = 4096


def _rotations(w):
    """R (9 columns) and the left Jacobian of SO(3) (9 columns) of rotation vectors (v, 3)."""
    theta2 = np.einsum("vi,vi->v", w, w)
    theta = np.sqrt(theta2)
    small = theta2 < 1e-8
    safe = np.where(small, 1.0, theta)
    a = np.where(small, 1 - theta2 / 6, np.sin(safe) / safe)
    b = np.where(small, 0.5 - theta2 / 24, (1 - np.cos(safe)) / safe**2)
    c = np.where(small, 1 / 6 - theta2 / 120, (1 - a) / safe**2)
    cross = np.zeros((len(w), 3, 3))
    cross[:, 0, 1], cross[:, 0, 2], cross[:, 1, 2] = -w[:, 2], w[:, 1], -w[:, 0]
    cross -= np.swapaxes(cross, 1, 2)
    square = cross @ cross
    identity = np.eye(3)
    rotation = identity + a[:, None, None] * cross + b[:, None, None] * square
    left = identity + b[:, None, None] * cross + c[:, None, None] * square
    return rotation.reshape(-1, 9).T.copy(), left.reshape(-1, 9).T.copy()


class BalEvaluator:
    """evaluate(…) of a shared CustomFamily; counts its calls."""

    def __init__(self):
        self.num_calls = 0
        self.buffers = [np.empty((2, 0))]

    def __call__(self, measurements, parameters, wanted):
        self.num_calls += 1
        (cameras, of_camera), (points, of_point) = parameters
        count = len(measurements)
        if count != self.buffers[0].shape[1]:  # what was returned is copied before the next call
            self.buffers = [np.empty((rows, count)) for rows in (2, 18, 6)]
        residuals = self.buffers[0]
        jacobians = self.buffers[1:] if wanted else None
        rotations, left = _rotations(cameras[:, :3])
        tables = np.vstack([rotations, cameras[:, 3:].T, left][:3 if wanted else 2])
        for begin in range(0, count, PIECE):
            piece = slice(begin, min(begin + PIECE, count))
            evaluate_piece(
                tables.take(of_camera[piece], axis=1), points.T.take(of_point[piece], axis=1),
                measurements[piece],
                residuals[:, piece],
                None if jacobians is None else [J[:, piece] for J in jacobians])
        if jacobians is None:
            return residuals.T
        return residuals.T, [
            np.moveaxis(J.reshape(2, -1, count), -1, 0) for J in jacobians]


def evaluate_piece(camera, X, z, residuals, jacobians):
    """One piece: camera (24 columns: R, t, f, k1, k2, left Jacobian), X (3 columns)."""
    R, t, f, k1, k2 = camera[:9], camera[9:12], camera[12], camera[13], camera[14]
    turned = [R[3 * r] * X[0] + R[3 * r + 1] * X[1] + R[3 * r + 2] * X[2] for r in range(3)]
    inverse = -1.0 / (turned[2] + t[2])
    p = ((turned[0] + t[0]) * inverse, (turned[1] + t[1]) * inverse)
    r2 = p[0] * p[0] + p[1] * p[1]
    k2r2 = k2 * r2
    distortion = 1.0 + r2 * (k1 + k2r2)
    scale = f * distortion
    for i in range(2):
        np.subtract(scale * p[i], z[:, i], out=residuals[i])
    if jacobians is None:
        return
    J_camera, J_point = jacobians
    bend = f * 2.0 * (k1 + 2.0 * k2r2)  # d(scale) / d(p_j) = bend p_j
    fr2 = f * r2
    mixed = bend * p[0] * p[1]
    slopes = ((scale + bend * p[0] * p[0], mixed), (mixed, scale + bend * p[1] * p[1]))
    left = camera[15:]
    for i in range(2):
        # A = d(residual_i) / dP, P the point in the camera: p = -P_xy / P_z
        A = (slopes[i][0] * inverse, slopes[i][1] * inverse,
             (slopes[i][0] * p[0] + slopes[i][1] * p[1]) * inverse)
        # d(R X) / dw = -[R X]x J_l
        B = (A[2] * turned[1] - A[1] * turned[2], A[0] * turned[2] - A[2] * turned[0],
             A[1] * turned[0] - A[0] * turned[1])
        row = J_camera[9 * i:9 * i + 9]
        for c in range(3):
            np.add(B[0] * left[c] + B[1] * left[3 + c], B[2] * left[6 + c], out=row[c])
            row[3 + c] = A[c]
            np.add(A[0] * R[c] + A[1] * R[3 + c], A[2] * R[6 + c], out=J_point[3 * i + c])
        np.multiply(distortion, p[i], out=row[6])
        np.multiply(fr2, p[i], out=row[7])
        np.multiply(row[7], r2, out=row[8])
