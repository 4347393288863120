"""Checks of arguments. Messages name the argument, its shape and what was expected."""

from __future__ import annotations

from typing import Any, Optional, Sequence

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int32]


def _shape_text(shape: Sequence[Any]) -> str:
    inner = ", ".join("n" if size is None else str(size) for size in shape)
    return f"({inner},)" if len(shape) == 1 else f"({inner})"


def to_floats(name: str, value: npt.ArrayLike, *shapes: Sequence[Optional[int]]) -> FloatArray:
    """A float64 array, row by row, of one of the shapes, None being any size. No needless copy."""
    if isinstance(value, np.ma.MaskedArray) and np.any(value.mask):
        raise ValueError(f"{name}: has masked entries, expected numbers everywhere")
    try:
        array = np.asarray(value)
    except ValueError as error:
        raise ValueError(f"{name}: {error}") from None
    if array.dtype.kind not in "fiu":
        raise TypeError(f"{name}: dtype {array.dtype}, expected real numbers")
    array = np.asarray(array, dtype=np.float64, order="C")
    if not any(
        array.ndim == len(shape) and all(w in (None, s) for w, s in zip(shape, array.shape))
        for shape in shapes
    ):
        wanted = " or ".join(_shape_text(shape) for shape in shapes)
        raise ValueError(f"{name}: shape {_shape_text(array.shape)}, expected {wanted}")
    if not np.isfinite(array).all():
        at = np.argwhere(~np.isfinite(array))[0]
        raise ValueError(f"{name}: entry {tuple(int(i) for i in at)} is not finite")
    return array


def unit_quaternions(name: str, poses: FloatArray) -> FloatArray:
    """A copy of poses (n, 7) with quaternions of length 1, which they must have to three digits.

    Those that have it up to rounding stay as they are, to the last bit.
    """
    norms = np.linalg.norm(poses[:, 3:], axis=1)
    bad = np.flatnonzero(np.abs(norms - 1.0) > 1e-3)
    if bad.size > 0:
        raise ValueError(f"{name}: row {bad[0]}: a quaternion of length {norms[bad[0]]:.6g}")
    norms[np.abs(norms - 1.0) < 1e-15] = 1.0
    copy = poses.copy()
    copy[:, 3:] /= norms[:, None]
    return copy


def to_indices(name: str, value: npt.ArrayLike, size: int, count: Optional[int] = None) -> IntArray:
    """Whole numbers (count,), each in [0, size)."""
    array = np.asarray(value)
    if array.dtype.kind not in "iu" and array.size > 0:
        raise TypeError(f"{name}: dtype {array.dtype}, expected whole numbers")
    if array.ndim != 1 or count not in (None, array.size):
        wanted = "(n,)" if count is None else f"({count},)"
        raise ValueError(f"{name}: shape {_shape_text(array.shape)}, expected {wanted}")
    bad = np.flatnonzero((array < 0) | (array >= size))
    if bad.size > 0:
        raise ValueError(f"{name}: entry {bad[0]} is {array[bad[0]]}, not in [0, {size})")
    return np.ascontiguousarray(array, dtype=np.int32)


def to_mask(name: str, value: Any, size: int) -> npt.NDArray[np.bool_]:
    """Which of `size` things: True for all, a mask (size,), or indices of some."""
    if isinstance(value, (bool, np.bool_)):
        return np.full(size, bool(value))
    array = np.asarray(value)
    if array.dtype.kind == "b":
        if array.shape != (size,):
            raise ValueError(f"{name}: shape {_shape_text(array.shape)}, expected ({size},)")
        return np.asarray(array, dtype=np.bool_)
    mask = np.zeros(size, dtype=np.bool_)
    mask[to_indices(name, array.reshape(-1), size)] = True
    return mask


def check_writable(name: str, target: Any) -> None:
    """Whether results can be written there."""
    if not isinstance(target, np.ndarray) or target.dtype != np.float64:
        raise TypeError(f"{name}: in_place needs a float64 array, this is {type(target).__name__}")
    if not target.flags.writeable:
        raise ValueError(f"{name}: in_place needs an array that can be written")


def write_into(name: str, target: Any, values: FloatArray) -> None:
    """Writes results where they came from."""
    check_writable(name, target)
    target[...] = values.reshape(target.shape)
