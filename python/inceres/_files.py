"""Files of problems, as arrays. Readers take text, .gz and .bz2, and BAL as .balb.

Failures are OSError.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import Union

import numpy as np
import numpy.typing as npt

from . import _core
from ._arrays import FloatArray, IntArray, to_floats, to_indices

Path = Union[str, "os.PathLike[str]"]


@dataclass(frozen=True)
class BalProblem:
    """A problem in BAL format: bundle_adjust(*problem.arrays())."""

    cameras: FloatArray
    points: FloatArray
    camera_indices: IntArray
    point_indices: IntArray
    observations: FloatArray

    def arrays(self) -> tuple[FloatArray, FloatArray, IntArray, IntArray, FloatArray]:
        """In the order of bundle_adjust's arguments."""
        return (self.cameras, self.points, self.camera_indices, self.point_indices,
                self.observations)


@dataclass(frozen=True)
class PoseGraph:
    """A pose graph: planar poses (n, 3) or spatial ones (n, 7), as optimize_pose_graph has them."""

    poses: FloatArray
    edges: IntArray
    measurements: FloatArray
    information: FloatArray
    fixed: IntArray
    ids: npt.NDArray[np.int64]


@dataclass(frozen=True)
class Keyframes:
    """What a visual odometry with keyframes hands to its back-end. Rows are in order of arrival.

    poses (n, 7); features: anchors (m, 2) keyframe and number there, bearings (m, 2), depths (m,)
    measured, 0 if not; guesses: guess_ids (g, 2) keyframe and feature, guesses (g,);
    observations: observation_ids (k, 2) keyframe and feature, observations (k, 2) in the plane
    z = 1, observed_depths (k,), information (k, 2, 2); betweens: between_ids (b, 3) arrival, a, b,
    relative_poses (b, 7) q_ab, p_ab, between_information (b, 6, 6), rotation first. Depths are
    inverse, 1/m.
    """

    poses: FloatArray
    anchors: IntArray
    bearings: FloatArray
    depths: FloatArray
    guess_ids: IntArray
    guesses: FloatArray
    observation_ids: IntArray
    observations: FloatArray
    observed_depths: FloatArray
    information: FloatArray
    between_ids: IntArray
    relative_poses: FloatArray
    between_information: FloatArray


def read_bal(path: Path, *, max_unpacked_bytes: int = 0) -> BalProblem:
    """Reads a "bundle adjustment in the large" file: text, or binary if the name ends in .balb."""
    return BalProblem(*_core.read_bal(os.fspath(path), max_unpacked_bytes))


def write_bal(path: Path, problem: BalProblem) -> None:
    """Writes one; compressed if the name ends in .gz or .bz2, binary if in .balb.

    Numbers read back the same.
    """
    _core.write_bal(os.fspath(path), *problem.arrays())


def read_g2o(path: Path, *, max_unpacked_bytes: int = 0) -> PoseGraph:
    """Reads a g2o pose graph: VERTEX_SE2 and EDGE_SE2, or VERTEX_SE3:QUAT and EDGE_SE3:QUAT."""
    return PoseGraph(*_core.read_g2o(os.fspath(path), max_unpacked_bytes))


def read_keyframes(path: Path, *, max_unpacked_bytes: int = 0) -> Keyframes:
    """Reads a keyframe sequence; inceres/io/keyframes.h has the format."""
    (poses, anchors, features, guess_ids, guesses, ids, seen, between_ids, relative,
     between_information) = _core.read_keyframes(os.fspath(path), max_unpacked_bytes)
    information = seen[:, [3, 4, 4, 5]].reshape(-1, 2, 2)
    return Keyframes(
        poses, anchors, features[:, :2].copy(), features[:, 2].copy(), guess_ids, guesses[:, 0],
        ids, seen[:, :2].copy(), seen[:, 2].copy(), information, between_ids, relative,
        between_information.reshape(-1, 6, 6))


def write_g2o(path: Path, graph: PoseGraph) -> None:
    """Writes a pose graph. Numbers read back the same, quaternions up to their norm."""
    size = np.shape(graph.poses)[1] if np.ndim(graph.poses) == 2 else 0
    poses = to_floats("poses", graph.poses, (None, 3), (None, 7))
    d = 3 if size == 3 else 6
    measurements = to_floats("measurements", graph.measurements, (None, size))
    count = len(measurements)
    information = to_floats("information", graph.information, (count, d, d))
    edges = np.asarray(graph.edges)
    if edges.shape != (count, 2):
        raise ValueError(f"edges: shape {edges.shape}, expected ({count}, 2)")
    to_indices("edges", edges.reshape(-1), len(poses))
    ids = np.asarray(graph.ids)
    if ids.shape != (len(poses),) or len(np.unique(ids)) != len(poses):
        raise ValueError(f"ids: expected {len(poses)} different ones")
    kind = "SE2" if size == 3 else "SE3:QUAT"
    upper = np.triu_indices(d)
    lines = [f"VERTEX_{kind} {i} {_numbers(pose)}" for i, pose in zip(ids, poses)]
    lines += [f"FIX {ids[i]}" for i in to_indices("fixed", graph.fixed, len(poses))]
    lines += [
        f"EDGE_{kind} {ids[a]} {ids[b]} {_numbers(measured)} {_numbers(weight[upper])}"
        for (a, b), measured, weight in zip(edges, measurements, information)
    ]
    _write_lines(path, lines)


def write_keyframes(path: Path, sequence: Keyframes) -> None:
    """Writes a keyframe sequence, as text. Rotations read back up to rounding."""
    lines: list[list[str]] = [[] for _ in range(len(sequence.poses))]
    for i, pose in enumerate(to_floats("poses", sequence.poses, (None, 7))):
        lines[i].append(f"KEYFRAME {i} {_numbers(_matrix(pose[3:]).T)} {_numbers(pose[:3])}")
    for (i, f), guess in zip(sequence.guess_ids, sequence.guesses):
        a, k = sequence.anchors[f]
        lines[i].append(f"DEPTH_GUESS {a} {k} {_numbers(guess)}")
    later: list[list[str]] = [[] for _ in lines]
    for f, (a, k) in enumerate(sequence.anchors):
        lines[a].append(f"FEATURE {a} {k} {_numbers(sequence.bearings[f])} "
                        f"{_numbers(sequence.depths[f])}")
    for n, (i, f) in enumerate(sequence.observation_ids):
        a, k = sequence.anchors[f]
        weight = sequence.information[n]
        numbers = [*sequence.observations[n], sequence.observed_depths[n], weight[0, 0],
                   weight[0, 1], weight[1, 1]]
        later[i].append(f"OBS {i} {a} {k} {_numbers(numbers)}")
    for n, (i, a, b) in enumerate(sequence.between_ids):
        relative = sequence.relative_poses[n]
        later[i].append(f"BETWEEN {a} {b} {_numbers(_matrix(relative[:4]))} "
                        f"{_numbers(relative[4:])} {_numbers(sequence.between_information[n])}")
    _write_lines(path, [line for i in range(len(lines)) for line in _in_order(lines[i], later[i])])


def _in_order(first: list[str], later: list[str]) -> list[str]:
    """Guesses name features, which must have arrived: they follow them."""
    guesses = [line for line in first if line.startswith("DEPTH_GUESS")]
    return [line for line in first if not line.startswith("DEPTH_GUESS")] + guesses + later


def _matrix(q: FloatArray) -> FloatArray:
    """The rotation of a unit quaternion x, y, z, w."""
    x, y, z, w = q / np.linalg.norm(q)
    return np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ])


def _numbers(values: npt.ArrayLike) -> str:
    """In the shortest form that reads back as the same double."""
    return " ".join(repr(float(value)) for value in np.ravel(values))


def _write_lines(path: Path, lines: list[str]) -> None:
    """Beside the file, then in its place: it is never half there."""
    name = os.fspath(path)
    if name.endswith((".gz", ".bz2")):
        raise ValueError(f"path: {name}: this writer does not compress")
    partial = name + ".partial"
    try:
        with open(partial, "w", encoding="ascii") as file:
            file.write("\n".join(lines) + "\n")
        os.replace(partial, name)
    except OSError:
        if os.path.exists(partial):
            os.remove(partial)
        raise
