"""Memory of a search by boxes: that of the caller, which lets it continue where it stopped, and that of one call.

If a kernel returns a bundle of arrays, Python builds the bundle, and an interrupt loses it. Python therefore allocates
everything that outlives a call.
"""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np

from kinseek.kernels.arrays import Array, Flags, Indices
from kinseek.kernels.entry import OUT
from kinseek.kernels.jit import counted

from .box import BoxScratch, make_box_scratch
from .neighbourhood import Expansion, make_expansion
from .progress import COUNTS, FIGURES


class Heap(NamedTuple):
    """Boxes ordered by their bounds, the smallest one first."""

    bound: Annotated[Array, "room", OUT]
    """A lower bound of the weighted error in the box of each row, (room,)."""
    order: Annotated[Indices, "room", OUT]
    """Rows of the remaining boxes as a heap, the first COUNT entries; then rows that are free again, (room,)."""


class Places(NamedTuple):
    """Solutions and their neighbourhoods."""

    answers: Annotated[Array, "*", "n"]
    """Joint values that are known to meet the tolerances, (k, n); may be empty."""
    periodic: Annotated[Flags, "reduced"]
    """True if a full turn of the variable makes no difference, (reduced n,)."""
    isolated: Annotated[Flags, "most", OUT]
    """True if the solution has a neighbourhood. The first KNOWN entries of this and the following arrays are valid,
    (most,)."""
    number: Annotated[Indices, "most", OUT]
    """Index of the given solution, or -1 for a new one, (most,)."""
    q: Annotated[Array, "most", "n", OUT]
    """(most, n)"""
    centre: Annotated[Array, "most", "reduced", OUT]
    """Centre of the neighbourhood, (most, reduced n)."""
    radius: Annotated[Array, "most", "reduced", OUT]
    """Half widths of the neighbourhood, (most, reduced n)."""
    distance: Annotated[Array, "most", "reduced", OUT]
    """Upper bounds of the distance from the centre of anything within the tolerances in the neighbourhood, (most, reduced
    n)."""
    exists: Annotated[Flags, "most", OUT]
    """True if exactly one joint vector in the neighbourhood reaches the goal exactly, ignoring limits, (most,)."""


class Memory(NamedTuple):
    """State of a search, which continues from it when it is called again."""

    boxes: Annotated[Array, "room", "*", OUT]
    """The remaining boxes, (room, 2 dof): centres and half widths."""
    heap: Heap
    """Their order and bounds, for ENCLOSE; it begins with the first COUNT rows."""
    places: Places
    """Solutions and their neighbourhoods, for ISOLATE; otherwise without room."""
    q: Annotated[Array, "n", OUT]
    """The best joint values known, (n,); better ones are written here."""
    counts: Annotated[Indices, COUNTS, OUT]
    """Counts, indexed by COUNT and the following constants, (COUNTS,)."""
    figures: Annotated[Array, FIGURES, OUT]
    """Figures, indexed by UPPER and the following constants, (FIGURES,)."""


class SearchScratch(NamedTuple):
    """Scratch memory of one call."""

    scratch: BoxScratch
    """The current box."""
    around: Expansion
    """For the neighbourhood of a solution."""
    trial: Array
    """Joint values that may be better than those known, or a solution, (n,)."""
    T: Array
    """Their pose of the hand, columns x, y, z and p, (3, 4)."""


@counted
def make_search_scratch(joints: int, memory: Memory) -> SearchScratch:
    """Allocate the scratch memory for a number of joints of the arm that the boxes describe."""
    dof = memory.boxes.shape[1] // 2
    return SearchScratch(
        make_box_scratch(joints, dof), make_expansion(dof), np.empty(len(memory.q)), np.empty((3, 4))
    )
