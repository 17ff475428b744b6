"""Steps for goals with free axes and ranges, which use only the part of the deviation outside the ranges.

The deviation of a pose from the target has six components in a frame, see `kinseek.goal.Goal`. A component outside its
range has a row in the Jacobian, and its distance to the range as residual. A component inside has neither, so the step is
free to move it. Let D be the rotation of the deviation in the frame and w = log D. A rotation ω of the hand changes w by
``J_l(w)⁻¹ ω``, with the inverse of SO(3)'s left Jacobian ``J_l⁻¹ = I - [w]/2 + (1/θ² - cot(θ/2)/2θ) [w]²`` (Solà, Deray
and Atchuthan 2018, Sec. 4). The rows are therefore exact for rotations of any size.
"""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

from kinseek.kernels.arm.range_error import (
    CONE,
    FRAME,
    HIGH,
    LOW,
    QUESTION,
    SWINGS,
    beyond,
    deviation,
    range_errors,
)
from kinseek.kernels.arm.vectors import Vector, dot, norm
from kinseek.kernels.arrays import Array, Indices
from kinseek.kernels.atlas.descent import LONGEST
from kinseek.kernels.atlas.lanes import (
    COSINE,
    DISTANCE2,
    LANES,
    RESIDUAL2,
    SINE2,
    Lanes,
    lanes_forward,
    lanes_gram,
    lanes_hold,
    lanes_jacobian,
    lanes_move,
    lanes_solve,
)
from kinseek.kernels.atlas.memory import Scratch, scratch_of, scratch_size
from kinseek.kernels.atlas.task import Job, Task, task_at
from kinseek.kernels.jit import inlined
from kinseek.kernels.layout import Layout
from kinseek.kernels.pointers import routine

POSES = 32
"""Poses of the ranges at which starts are looked up."""

WRAP = 0.5
"""Rotations at most this short of π [rad] may be nearer to a range the other way round."""

INSIDE = 1e-3
"""Largest distance that a step leads into a range [m or rad], for any width of the range and any tolerance."""

HOLD = 0.02
"""Every other lane keeps the row of a component that is this close to the end of its range, relative to the range. It
keeps what it has reached while it improves the other components."""

NEARLY_STRAIGHT = 1e-6
"""Squared angle [rad²] below which the coefficient of [w]² in J_l⁻¹ is its value at 0, 1/12, because its formula cancels
there. Relative to that value, the next term is a sixtieth of the squared angle."""


class RangeScratch(NamedTuple):
    """Memory of a goal with ranges, after the scratch memory of its call."""

    question: Annotated[Array, QUESTION]
    """The goal, see `range_error.FRAME`, (QUESTION,)."""
    poses: Annotated[Array, POSES, 3, 4]
    """Poses at which starts are looked up, (POSES, 3, 4)."""
    used: Annotated[Indices, 2 * POSES]
    """Sample used at each pose in the first and in the second look-up; -1 for none, (2 · POSES,)."""
    rows: Annotated[Array, 2, 9, LANES]
    """Two matrices for each lane, (2, 9, LANES), each row by row."""
    out: Annotated[Array, 6]
    """Deviation of the current pose, (6,)."""


LAYOUT = Layout(RangeScratch)
"""Layout in memory."""


range_scratch_size, lay_range_scratch = LAYOUT.size, LAYOUT.make


@inlined
def range_scratch_of(job: Job, task: Task) -> RangeScratch:
    """The scratch memory of a job for goals with ranges, behind that of other goals."""
    return make_range_scratch(job.memory, len(task.lower), len(task.chain.leader))


@inlined
def make_range_scratch(memory: Array, dof: int, joints: int) -> RangeScratch:
    """Create the views after the scratch memory, in a memory of `scratch_size` and `range_scratch_size` numbers."""
    ranges: RangeScratch = lay_range_scratch(memory.ctypes.data + 8 * scratch_size(dof, joints), dof, joints)
    return ranges


@inlined
def way_in(value: float, low: float, high: float, tolerance: float, hold: bool) -> tuple[float, float]:
    """Distance from a value into its range, and 1 if the component has a row, else 0.

    It leads slightly past the end, by at most a tolerance, so that rounding does not leave the solution outside.
    """
    width = high - low
    margin = min(0.25 * width, tolerance, INSIDE)
    band = max(HOLD * min(width, 1.0), margin) if hold else margin
    if value < low + band:
        return max(low + margin - value, 0.0) if width > 0.0 else low - value, 1.0
    if value > high - band:
        return min(high - margin - value, 0.0) if width > 0.0 else high - value, 1.0
    return 0.0, 0.0


@inlined
def past_the_half_turn(out: Array, question: Array) -> None:
    """Replace a long rotation vector in out[3:6] by that of the rotation the other way round if it is nearer to the range.

    A rotation of slightly more than π about an axis has a rotation vector in the opposite direction. It is far from a
    range that ends at 3 rad, although the hand is close to it. The distance to such a range is therefore measured past π.
    """
    angle = math.sqrt(out[3] * out[3] + out[4] * out[4] + out[5] * out[5])
    if angle < math.pi - WRAP:
        return
    # w and w (1 - 2π/|w|) are the same rotation.
    other = 1.0 - 2.0 * math.pi / angle
    here, there = 0.0, 0.0
    for i in range(3, 6):
        gap = beyond(out[i], question[LOW + i], question[HIGH + i])
        here += gap * gap
        gap = beyond(other * out[i], question[LOW + i], question[HIGH + i])
        there += gap * gap
    if there < here:
        for i in range(3, 6):
            out[i] *= other


@inlined
def cone_row(task: Task, lanes: Lanes, ranges: RangeScratch, hold: bool, l: int) -> float:
    """Write residual and row of the angle between an axis and its direction in the target; return the squared residual.

    A rotation ω of the hand changes the angle θ = |w| of the swing w by ω · w / θ.
    """
    question, rows, cone = ranges.question, ranges.rows, ranges.question[CONE]
    F, w = question[FRAME:LOW], Vector(ranges.out[3], ranges.out[4], ranges.out[5])
    angle = norm(w)
    way, has = way_in(angle, -cone, cone, task.orientation_tolerance, hold)
    e, scale = lanes.weight[1, l] * way, has / angle if angle > 0.0 else 0.0
    lanes.residual[3, l], lanes.residual[4, l], lanes.residual[5, l] = e, 0.0, 0.0
    for k in range(9):
        rows[1, k, l] = 0.0
    for k in range(3):
        rows[1, k, l] = scale * (w.x * F[3 * k] + w.y * F[3 * k + 1] + w.z * F[3 * k + 2])
    return float(e * e)


@inlined
def rows_of(task: Task, scratch: Scratch, ranges: RangeScratch, l: int) -> None:
    """Compute residual, errors and rows of lane l at its pose."""
    question, lanes, rows, out = ranges.question, scratch.lanes, ranges.rows, ranges.out
    F = question[FRAME:LOW]
    for r in range(3):
        for k in range(4):
            scratch.pose[r, k] = lanes.pose[r, k, l]
    u = deviation(scratch.pose, question, out)
    place, turn = range_errors(out, question)
    lanes.error[DISTANCE2, l], lanes.error[SINE2, l], lanes.error[COSINE, l] = place * place, turn * turn, 0.0
    total, hold, swings = 0.0, l % 2 == 1, question[SWINGS] != 0.0
    for i in range(3):
        way, has = way_in(out[i], question[LOW + i], question[HIGH + i], task.position_tolerance, hold)
        e = lanes.weight[0, l] * way
        lanes.residual[i, l] = e
        total += e * e
        for k in range(3):
            rows[0, 3 * i + k, l] = has * F[3 * k + i]
    if swings and question[CONE] > 0.0:
        lanes.error[RESIDUAL2, l] = total + cone_row(task, lanes, ranges, hold, l)
        return
    if not swings:
        past_the_half_turn(out, question)
    x, y, z = out[3], out[4], out[5]
    square = x * x + y * y + z * z
    curve = 1.0 / 12.0
    if square > NEARLY_STRAIGHT:
        angle = math.sqrt(square)
        curve = 1.0 / square - math.cos(0.5 * angle) / (2.0 * angle * math.sin(0.5 * angle))
    for i in range(3):
        way, has = -out[3 + i], 1.0
        if swings:
            # Row i of I - u uᵀ: the swing leaves a rotation about the axis itself free.
            own = u.x if i == 0 else (u.y if i == 1 else u.z)
            a, b, c = -own * u.x, -own * u.y, -own * u.z
            diagonal = 1.0
        else:
            low, high = question[LOW + 3 + i], question[HIGH + 3 + i]
            way, has = way_in(out[3 + i], low, high, task.orientation_tolerance, hold)
            # Row i of I - [w]/2 + curve (w wᵀ - |w|² I).
            own = out[3 + i]
            a, b, c = curve * own * x, curve * own * y, curve * own * z
            diagonal = 1.0 - curve * square
            if i == 0:
                b, c = b + 0.5 * z, c - 0.5 * y
            elif i == 1:
                a, c = a - 0.5 * z, c + 0.5 * x
            else:
                a, b = a + 0.5 * y, b - 0.5 * x
        a, b, c = (
            a + (diagonal if i == 0 else 0.0),
            b + (diagonal if i == 1 else 0.0),
            c + (diagonal if i == 2 else 0.0),
        )
        e = lanes.weight[1, l] * way
        lanes.residual[3 + i, l] = e
        total += e * e
        for k in range(3):
            rows[1, 3 * i + k, l] = has * (a * F[3 * k] + b * F[3 * k + 1] + c * F[3 * k + 2])
    lanes.error[RESIDUAL2, l] = total


@inlined
def matrix_row(rows: Array, r: int, l: int) -> Vector:
    """Row r of the matrix of a lane, (9, LANES)."""
    return Vector(rows[3 * r, l], rows[3 * r + 1, l], rows[3 * r + 2, l])


@inlined
def multiply_rows(lanes: Lanes, rows: Array, w: int) -> None:
    """Multiply the rows of every lane's Jacobian by the lane's matrices."""
    J = lanes.jacobian
    for i in range(J.shape[0]):
        for half in range(2):
            for l in range(w):
                column = Vector(J[i, 3 * half, l], J[i, 3 * half + 1, l], J[i, 3 * half + 2, l])
                J[i, 3 * half, l] = dot(matrix_row(rows[half], 0, l), column)
                J[i, 3 * half + 1, l] = dot(matrix_row(rows[half], 1, l), column)
                J[i, 3 * half + 2, l] = dot(matrix_row(rows[half], 2, l), column)


@routine
def range_step_routine(job: Job, move: bool) -> int:
    """See `descent.iterate`."""
    task, w = task_at(job), job.width
    scratch, ranges = scratch_of(job, task), range_scratch_of(job, task)
    lanes = scratch.lanes
    if move:
        lanes_jacobian(task.chain.leader, task.links, lanes, 0.0, w)
        multiply_rows(lanes, ranges.rows, w)
        lanes_hold(task.lower, task.upper, lanes, w)
        lanes_gram(scratch.damping[0], scratch.floor, lanes, w)
        lanes_solve(lanes, w)
        lanes_move(task.lower, task.upper, LONGEST, lanes, w)
    lanes_forward(task.chain.leader, task.links, lanes, w)
    for l in range(LANES):
        rows_of(task, scratch, ranges, l)
    return 0
