"""A grid refined around its best nodes, pass by pass: the inner loop of divide and conquer (the paper, Alg. 2).

The Python layer makes the plan and owns the memory. A descent continues from its state for a limited amount of work, so
that signals are handled and time limits are kept in between.
"""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinseek.kernels.arrays import Array, ChainArrays, GoalArrays, Indices
from kinseek.kernels.entry import OUT
from kinseek.kernels.jit import array_view, entry, exact, inlined_with_wrapper

from .memory import Beam, NodeScratch, Window, make_grid_scratch
from .window import EARLY, PAUSED, WHOLE, clear, nodes_until, offer, search_part, window_nodes


class Grid(NamedTuple):
    """Node i of joint d has the value ``lower[d] + i · step[d]``."""

    lower: Annotated[Array, "n"]
    """[rad] or [m], (n,)"""
    upper: Annotated[Array, "n"]
    """[rad] or [m], (n,)"""
    step: Annotated[Array, "n"]
    """[rad] or [m], (n,)"""
    wraps: Annotated[NDArray[np.bool_], "n"]
    """True if node B is the same as node 0, (n,)."""
    size: int
    """B"""
    table: Annotated[Array, "n", "*"]
    """All values computed in advance, (n, B): the static tree; or (n, 0): computed when needed, the dynamic tree."""

    def values_of(self, nodes: Indices) -> Array:
        """Joint values of nodes, (n, k) -> (n, k), [rad] or [m]."""
        values = self.lower[:, None] + self.step[:, None] * nodes
        return np.minimum(values, self.upper[:, None])


class Passes(NamedTuple):
    """The plan of a descent."""

    spacings: Annotated[Indices, "*"]
    """Spacing of the nodes in each pass, falling to 1."""
    later: Annotated[Indices, "n"]
    """Number of nodes of each joint in the passes after the first, (n,)."""
    first: Annotated[Indices, "n", "*"]
    """Nodes of the first pass, (n, most of any joint)."""
    counts: Annotated[Indices, "n"]
    """Number of nodes of each joint in the first pass, (n,)."""
    clips: bool
    """True if a window is truncated at a limit instead of sliding inward."""
    stop_below: float
    """The first leaf whose weighted error is below this ends the descent; -1 never ends it."""
    tie: float
    """See `window.search_part`."""
    beam: int
    children: int


PASS, CELL, LEAF, MERGED, LEAVES, EXPANDED, TRIED, VISITED, STOPPED = range(9)
"""Indices into the state of a descent: its pass; the cell of the pass, -1 before the first; the next leaf of that cell's
window; the next entry of the litter to merge, -1 before its window is searched; the leaves and the nodes of the
finished windows; the same including the finished part of the last window; and whether a leaf was good enough to stop."""

BEGINNING = (0, -1, 0, -1, 0, 0, 0, 0, 0)


@exact
def node_value(grid: Grid, d: int, node: int) -> float:
    """Value of a node [rad] or [m]: from the table of the static tree, or computed, bit for bit, in the dynamic tree."""
    stored = grid.table.shape[1] > 0
    value: float = grid.table[d, node] if stored else min(grid.lower[d] + grid.step[d] * node, grid.upper[d])
    return value


@inlined_with_wrapper
def first_window(grid: Grid, first: Indices, counts: Indices, window: Window) -> None:
    """Write the planned nodes of the first pass into the window."""
    for d in range(len(counts)):
        window.counts[d] = counts[d]
        for i in range(counts[d]):
            window.nodes[d, i] = first[d, i]
            window.values[d, i] = node_value(grid, d, first[d, i])


@inlined_with_wrapper
def later_window(
    grid: Grid, centre: Indices, spacing: int, counts: Indices, clips: bool, window: Window
) -> None:
    """Write the nodes around a centre, as many on either side, into the window; `window_around` in Python."""
    for d in range(len(centre)):
        count, clipped = counts[d], clips and not grid.wraps[d]
        if not clipped:
            count = min(count, (grid.size - 1) // spacing + 1)
        first = centre[d] - (count // 2) * spacing
        if not grid.wraps[d] and not clipped:
            # The window slides inward at a limit, so that the number of nodes is the one of the paper's formula.
            while first < 0:
                first += spacing
            while first + (count - 1) * spacing >= grid.size and first >= spacing:
                first -= spacing
        kept = 0
        for i in range(count):
            node = first + i * spacing
            if grid.wraps[d]:
                node %= grid.size
            elif node >= grid.size:
                break
            elif node < 0:
                continue
            window.nodes[d, kept] = node
            window.values[d, kept] = node_value(grid, d, node)
            kept += 1
        window.counts[d] = kept


@entry
def descend(
    chain: ChainArrays,
    goal: GoalArrays,
    grid: Grid,
    passes: Passes,
    budget: int,
    work: int,
    memory: Annotated[Array, "*", OUT],
    at: Annotated[Indices, len(BEGINNING), OUT],
    q: Annotated[Array, "n", OUT],
) -> bool:
    """Continue a descent; return True if it is done.

    Args:
        chain: The arm.
        goal: The goal.
        grid: The nodes.
        passes: The plan.
        budget: Largest number of leaves in all passes.
        work: Work limit of this call, in leaves; it may be exceeded slightly.
        memory: Memory of the descent, of `memory_size`.
        at: State of the descent, see `PASS`; `BEGINNING` at first.
        q: Receives the best joint values so far, (n,).
    """
    dof = len(grid.lower)
    most = passes.first.shape[1]
    for d in range(dof):
        most = max(most, passes.later[d])
    scratch, window, first, second, litter = make_grid_scratch(
        memory, dof, most, passes.beam, passes.children
    )
    if at[PASS] == 0 and at[CELL] < 0:
        clear(first)
        clear(second)
        clear(litter)
    done = go_on(chain, goal, grid, passes, budget, work, window, scratch, first, second, litter, at)
    at[TRIED], at[VISITED] = at[LEAVES], at[EXPANDED]
    least = np.inf
    if done and at[STOPPED] == 0:
        least = copy_best(second if len(passes.spacings) % 2 == 0 else first, least, q)
    else:
        if at[LEAF] > 0:
            at[TRIED] += at[LEAF]
            at[VISITED] += nodes_until(window.counts, at[LEAF] - 1)
        least = copy_best(first, least, q)
        least = copy_best(second, least, q)
        least = copy_best(litter, least, q)
    return done


@inlined_with_wrapper
def copy_best(beam: Beam, least: float, q: Array) -> float:
    """Write the best leaf of a beam into q, (n,), if its error is less than `least`; return the smaller of both."""
    for k in range(len(beam.errors)):
        if beam.errors[k] < least:
            least = beam.errors[k]
            for d in range(len(q)):
                q[d] = beam.q[k, d]
    return least


@array_view
def go_on(
    chain: ChainArrays,
    goal: GoalArrays,
    grid: Grid,
    passes: Passes,
    budget: int,
    work: int,
    window: Window,
    scratch: NodeScratch,
    first: Beam,
    second: Beam,
    litter: Beam,
    at: Indices,
) -> bool:
    """Do the work of `descend` on laid-out memory; `first` is the beam of the first, third and further odd passes."""
    while at[PASS] < len(passes.spacings):
        k = at[PASS]
        cells, beam = second, first
        if k % 2 == 1:
            cells, beam = first, second
        limited = k > 0 and passes.children < passes.beam
        if at[CELL] < 0:
            keep_best(cells, beam)
            at[CELL] = 0
        while at[CELL] < (1 if k == 0 else passes.beam):
            if at[MERGED] < 0:
                if at[LEAF] == 0:
                    cell = at[CELL]
                    if k == 0:
                        first_window(grid, passes.first, passes.counts, window)
                    elif cells.errors[cell] < np.inf and at[LEAVES] < budget:
                        spacing = passes.spacings[k]
                        later_window(grid, cells.nodes[cell], spacing, passes.later, passes.clips, window)
                    else:
                        at[CELL] += 1
                        continue
                    clear(litter)
                found = litter if limited else beam
                left = budget - at[LEAVES]
                leaf, ended, work = search_part(
                    chain, goal, window, passes.stop_below, passes.tie, left, at[LEAF], work, found, scratch
                )
                at[LEAF] = leaf
                if ended == PAUSED:
                    return False
                at[LEAVES] += leaf
                if ended == WHOLE:
                    at[EXPANDED] += window_nodes(window.counts)
                else:
                    at[EXPANDED] += nodes_until(window.counts, leaf - 1)
                at[LEAF] = 0
                if ended == EARLY and at[LEAVES] < budget:
                    at[STOPPED] = 1
                    return True
                at[MERGED] = 0 if limited else len(litter.errors)
            while at[MERGED] < len(litter.errors):
                m = at[MERGED]
                if litter.errors[m] < np.inf:
                    offer(beam, litter.errors[m], litter.nodes[m], litter.q[m])
                    work -= len(beam.errors)
                at[MERGED] += 1
                if work <= 0:
                    return False
            at[MERGED] = -1
            at[CELL] += 1
            if work <= 0:
                return False
        at[PASS] += 1
        at[CELL] = -1
    return True


@inlined_with_wrapper
def keep_best(cells: Beam, beam: Beam) -> None:
    """Start a pass with the best leaf so far, which is also a node of its own window."""
    clear(beam)
    best = 0
    for k in range(1, len(cells.errors)):
        if cells.errors[k] < cells.errors[best]:
            best = k
    if cells.errors[best] < np.inf:
        offer(beam, cells.errors[best], cells.nodes[best], cells.q[best])
