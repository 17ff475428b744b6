"""Errors of a pose: the paper's weighted error, and the errors in [m] and [rad] that are compared with the tolerances."""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np

from kinseek.kernels.arrays import Array, ChainArrays, Flags, GoalArrays
from kinseek.kernels.entry import OUT
from kinseek.kernels.jit import entry, exact, inlined

from .forward import forward_many
from .vectors import column, cross, dot, minus, norm, plus

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
    return norm(minus(column(T, 3), column(target, 3)))


@inlined
def rotation_angle(T: Array, target: Array) -> float:
    """Angle of the rotation between two poses, in [rad], accurate both at 0 and at π.

    The cross products of the columns add up to the axis times twice the sine, and their dot products to 1 plus twice the
    cosine.
    """
    x, y, z = column(T, 0), column(T, 1), column(T, 2)
    a, b, c = column(target, 0), column(target, 1), column(target, 2)
    axis = plus(plus(cross(x, a), cross(y, b)), cross(z, c))
    return math.atan2(norm(axis), dot(x, a) + dot(y, b) + dot(z, c) - 1.0)


@inlined
def axis_angle(T: Array, target: Array) -> float:
    """Angle between the x columns of two poses, in [rad]."""
    x, a = column(T, 0), column(target, 0)
    return math.atan2(norm(cross(x, a)), dot(x, a))


@inlined
def column_change(T: Array, goal: GoalArrays, c: int) -> float:
    """``|c - c_g|²`` of a column."""
    change = minus(column(T, c), column(goal.target, c))
    return dot(change, change)


@exact
def unfused(a: float, b: float) -> float:
    """``a b``, rounded before it enters a sum.

    Of a sum of two products LLVM fuses either, depending on the kernel around it. The weighted error must have the same
    bits in every kernel.
    """
    return a * b


@inlined
def weighted_error(T: Array, goal: GoalArrays) -> float:
    """``K_P |p - p_g| + Σ K_c (1 - c·c_g)`` over the columns c that matter (the paper, Sec. 2.2).

    Computed as ``½ |c - c_g|²``, which is the same for unit vectors: ``1 - c·c_g`` cancels near the goal and could be
    negative.
    """
    error = unfused(goal.position_weight, distance(T, goal.target))
    for c in range(3):
        error += 0.5 * goal.axis_weights[c] * column_change(T, goal, c)
    return error


@inlined
def chordal_error(T: Array, goal: GoalArrays) -> float:
    """``K_P |p - p_g|² + Σ K_c |c - c_g|²``: along one joint an exact sinusoid or parabola."""
    error = 0.0
    for c in range(4):
        weight = goal.position_weight if c == 3 else goal.axis_weights[c]
        error += weight * column_change(T, goal, c)
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
    """Compute the errors of poses.

    Args:
        poses: Poses of the tip, (k, 4, 4), lengths in [m].
        targets: Target poses, (k, 3, 4), lengths in [m].
        goal: The weights, which also define the relevant parts of a pose.

    Returns:
        Position error [m], orientation error [rad] and weighted error of each, (k, 3).
    """
    result = np.empty((len(poses), 3))
    write_pose_errors(np.ascontiguousarray(poses), np.ascontiguousarray(targets), goal, result)
    return result


def judge(chain: ChainArrays, q: Array, targets: Array, goal: GoalArrays) -> Array:
    """Compute the errors of joint values, (k, n), by plain FK, see `judge_poses`."""
    return judge_poses(forward_many(chain, q), targets, goal)


@exact
def is_loose(T: Array, tolerance: float) -> bool:
    """Return True if T, (4, 4), is farther from a rigid transform than `tolerance`, a reflection, or beyond `LARGEST`.

    Numbers that are not finite are found. It is compiled as exact code: the other kernels may fuse products with sums.
    """
    for c in range(4):
        # `not … <= …` also rejects NaN, with which every comparison is False.
        if not abs(T[3, c] - (1.0 if c == 3 else 0.0)) <= tolerance:
            return True
    for c in range(3):
        for d in range(c + 1):
            product = T[0, c] * T[0, d] + T[1, c] * T[1, d] + T[2, c] * T[2, d]
            if not abs(product - (1.0 if c == d else 0.0)) <= tolerance:
                return True
        if not abs(T[c, 3]) <= LARGEST:
            return True
    # RᵀR = 1 holds for reflections too, but their determinant is -1.
    volume = T[0, 0] * (T[1, 1] * T[2, 2] - T[1, 2] * T[2, 1])
    volume += T[0, 1] * (T[1, 2] * T[2, 0] - T[1, 0] * T[2, 2])
    volume += T[0, 2] * (T[1, 0] * T[2, 1] - T[1, 1] * T[2, 0])
    mirrored: bool = not volume > 0.0
    return mirrored


@exact
def is_rigid(T: Array) -> bool:
    """Return True if T, (4, 4), is a rigid transform up to `ROUNDING`, see `is_loose`, whose last row is exact."""
    if T[3, 0] != 0.0 or T[3, 1] != 0.0 or T[3, 2] != 0.0 or T[3, 3] != 1.0:
        return False
    return not is_loose(T, ROUNDING)


@entry
def all_rigid(poses: Annotated[Array, "k", 4, 4], each: Annotated[Flags, "k", OUT]) -> bool:
    """Return True if all poses, (k, 4, 4), are rigid transforms up to rounding, and write this of each, (k,)."""
    loose = 0
    for k in range(len(poses)):
        each[k] = is_rigid(poses[k])
        loose += 0 if each[k] else 1
    return loose == 0


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
