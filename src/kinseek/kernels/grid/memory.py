"""Memory of a grid search, in one block.

One array replaces thirty: each array argument of a kernel costs a third of a microsecond.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Annotated, NamedTuple

from kinseek.kernels.arrays import Array, Indices
from kinseek.kernels.jit import inlined
from kinseek.kernels.layout import Layout, floats, named, whole

MOST_LANES = 8000
"""Largest number of tabulated leaves; ten doubles each, so that the table stays in a core's second-level cache."""

A_LANE = 10
"""Numbers in memory for each tabulated leaf: nine of its pose, and its error."""


class Window(NamedTuple):
    """The grid to search: some values of each joint, in order."""

    values: Annotated[Array, "dof", "most"]
    """Joint values [rad] or [m], (n, most values of any joint)."""
    nodes: Annotated[Indices, "dof", "most"]
    """Node numbers of these values, same shape."""
    counts: Annotated[Indices, "dof"]
    """Number of values of each joint, (n,)."""


class Beam(NamedTuple):
    """The K best leaves so far, unordered."""

    errors: Annotated[Array, "cells"]
    """Weighted errors, (K,); infinite for empty entries."""
    nodes: Annotated[Indices, "cells", "dof"]
    """Their nodes, (K, n)."""
    q: Annotated[Array, "cells", "dof"]
    """Their joint values, (K, n)."""


class WindowScratch(NamedTuple):
    """A window, and scratch memory of its search."""

    lanes: Annotated[Array, 3, 3, MOST_LANES]
    """Columns x, y and p of the tabulated tips, (3, 3, MOST_LANES)."""
    errors: Annotated[Array, MOST_LANES]
    """Weighted errors of the tabulated leaves below a prefix, (MOST_LANES,)."""
    poses: Annotated[Array, "dof+1", 3, 4]
    """Poses along the current path, (n+1, 3, 4)."""
    path: Annotated[Indices, "dof"]
    """Index of the value of each joint on the current path, (n,)."""
    path_q: Annotated[Array, "dof"]
    """Joint values on the current path, (n,)."""
    leaf_nodes: Annotated[Indices, "dof"]
    """Nodes of a leaf, (n,)."""
    leaf_q: Annotated[Array, "dof"]
    """Joint values of a leaf, (n,)."""
    window: Window


class GridMemory(NamedTuple):
    """Memory of a descent."""

    scratch: WindowScratch
    odd: Beam
    """Beam of the first, third and further odd passes."""
    even: Beam
    """Beam of the second and further even passes."""
    children: Beam
    """Leaves of one cell for the next pass, if their number is limited."""


SIZES = ("dof", "most", "cells", "children")
"""The number of joints; the largest number of values of a joint in a window; the number of cells that a pass leaves to
the next; and the number that one cell may leave."""
CHILDREN, DOF = named("children"), named("dof")

BEAM_OF_CHILDREN = Layout(
    Beam, SIZES, "children", errors=floats(CHILDREN), nodes=whole(CHILDREN, DOF), q=floats(CHILDREN, DOF)
)
LAYOUT = Layout(GridMemory, SIZES, children=BEAM_OF_CHILDREN)

LINE = 64
"""Size of a line of the processor's cache [bytes]: tabulated leaves are read fastest from the beginning of a line."""

view_memory = LAYOUT.make


@lru_cache(maxsize=64)  # Summing up takes as long as a hundred leaves.
def memory_size(dof: int, most: int, cells: int, children: int) -> int:
    """Length in numbers of the memory of a descent, see `SIZES`."""
    return LINE // 8 + LAYOUT.count.of(dof=dof, most=most, cells=cells, children=children)


@inlined
def grid_memory(memory: Array, dof: int, most: int, cells: int, children: int) -> GridMemory:
    """Create the views of a descent in a memory of `memory_size` numbers."""
    address = (memory.ctypes.data + LINE - 1) // LINE * LINE
    views: GridMemory = view_memory(address, dof, most, cells, children)
    return views
