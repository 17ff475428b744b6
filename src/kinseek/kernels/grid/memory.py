"""Memory of a grid search: bundles of arrays, separate or laid out in one block."""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np

from kinseek.kernels.arrays import Array, Indices
from kinseek.kernels.entry import OUT
from kinseek.kernels.jit import array_view
from kinseek.kernels.layout import Layout, floats, named, whole

MOST_LANES = 8000
"""Largest number of tabulated leaves; ten doubles each, so that the table stays in a core's second-level cache."""


class Window(NamedTuple):
    """The grid to search: some values of each joint, in order."""

    values: Annotated[Array, "n", "most", OUT]
    """Joint values [rad] or [m], (n, most values of any joint)."""
    nodes: Annotated[Indices, "n", "most", OUT]
    """The caller's node numbers of these values, same shape."""
    counts: Annotated[Indices, "n", OUT]
    """Number of values of each joint, (n,)."""


class Beam(NamedTuple):
    """The K best leaves so far, unordered."""

    errors: Annotated[Array, "cells", OUT]
    """Weighted errors, (K,); infinite for empty entries."""
    nodes: Annotated[Indices, "cells", "n", OUT]
    """Their nodes, (K, n)."""
    q: Annotated[Array, "cells", "n", OUT]
    """Their joint values, (K, n)."""


class NodeScratch(NamedTuple):
    """Scratch memory of one search."""

    lanes: Annotated[Array, 9, MOST_LANES, OUT]
    """Columns x, y, z and p of the tabulated tips without z, (9, MOST_LANES)."""
    errors: Annotated[Array, MOST_LANES, OUT]
    """(MOST_LANES,)"""
    poses: Annotated[Array, "n+1", 3, 4, OUT]
    """Poses along the current path, (n+1, 3, 4)."""
    path: Annotated[Indices, "n", OUT]
    """Index of the value of each joint on the current path, (n,)."""
    q: Annotated[Array, "n", OUT]
    """(n,)"""


def make_node_scratch(dof: int) -> NodeScratch:
    """Allocate the scratch memory of one search."""
    return NodeScratch(
        np.empty((9, MOST_LANES)),
        np.empty(MOST_LANES),
        np.empty((dof + 1, 3, 4)),
        np.empty(dof, dtype=np.int64),
        np.empty(dof),
    )


def make_beam(size: int, dof: int) -> Beam:
    """Allocate an empty beam."""
    return Beam(np.full(size, np.inf), np.empty((size, dof), dtype=np.int64), np.empty((size, dof)))


def make_window(dof: int, most: int) -> Window:
    """Allocate a window of at most `most` values of any joint."""
    return Window(np.empty((dof, most)), np.empty((dof, most), dtype=np.int64), np.empty(dof, dtype=np.int64))


class GridScratch(NamedTuple):
    """Memory of a descent."""

    scratch: NodeScratch
    window: Window
    first: Beam
    """Beam of the odd passes: the first, the third, and so on."""
    second: Beam
    """Beam of the even passes."""
    litter: Beam
    """Leaves of one cell for the next pass, if their number is limited."""


MADE_FOR = ("n", "most", "cells", "children")
"""Sizes: the number of joints; the largest number of values of a joint in a window; the number of cells that a pass
leaves to the next; and the number that one cell may leave."""
CHILDREN, DOF = named("children"), named("n")

LITTER = Layout(
    Beam,
    MADE_FOR,
    name="litter",
    errors=floats(CHILDREN),
    nodes=whole(CHILDREN, DOF),
    q=floats(CHILDREN, DOF),
)
LAYOUT = Layout(GridScratch, MADE_FOR, litter=LITTER)
"""Layout of the memory of a descent: one array instead of thirty, because each array argument of a kernel costs a third
of a microsecond."""

LINE = 64
"""Size of a line of the processor's cache [bytes]: tabulated leaves are read fastest from the beginning of a line."""

lay_grid_scratch = LAYOUT.make


def memory_size(dof: int, most: int, cells: int, children: int) -> int:
    """Length in numbers of the memory of a descent, see `MADE_FOR`."""
    return LINE // 8 + LAYOUT.count.of(n=dof, most=most, cells=cells, children=children)


@array_view
def make_grid_scratch(memory: Array, dof: int, most: int, cells: int, children: int) -> GridScratch:
    """Create the views of a descent in a memory of `memory_size` numbers."""
    address = (memory.ctypes.data + LINE - 1) // LINE * LINE
    grid_scratch: GridScratch = lay_grid_scratch(address, dof, most, cells, children)
    return grid_scratch
