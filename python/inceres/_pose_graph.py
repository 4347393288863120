"""Pose graphs from arrays of edges."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Callable, Optional

import numpy as np
import numpy.typing as npt

from . import _core
from ._arrays import (
    FloatArray,
    check_writable,
    to_floats,
    to_indices,
    to_mask,
    unit_quaternions,
    write_into,
)
from ._bundle import Loss
from ._errors import Interrupted, SolveError, is_usable

# RelativePose has rotation before position and measures from the other end: see relative_pose_rows.
_SWAP = np.array([3, 4, 5, 0, 1, 2])
_SIGN = np.array([-1.0, -1.0, -1.0, 1.0, 1.0, 1.0])


@dataclass(frozen=True)
class PoseGraphResult:
    """What optimize_pose_graph has found."""

    poses: FloatArray
    summary: dict[str, Any]


def sqrt_information(name: str, information: FloatArray) -> FloatArray:
    """Upper triangular U with U'U = information, of each (n, d, d)."""
    if not np.allclose(information, np.swapaxes(information, 1, 2), rtol=1e-9, atol=1e-12):
        raise ValueError(f"{name}: not symmetric")
    try:
        return np.swapaxes(np.linalg.cholesky(information), 1, 2)
    except np.linalg.LinAlgError:
        smallest = np.linalg.eigvalsh(information)[:, 0]
        row = int(np.argmin(smallest))
        raise ValueError(f"{name}: row {row} is not positive definite") from None


def planar_rows(measurements: npt.ArrayLike, information: Optional[npt.ArrayLike]) -> FloatArray:
    """Rows of PlanarRelativePose for edges (n, 3) that see their end from their beginning."""
    motions = to_floats("measurements", measurements, (None, 3))
    if information is None:
        return motions
    weights = to_floats("information", information, (len(motions), 3, 3))
    return np.hstack([motions, sqrt_information("information", weights).reshape(-1, 9)])


def relative_pose_rows(
    measurements: npt.ArrayLike, information: Optional[npt.ArrayLike]
) -> FloatArray:
    """Rows of RelativePose for edges (n, 7) p, q (x, y, z, w): T_from^-1 T_to.

    The information is that of (p, rotation), as g2o has it. Variables are (to, from): the family's
    a is the edge's end, so that R_ab' is the measured rotation and p_ab the measured position.
    """
    motions = unit_quaternions("measurements", to_floats("measurements", measurements, (None, 7)))
    count = len(motions)
    weights = (
        np.broadcast_to(np.eye(6), (count, 6, 6))
        if information is None
        else to_floats("information", information, (count, 6, 6))
    )
    swapped = weights[:, _SWAP][:, :, _SWAP] * np.outer(_SIGN, _SIGN)
    conjugate = motions[:, 3:] * [-1.0, -1.0, -1.0, 1.0]
    roots = sqrt_information("information", swapped).reshape(-1, 36)
    return np.hstack([conjugate, motions[:, :3], roots])


def optimize_pose_graph(
    poses: npt.ArrayLike,
    edges: npt.ArrayLike,
    measurements: npt.ArrayLike,
    information: Optional[npt.ArrayLike] = None,
    *,
    fixed: Any = (0,),
    loss: Loss = None,
    in_place: bool = False,
    callback: Optional[Callable[[dict[str, Any]], Optional[bool]]] = None,
    **options: Any,
) -> PoseGraphResult:
    """Moves poses to where the measured relative ones are explained best.

    poses: planar (n, 3) x, y, theta or spatial (n, 7) p, q (x, y, z, w). edges: (k, 2) from, to.
    measurements: (k, 3) or (k, 7), the pose of `to` seen from `from`. Quaternions are taken as
    bundle_adjust takes them. information: (k, 3, 3) or (k, 6, 6), inverse covariances of
    (x, y, theta) or (p, rotation), by default identities. fixed: which poses stay: indices, a mask,
    or True; by default the first. The rest is as in bundle_adjust. The default strategy is
    Levenberg–Marquardt; strategy="dogleg" is faster where start values are good.
    """
    start = to_floats("poses", poses, (None, 3), (None, 7))
    planar = start.shape[1] == 3
    if not planar:
        start = unit_quaternions("poses", start)
    ends = np.asarray(edges)
    if ends.ndim != 2 or ends.shape[1] != 2:
        raise ValueError(f"edges: shape {ends.shape}, expected (n, 2)")
    make_rows = planar_rows if planar else relative_pose_rows
    rows = make_rows(measurements, information)
    first = to_indices("edges", ends[:, 0], len(start), len(rows))
    second = to_indices("edges", ends[:, 1], len(start), len(rows))
    loops = np.flatnonzero(first == second)
    if loops.size > 0:
        raise ValueError(f"edges: row {loops[0]} leads from pose {first[loops[0]]} to itself")
    held = to_mask("fixed", fixed, len(start))
    held |= np.bincount(np.concatenate([first, second]), minlength=len(start)) == 0
    graph = _core.FactorGraph()
    manifold: Optional[_core.Manifold] = None if planar else _core.PoseManifold()
    ids = graph.add_variables(start, "frame", manifold, held)
    family: _core.Family = _core.PlanarRelativePose() if planar else _core.RelativePose()
    order = (first, second) if planar else (second, first)
    graph.add_factors(
        graph.add_family(family), np.column_stack([ids[end] for end in order]), rows, loss)

    def finish(summary: dict[str, Any]) -> PoseGraphResult:
        if not is_usable(summary):
            raise SolveError(summary)
        found = graph.values(ids)
        if in_place:
            write_into("poses", poses, found)
            found = np.asarray(poses)
        return PoseGraphResult(found, summary)

    if in_place:
        check_writable("poses", poses)
    try:
        return finish(graph.solve(callback, **options))
    except Interrupted as interrupted:
        interrupted.summary["termination"] = "USER_SUCCESS"
        interrupted.result = finish(interrupted.summary)
        raise
