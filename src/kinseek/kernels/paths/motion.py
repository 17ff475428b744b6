"""The straight motion of the hand from a pose to the next, undone by two additional joints; and memory for a tube."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from kinseek.kernels.arrays import Array, ChainArrays
from kinseek.kernels.jit import counted, inlined
from kinseek.kernels.proof.box import BoxScratch, Form, make_box_scratch


class Tube(NamedTuple):
    """Memory of one tube around the centre of the scratch memory, and bounds for it; rows are joints."""

    c: Array
    """Centre, (n+1,)."""
    t: Array
    """Derivative of the branch with respect to s, with last entry 1, (n+1,)."""
    u: Array
    """Second derivative, with last entry 0, (n+1,)."""
    rows: Array
    """M for the columns and the point, laid out as a pose, (n, 3, 4)."""
    across: Array
    """M for the deviation of the joints in the held directions, (n, k)."""
    point: Array
    """Norm of the part of M for the point, (n,)."""
    column: Array
    """Norm of the part of M for the columns, (n,)."""
    value: Array
    """M f(c), (n,)."""
    slope: Array
    """M f', (n, n+1)."""
    bend: Array
    """M H, (n, n+1, n+1)."""
    D: Array
    """Inverse of the normal matrix, (n, n)."""
    start: Array
    """a, (n,)."""
    wide: Array
    """v, (n+1,)."""
    half: Array
    """ρ, (n,)."""
    reach: Array
    """κ(ρ), (n,)."""
    away: Array
    """ε, (n,)."""
    gain_point: Array
    """∂rest/∂δ of the point for each physical joint, (m+2,)."""
    gain_column: Array
    """∂rest/∂δ of the columns, (m+2,)."""
    spread: Array
    """Sum of the half widths of the revolute joints from the middle of the arm up to each joint, (m+2,)."""


class Motion(NamedTuple):
    """The motion of the hand from a pose to the next, undone by two additional joints of the arm."""

    form: Form
    """The arm with these two joints."""
    scratch: BoxScratch
    """Scratch memory; the last entry of its centre is s."""
    tube: Tube
    hold: Array
    """Directions in which the joints are held to linear interpolation, (k, n); empty if solutions are isolated."""
    begin: Array
    """Joint values at s = 0, (n,)."""
    end: Array
    """Joint values at s = 1, (n,)."""
    numbers: Array
    """See `LENGTH`."""


LENGTH, MARGIN, MARGIN_A, COUNT = range(4)
"""Indices into the numbers of a motion: the length of a radian [m]; the allowance for rounding of the point [m] and of
the columns; and the number of these entries."""


@counted
def make_motion(chain: ChainArrays, columns: int, begin: Array, hold: Array, numbers: Array) -> Motion:
    """Allocate the memory for the steps of one path; `lead` sets the first two joints."""
    m, n = len(chain.leader), len(chain.lower)
    fixed, prismatic = np.zeros((m + 3, 3, 4)), np.zeros(m + 2, dtype=np.bool_)
    leader, multiplier, offset = np.full(m + 2, n), np.zeros(m + 2), np.zeros(m + 2)
    prismatic[1] = True
    for k in range(m):
        prismatic[k + 2], leader[k + 2] = chain.prismatic[k], chain.leader[k]
        multiplier[k + 2], offset[k + 2] = chain.multiplier[k], chain.offset[k]
    for k in range(m + 1):
        for r in range(3):
            for c in range(4):
                fixed[k + 2, r, c] = chain.fixed[k, r, c]
    tube = Tube(
        np.zeros(n + 1),
        np.ones(n + 1),
        np.zeros(n + 1),
        np.zeros((n, 3, 4)),
        np.zeros((n, hold.shape[0])),
        np.zeros(n),
        np.zeros(n),
        np.zeros(n),
        np.zeros((n, n + 1)),
        np.zeros((n, n + 1, n + 1)),
        np.zeros((n, n)),
        np.zeros(n),
        np.zeros(n + 1),
        np.zeros(n),
        np.zeros(n),
        np.zeros(n),
        np.zeros(m + 2),
        np.zeros(m + 2),
        np.zeros(m + 2),
    )
    form = Form(fixed, prismatic, leader, multiplier, offset, 0, columns, 0, 0.0)
    return Motion(
        form, make_box_scratch(m + 2, n + 1), tube, hold.copy(), begin.copy(), begin.copy(), numbers.copy()
    )


@inlined
def frame_along(x: float, y: float, z: float, size: float, frame: Array) -> None:
    """Write axes into the rotation of `frame`, (3, 4); the third has the direction of a vector of length `size`."""
    if size > 0.0:
        x, y, z = x / size, y / size, z / size
    else:
        x, y, z = 0.0, 0.0, 1.0
    # Normal to the vector and to the coordinate axis that is farthest from it.
    if abs(x) <= abs(y) and abs(x) <= abs(z):
        a, b, c = 0.0, z, -y
    elif abs(y) <= abs(z):
        a, b, c = -z, 0.0, x
    else:
        a, b, c = y, -x, 0.0
    length = math.sqrt(a * a + b * b + c * c)
    a, b, c = a / length, b / length, c / length
    frame[0, 0], frame[1, 0], frame[2, 0] = a, b, c
    frame[0, 1], frame[1, 1], frame[2, 1] = y * c - z * b, z * a - x * c, x * b - y * a
    frame[0, 2], frame[1, 2], frame[2, 2] = x, y, z


@inlined
def lead(motion: Motion, chain: ChainArrays, target: Array, slide: Array, turn: Array) -> None:
    """Set the two joints that undo the motion of the hand from a target, (3, 4), by d [m] and w [rad], (3,), in the base."""
    form, goal = motion.form, motion.scratch.goal
    fixed = form.fixed
    way = math.sqrt(slide[0] * slide[0] + slide[1] * slide[1] + slide[2] * slide[2])
    angle = math.sqrt(turn[0] * turn[0] + turn[1] * turn[1] + turn[2] * turn[2])
    form.multiplier[0], form.multiplier[1] = -angle, -way
    frame_along(turn[0], turn[1], turn[2], angle, fixed[0])
    along = motion.scratch.T  # Free until the arm is placed.
    frame_along(slide[0], slide[1], slide[2], way, along)
    for r in range(3):
        fixed[0, r, 3] = target[r, 3]
        for c in range(4):
            goal[r, c] = target[r, c]
    for r in range(3):
        for c in range(3):
            fixed[1, r, c] = (
                fixed[0, 0, r] * along[0, c] + fixed[0, 1, r] * along[1, c] + fixed[0, 2, r] * along[2, c]
            )
        fixed[1, r, 3] = -(
            fixed[0, 0, r] * target[0, 3] + fixed[0, 1, r] * target[1, 3] + fixed[0, 2, r] * target[2, 3]
        )
        for c in range(4):
            first = chain.fixed[0]
            fixed[2, r, c] = along[0, r] * first[0, c] + along[1, r] * first[1, c] + along[2, r] * first[2, c]


@inlined
def across_by(motion: Motion, a: int, q: Array, s: float) -> float:
    """Deviation of joint values in held direction `a` from the interpolated values at s."""
    off = 0.0
    for j in range(motion.hold.shape[1]):
        off += motion.hold[a, j] * (q[j] - motion.begin[j] - s * (motion.end[j] - motion.begin[j]))
    return off
