"""Enclose the smallest weighted error in a box by branch and bound; the box with the smallest bound comes first."""

from __future__ import annotations

import math

from kinseek.kernels.arm.forward import forward
from kinseek.kernels.arm.pose_error import weighted_error
from kinseek.kernels.arrays import Array, Indices
from kinseek.kernels.jit import inlined

from .approach import complete
from .box import turn_goal, widths
from .form import underestimate
from .last_joint import twist_cost
from .memory import Heap, Memory, SearchScratch
from .progress import CEILING, COUNT, UPPER, USED, Question, Tuning
from .taylor import miss

FINE = 1.2
"""Boxes that rotate the hand by less than this [rad] are cut along a first joint as along any other, because azimuths
hardly cut them. With twice the value there were 2.5 % more boxes. Not examined further."""


@inlined
def sift_up(heap: Array, order: Indices, at: int) -> None:
    """Move the entry at `at` up to its place; `heap` holds the bound of each row, `order` the rows."""
    while at > 0:
        parent = (at - 1) // 2
        if heap[order[parent]] <= heap[order[at]]:
            return
        order[parent], order[at] = order[at], order[parent]
        at = parent


@inlined
def sift_down(heap: Array, order: Indices, size: int) -> None:
    """Move the entry at the top down to its place."""
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


@inlined
def push(heap: Heap, counts: Indices, bound: float) -> int:
    """Add a box to the heap; return its row, into which the caller writes it."""
    count, order = counts[COUNT], heap.order
    if count == counts[USED]:
        order[count] = count
        counts[USED] += 1
    # Beyond `count`, the order lists the rows that are free.
    row: int = order[count]
    heap.bound[row] = bound
    sift_up(heap.bound, order, count)
    counts[COUNT] += 1
    return row


@inlined
def pop(heap: Heap, counts: Indices) -> None:
    """Remove the box at the top of the heap; its row is free."""
    counts[COUNT] -= 1
    last, order = counts[COUNT], heap.order
    order[0], order[last] = order[last], order[0]
    sift_down(heap.bound, order, last)


@inlined
def start_heap(question: Question, tuning: Tuning, memory: Memory, T: Array, least: float) -> None:
    """Order the first boxes, none with a bound below `least`, and judge the known joint values."""
    heap, counts = memory.heap, memory.counts
    for row in range(counts[COUNT]):
        heap.bound[row], heap.order[row] = max(heap.bound[row], least), row
        sift_up(heap.bound, heap.order, row)
    counts[USED] = counts[COUNT]
    forward(question.chain, memory.q, T)
    improve(weighted_error(T, question.goal), tuning, memory.figures)


@inlined
def improve(error: float, tuning: Tuning, figures: Array) -> None:
    """Update the ceiling for better joint values, which leaves fewer boxes."""
    figures[UPPER], figures[CEILING] = error, (1.0 - tuning.gap) * error


@inlined
def enclose(
    question: Question, tuning: Tuning, memory: Memory, work: SearchScratch, first: float
) -> tuple[bool, float]:
    """Bound the error in the current box to second order, cut off the part above the ceiling, and judge its middle.

    Returns:
        False if nothing of the box is left, and a lower bound of the error in it, given the one of `first_order`.
    """
    form, proof_goal, roll, chain = question.form, question.proof_goal, question.roll, question.chain
    scratch, trial, T, figures = work.scratch, work.trial, work.T, memory.figures
    ceiling, extra = figures[CEILING], 0.0
    if roll.present:
        turn_goal(form, proof_goal, scratch)
        widths(form, scratch)
        extra = twist_cost(form, proof_goal, roll, scratch, ceiling)
    if extra >= ceiling:
        return False, extra
    complete(question, scratch, trial)
    kept, bound = underestimate(form, proof_goal, scratch, ceiling - extra)
    square_p, square_c = miss(scratch, form.columns)
    if proof_goal.weight_p * math.sqrt(square_p) + 0.5 * proof_goal.weight_a * square_c < figures[UPPER]:
        forward(chain, trial, T)
        error = weighted_error(T, question.goal)
        if error < figures[UPPER]:
            improve(error, tuning, figures)
            for i in range(len(trial)):
                memory.q[i] = trial[i]
    return kept, max(first, bound) + extra
