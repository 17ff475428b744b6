"""The swept joint of a closed form: the values that are tried, and the displacement that remains for the other joints.

If the value of the swept joint is given, the other joints form an arm with a closed form. Which values leave a solution
within the limits depends mostly on the direction of the hand about the axis of the joint, or on its position along the
axis of a prismatic joint. At a fixed offset from that direction the other joints have nearly the same task wherever the
hand is. `swept_values` tries which offsets serve best when an arm is loaded. If the last joint is the swept one, the arm
is solved backwards, and the shoulder as seen from the hand takes the place of the hand.
"""

from __future__ import annotations

import math

from kinseek.kernels.arm.division import nearest_copy
from kinseek.kernels.arm.forward import copy_pose
from kinseek.kernels.arm.trigonometry import sine_cosine
from kinseek.kernels.arm.vectors import (
    column,
    cross,
    dot,
    minus,
    plus,
    rotate,
    scaled,
    transformed,
    write_column,
)
from kinseek.kernels.arrays import Array
from kinseek.kernels.atlas.task import Task
from kinseek.kernels.jit import inlined

from .candidates import Structure, read_structure
from .subproblems import angle


@inlined
def swept_joint(structure: Array, dof: int) -> int:
    """Index of the swept joint of an arm."""
    return dof - 1 if read_structure(structure).backward > 0.0 else 0


@inlined
def direction(s: Structure, D: Array) -> float:
    """Direction of the point x, seen from the swept joint: an angle [rad], or a position [m] along its axis.

    The last axes do not move x, see `candidates`.
    """
    u = minus(transformed(D, s.centre), s.swept_point)
    if s.slides > 0.0:
        return dot(s.swept_axis, u)
    return angle(dot(cross(s.swept_axis, s.swept_across), u), dot(s.swept_across, u))


@inlined
def taken_off(structure: Array, D: Array, value: float, rest: Array) -> None:
    """Write the displacement, (3, 4), of the other joints for a value of the swept joint; all of D if there is none."""
    s = read_structure(structure)
    if s.swept == 0.0 or s.slides > 0.0:
        copy_pose(D, rest)
        if s.swept > 0.0:
            write_column(minus(column(D, 3), scaled(value, s.swept_axis)), rest, 3)
        return
    axis, point = s.swept_axis, s.swept_point
    sine, cosine = sine_cosine(-value)
    for c in range(3):
        write_column(rotate(axis, cosine, sine, column(D, c)), rest, c)
    write_column(plus(rotate(axis, cosine, sine, minus(column(D, 3), point)), point), rest, 3)


@inlined
def given_value(task: Task, value: float, near: Array) -> tuple[float, bool]:
    """Move a value of the swept joint into its limits by full turns, close to `near`; return it and whether it is inside."""
    i = swept_joint(task.structure, len(task.lower))
    low, high = task.chain.lower[i], task.chain.upper[i]
    if read_structure(task.structure).slides == 0.0:
        if math.isinf(task.lower[i]):
            low, high = near[i] - math.pi, near[i] + math.pi
        value = nearest_copy(value, low, high, near[i])
    return value, low <= value <= high


@inlined
def end_value(task: Task, which: int) -> tuple[float, bool]:
    """Lower or upper end (0 or 1) of the range of the swept joint, and whether that end is finite."""
    i = swept_joint(task.structure, len(task.lower))
    value = task.lower[i] if which == 0 else task.upper[i]
    return value, not math.isinf(value)
