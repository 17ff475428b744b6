"""Errors of a pose: the paper's weighted error, and the errors in [m] and [rad] that are compared with the tolerances."""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np

from kinseek.kernels.arrays import Array, ChainArrays, Flags, GoalArrays
from kinseek.kernels.entry import OUT
from kinseek.kernels.jit import entry, exact, inlined

from .forward import forward

ROUNDING = 2e-14
"""A matrix is a rotation up to rounding if its RᵀR is no farther than this from the identity, which covers a product of
some fifty rotations. It is then used unchanged. Other matrices are projected onto a rotation or rejected."""

LARGEST = 1e7
"""Largest accepted length [m], angle [rad] and tolerance. Neighbouring doubles are 1.9e-9 apart there, and the rounding
error of forward kinematics with twenty links of that length is 4e-8 m. It is the largest power of ten at which that
error stays below a tenth of the default tolerance, 1e-6 m. tests/test_sizes.py measures it."""

HEAVIEST, LIGHTEST = 1e15, 1e-15
"""Largest and smallest accepted weight. Searches square weighted errors and multiply the squares. With lengths up to
`LARGEST` the products stay within 1e±90, far from the limits of doubles. Beyond a ratio of 1e16 the smaller of two
weighted errors is rounding of the larger."""


@inlined
def distance(T: Array, target: Array) -> float:
    """Distance between the origins of two poses, (3, 4) or (4, 4), in [m]."""
    x, y, z = T[0, 3] - target[0, 3], T[1, 3] - target[1, 3], T[2, 3] - target[2, 3]
    return math.sqrt(x * x + y * y + z * z)


@inlined
def axis_dot(T: Array, target: Array, c: int) -> float:
    """Dot product of column c of two rotations."""
    dot: float = T[0, c] * target[0, c] + T[1, c] * target[1, c] + T[2, c] * target[2, c]
    return dot


@inlined
def rotation_angle(T: Array, target: Array) -> float:
    """Angle of the rotation between two poses, in [rad], accurate both at 0 and at π."""
    xx, yy, zz = axis_dot(T, target, 0), axis_dot(T, target, 1), axis_dot(T, target, 2)
    sx = sy = sz = 0.0  # Twice the sine times the axis: sum of the cross products of the columns.
    for c in range(3):
        sx += T[1, c] * target[2, c] - T[2, c] * target[1, c]
        sy += T[2, c] * target[0, c] - T[0, c] * target[2, c]
        sz += T[0, c] * target[1, c] - T[1, c] * target[0, c]
    return math.atan2(math.sqrt(sx * sx + sy * sy + sz * sz), xx + yy + zz - 1.0)


@inlined
def axis_angle(T: Array, target: Array) -> float:
    """Angle between the x columns of two poses, in [rad]."""
    ax, ay, az = T[0, 0], T[1, 0], T[2, 0]
    bx, by, bz = target[0, 0], target[1, 0], target[2, 0]
    cx, cy, cz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    return math.atan2(math.sqrt(cx * cx + cy * cy + cz * cz), ax * bx + ay * by + az * bz)


@inlined
def weighted_error(T: Array, goal: GoalArrays) -> float:
    """``K_P |p - p_g| + Σ K_c (1 - c·c_g)`` over the columns c that matter (the paper, Sec. 2.2).

    Computed as ``½ |c - c_g|²``, which is the same for unit vectors: ``1 - c·c_g`` cancels near the goal and could be
    negative.
    """
    error = goal.position_weight * distance(T, goal.target)
    for c in range(3):
        x, y, z = T[0, c] - goal.target[0, c], T[1, c] - goal.target[1, c], T[2, c] - goal.target[2, c]
        error += 0.5 * goal.axis_weights[c] * (x * x + y * y + z * z)
    return error


@inlined
def chordal_error(T: Array, goal: GoalArrays) -> float:
    """``K_P |p - p_g|² + Σ K_c |c - c_g|²``: along one joint an exact sinusoid or parabola."""
    error = 0.0
    for c in range(4):
        weight = goal.position_weight if c == 3 else goal.axis_weights[c]
        x, y, z = (
            T[0, c] - goal.target[0, c],
            T[1, c] - goal.target[1, c],
            T[2, c] - goal.target[2, c],
        )
        error += weight * (x * x + y * y + z * z)
    return error


@inlined
def errors(T: Array, goal: GoalArrays) -> tuple[float, float]:
    """Position error [m] and orientation error [rad], each zero if the goal does not constrain it."""
    position = distance(T, goal.target) if goal.position_weight > 0.0 else 0.0
    if goal.axis_weights[1] > 0.0:
        return position, rotation_angle(T, goal.target)
    if goal.axis_weights[0] > 0.0:
        return position, axis_angle(T, goal.target)
    return position, 0.0


@entry
def write_errors(
    chain: ChainArrays,
    q: Annotated[Array, "k", "n"],
    targets: Annotated[Array, "k", 3, 4],
    goal: GoalArrays,
    result: Annotated[Array, "k", 3, OUT],
) -> None:
    """Write the result of `judge` into `result`, (k, 3)."""
    T = np.empty((3, 4))
    for k in range(len(q)):
        forward(chain, q[k], T)
        this = GoalArrays(targets[k], goal.position_weight, goal.axis_weights)
        result[k, 0], result[k, 1] = errors(T, this)
        result[k, 2] = weighted_error(T, this)


def judge(chain: ChainArrays, q: Array, targets: Array, goal: GoalArrays) -> Array:
    """Compute the errors of joint values by plain FK.

    Args:
        chain: The arm.
        q: Joint values, (k, n).
        targets: Target poses, (k, 3, 4), lengths in [m].
        goal: The weights, which also define the relevant parts of a pose.

    Returns:
        Position error [m], orientation error [rad] and weighted error of each, (k, 3).
    """
    result = np.empty((len(q), 3))
    write_errors(chain, np.ascontiguousarray(q), np.ascontiguousarray(targets), goal, result)
    return result


@exact
def is_rigid(T: Array) -> bool:
    """Return True if T, (4, 4), is finite, not beyond `LARGEST`, and a rigid transform up to `ROUNDING`.

    It is compiled as exact code: the other kernels may assume that no number is NaN.
    """
    for r in range(4):
        for c in range(4):
            if not abs(T[r, c]) <= LARGEST:
                return False
    if T[3, 0] != 0.0 or T[3, 1] != 0.0 or T[3, 2] != 0.0 or T[3, 3] != 1.0:
        return False
    for c in range(3):
        for d in range(c + 1):
            dot = T[0, c] * T[0, d] + T[1, c] * T[1, d] + T[2, c] * T[2, d]
            if abs(dot - (1.0 if c == d else 0.0)) > ROUNDING:
                return False
    volume = T[0, 0] * (T[1, 1] * T[2, 2] - T[1, 2] * T[2, 1])
    volume += T[0, 1] * (T[1, 2] * T[2, 0] - T[1, 0] * T[2, 2])
    volume += T[0, 2] * (T[1, 0] * T[2, 1] - T[1, 1] * T[2, 0])
    upright: bool = volume > 0.0
    return upright


@entry
def all_rigid(poses: Annotated[Array, "k", 4, 4]) -> bool:
    """Return True if all poses, (k, 4, 4), are finite and rigid transforms up to rounding."""
    loose = 0
    for k in range(len(poses)):
        loose += 0 if is_rigid(poses[k]) else 1
    return loose == 0


@entry
def write_rigid(poses: Annotated[Array, "k", 4, 4], result: Annotated[Flags, "k", OUT]) -> None:
    """Write the result of `rigid_each` into `result`, (k,)."""
    for k in range(len(poses)):
        result[k] = is_rigid(poses[k])


def rigid_each(poses: Array) -> Flags:
    """True for each pose of (k, 4, 4) that is a rigid transform up to rounding, see `is_rigid`, (k,)."""
    result = np.empty(len(poses), dtype=np.bool_)
    write_rigid(np.ascontiguousarray(poses), result)
    return result


@exact
def is_loose(T: Array, tolerance: float) -> bool:
    """Return True if a finite T, (4, 4), is farther from a rigid transform than `tolerance`, or a reflection."""
    for c in range(4):
        if not abs(T[3, c] - (1.0 if c == 3 else 0.0)) <= tolerance:
            return True
    for c in range(3):
        for d in range(c + 1):
            dot = T[0, c] * T[0, d] + T[1, c] * T[1, d] + T[2, c] * T[2, d]
            if not abs(dot - (1.0 if c == d else 0.0)) <= tolerance:
                return True
        if not abs(T[c, 3]) <= LARGEST:
            return True
    volume = T[0, 0] * (T[1, 1] * T[2, 2] - T[1, 2] * T[2, 1])
    volume += T[0, 1] * (T[1, 2] * T[2, 0] - T[1, 0] * T[2, 2])
    volume += T[0, 2] * (T[1, 0] * T[2, 1] - T[1, 1] * T[2, 0])
    mirrored: bool = not volume > 0.0
    return mirrored


@entry(exact=True)
def first_loose(poses: Annotated[Array, "k", 4, 4], tolerance: float, nan_is_fine: bool) -> int:
    """Index of the first pose of (k, 4, 4) that is not a rigid transform, or -1; `nan_is_fine` skips NaN."""
    for k in range(len(poses)):
        absent = False
        if nan_is_fine:
            for r in range(4):
                for c in range(4):
                    absent = absent or poses[k, r, c] != poses[k, r, c]
        if not absent and is_loose(poses[k], tolerance):
            return k
    return -1


@entry
def write_pose_errors(
    poses: Annotated[Array, "k", 4, 4],
    targets: Annotated[Array, "k", 3, 4],
    goal: GoalArrays,
    result: Annotated[Array, "k", 3, OUT],
) -> None:
    """Write the result of `judge_poses` into `result`, (k, 3)."""
    for k in range(len(poses)):
        this = GoalArrays(targets[k], goal.position_weight, goal.axis_weights)
        result[k, 0], result[k, 1] = errors(poses[k], this)
        result[k, 2] = weighted_error(poses[k], this)


def judge_poses(poses: Array, targets: Array, goal: GoalArrays) -> Array:
    """Errors of given poses, (k, 4, 4), as from `judge`, (k, 3)."""
    result = np.empty((len(poses), 3))
    write_pose_errors(np.ascontiguousarray(poses), np.ascontiguousarray(targets), goal, result)
    return result
