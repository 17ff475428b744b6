"""The best box first: enclose the least weighted error that any joint values have."""

from __future__ import annotations

import numpy as np

from .arrays import Array, ChainArrays, GoalArrays, Indices
from .bounds import first_order
from .boxes import (
    HEAD,
    LEAST,
    Form,
    Wanted,
    load_box,
    make_desk,
    place,
    store_box,
    turn_goal,
    turned,
    volume,
    widest,
    widths,
)
from .exclusion import ENDED, STOPPED, Search
from .forms import underestimate
from .forward import forward
from .gate import gate
from .jit import hidden, kernel, view
from .pose_error import weighted_error
from .roll import Roll, complete, cut_twist, roll_fits, twist_cost

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
    boxes: Array,
    q: Array,
    tuning: Array,
    budget: int,
) -> Search:
    """Enclose the least weighted error inside the limits, best box first.

    Args:
        form: The part of the arm that the boxes are about.
        wanted: What is asked of it.
        roll: The last joint, where it is divided out.
        chain: The arm again, to judge joint values by plain forward kinematics.
        goal: The goal as it was asked.
        boxes: Boxes to start with, (k, 2 dof + 1): centres, half widths, and a lower bound of the error in each.
        q: The best joint values known, (n,).
        tuning: Largest spread for the second order [rad], shrink that earns another look, relative gap.
        budget: Boxes to examine.
    """
    dof, count, seen = boxes.shape[1] // 2, len(boxes), 0
    desk = make_desk(len(form.leader), dof)
    capacity = 1024 + count
    rows, bound, order = np.empty((capacity, 2 * dof)), np.zeros(capacity), np.empty(capacity, dtype=np.int64)
    least = gate(form, wanted, chain)[1]
    for row in range(count):
        for i in range(2 * dof):
            rows[row, i] = boxes[row, i]
        bound[row], order[row] = max(boxes[row, 2 * dof], least), row
        sift_up(bound, order, row)
    used = count
    best, trial, T = q.copy(), q.copy(), np.empty((3, 4))
    forward(chain, q, T)
    upper = weighted_error(T, goal)
    ceiling = (1.0 - tuning[2]) * upper
    stuck_bound, stuck_width = np.inf, 0.0
    while count > 0 and seen < budget:
        row = order[0]
        if bound[row] >= ceiling:
            break
        load_box(rows, row, desk)
        below = bound[row]
        while True:
            desk.out[1] = 0.0
            seen += 1
            place(form, desk)
            widths(form, desk)
            kept = first_order(form, wanted, desk, ceiling)
            below = max(below, desk.out[1])
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
            below = max(below, desk.out[1] + extra)
            if desk.out[0] < upper:
                forward(chain, trial, T)
                error = weighted_error(T, goal)
                if error < upper:
                    upper = error
                    ceiling = (1.0 - tuning[2]) * upper
                    for i in range(len(q)):
                        best[i] = trial[i]
            if not kept or volume(desk) > tuning[1] * before or seen >= budget:
                break
        if kept and below < ceiling:
            i = widest(form, wanted, desk, HEAD if spread > FINE else 1.0)
            if desk.h[i] < 1e-10 * (1.0 + abs(desk.c[i])):
                stuck_bound, stuck_width = min(stuck_bound, below), max(stuck_width, desk.h[i])
                kept = False
        if not kept or below >= ceiling:
            count -= 1
            order[0], order[count] = order[count], order[0]
            sift_down(bound, order, count)
            continue
        if count + 1 > used and used == capacity:
            rows, bound, order = grown(rows, bound, order)
            capacity = len(bound)
        centre, half = desk.c[i], 0.5 * desk.h[i]
        desk.h[i] = half + LEAST
        desk.c[i] = centre - half
        store_box(rows, row, desk)
        bound[row] = below
        sift_down(bound, order, count)
        if count == used:
            order[count] = used
            used += 1
        desk.c[i] = centre + half
        store_box(rows, order[count], desk)
        bound[order[count]] = below
        sift_up(bound, order, count)
        count += 1
    lower, largest, outcome, open_ = min(ceiling, stuck_bound), stuck_width, ENDED, 0
    left = np.empty((count, 2 * dof + 1))
    for k in range(count):
        row = order[k]
        if bound[row] < ceiling:
            lower = min(lower, bound[row])
            for i in range(2 * dof):
                left[open_, i] = rows[row, i]
            left[open_, 2 * dof] = bound[row]
            open_ += 1
            for i in range(dof):
                largest = max(largest, rows[row, dof + i])
    if open_ > 0 or stuck_bound < ceiling:
        outcome = STOPPED
    return Search(outcome, seen, largest, best, lower, upper, left[:open_].copy(), stuck_width, stuck_bound)


@view
def grown(rows: Array, bound: Array, order: Indices) -> tuple[Array, Array, Indices]:
    """Twice the room for boxes."""
    more = 2 * len(bound)
    new_rows, new_bound = np.empty((more, rows.shape[1])), np.empty(more)
    new_order = np.empty(more, dtype=np.int64)
    for i in range(len(bound)):
        for j in range(rows.shape[1]):
            new_rows[i, j] = rows[i, j]
        new_bound[i], new_order[i] = bound[i], order[i]
    return new_rows, new_bound, new_order
