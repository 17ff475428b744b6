"""`kinseek.pose`: poses from a position and a rotation whose convention is named explicitly."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from typing import Any, Never, TypedDict, Unpack, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .errors import InvalidGoal
from .kernels.arm.pose_error import LARGEST
from .poses import (
    REPAIRABLE,
    ROUNDED,
    all_finite,
    any_carries_pose,
    batch_index,
    carries_pose,
    matrix_of,
    rigid,
    row_of,
)
from .support.interrupts import CHUNK, chunks, in_chunks
from .support.shapes import Pose
from .support.transforms import angles_between, from_axes, from_quaternion, from_rpy, rotation_onto, rotations
from .support.units import warn_of_angles
from .support.validation import as_float_array, as_number, largest_of
from .unknown_arguments import unknown_argument

Array = NDArray[np.float64]

SKEW = math.radians(10.0)
"""Default of `skew`. Measured normals, and tangents taken between points of a curve, miss a right angle by a few degrees; of
two directions with nothing in common, one pair in six is closer to it than this. Not examined further."""
SHORTEST = 1e-9
"""Directions shorter than this are rejected: the difference of two equal points is rounding alone."""
PARALLEL = 1e-6
"""Directions closer to parallel than this are rejected [rad]: rounding would decide the rotation."""


class OneRotation(TypedDict, total=False):
    """Keyword arguments of `pose` for one position; `pose` documents them."""

    quat_wxyz: Sequence[float] | None
    quat_xyzw: Sequence[float] | None
    rpy: Sequence[float] | None
    rotvec: Sequence[float] | None
    z_axis: Sequence[float] | None
    x_axis: Sequence[float] | None
    y_axis: Sequence[float] | None
    skew: float | None
    degrees: bool
    repair: bool


class Rotations(TypedDict, total=False):
    """Keyword arguments of `pose` for any positions; `pose` documents them."""

    quat_wxyz: ArrayLike | None
    quat_xyzw: ArrayLike | None
    rpy: ArrayLike | None
    rotvec: ArrayLike | None
    z_axis: ArrayLike | None
    x_axis: ArrayLike | None
    y_axis: ArrayLike | None
    skew: float | None
    degrees: bool
    rotation: Any
    repair: bool


@overload
def pose(position: Sequence[float], **rotation: Unpack[OneRotation]) -> Pose: ...
@overload
def pose(position: ArrayLike, **rotation: Unpack[Rotations]) -> Array: ...
def pose(
    position: ArrayLike,
    *,
    quat_wxyz: ArrayLike | None = None,
    quat_xyzw: ArrayLike | None = None,
    rpy: ArrayLike | None = None,
    rotvec: ArrayLike | None = None,
    degrees: bool = False,
    rotation: Any = None,
    repair: bool = False,
    z_axis: ArrayLike | None = None,
    x_axis: ArrayLike | None = None,
    y_axis: ArrayLike | None = None,
    skew: float | None = None,
    **unknown: Never,
) -> Array:
    """Build a pose from a position and at most one rotation; without one the pose is not rotated.

    Args:
        position: Position [m], (..., 3). Or a whole pose, (..., 4, 4), or an object that carries one, such as a
            ROS message, without a rotation.
        quat_wxyz: Quaternion with its real part first, (..., 4); need not be of unit length.
        quat_xyzw: Quaternion with its real part last, (..., 4); need not be of unit length.
        rpy: Roll, pitch, yaw [rad] about the fixed axes x, y, z in this order, as in URDF, (..., 3).
        rotvec: Rotation vector, axis times angle [rad], (..., 3).
        degrees: `rpy` and `rotvec` are in degrees.
        rotation: Rotation matrix, (..., 3, 3), or an object with ``.as_matrix()``, such as a SciPy ``Rotation``.
        repair: Replace a matrix that was rounded to a few digits by the nearest rotation, and report by a warning how far it
            was from one. A matrix farther than 1e-6 from a rotation is rejected; with `repair`, one farther than 0.1.
        z_axis: Direction of the pose's z axis, (..., 3), of any length, e.g. the normal of a surface. Give exactly two of
            the three axes. Of these, the first in the order z, x, y is exact. The other one is turned in the plane of both,
            so that it is at right angles to the exact one (Gram-Schmidt).
        x_axis: Direction of the pose's x axis, (..., 3), of any length, e.g. the tangent of a seam.
        y_axis: Direction of the pose's y axis, (..., 3), of any length.
        skew: Largest angle by which both axes may miss a right angle [rad], from 0 to π/2; None: 10°. With π/2 the second
            axis may have any direction that is not parallel to the exact one.

    Returns:
        Transform, (..., 4, 4).

    Raises:
        InvalidGoal: Wrong shapes, NaN or infinity, a zero quaternion, more than one rotation, a quaternion in degrees, a
            matrix that is not a rotation, `repair` without a matrix, or one axis or three. Axes that are zero, parallel, or
            farther from a right angle than `skew`.

    Warns:
        UnitWarning: `rpy` or `rotvec` has an angle beyond 2π, and `degrees` is not given.
        RepairWarning: A matrix was farther than 1e-6 from a rotation, and `repair` is given.
    """
    if unknown:
        raise unknown_argument(pose, unknown)
    named = _given(quat_wxyz=quat_wxyz, quat_xyzw=quat_xyzw, rpy=rpy, rotvec=rotvec, rotation=rotation)
    axes = _given(z_axis=z_axis, x_axis=x_axis, y_axis=y_axis)
    degrees, repair = _flag("degrees", degrees), _flag("repair", repair)
    if len(named) + bool(axes) > 1:
        raise InvalidGoal(f"give one rotation, got {' and '.join([*named, *axes])}")
    if degrees and not {*named, *axes} <= {"rpy", "rotvec"}:
        raise InvalidGoal(f"degrees=True is for rpy and rotvec: {next(iter([*named, *axes]))} has no unit")
    if skew is not None and not axes:
        raise InvalidGoal("skew= is for directions: z_axis=, x_axis= and y_axis=, exactly two of them")
    repairable = ROUNDED if repair else REPAIRABLE
    whole = _whole(position)
    if whole is not None:
        if beside := [*named, *axes, *["degrees"] * degrees]:
            raise InvalidGoal(f"a whole pose, {whole.shape}, cannot be combined with {' and '.join(beside)}")
        return rigid(whole.astype(np.float64), repairable, 3)
    if repair and rotation is None:
        raise InvalidGoal(
            "repair=True is for matrices: rotation=R, (..., 3, 3), or a whole pose, (..., 4, 4)"
        )
    turn = _of_axes(axes, skew) if axes else np.eye(3)
    for name, value in named.items():
        if name == "rotation":
            turn = _of_matrix(value, repairable)
        elif name in ("rpy", "rotvec"):
            angles = _finite(value, name, 3)
            if not degrees:
                lengths = angles if name == "rpy" else _lengths(angles)
                warn_of_angles(lengths, name, "say degrees=True", 2)
            turn = _rotation_matrix(name, np.deg2rad(angles) if degrees else angles)
        else:
            turn = _rotation_matrix(name, value)
    return at_position(position, turn)


def _given(**arguments: Any) -> dict[str, Any]:
    """Return the arguments that are not None, in order."""
    return {name: value for name, value in arguments.items() if value is not None}


def _whole(position: Any) -> Array | None:
    """Return the argument `position` as an array if it is a whole pose, (..., 4, 4), or an object that carries one."""
    if isinstance(position, np.ndarray):
        return position if position.shape[-2:] == (4, 4) else None
    listed = isinstance(position, list | tuple)
    carries = any_carries_pose(position) if listed else carries_pose(position)
    if not (carries or (listed and len(position) > 0 and _is_nested(position[0]))):
        return None
    matrix = matrix_of(position)
    return matrix if carries or matrix.shape[-2:] == (4, 4) else None


def _flag(name: str, value: Any) -> bool:
    try:
        return bool(value)
    except ValueError:  # An array has no truth value.
        raise InvalidGoal(f"{name} must be True or False, got {value!r:.200}") from None


def _is_nested(value: Any) -> bool:
    """Return whether an element of a sequence has elements itself; true also for what NumPy cannot make an array of."""
    try:
        return np.ndim(value) > 0
    except ValueError:  # Rows of different lengths, or nested too deeply.
        return True


def _of_matrix(value: Any, repairable: float) -> Array:
    """Read rotation matrices, (..., 3, 3)."""
    try:
        turn = matrix_of(value)
        if turn.ndim < 2 or turn.shape[-2:] != (3, 3):
            raise InvalidGoal(f"expected a matrix of shape (3, 3) or (..., 3, 3), got {turn.shape}")
        return rigid(at_position(np.zeros(3), turn), repairable, 4)[..., :3, :3]
    except InvalidGoal as error:
        raise InvalidGoal(f"rotation: {error}") from None


def _of_axes(axes: Mapping[str, ArrayLike], skew: float | None) -> Array:
    """Make rotations, (..., 3, 3), from two of the axes ``z_axis``, ``x_axis`` and ``y_axis``, in this order."""
    if len(axes) != 2:
        raise InvalidGoal(f"give exactly two of z_axis, x_axis and y_axis, got {' and '.join(axes)}")
    limit = SKEW if skew is None else as_number("skew", skew, 0.0, math.pi / 2, InvalidGoal)
    exact, other = (_unit_vectors(value, name) for name, value in axes.items())
    try:
        exact, other = np.broadcast_arrays(exact, other)
    except ValueError:
        shapes = f"{exact.shape} and {other.shape}"
        raise InvalidGoal(f"{' and '.join(axes)} of shapes {shapes} do not broadcast") from None
    first, second = exact.reshape(-1, 3), other.reshape(-1, 3)
    _require_right_angles(first, second, tuple(axes), exact.shape[:-1], limit)
    columns = ["xyz".index(name[0]) for name in axes]
    return in_chunks(lambda a, b: from_axes(a, b, *columns), first, second).reshape(*exact.shape, 3)


def _unit_vectors(value: ArrayLike, name: str) -> Array:
    """Return directions of any length but 0, (..., 3), with length 1."""
    vectors = _finite(value, name, 3)
    flat = vectors.reshape(-1, 3)
    largest = in_chunks(lambda some: np.abs(some).max(axis=-1), flat)
    if (zero := largest < SHORTEST).any():
        where = batch_index(int(np.argmax(zero)), vectors.shape[:-1])
        raise InvalidGoal(
            f"{name} must be longer than {SHORTEST:g}{where}, got {row_of(flat[np.argmax(zero)])}"
        )
    scaled = flat / largest[:, None]  # Squares of a length might overflow.
    return in_chunks(lambda some: some / np.linalg.norm(some, axis=-1)[:, None], scaled).reshape(
        vectors.shape
    )


def _require_right_angles(
    exact: Array, other: Array, names: tuple[str, ...], batch: tuple[int, ...], limit: float
) -> None:
    """Reject pairs of unit vectors, (k, 3) each, whose angle differs from a right angle by more than `limit` [rad]."""
    angles = in_chunks(angles_between, exact, other)
    off = np.abs(angles - math.pi / 2)
    parallel = off > math.pi / 2 - PARALLEL
    wrong = parallel | (off > limit)
    if not wrong.any():
        return
    worst = int(np.argmax(wrong))
    where, angle = batch_index(worst, batch), f"{math.degrees(angles[worst]):.4g}°"
    if parallel[worst]:
        raise InvalidGoal(
            f"{' and '.join(names)} are parallel{where}: expected an angle of about 90° between them, got {angle}: "
            f"{row_of(exact[worst])} and {row_of(other[worst])}"
        )
    raise InvalidGoal(
        f"the angle between {' and '.join(names)} must be within {math.degrees(limit):.3g}° of 90°{where}, got {angle}; "
        f"kinseek.pose(..., skew=...) sets this limit [rad]"
    )


def _rotation_matrix(name: str, value: ArrayLike) -> Array:
    if name in ("rpy", "rotvec"):
        angles = _finite(value, name, 3)
        if (most := largest_of(angles)) > LARGEST:
            raise InvalidGoal(f"{name} must have angles of at most {LARGEST:g} rad, got {most:g}")
        return _matrices(from_rpy if name == "rpy" else rotations, angles)
    numbers = _finite(value, name, 4)
    with np.errstate(over="ignore"):
        length = _lengths(numbers)
    if (length < 1e-9).any():
        raise InvalidGoal(f"{name} has length {length.min():.3g}: a zero quaternion is not a rotation")
    if name == "quat_wxyz":
        return _matrices(from_quaternion, numbers)
    return _matrices(lambda some: from_quaternion(np.roll(some, 1, axis=-1)), numbers)


def _matrices(convert: Callable[[Array], Array], numbers: Array) -> Array:
    """Convert rotations that are written otherwise, (..., k) -> (..., 3, 3)."""
    flat = numbers.reshape(-1, numbers.shape[-1])
    return in_chunks(convert, flat).reshape(*numbers.shape[:-1], 3, 3)


def _lengths(vectors: Array) -> Array:
    """Lengths of vectors, (..., k) -> (...)."""
    flat = vectors.reshape(-1, vectors.shape[-1])
    return in_chunks(lambda some: np.linalg.norm(some, axis=-1), flat).reshape(vectors.shape[:-1])


def at_position(position: ArrayLike, turn: Array) -> Array:
    """Combine positions [m], (..., 3), and rotations, (..., 3, 3), that broadcast, into poses, (..., 4, 4)."""
    point = _finite(position, "position", 3)
    try:
        batch = point.shape[:-1] if turn.ndim == 2 else np.broadcast_shapes(point.shape[:-1], turn.shape[:-2])
    except ValueError as error:
        raise InvalidGoal(
            f"position of shape {point.shape} and rotation of batch shape {turn.shape[:-2]} do not broadcast"
        ) from error
    result = np.zeros((*batch, 4, 4))
    turns, points = np.broadcast_to(turn, (*batch, 3, 3)), np.broadcast_to(point, (*batch, 3))
    size = max(CHUNK * batch[0] // max(math.prod(batch), 1), 1) if batch else 1
    for some in chunks(batch[0], size) if batch else ((),):  # Chunks of the first axis.
        part = result[some]
        part[..., :3, :3], part[..., :3, 3], part[..., 3, 3] = turns[some], points[some], 1.0
    return result


def _finite(value: ArrayLike, name: str, size: int) -> Array:
    try:
        numbers = as_float_array(value)
    except (TypeError, ValueError, OverflowError) as error:
        raise InvalidGoal(f"{name} must be numbers of shape (..., {size}): {error}") from error
    if numbers.ndim == 0 or numbers.shape[-1] != size:
        raise InvalidGoal(f"{name} must have shape ({size},) or (..., {size}), got {numbers.shape}")
    if not all_finite(numbers):
        raise InvalidGoal(f"{name} contains NaN or infinity: {numbers}")
    return numbers


def unit_vector(value: ArrayLike, name: str) -> Array:
    """Return one vector of any length but 0, (3,), with length 1."""
    vector = _finite(value, name, 3)
    if vector.ndim != 1 or np.linalg.norm(vector) < SHORTEST:
        raise InvalidGoal(f"{name} must be one vector (3,) longer than zero, got {vector}")
    return np.asarray(vector / np.linalg.norm(vector))


@lru_cache(maxsize=64)
def x_onto(axis: tuple[float, ...]) -> Array:
    """Return a rotation that maps the x axis to a unit vector, (3, 3)."""
    turn = rotation_onto(np.array([1.0, 0.0, 0.0]), np.array(axis))
    turn.flags.writeable = False
    return turn
