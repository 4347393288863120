"""Bundle adjustment from arrays."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Callable, Mapping, Optional, Sequence, Union

import numpy as np
import numpy.typing as npt

from . import _core
from ._arrays import (
    FloatArray,
    IntArray,
    check_writable,
    to_floats,
    to_indices,
    to_mask,
    unit_quaternions,
    write_into,
)
from ._errors import Interrupted, SolveError, is_usable

MODELS = ("bal", "pinhole", "brown", "equidistant", "stereo", "inverse_depth")
_INTRINSICS = {"pinhole": 4, "brown": 8, "equidistant": 8, "stereo": 5}
_IDENTITY = np.array([[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]])

Loss = Union[None, _core.Loss, Sequence[Optional[_core.Loss]]]


@dataclass(frozen=True)
class BundleResult:
    """What bundle_adjust has found."""

    cameras: FloatArray
    points: FloatArray
    summary: dict[str, Any]


@dataclass
class _Problem:
    """The arguments, checked, and the graph made of them."""

    model: str
    cameras: FloatArray
    points: FloatArray
    camera_indices: IntArray
    point_indices: IntArray
    observations: FloatArray
    graph: _core.FactorGraph
    camera_ids: IntArray
    point_ids: IntArray
    holds_intrinsics: bool


def bundle_adjust(
    cameras: npt.ArrayLike,
    points: npt.ArrayLike,
    camera_indices: npt.ArrayLike,
    point_indices: npt.ArrayLike,
    observations: npt.ArrayLike,
    *,
    model: str = "bal",
    loss: Loss = None,
    fixed: Optional[Mapping[str, Any]] = None,
    intrinsics: Optional[npt.ArrayLike] = None,
    extrinsics: Optional[npt.ArrayLike] = None,
    anchors: Optional[npt.ArrayLike] = None,
    bearings: Optional[npt.ArrayLike] = None,
    sigma: Optional[npt.ArrayLike] = None,
    in_place: bool = False,
    callback: Optional[Callable[[dict[str, Any]], Optional[bool]]] = None,
    **options: Any,
) -> BundleResult:
    """Moves cameras and points to where the observations are explained best.

    Observation i says where camera ``camera_indices[i]`` sees point ``point_indices[i]``.

    =================  ================  ==========  =================  ========================
    ``model``          cameras           points      observations       intrinsics
    =================  ================  ==========  =================  ========================
    ``bal``            (n, 9) w t f k k  (m, 3)      (k, 2)             part of the cameras
    ``pinhole``        (n, 7) poses      (m, 3)      (k, 2)             (4,) or (n, 4)
    ``brown``          (n, 7) poses      (m, 3)      (k, 2)             (8,) or (n, 8)
    ``equidistant``    (n, 7) poses      (m, 3)      (k, 2)             (8,) or (n, 8)
    ``stereo``         (n, 7) poses      (m, 3)      (k, 3) u_l v u_r   (5,) or (n, 5)
    ``inverse_depth``  (n, 7) poses      (m, 1)      (k, 2), z = 1      none
    =================  ================  ==========  =================  ========================

    A pose is p (3), q (x, y, z, w): the camera's place in the world and its rotation
    world_from_camera; with ``extrinsics`` (7,), body_from_camera, it is that of a body that carries
    the camera. Quaternions may be up to 1e-3 off length 1: they are divided by their length, and
    results have it. Intrinsics are f_x, f_y, c_x, c_y, then k1, k2, p1, p2 (brown), k1 to k4
    (equidistant) or the baseline (stereo); they are not estimated. With inverse depths
    ``anchors`` (m,) names the camera that saw each point first and ``bearings`` (m, 2) where, in
    the plane z = 1; no observation is by the anchor itself.

    loss: None, one loss for all, or one for each observation. fixed: what stays where it is, of
    ``{"cameras": …, "points": …}`` as indices, mask or True; of bal also ``"intrinsics": True``.
    Cameras and points without observations stay, too. sigma: standard deviation of the
    observations, one or (k,), not for bal. in_place: write the results into ``cameras`` and
    ``points``, float64 arrays, instead of new ones; if the solve fails they are not touched.
    callback, options: as for FactorGraph.solve (solver_options() lists them).

    Raises ValueError or TypeError naming the argument, SolveError if there is no result, and
    Interrupted, with the best result so far, after Ctrl-C. Releases the GIL while it solves.
    """
    problem = _make_problem(
        cameras, points, camera_indices, point_indices, observations, model, dict(fixed or {}),
        anchors,
    )
    _connect(problem, loss, intrinsics, extrinsics, anchors, bearings, sigma)

    def finish(summary: dict[str, Any]) -> BundleResult:
        if not is_usable(summary):
            raise SolveError(summary)
        new_cameras = problem.graph.values(problem.camera_ids)
        new_points = problem.graph.values(problem.point_ids).reshape(np.shape(points))
        if not in_place:
            return BundleResult(new_cameras, new_points, summary)
        write_into("cameras", cameras, new_cameras)
        write_into("points", points, new_points)
        return BundleResult(np.asarray(cameras), np.asarray(points), summary)

    if in_place:  # what could not be written is found now
        check_writable("cameras", cameras)
        check_writable("points", points)
    try:
        return finish(problem.graph.solve(callback, **options))
    except Interrupted as interrupted:
        interrupted.summary["termination"] = "USER_SUCCESS"
        interrupted.result = finish(interrupted.summary)
        raise


def _make_problem(
    cameras: npt.ArrayLike, points: npt.ArrayLike, camera_indices: npt.ArrayLike,
    point_indices: npt.ArrayLike, observations: npt.ArrayLike, model: str, fixed: dict[str, Any],
    anchors: Optional[npt.ArrayLike],
) -> _Problem:
    """Checks what all models have in common; variables are in the graph, factors are not."""
    if model not in MODELS:
        raise ValueError(f"model: {model!r}, expected one of {', '.join(MODELS)}")
    c = to_floats("cameras", cameras, (None, 9 if model == "bal" else 7))
    p = (
        to_floats("points", points, (None, 1), (None,)).reshape(-1, 1)
        if model == "inverse_depth"
        else to_floats("points", points, (None, 3))
    )
    z = to_floats("observations", observations, (None, 3 if model == "stereo" else 2))
    of_camera = to_indices("camera_indices", camera_indices, len(c), len(z))
    of_point = to_indices("point_indices", point_indices, len(p), len(z))
    if model != "bal":
        c = unit_quaternions("cameras", c)
    held_cameras = to_mask("fixed['cameras']", fixed.pop("cameras", False), len(c))
    held_points = to_mask("fixed['points']", fixed.pop("points", False), len(p))
    holds_intrinsics = fixed.pop("intrinsics", False)
    if fixed or holds_intrinsics not in (True, False) or (holds_intrinsics and model != "bal"):
        raise ValueError(
            f"fixed: {fixed or {'intrinsics': holds_intrinsics}}, expected 'cameras', 'points', or "
            "of bal 'intrinsics': True"
        )
    involved = np.bincount(of_camera, minlength=len(c)) > 0
    if anchors is not None:
        involved[to_indices("anchors", anchors, len(c), len(p))[of_point]] = True
    held_cameras |= ~involved
    held_points |= np.bincount(of_point, minlength=len(p)) == 0
    graph = _core.FactorGraph()
    manifold: Optional[_core.Manifold] = None if model == "bal" else _core.PoseManifold()
    if holds_intrinsics:
        manifold = _core.SubsetManifold(9, [6, 7, 8])
    camera_ids = graph.add_variables(c, "frame", manifold, held_cameras)
    point_ids = graph.add_variables(p, "landmark", None, held_points)
    return _Problem(
        model, c, p, of_camera, of_point, z, graph, camera_ids, point_ids, bool(holds_intrinsics))


def _connect(
    problem: _Problem, loss: Loss, intrinsics: Optional[npt.ArrayLike],
    extrinsics: Optional[npt.ArrayLike], anchors: Optional[npt.ArrayLike],
    bearings: Optional[npt.ArrayLike], sigma: Optional[npt.ArrayLike],
) -> None:
    """Adds the observations as factors of the model's family."""
    unused = {"intrinsics": intrinsics, "extrinsics": extrinsics, "anchors": anchors,
              "bearings": bearings, "sigma": sigma}
    used = {"bal": (), "inverse_depth": ("anchors", "bearings", "sigma")}.get(
        problem.model, ("intrinsics", "extrinsics", "sigma"))
    for name, value in unused.items():
        if value is not None and name not in used:
            raise ValueError(f"{name}: of no use to model {problem.model!r}")
        if value is None and name in used and name not in ("extrinsics", "sigma"):
            raise ValueError(f"{name}: model {problem.model!r} needs it")
    cameras = problem.camera_ids[problem.camera_indices]
    points = problem.point_ids[problem.point_indices]
    if problem.model == "bal":
        family = problem.graph.add_family(
            _core.BalReprojection(6 if problem.holds_intrinsics else 9))
        problem.graph.add_factors(
            family, np.column_stack([cameras, points]), problem.observations, loss)
    elif problem.model == "inverse_depth":
        assert anchors is not None and bearings is not None
        _connect_inverse_depths(problem, cameras, points, loss, anchors, bearings, sigma)
    else:
        assert intrinsics is not None
        _connect_points(problem, cameras, points, loss, intrinsics, extrinsics, sigma)


def _whitened(problem: _Problem, rows: FloatArray, sigma: Optional[npt.ArrayLike]) -> FloatArray:
    """Measurements with the square root information 1 / sigma behind them."""
    if sigma is None:
        return rows
    count = len(problem.observations)
    deviations = np.broadcast_to(to_floats("sigma", sigma, (), (count,)), (count,))
    if not (deviations > 0.0).all():
        raise ValueError(f"sigma: {deviations.min()}, expected positive standard deviations")
    size = problem.observations.shape[1]
    pattern = np.eye(3).ravel() if size == 3 else np.array([1.0, 0.0, 1.0])
    return np.hstack([rows, pattern / deviations[:, None]])


def _check_losses(loss: Loss, count: int) -> None:
    """What FactorGraph.add_factors says of them: for losses that come to more than one family."""
    if loss is None or isinstance(loss, _core.Loss):
        return
    if not isinstance(loss, (Sequence, np.ndarray)) or isinstance(loss, str):
        raise TypeError("loss: expected None, a Loss or a sequence of them")
    if len(loss) != count:
        raise ValueError(f"loss: {len(loss)} losses for {count} factors")


def _connect_points(
    problem: _Problem, cameras: IntArray, points: IntArray, loss: Loss, intrinsics: npt.ArrayLike,
    extrinsics: Optional[npt.ArrayLike], sigma: Optional[npt.ArrayLike],
) -> None:
    """A family for each set of intrinsics that some camera has."""
    _check_losses(loss, len(problem.observations))
    size = _INTRINSICS[problem.model]
    num_cameras = len(problem.cameras)
    numbers = to_floats("intrinsics", intrinsics, (size,), (num_cameras, size))
    sets, set_of = np.unique(
        np.broadcast_to(numbers, (num_cameras, size)), axis=0, return_inverse=True)
    place = _IDENTITY if extrinsics is None else unit_quaternions(
        "extrinsics", to_floats("extrinsics", extrinsics, (7,)).reshape(1, 7))
    mounted = problem.graph.add_variables(place, "frame", _core.PoseManifold(), True)[0]
    rows = _whitened(problem, problem.observations, sigma)
    make = {"stereo": _core.StereoReprojection, "equidistant": _core.EquidistantReprojection}.get(
        problem.model, _core.PointReprojection)
    set_of_observation = set_of.reshape(-1)[problem.camera_indices]
    for number, values in enumerate(sets):
        chosen = np.flatnonzero(set_of_observation == number)
        if chosen.size == 0:
            continue
        family = problem.graph.add_family(make(values))
        variables = np.column_stack([cameras[chosen], np.full(len(chosen), mounted),
                                     points[chosen]])
        some = loss if loss is None or isinstance(loss, _core.Loss) else [loss[i] for i in chosen]
        problem.graph.add_factors(family, variables, rows[chosen], some)


def _connect_inverse_depths(
    problem: _Problem, cameras: IntArray, points: IntArray, loss: Loss, anchors: npt.ArrayLike,
    bearings: npt.ArrayLike, sigma: Optional[npt.ArrayLike],
) -> None:
    """Observations of features that lie on a ray of their anchor."""
    num_points = len(problem.points)
    anchor_of = to_indices("anchors", anchors, len(problem.cameras), num_points)
    seen = to_floats("bearings", bearings, (num_points, 2))
    anchor = anchor_of[problem.point_indices]
    own = np.flatnonzero(anchor == problem.camera_indices)
    if own.size > 0:
        raise ValueError(
            f"observations: row {own[0]} is by the anchor of its point; it belongs into bearings")
    rows = np.hstack([seen[problem.point_indices], problem.observations])
    family = problem.graph.add_family(_core.InverseDepthReprojection())
    variables = np.column_stack([problem.camera_ids[anchor], cameras, points])
    problem.graph.add_factors(family, variables, _whitened(problem, rows, sigma), loss)
