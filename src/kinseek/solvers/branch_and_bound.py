"""Branch and bound: prove that a goal is out of reach, or say how near any pose could come.

Boxes of joint values are cut in half, again and again. Each is tested by the bounds of `kernels.bounds`: first what the
whole box can do, then one linear form of the hand's pose to second order, which also cuts the box from its sides. All
boxes gone: nothing inside the limits reaches the goal. Best box first, the same search encloses the least error.
(Land & Doig 1960; in robotics Rao, Asaithambi & Agrawal 1998, who solve inverse kinematics by interval analysis.)
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from kinseek.kernels.arrays import Array, ChainArrays, GoalArrays
from kinseek.kernels.atlas import TURN, nearest_copy
from kinseek.kernels.bounds import (
    CHORD,
    LENGTH,
    MARGIN_A,
    POSITION,
    Desk,
    Form,
    Wanted,
    first_order,
    make_desk,
    place,
    second_order,
    widths,
)
from kinseek.kernels.forward import forward
from kinseek.kernels.jit import inner, kernel
from kinseek.kernels.pose_error import errors, weighted_error

ENDED, FOUND, STOPPED = 0, 1, 2


class Roll(NamedTuple):
    """The last joint, where it is divided out."""

    present: bool
    lower: float
    upper: float
    """Limits [rad]; at least a full turn apart where they do not matter."""


class Search(NamedTuple):
    """How a search went."""

    outcome: int
    """ENDED: no box left; FOUND: `q` is within the tolerances; STOPPED: by the budget or by rounding."""
    boxes: int
    largest: float
    """Widest box that is left, the half width of its widest variable [rad] or [m]; 0 if none."""
    q: Array
    """(n,), the best joint values seen."""
    lower: float
    """Lower bound on the weighted error."""
    upper: float
    """Weighted error of `q`."""


@inner
def roll_fits(form: Form, wanted: Wanted, roll: Roll, desk: Desk) -> bool:
    """Can the last joint, within its limits, make up for what is left of the rotation? Its best value goes to ``u[2]``.

    The hand without its last turn is off by a rotation of at most Ω. Write the turn that is asked for as a quaternion: its
    part about the last axis is cos(τ/2) long, τ the tilt. So the last joint is within ``2 acos(cos(Ω/2)/cos(τ/2))``.
    """
    T, goal = desk.T, desk.goal
    m00 = m01 = m10 = m11 = dot = 0.0
    for r in range(3):
        m00 += T[r, 1] * goal[r, 1]
        m01 += T[r, 1] * goal[r, 2]
        m10 += T[r, 2] * goal[r, 1]
        m11 += T[r, 2] * goal[r, 2]
        dot += T[r, 0] * goal[r, 0]
    best = math.atan2(m10 - m01, m00 + m11)
    middle, half = 0.5 * (roll.lower + roll.upper), 0.5 * (roll.upper - roll.lower)
    desk.u[2] = nearest_copy(best, roll.lower, roll.upper, middle)
    if half >= math.pi:
        return True
    omega = wanted.scalars[CHORD] * 1.1 + wanted.scalars[MARGIN_A]
    for k in range(len(form.leader)):
        if not form.prismatic[k]:
            omega += desk.half[k]
    if omega >= math.pi:
        return True
    ratio = math.cos(0.5 * omega) / math.sqrt(max(0.5 * (1.0 + dot), 1e-30))
    # The slack of sqrt(1e-12) covers rounding where the ratio is close to one.
    miss = 2.0 * math.acos(min(ratio, 1.0)) + 2e-6
    off = best - middle
    off -= 2.0 * math.pi * math.floor(off / (2.0 * math.pi) + 0.5)
    return abs(off) <= half + miss


@inner
def widest(form: Form, wanted: Wanted, desk: Desk) -> int:
    """The variable whose range moves the hand most."""
    best, index = -1.0, 0
    for i in range(len(desk.c)):
        desk.delta[i] = 0.0
    for k in range(len(form.leader)):
        turn = (
            0.0 if form.prismatic[k] else wanted.scalars[LENGTH] * (desk.s[k] if form.columns == 1 else 1.0)
        )
        if form.columns == 0:
            turn = 0.0
        i = form.leader[k]
        desk.delta[i] += abs(form.multiplier[k]) * desk.h[i] * (desk.r[k] + turn)
    for i in range(len(desk.c)):
        if desk.delta[i] > best:
            best, index = desk.delta[i], i
    return index


@inner
def load_box(boxes: Array, row: int, desk: Desk) -> None:
    """Take a box from row `row` of the list."""
    dof = len(desk.c)
    for i in range(dof):
        desk.c[i] = boxes[row, i]
        desk.h[i] = boxes[row, dof + i]


@inner
def store_box(boxes: Array, row: int, desk: Desk) -> None:
    """Write the box of the desk to row `row`."""
    dof = len(desk.c)
    for i in range(dof):
        boxes[row, i] = desk.c[i]
        boxes[row, dof + i] = desk.h[i]


@inner
def volume(desk: Desk) -> float:
    """Volume of the box."""
    product = 1.0
    for i in range(len(desk.h)):
        product *= desk.h[i]
    return product


@inner
def complete(form: Form, roll: Roll, chain: ChainArrays, desk: Desk, q: Array) -> None:
    """Joint values of the box' centre, (n,), inside the limits."""
    for i in range(len(q)):
        value = desk.u[2] if roll.present and i == len(q) - 1 else desk.c[i]
        if i == 0 and form.head == TURN:
            value = nearest_copy(
                value, chain.lower[0], chain.upper[0], 0.5 * (chain.lower[0] + chain.upper[0])
            )
        q[i] = min(max(value, chain.lower[i]), chain.upper[i])


@kernel
def exclude(
    form: Form,
    wanted: Wanted,
    roll: Roll,
    chain: ChainArrays,
    goal: GoalArrays,
    boxes: Array,
    tuning: Array,
    budget: int,
) -> Search:
    """Look for any q within both tolerances, box after box, the last one first.

    Args:
        form: The part of the arm that the boxes are about.
        wanted: What is asked of it.
        roll: The last joint, where it is divided out.
        chain: The whole arm, for the witness.
        goal: The goal as it was asked.
        boxes: Boxes to start with, (k, 2 dof): centres and half widths.
        tuning: Largest spread for the second order [rad], passes, shrink that earns another look.
        budget: Boxes to examine.
    """
    dof, count, seen = len(form_dof(boxes)), len(boxes), 0
    desk = make_desk(len(form.leader), dof)
    stack = np.empty((count + 64 * dof + 64, 2 * dof))
    for i in range(count):
        for j in range(2 * dof):
            stack[i, j] = boxes[i, j]
    q, T, best = np.zeros(len(chain.lower)), np.empty((3, 4)), np.inf
    trial = np.zeros(len(chain.lower))
    stuck = 0.0
    while count > 0 and seen < budget:
        count -= 1
        load_box(stack, count, desk)
        seen += 1
        place(form, desk)
        widths(form, desk)
        if not first_order(form, wanted, desk, -1.0):
            continue
        spread = 0.0
        for k in range(len(form.leader)):
            spread += 0.0 if form.prismatic[k] else desk.half[k]
        before = volume(desk)
        if spread < tuning[0]:
            if not second_order(form, wanted, desk, -1.0, int(tuning[1])):
                continue
            desk.u[2] = 0.0
            if roll.present and not roll_fits(form, wanted, roll, desk):
                continue
            if desk.u[0] <= wanted.scalars[POSITION] and desk.u[1] <= wanted.scalars[CHORD]:
                complete(form, roll, chain, desk, trial)
                forward(chain, trial, T)
                position, orientation = errors(T, goal)
                error = weighted_error(T, goal)
                if error < best:
                    best = error
                    for i in range(len(q)):
                        q[i] = trial[i]
                if position <= tuning[3] and orientation <= tuning[4]:
                    return Search(FOUND, seen, 0.0, trial, 0.0, error)
            if volume(desk) < tuning[2] * before:
                store_box(stack, count, desk)
                count += 1
                continue
        i = widest(form, wanted, desk)
        if desk.h[i] < 1e-10 * (1.0 + abs(desk.c[i])):
            stuck = max(stuck, desk.h[i])
            continue
        half = 0.5 * desk.h[i]
        centre = desk.c[i]
        desk.h[i] = half + 1e-15
        desk.c[i] = centre - half
        store_box(stack, count, desk)
        desk.c[i] = centre + half
        store_box(stack, count + 1, desk)
        count += 2
    largest = stuck
    for k in range(count):
        for i in range(dof):
            largest = max(largest, stack[k, dof + i])
    ended = count == 0 and stuck == 0.0
    return Search(ENDED if ended else STOPPED, seen, largest, q, 0.0, best)


@inner
def form_dof(boxes: Array) -> Array:
    """A view as long as the boxes have variables."""
    return boxes[0, : boxes.shape[1] // 2]
