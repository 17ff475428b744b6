"""A grid refined around its best nodes, pass by pass: divide and conquer (the paper, Alg. 2), and brute force in one pass.

The Python layer makes the plan and owns the memory. `descend` searches windows with machine code. `write_leaves` and
`keep_leaves` do the same in turns with a caller who evaluates the leaves, for kinematics that are the user's function. Both
continue from the progress of a descent for a limited amount of work, so that signals are handled and time limits are kept
in between.
"""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinseek.kernels.arrays import Array, ChainArrays, GoalArrays, Indices
from kinseek.kernels.entry import OUT
from kinseek.kernels.jit import entry, exact, inlined

from .memory import Beam, GridMemory, Window, grid_memory
from .window import (
    EVERYTHING,
    FINISHED,
    PAUSED,
    Limits,
    Searched,
    clear,
    keep_better,
    leaf_count,
    nodes_expanded,
    offer,
    search_window,
    worst_error,
    write_leaf,
)


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
    """The plan of a descent through p passes."""

    spacings: Annotated[Indices, "p"]
    """Spacing of the nodes in each pass, falling to 1, (p,)."""
    counts: Annotated[Indices, "p", "n"]
    """Number of nodes of each joint in a window of each pass, (p, n)."""
    first: Annotated[Indices, "n", "*"]
    """Nodes of the first pass, (n, most nodes of any joint in any pass)."""
    clips: bool
    """True if a window is truncated at a limit instead of sliding inward."""
    stop_below: float
    """The first leaf whose weighted error is below this ends the descent; -1 never ends it."""
    tie: float
    """See `window.Limits`."""
    budget: int
    """Largest number of leaves in all passes."""
    beam: int
    """Number of cells that a pass leaves to the next."""
    children: int
    """Number of cells that one cell may leave to the next pass."""


PASS = 0
"""Progress of a descent: its pass."""
CELL = 1
"""How many cells of the pass are finished."""
LEAF = 2
"""How many leaves of the present window are evaluated, 0 if there is no window yet."""
LEAVES = 3
"""All leaves so far."""
NODES = 4
"""All nodes so far."""

BEGINNING = (0, 0, 0, 0, 0)

Progress = Annotated[Indices, len(BEGINNING), OUT]


@entry
def descend(
    chain: ChainArrays,
    goal: GoalArrays,
    grid: Grid,
    passes: Passes,
    work: int,
    memory: Annotated[Array, "*", OUT],
    progress: Progress,
    q: Annotated[Array, "n", OUT],
) -> int:
    """Continue a descent; return FINISHED, STOPPED or PAUSED.

    Args:
        chain: The arm.
        goal: The goal.
        grid: The nodes.
        passes: The plan.
        work: Work limit of this call, in leaves; it may be exceeded slightly.
        memory: Memory of the descent, of `memory_size`.
        progress: Progress of the descent, see `PASS`; `BEGINNING` at first.
        q: Receives the best joint values so far, (n,).
    """
    views = grid_memory(memory, len(q), passes.first.shape[1], passes.beam, passes.children)
    scratch, ended = views.scratch, FINISHED
    while open_window(grid, passes, views, progress):
        limits, found = limits_of(passes, work, scratch.window, progress), receiver(passes, views, progress)
        state = search_window(chain, goal, limits, progress[LEAF], found, scratch)
        note_leaf(state.leaf, scratch.window, progress)
        ended = state.ended
        if ended != FINISHED:
            break
        work = close_window(state.work, views, progress)
        if work <= 0:
            ended = PAUSED
            break
    copy_best(views, q)
    return ended


@entry
def write_leaves(
    grid: Grid,
    passes: Passes,
    memory: Annotated[Array, "*", OUT],
    progress: Progress,
    q: Annotated[Array, "k", "n", OUT],
) -> int:
    """Write joint values of the next leaves of a window into q, (k, n); return their number, 0 if all are searched.

    The caller evaluates them and calls `keep_leaves`.
    """
    views = grid_memory(memory, q.shape[1], passes.first.shape[1], passes.beam, passes.children)
    if not open_window(grid, passes, views, progress):
        return 0
    begin = progress[LEAF]
    limits = limits_of(passes, EVERYTHING, views.scratch.window, progress)
    count: int = min(limits.leaves - begin, len(q))
    for i in range(count):
        write_leaf(views.scratch, 0, begin + i)
        for d in range(q.shape[1]):
            q[i, d] = views.scratch.leaf_q[d]
    return count


@entry
def keep_leaves(
    errors: Annotated[Array, "*"],
    passes: Passes,
    memory: Annotated[Array, "*", OUT],
    progress: Progress,
    q: Annotated[Array, "n", OUT],
) -> int:
    """Keep the best of the leaves that `write_leaves` wrote; return FINISHED, or STOPPED if one is good enough.

    Args:
        errors: Weighted errors of these leaves, (k,); infinite without a pose.
        passes: The plan.
        memory: Memory of the descent.
        progress: Progress of the descent.
        q: Receives the best joint values so far, (n,).
    """
    views = grid_memory(memory, len(q), passes.first.shape[1], passes.beam, passes.children)
    found, window, begin = receiver(passes, views, progress), views.scratch.window, progress[LEAF]
    limits = limits_of(passes, EVERYTHING, window, progress)
    state = Searched(begin, FINISHED, limits.work, worst_error(found) - limits.tie)
    state = keep_better(errors, 0, limits, state, found, views.scratch)
    note_leaf(begin + len(errors), window, progress)
    if state.ended == FINISHED and progress[LEAF] == limits.leaves:
        close_window(state.work, views, progress)
    copy_best(views, q)
    return state.ended


@inlined
def open_window(grid: Grid, passes: Passes, memory: GridMemory, progress: Indices) -> bool:
    """Write the next window, unless one is being searched; return False if there is none."""
    window = memory.scratch.window
    while progress[PASS] < len(passes.spacings):
        if progress[LEAF] > 0:
            return True
        k, cell = progress[PASS], progress[CELL]
        # A pass reads the beam that the pass before it has filled, and fills the other one.
        cells = memory.even if k % 2 == 0 else memory.odd
        beam = memory.odd if k % 2 == 0 else memory.even
        if cell == 0:
            clear(beam)
            if k == 0:
                clear(cells)
                clear(memory.children)
            keep_best(cells, beam)
        if cell == (1 if k == 0 else passes.beam):
            progress[PASS] += 1
            progress[CELL] = 0
        elif progress[LEAVES] < passes.budget and (k == 0 or cells.errors[cell] < np.inf):
            write_window(grid, passes, k, cells.nodes[cell], window)
            return True
        else:
            progress[CELL] += 1
    return False


@inlined
def keep_best(cells: Beam, beam: Beam) -> None:
    """Start a pass with the best leaf so far, which is also a node of its own window."""
    best = 0
    for k in range(1, len(cells.errors)):
        if cells.errors[k] < cells.errors[best]:
            best = k
    if cells.errors[best] < np.inf:
        offer(beam, cells.errors[best], cells.nodes[best], cells.q[best])


@inlined
def write_window(grid: Grid, passes: Passes, k: int, centre: Indices, window: Window) -> None:
    """Write the planned nodes of the first pass, k = 0, or the nodes around a centre, (n,), into the window."""
    for d in range(len(grid.lower)):
        count, nodes = passes.counts[k, d], window.nodes[d]
        if k == 0:
            for i in range(count):
                nodes[i] = passes.first[d, i]
        else:
            end = WRAPS if grid.wraps[d] else (CLIPS if passes.clips else SLIDES)
            count = nodes_around(centre[d], passes.spacings[k], count, grid.size, end, nodes)
        window.counts[d] = count
        for i in range(count):
            window.values[d, i] = node_value(grid, d, nodes[i])


WRAPS, SLIDES, CLIPS = 0, 1, 2
"""What a window does at the end of a joint's range: it continues at the other end, slides inward, or is truncated."""


@entry
def nodes_around(
    centre: int, spacing: int, count: int, size: int, end: int, nodes: Annotated[Indices, "*", OUT]
) -> int:
    """Write the nodes of a joint around a centre, as many on either side, into `nodes`; return their number.

    Args:
        centre: The node in the middle.
        spacing: Distance of two nodes, in nodes of the grid.
        count: Wanted number of nodes, odd.
        size: B.
        end: WRAPS, SLIDES or CLIPS.
        nodes: Receives the nodes, (at least `count`,).
    """
    if end != CLIPS:
        count = min(count, (size - 1) // spacing + 1)
    first = centre - (count // 2) * spacing
    if end == SLIDES:  # So that the number of nodes is the one of the paper's formula.
        while first < 0:
            first += spacing
        while first + (count - 1) * spacing >= size and first >= spacing:
            first -= spacing
    kept = 0
    for i in range(count):
        node = first + i * spacing
        if end == WRAPS:
            node %= size
        if 0 <= node < size:
            nodes[kept] = node
            kept += 1
    return kept


@exact
def node_value(grid: Grid, d: int, node: int) -> float:
    """Value of a node [rad] or [m]: from the table of the static tree, or computed, bit for bit, in the dynamic tree."""
    stored = grid.table.shape[1] > 0
    value: float = grid.table[d, node] if stored else min(grid.lower[d] + grid.step[d] * node, grid.upper[d])
    return value


@inlined
def limits_of(passes: Passes, work: int, window: Window, progress: Indices) -> Limits:
    """Limits of the search of the present window."""
    left = passes.budget - (progress[LEAVES] - progress[LEAF])
    return Limits(passes.stop_below, passes.tie, min(left, leaf_count(window.counts, 0)), work)


@inlined
def receiver(passes: Passes, memory: GridMemory, progress: Indices) -> Beam:
    """Beam that receives the leaves of the present window: that of the pass, unless the children of a cell are limited."""
    k = progress[PASS]
    if k > 0 and passes.children < passes.beam:
        return memory.children
    return memory.odd if k % 2 == 0 else memory.even


@inlined
def note_leaf(leaf: int, window: Window, progress: Indices) -> None:
    """Note that so many leaves of the present window are evaluated."""
    counts = window.counts
    progress[NODES] += nodes_expanded(counts, leaf) - nodes_expanded(counts, progress[LEAF])
    progress[LEAVES] += leaf - progress[LEAF]
    progress[LEAF] = leaf


@inlined
def close_window(work: int, memory: GridMemory, progress: Indices) -> int:
    """Move the children of a cell into the beam of its pass, and go on to the next cell; return the work that is left.

    If the work limit is reached before, the window stays open, and the next call moves the rest.
    """
    beam = memory.odd if progress[PASS] % 2 == 0 else memory.even
    children = memory.children
    for m in range(len(children.errors)):
        if children.errors[m] < np.inf:
            if work <= 0:
                return work
            offer(beam, children.errors[m], children.nodes[m], children.q[m])
            children.errors[m] = np.inf
            work -= len(beam.errors)
    progress[CELL] += 1
    progress[LEAF] = 0
    return work


@inlined
def copy_best(memory: GridMemory, q: Array) -> None:
    """Write the joint values of the best leaf so far into q, (n,), if there is one."""
    least = copy_better(memory.odd, np.inf, q)
    least = copy_better(memory.even, least, q)
    copy_better(memory.children, least, q)


@inlined
def copy_better(beam: Beam, least: float, q: Array) -> float:
    """Write the best leaf of a beam into q, (n,), if its error is less than `least`; return the smaller of both."""
    for k in range(len(beam.errors)):
        if beam.errors[k] < least:
            least = beam.errors[k]
            for d in range(len(q)):
                q[d] = beam.q[k, d]
    return least
