"""How near can anything in a box come? Best box first, this encloses the least weighted error of all joint values."""

from __future__ import annotations

from typing import NamedTuple

from kinseek.kernels.arm.forward import forward
from kinseek.kernels.arm.pose_error import weighted_error
from kinseek.kernels.arrays import Array, ChainArrays, GoalArrays, Indices
from kinseek.kernels.entry import F64, I64, Bundle
from kinseek.kernels.jit import hidden

from .bounds import first_order
from .box import BELOW, MIDDLE_ERROR, Desk, Form, Wanted, place, turn_goal, turned, volume, widths
from .form import underestimate
from .gate import gate
from .last_joint import Roll, complete, cut_twist, roll_fits, twist_cost
from .progress import AGAIN, CEILING, COUNT, GONE, OPEN, UPPER, USED, Tuning

FINE = 1.2
"""Boxes that turn the hand by less [rad] are cut along a first joint as along any other: azimuths hardly cut them.
By trial: 2.5 % more boxes with twice as much."""


class Heap(NamedTuple):
    """Boxes in the order of their bounds, the least one first."""

    bound: Array
    """A lower bound of the weighted error in the box of each row, (room,)."""
    order: Indices
    """Rows of the boxes that are left, the first COUNT of it, as a heap; then rows to be taken again, (room,)."""


HEAP = Bundle(Heap, bound=F64["room"].out, order=I64["room"].out)


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


@hidden
def start_heap(
    form: Form,
    wanted: Wanted,
    chain: ChainArrays,
    goal: GoalArrays,
    heap: Heap,
    q: Array,
    T: Array,
    tuning: Tuning,
    counts: Indices,
    figures: Array,
) -> None:
    """Put the first boxes in order, none below what lengths and angles tell, and judge the joint values known, (n,)."""
    least = gate(form, wanted, chain)[1]
    for row in range(counts[COUNT]):
        heap.bound[row], heap.order[row] = max(heap.bound[row], least), row
        sift_up(heap.bound, heap.order, row)
    counts[USED] = counts[COUNT]
    forward(chain, q, T)
    improve(weighted_error(T, goal), tuning, figures)


@hidden
def improve(error: float, tuning: Tuning, figures: Array) -> None:
    """Better joint values are known: fewer boxes count."""
    figures[UPPER], figures[CEILING] = error, (1.0 - tuning.gap) * error


@hidden
def bound_box(
    form: Form,
    wanted: Wanted,
    roll: Roll,
    chain: ChainArrays,
    goal: GoalArrays,
    below: float,
    q: Array,
    tuning: Tuning,
    figures: Array,
    desk: Desk,
    trial: Array,
    T: Array,
) -> tuple[int, float, float]:
    """Look once at the box in hand, cut off it what is above the ceiling, and judge its middle.

    Returns:
        GONE, AGAIN or OPEN; by how much the box turns the hand [rad]; a lower bound of the error in it, `below` or better.
    """
    ceiling = figures[CEILING]
    desk.found[BELOW] = 0.0
    place(form, desk)
    widths(form, desk)
    kept = first_order(form, wanted, desk, ceiling)
    below = max(below, desk.found[BELOW])
    if kept and form.tail == 1:
        kept = cut_twist(form, wanted, desk, ceiling)
    spread = turned(form, desk, len(form.leader))
    if not kept:
        return GONE, spread, below
    if spread >= tuning.spread:
        return OPEN, spread, below
    extra, before = 0.0, volume(desk)
    if roll.present:
        turn_goal(form, wanted, desk)
        roll_fits(form, wanted, roll, desk)
        widths(form, desk)
        extra = twist_cost(form, wanted, roll, desk, ceiling)
    if extra >= ceiling:
        return GONE, spread, max(below, extra)
    complete(form, roll, chain, desk, trial)
    kept = underestimate(form, wanted, desk, ceiling - extra)
    below = max(below, desk.found[BELOW] + extra)
    if desk.found[MIDDLE_ERROR] < figures[UPPER]:
        forward(chain, trial, T)
        error = weighted_error(T, goal)
        if error < figures[UPPER]:
            improve(error, tuning, figures)
            for i in range(len(q)):
                q[i] = trial[i]
    if not kept:
        return GONE, spread, below
    return AGAIN if volume(desk) < tuning.shrink * before else OPEN, spread, below
