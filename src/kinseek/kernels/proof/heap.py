"""A binary heap of boxes: the one with the smallest bound is at the top (Williams 1964)."""

from __future__ import annotations

from typing import Annotated, NamedTuple

from kinseek.kernels.arrays import Array, Indices
from kinseek.kernels.entry import OUT
from kinseek.kernels.jit import inlined

from .progress import COUNT, USED


class Heap(NamedTuple):
    """Boxes ordered by their bounds, the smallest one first."""

    bound: Annotated[Array, "room", OUT]
    """A lower bound of the weighted error in the box of each row, (room,)."""
    order: Annotated[Indices, "room", OUT]
    """Rows of the remaining boxes as a heap, the first COUNT entries; then rows that are free again, (room,)."""


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
def pop(heap: Heap, counts: Indices) -> None:
    """Remove the box with the smallest bound; its row is free again."""
    counts[COUNT] -= 1
    order, last = heap.order, counts[COUNT]
    order[0], order[last] = order[last], order[0]
    sift_down(heap.bound, order, last)


@inlined
def free_row(heap: Heap, counts: Indices) -> int:
    """Row for one more box: that of a finished one, or a new one."""
    count = counts[COUNT]
    if count == counts[USED]:
        heap.order[count] = count
        counts[USED] += 1
    row: int = heap.order[count]
    return row


@inlined
def push(heap: Heap, counts: Indices) -> None:
    """Add the box in `free_row`, whose bound is written."""
    sift_up(heap.bound, heap.order, counts[COUNT])
    counts[COUNT] += 1
