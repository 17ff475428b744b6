"""What a search by boxes keeps: the caller's memory, so that it can go on where it stopped, and that of one call.

A kernel that hands a bundle of arrays to Python has Python build it, and where that is interrupted there is nothing to hand
back: so Python makes what outlives a call.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from kinseek.kernels.arrays import Array, Flags, Indices
from kinseek.kernels.entry import F64, FLAG, I64, Bundle
from kinseek.kernels.jit import array_view

from .box import BoxScratch, make_box_scratch
from .neighbourhood import Expansion, make_expansion
from .progress import COUNTS, FIGURES


class Heap(NamedTuple):
    """Boxes in the order of their bounds, the least one first."""

    bound: Array
    """A lower bound of the weighted error in the box of each row, (room,)."""
    order: Indices
    """Rows of the boxes that are left, the first COUNT of it, as a heap; then rows to be taken again, (room,)."""


HEAP = Bundle(Heap, bound=F64["room"].out, order=I64["room"].out)


class Places(NamedTuple):
    """Answers and their neighbourhoods."""

    answers: Array
    """Joint values that are known to meet the tolerances, (k, n); none are needed."""
    periodic: Flags
    """Is a whole turn of the variable as good as none? (reduced n,)"""
    isolated: Flags
    """Has it a neighbourhood? The first KNOWN of this and of what follows are written, (most,)."""
    number: Indices
    """Which of the given answers it is, or -1, (most,)."""
    q: Array
    """(most, n)"""
    centre: Array
    """Of the neighbourhood, (most, reduced n)."""
    radius: Array
    """Half widths of the neighbourhood, (most, reduced n)."""
    distance: Array
    """Of anything within the tolerances in its neighbourhood from the centre of it, (most, reduced n)."""
    exists: Flags
    """Does exactly one joint vector in its neighbourhood reach the goal exactly, limits left out of account? (most,)"""


PLACES = Bundle(
    Places,
    answers=F64["*", "n"],
    periodic=FLAG["reduced"],
    isolated=FLAG["most"].out,
    number=I64["most"].out,
    q=F64["most", "n"].out,
    centre=F64["most", "reduced"].out,
    radius=F64["most", "reduced"].out,
    distance=F64["most", "reduced"].out,
    exists=FLAG["most"].out,
)


class Memory(NamedTuple):
    """What a search knows, and goes on from when it is called again."""

    boxes: Array
    """The boxes that are left, (room, 2 dof): centres and half widths."""
    heap: Heap
    """Their order and bounds, to ENCLOSE; it begins with the first COUNT rows."""
    places: Places
    """Answers and their neighbourhoods, to ISOLATE; else there is room for none."""
    q: Array
    """The best joint values known or seen, (n,); better ones are written here."""
    counts: Indices
    """COUNT and following, (COUNTS,)."""
    figures: Array
    """UPPER and following, (FIGURES,)."""


MEMORY = Bundle(
    Memory,
    boxes=F64["room", "*"].out,
    heap=HEAP,
    places=PLACES,
    q=F64["n"].out,
    counts=I64[COUNTS].out,
    figures=F64[FIGURES].out,
)


class SearchScratch(NamedTuple):
    """Memory of one call."""

    scratch: BoxScratch
    """The box in hand."""
    around: Expansion
    """For the neighbourhood of an answer."""
    trial: Array
    """Joint values that may be better than those known, or an answer, (n,)."""
    T: Array
    """Where they bring the hand, columns x, y, z and p, (3, 4)."""


@array_view
def make_node_scratch(joints: int, memory: Memory) -> SearchScratch:
    """Allocate it for so many joints of the arm that the boxes are about."""
    dof = memory.boxes.shape[1] // 2
    return SearchScratch(
        make_box_scratch(joints, dof), make_expansion(dof), np.empty(len(memory.q)), np.empty((3, 4))
    )
