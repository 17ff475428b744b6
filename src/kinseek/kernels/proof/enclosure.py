"""The best box first: enclose the least weighted error that any joint values have."""

from __future__ import annotations

import numpy as np

from kinseek.kernels.arm.forward import forward
from kinseek.kernels.arm.pose_error import weighted_error
from kinseek.kernels.arrays import Array, ChainArrays, GoalArrays, Indices
from kinseek.kernels.jit import hidden, kernel

from .bounds import first_order
from .box import (
    BELOW,
    HEAD,
    MIDDLE_ERROR,
    NARROW,
    Form,
    Wanted,
    halve,
    load_box,
    make_desk,
    place,
    turn_goal,
    turned,
    volume,
    widest,
    widths,
)
from .exclusion import COUNT, ENDED, FULL, SEEN, STOPPED, STUCK, UPPER
from .form import underestimate
from .gate import gate
from .last_joint import Roll, complete, cut_twist, roll_fits, twist_cost

USED = 2  # Rows that have held a box: those of boxes that are done are taken again. Beside COUNT and SEEN.
FLOOR = 2  # Least bound of the boxes given up as too narrow. Beside UPPER and STUCK.

FINE = 1.2
"""Boxes that turn the hand by less [rad] are cut along a first joint as along any other: azimuths hardly cut them."""


@hidden
def sift_up(heap: Array, order: Indices, at: int) -> None:
    """Bring the entry at `at` up to its place; `heap` holds the bound of each row, `order` the rows."""
    while at > 0:
        parent = (at - 1) // 2
        if heap[order[parent]] <= heap[order[at]]:
            return
        order[parent], order[at] = order[at], order[parent]
        at = parent


@hidden
def sift_down(heap: Array, order: Indices, size: int) -> None:
    """Bring the entry at the top down to its place."""
    at = 0
    while True:
        child = 2 * at + 1
        if child >= size:
            return
        if child + 1 < size and heap[order[child + 1]] < heap[order[child]]:
            child += 1
        if heap[order[at]] <= heap[order[child]]:
            return
        order[child], order[at] = order[at], order[child]
        at = child


@kernel
def enclose(
    form: Form,
    wanted: Wanted,
    roll: Roll,
    chain: ChainArrays,
    goal: GoalArrays,
    rows: Array,
    bound: Array,
    order: Indices,
    q: Array,
    tuning: Array,
    counts: Indices,
    figures: Array,
    until: int,
    budget: int,
) -> int:
    """Enclose the least weighted error inside the limits, best box first.

    It may be called again to go on where it stopped, and finds the same as if it had not stopped.

    Args:
        form: The part of the arm that the boxes are about.
        wanted: What is asked of it.
        roll: The last joint, where it is divided out.
        chain: The arm again, to judge joint values by plain forward kinematics.
        goal: The goal as it was asked.
        rows: Boxes, (room, 2 dof): centres, half widths.
        bound: A lower bound of the error in each, (room,).
        order: Rows of the boxes that are left, the first COUNT of it, as a heap; then rows to be taken again, (room,).
        q: The best joint values known, (n,); better ones are written here.
        tuning: Largest spread for the second order [rad], shrink that earns another look, relative gap.
        counts: COUNT, SEEN and USED, (3,); with USED = 0 the search begins, with the first COUNT rows.
        figures: UPPER, STUCK and FLOOR, (3,).
        until: Boxes that may have been examined by the end of this call.
        budget: Boxes that may be examined in all.

    Returns:
        ENDED, STOPPED or FULL.
    """
    dof, count, seen, used = rows.shape[1] // 2, counts[COUNT], counts[SEEN], counts[USED]
    desk, trial, T = make_desk(len(form.leader), dof), q.copy(), np.empty((3, 4))
    if used == 0:
        least = gate(form, wanted, chain)[1]
        for row in range(count):
            bound[row], order[row] = max(bound[row], least), row
            sift_up(bound, order, row)
        used = count
        forward(chain, q, T)
        figures[UPPER] = weighted_error(T, goal)
    upper, stuck_width, stuck_bound, outcome = figures[UPPER], figures[STUCK], figures[FLOOR], ENDED
    ceiling = (1.0 - tuning[2]) * upper
    while count > 0:
        if seen >= until or count == len(rows):
            outcome = STOPPED if seen >= until else FULL
            break
        row = order[0]
        if bound[row] >= ceiling:
            break
        load_box(rows, row, desk)
        below = bound[row]
        while True:
            desk.found[BELOW] = 0.0
            seen += 1
            place(form, desk)
            widths(form, desk)
            kept = first_order(form, wanted, desk, ceiling)
            below = max(below, desk.found[BELOW])
            if kept and form.tail == 1:
                kept = cut_twist(form, wanted, desk, ceiling)
            spread = turned(form, desk, len(form.leader))
            if not kept or spread >= tuning[0]:
                break
            extra = 0.0
            before = volume(desk)
            if roll.present:
                turn_goal(form, wanted, desk)
                roll_fits(form, wanted, roll, desk)
                widths(form, desk)
                extra = twist_cost(form, wanted, roll, desk, ceiling)
            if extra >= ceiling:
                kept, below = False, max(below, extra)
                break
            complete(form, roll, chain, desk, trial)
            kept = underestimate(form, wanted, desk, ceiling - extra)
            below = max(below, desk.found[BELOW] + extra)
            if desk.found[MIDDLE_ERROR] < upper:
                forward(chain, trial, T)
                error = weighted_error(T, goal)
                if error < upper:
                    upper = error
                    ceiling = (1.0 - tuning[2]) * upper
                    for i in range(len(q)):
                        q[i] = trial[i]
            if not kept or not volume(desk) < tuning[1] * before or seen >= budget:
                break
        if kept and below < ceiling:
            i = widest(form, wanted, desk, HEAD if spread > FINE else 1.0)
            if desk.h[i] < NARROW * (1.0 + abs(desk.c[i])):
                stuck_bound, stuck_width = min(stuck_bound, below), max(stuck_width, desk.h[i])
                kept = False
        if not kept or below >= ceiling:
            count -= 1
            order[0], order[count] = order[count], order[0]
            sift_down(bound, order, count)
            continue
        if count == used:
            order[count] = used
            used += 1
        other = order[count]
        halve(desk, i, rows, row, other)
        bound[row] = bound[other] = below
        sift_down(bound, order, count)
        sift_up(bound, order, count)
        count += 1
    counts[COUNT], counts[SEEN], counts[USED] = count, seen, used
    figures[UPPER], figures[STUCK], figures[FLOOR] = upper, stuck_width, stuck_bound
    return outcome
