"""Looking on: progress lines, and whether Jacobians are derivatives."""

from __future__ import annotations

from typing import Any, Callable, Sequence

import numpy as np
import numpy.typing as npt

from ._arrays import FloatArray, to_floats

Evaluate = Callable[[FloatArray, Sequence[Any], tuple[bool, ...]], Any]


def print_progress(row: dict[str, Any]) -> None:
    """A callback that prints a line an iteration, as Ceres does; of updates, their own."""
    if row["iteration"] == 0:
        print("iter      cost      cost_change  |gradient|   |step|    ratio     radius  seconds")
    radius = row.get("trust_region_radius", 0.0) or row.get("damping", 0.0)
    print(
        f"{row['iteration']:4d} {row['cost']:13.6e} {row['cost_change']:11.2e} "
        f"{row['gradient_max_norm']:10.2e} {row['step_norm']:10.2e} "
        f"{row['relative_decrease']:9.2e} {radius:9.2e} {row['cumulative_seconds']:8.3f}",
        flush=True,
    )


def check_jacobians(
    evaluate: Evaluate,
    measurements: npt.ArrayLike,
    parameters: Sequence[npt.ArrayLike],
    *,
    shared: bool = False,
    step: float = 1e-6,
) -> list[float]:
    """How far a CustomFamily's Jacobians are from central differences of its residuals.

    measurements (k, m) and parameters, an array (k, ambient size) a slot, are points to look at.
    Returns for each slot the largest difference, relative to the largest entry of that slot's
    numeric Jacobian (at least 1): about 1e-8 where all is well.
    """
    rows = to_floats("measurements", measurements, (None, None))
    points = [to_floats(f"parameters[{s}]", p, (len(rows), None)) for s, p in enumerate(parameters)]

    def call(moved: Sequence[FloatArray], wanted: tuple[bool, ...]) -> Any:
        index = np.arange(len(rows))
        return evaluate(rows, [(p, index) for p in moved] if shared else list(moved), wanted)

    # Copies: a function may use the arrays it returned again.
    jacobians = [np.array(J) for J in call(points, (True,) * len(points))[1]]
    errors = []
    for s, point in enumerate(points):
        numeric = []
        for c in range(point.shape[1]):
            h = step * np.maximum(1.0, np.abs(point[:, c]))
            residuals = []
            for sign in (1.0, -1.0):
                moved = [p.copy() for p in points]
                moved[s][:, c] += sign * h
                residuals.append(np.array(call(moved, ())).reshape(len(rows), -1))
            numeric.append((residuals[0] - residuals[1]) / (2.0 * h[:, None]))
        expected = np.stack(numeric, axis=2)
        given = jacobians[s]
        if given.shape != expected.shape:
            raise ValueError(
                f"jacobian of slot {s}: shape {given.shape}, expected {expected.shape}")
        scale = max(1.0, float(np.abs(expected).max(initial=0.0)))
        errors.append(float(np.abs(given - expected).max(initial=0.0)) / scale)
    return errors
