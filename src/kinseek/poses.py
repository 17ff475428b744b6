"""Reading poses: validate arrays and objects of other libraries, and correct matrices that rounding made inexact."""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .errors import InvalidGoal, RepairWarning
from .kernels.arm.pose_error import LARGEST, all_rigid
from .pose_messages import is_message, matrix_of_message
from .support.interrupts import CHUNK, chunks, in_chunks
from .support.validation import as_float_array

Array = NDArray[np.float64]

_FLOAT = np.dtype(np.float64)

REPAIRABLE = 1e-6
"""A matrix closer than this to a rotation is replaced by the nearest rotation; others are rejected."""
ROUNDED = 0.1
"""The same limit with `repair`: a rotation written with two digits is at most 0.03 away."""


def plain_array(value: Any, shape: tuple[int, ...]) -> Array | None:
    """Return an array of doubles of this shape in the layout of kernels; None for anything else, which needs a full check.

    Other memory layouts, such as a transposed matrix or a field of a packed record, are copied.
    """
    if type(value) is not np.ndarray or value.shape != shape:
        return None
    # The type of an array from a pickle is equal by value, but is another object.
    if value.dtype is not _FLOAT and value.dtype != _FLOAT:
        return None
    flags = value.flags
    return value if flags.c_contiguous and flags.aligned else value.copy()


def plain_place(position: Any) -> Array | None:
    """Return the pose of an unrotated position, (4, 4), given three doubles or Python floats of magnitude at most `LARGEST`.

    Return None for anything else, which needs a full check.
    """
    if type(position) is np.ndarray:
        if position.shape != (3,) or position.dtype != _FLOAT:
            return None
        x, y, z = position.tolist()
    elif type(position) in (list, tuple) and len(position) == 3:
        x, y, z = position
        if not (type(x) is type(y) is type(z) is float):
            return None
    else:
        return None
    if not (abs(x) <= LARGEST and abs(y) <= LARGEST and abs(z) <= LARGEST):
        return None
    return np.array([[1.0, 0.0, 0.0, x], [0.0, 1.0, 0.0, y], [0.0, 0.0, 1.0, z], [0.0, 0.0, 0.0, 1.0]])


def as_pose(target: Any) -> Array:
    """Read a pose, or a batch of them, from an array or from an object that carries a 4x4.

    Args:
        target: (..., 4, 4), lengths in [m]; or an object with ``.homogeneous``, ``.A`` or ``.as_matrix()``; or a ROS
            message: Pose, Transform, or one that holds one of these, such as PoseStamped, whose frame is not checked; or a
            list of such objects.

    Returns:
        (..., 4, 4), every rotation orthonormal to rounding.

    Raises:
        InvalidGoal: Wrong shape, NaN or infinity, farther than 1e-6 from a rigid transform, or a position too far away to
            compute with.
    """
    return rigid(matrix_of(target), REPAIRABLE, 2)


def rigid(matrix: Array, repairable: float, level: int) -> Array:
    """Validate poses, (..., 4, 4), as `as_pose` does, and replace rotations off by at most `repairable` by the nearest one.

    A warning reports repairs beyond those of `as_pose`; `level` is the number of calls between here and the line to blame.
    """
    _require_shape(matrix)
    # One compiled pass accepts what is valid. The slower checks below only find out what is wrong.
    each, batch = matrix.reshape(-1, 4, 4), matrix.shape[:-2]
    rigid = np.empty(len(each), dtype=np.bool_)
    checked = [all_rigid(np.ascontiguousarray(each[some]), rigid[some]) for some in chunks(len(each))]
    if all(checked):
        return matrix
    if not all_finite(matrix):
        bad = ~np.isfinite(each).all(axis=(-2, -1))
        many = f" ({np.count_nonzero(bad)} such poses)" if batch else ""
        raise InvalidGoal(f"a pose contains NaN or infinity{batch_index(int(np.argmax(bad)), batch)}{many}")
    farthest = in_chunks(lambda some: np.abs(some[:, :3, 3]).max(axis=-1), each)
    if (far := farthest > LARGEST).any():
        first = int(np.argmax(far))
        raise InvalidGoal(
            f"a position must lie within {LARGEST:g} m of the origin along each axis{batch_index(first, batch)}, got "
            f"{farthest[first]:.6g} m: farther off, rounding of positions comes close to 1e-6 m. "
            f"Are these other units?"
        )
    turn, off, row, mirrored = _measured(matrix)
    wrong = (off > repairable) | (row > REPAIRABLE) | mirrored
    if wrong.any():
        first = int(np.argmax(wrong))
        where = batch_index(first, batch)
        raise InvalidGoal(
            _why_not_rigid(off.flat[first], row.flat[first], bool(mirrored.flat[first]), where, repairable)
            + _likely_cause(each[first])
        )
    if off.size and (most := float(off.max())) > REPAIRABLE:
        warnings.warn(
            f"{int((off > REPAIRABLE).sum())} of {off.size} matrices were not rotations, and were replaced by the nearest "
            f"ones: RᵀR differed from the identity by up to {most:.3g}",
            RepairWarning,
            stacklevel=level,
        )
    loose = ~rigid.reshape(matrix.shape[:-2])
    if loose.any():  # Only these: the others in the batch must stay unchanged.
        matrix[loose, :3, :3] = in_chunks(_nearest_rotations, turn[loose])
        matrix[loose, 3, :] = [0, 0, 0, 1]
    return matrix


def _nearest_rotations(turn: Array) -> Array:
    # U Vᵀ is the nearest orthogonal matrix in the Frobenius norm. Reflections were rejected before, so it is a rotation.
    left, _, right = np.linalg.svd(turn)
    return np.asarray(left @ right)


def _require_shape(matrix: Array) -> None:
    if matrix.ndim < 2 or matrix.shape[-2:] != (4, 4):
        raise InvalidGoal(f"a pose must have shape (4, 4) or (..., 4, 4), got {matrix.shape}{_hint(matrix)}")


def _measured(matrix: Array) -> tuple[Array, Array, Array, NDArray[np.bool_]]:
    """Return the rotations of finite matrices, (..., 4, 4), the errors of rotations and last rows, and which reflect."""
    shape, each = matrix.shape[:-2], matrix.reshape(-1, 4, 4)
    # Larger values are not rotations either, and their squares overflow.
    turn = in_chunks(lambda some: np.clip(some[:, :3, :3], -1e6, 1e6), each)
    off = in_chunks(_off, turn).reshape(shape)
    row = in_chunks(lambda some: np.abs(some[:, 3, :] - [0, 0, 0, 1]).max(axis=-1), each).reshape(shape)
    mirrored = in_chunks(lambda some: np.linalg.det(some) < 0, turn).reshape(shape)
    return turn.reshape(*shape, 3, 3), off, row, mirrored


def _off(turn: Array) -> Array:
    return np.asarray(np.abs(np.swapaxes(turn, -1, -2) @ turn - np.eye(3)).max(axis=(-2, -1)))


def good_and_bad(target: Any) -> tuple[Array, NDArray[np.bool_]]:
    """Read a batch of poses of which some may be invalid.

    Args:
        target: As `as_pose` takes it.

    Returns:
        The matrices, (..., 4, 4), and which of them `as_pose` would accept, (...).

    Raises:
        InvalidGoal: Wrong shape.
    """
    matrix = matrix_of(target)
    _require_shape(matrix)
    finite = np.asarray(np.isfinite(matrix).all(axis=(-2, -1)))
    # Products with NaN or infinity would warn, so these matrices are replaced before they are measured.
    tame = np.where(finite[..., None, None], matrix, np.eye(4))
    near = np.abs(tame[..., :3, 3]).max(axis=-1) <= LARGEST
    _, off, row, mirrored = _measured(tame)
    return matrix, finite & near & (off <= REPAIRABLE) & (row <= REPAIRABLE) & ~mirrored


def one_pose(value: Any, name: str) -> Array:
    """Read one pose, (4, 4), as `as_pose` does; error messages begin with its name."""
    try:
        matrix = as_pose(value)
    except InvalidGoal as error:
        raise InvalidGoal(f"{name}: {error}") from None
    if matrix.shape != (4, 4):
        raise InvalidGoal(f"{name} must be one pose, (4, 4), for the whole batch, got {matrix.shape}")
    return matrix


_CARRIERS = ("homogeneous", "A", "as_matrix")
"""Attributes under which objects of other libraries carry a 4x4."""
_PLAIN = (np.ndarray, list, tuple, int, float, str)
"""Elements of lists that need no look at their attributes."""


def carries_pose(value: Any) -> bool:
    """Return whether an object of another library has a matrix under one of the known names, or is a message with a pose."""
    return any(hasattr(value, name) for name in _CARRIERS) or is_message(value)


def any_carries_pose(values: list[Any] | tuple[Any, ...]) -> bool:
    """Return whether `carries_pose` is True of any element of a list."""
    return any(not isinstance(each, _PLAIN) and carries_pose(each) for each in values)


def matrix_of(target: Any) -> Array:
    """Read a matrix, or a batch of them, of any shape from an array, an object that carries one, or a list of such objects.

    Raises:
        InvalidGoal: The values are not numbers.
    """
    if isinstance(target, list | tuple):
        if any_carries_pose(target):
            target = [each if isinstance(each, _PLAIN) else matrix_of(each) for each in target]
    elif not isinstance(target, np.ndarray):
        target = _carried(target)
    try:
        return as_float_array(target)
    except (TypeError, ValueError, OverflowError) as error:
        raise InvalidGoal(
            f"a pose must be a (..., 4, 4) array or an object with .homogeneous, .A or .as_matrix(), "
            f"or a ROS message of a pose or transform, got {type(target).__name__}: {error}"
        ) from error


def _carried(value: Any) -> Any:
    """Return the matrix that an object carries, or the object itself if it carries none."""
    for attribute in _CARRIERS:
        carried = getattr(value, attribute, None)
        if carried is not None:
            return carried() if callable(carried) else carried
    matrix = matrix_of_message(value)
    return value if matrix is None else matrix


def _hint(matrix: Array) -> str:
    if matrix.shape[-1:] == (7,) or matrix.shape[-1:] == (6,):
        return (
            "; write kinseek.pose(position, quat_wxyz=... | quat_xyzw=... | rpy=...): the name says the order"
        )
    if matrix.shape[-2:] == (3, 3):
        return "; this is a rotation alone, the position is missing"
    if matrix.shape[-1:] == (3,):
        return "; kinseek.pose([x, y, z]) makes a pose, and Goal.position a goal without an orientation"
    return ""


def _why_not_rigid(off: float, row: float, mirrored: bool, where: str, repairable: float) -> str:
    if off > repairable:
        reason = f"RᵀR differs from the identity by {off:.3g}"
    elif mirrored:
        reason = "its determinant is -1, a reflection"
    else:
        reason = f"its last row differs from [0, 0, 0, 1] by {row:.3g}"
    rounded = REPAIRABLE < off <= ROUNDED and row <= REPAIRABLE and not mirrored
    hint = (
        "; for one that was rounded to a few digits, write kinseek.pose(..., repair=True)" if rounded else ""
    )
    return (
        f"not a rigid transform{where}: {reason} (up to {repairable:g} is repaired, more is rejected){hint}"
    )


def _likely_cause(matrix: Array) -> str:
    if not matrix[:3, :3].any():
        return "; its rotation is zero, as that of a message whose orientation was never set"
    bottom = matrix[:, 3]
    return "; is it transposed?" if (bottom == [0.0, 0.0, 0.0, 1.0]).all() and matrix[3, :3].any() else ""


def all_finite(numbers: Array) -> bool:
    """Return whether no number of an array, (..., k), is NaN or infinite."""
    if numbers.size <= CHUNK:
        return bool(np.isfinite(numbers).all())
    flat = numbers.reshape(-1, numbers.shape[-1])
    return all(bool(np.isfinite(flat[some]).all()) for some in chunks(len(flat)))


def batch_index(flat: int, batch: tuple[int, ...]) -> str:
    """Return where in a batch a row is, by its index in the flattened batch, for messages; empty without a batch."""
    where = tuple(map(int, np.unravel_index(flat, batch)))
    return f" at index {where[0] if len(where) == 1 else where} of the batch" if batch else ""


def row_of(values: Iterable[float]) -> str:
    """Format numbers in brackets with six digits for messages."""
    return f"[{', '.join(f'{round(float(value), 6) + 0.0:.6g}' for value in values)}]"


def rpy_of(turn: Array) -> tuple[float, float, float]:
    """Return roll, pitch and yaw of a rotation, (3, 3), for messages [rad]; at a gimbal lock the yaw is 0."""
    level = math.hypot(turn[0, 0], turn[1, 0])
    pitch = math.atan2(-turn[2, 0], level)
    if level < 1e-9:
        return math.atan2(-turn[1, 2], turn[1, 1]), pitch, 0.0
    return math.atan2(turn[2, 1], turn[2, 2]), pitch, math.atan2(turn[1, 0], turn[0, 0])
