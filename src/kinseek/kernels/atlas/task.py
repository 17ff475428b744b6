"""The task of a call and the memory it works on, as kernels see them: views by address, nothing copied."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinseek.kernels.arm.links import links_of
from kinseek.kernels.arrays import Array, ChainArrays, Indices
from kinseek.kernels.jit import view
from kinseek.kernels.layout import DOF, Layout, Rows, floats, whole
from kinseek.kernels.pointers import ROW, floats1, integer_part, integers, part1

from .lanes import LANES, Lanes
from .lanes import LAYOUT as LANES_LAYOUT
from .samples import Atlas, Division
from .tree import LEAF, Tree

OPEN = 1e300
"""Limit of a joint that turns fully; infinite if it is continuous, for then both ways round count."""

WANTED = 7
"""Numbers that say what is wanted, see `task_of`."""

DEEP = 160
"""Samples looked up at most for one goal."""


class Task(NamedTuple):
    """What every goal of a call has in common."""

    chain: ChainArrays
    links: Array
    """The chain as the lanes take it, see `links.links_of`."""
    atlas: Atlas
    division: Division
    lower: Array
    """Limits of the refinement, (n,): at least OPEN for a joint that turns fully, for it can always go on."""
    upper: Array
    columns: Array
    """Weights of the columns in the refinement, (3,): ½ each for a pose, (1, 0, 0) for a direction, 0 for a position."""
    length: float
    """Length that a radian counts as while refining, [m]."""
    wanted: Array
    """Position tolerance [m], orientation tolerance [rad], K_P, most FK evaluations, (4,)."""
    axis_weights: Array
    """K_A of the x, y and z columns, (3,), see `GoalArrays`."""


class TaskRows(NamedTuple):
    """A task as a handle holds it; arrays that have the name of a field of `Task` are that field."""

    chain: ChainArrays
    atlas: Atlas
    lower: Array
    upper: Array
    columns: Array
    numbers: Indices
    """Head, tail and columns of the division, and LANES, (4,)."""
    lengths: Array
    """Lengths of the division and of the task, (2,), [m]."""
    links: Array
    routines: Indices
    """Addresses of what kernels call, see `refine.routines`."""
    plain: Array
    """What is wanted of a plain pose, see `task_of`."""


ROWS = Rows(
    TaskRows,
    chain=Rows(
        ChainArrays,
        fixed="floats3",
        prismatic="flags",
        leader="integers",
        multiplier="floats1",
        offset="floats1",
        start="integers",
        lower="floats1",
        upper="floats1",
    ),
    atlas=Rows(
        Atlas,
        tree=Rows(Tree, points="floats3", axis="integers", split="floats1", beside="integers"),
        middle="floats2",
        poses="floats3",
        inverse_head="floats2",
        inverse_tip="floats2",
    ),
    lower="floats1",
    upper="floats1",
    columns="floats1",
    numbers="integers",
    lengths="floats1",
    links="floats2",
    routines="integers",
    plain="floats1",
)
"""The rows of a task's handle."""

ARRAYS = ROWS.count
NUMBERS, ROUTINES, PLAIN = (ROWS.first[name] for name in ("numbers", "routines", "plain"))


def task_arrays(
    chain: ChainArrays,
    atlas: Atlas,
    division: Division,
    lower: Array,
    upper: Array,
    columns: Array,
    length: float,
    routines: Indices,
    wanted: Array,
) -> list[NDArray[Any]]:
    """The arrays of a task in the order in which `task_of` reads them; `wanted` is that of a plain pose."""
    numbers = np.array([division.head, division.tail, division.columns, LANES], dtype=np.int64)
    lengths = np.array([division.length, length])
    links = links_of(chain)
    return ROWS.arrays(
        TaskRows(chain, atlas, lower, upper, columns, numbers, lengths, links, routines, wanted)
    )


@view
def handle_at(address: int) -> Indices:
    """View a handle by its own address."""
    seen: Indices = integer_part(address, 0, ARRAYS * ROW)
    return seen


@view
def plain_wanted(handle: Indices) -> Array:
    """Tolerances and weights of a plain pose, see `task_of`."""
    seen: Array = floats1(handle, PLAIN)
    return seen


@view
def routine_at(handle: Indices, k: int) -> int:
    """Address of routine k."""
    address: int = integers(handle, ROUTINES)[k]
    return address


@view
def lanes_of(handle: Indices) -> int:
    """LANES, as a number that the compiler cannot know."""
    count: int = integers(handle, NUMBERS)[3]
    return count


rows_of = ROWS.make


@view
def task_of(handle: Indices, wanted: Array) -> Task:
    """View a task by its handle.

    Args:
        handle: From `pointers.handle_of` of `task_arrays`.
        wanted: Position tolerance [m], orientation tolerance [rad], K_P, most FK evaluations, and K_A of the three
            columns, (7,).
    """
    rows: TaskRows = rows_of(handle, 0)
    numbers, lengths, address = rows.numbers, rows.lengths, wanted.ctypes.data
    division = Division(numbers[0], numbers[1], numbers[2], lengths[0])
    return Task(
        rows.chain,
        rows.links,
        rows.atlas,
        division,
        rows.lower,
        rows.upper,
        rows.columns,
        lengths[1],
        part1(address, 0, 4),
        part1(address, 4, 3),
    )


class Desk(NamedTuple):
    """Memory of one call."""

    lanes: Lanes
    seen: Array
    """The goal as the atlas sees it, (3, 4)."""
    spare: Array
    """(3, 4)"""
    between: Array
    """(3, 4)"""
    point: Array
    """Its coordinates, (9,)."""
    distance: Array
    """(DEEP,)"""
    neighbour: Indices
    """(DEEP,)"""
    stack: Indices
    """(64,)"""
    bound: Array
    """(64 + LEAF,)"""
    seed: Array
    """(n,)"""
    found: Array
    """Where each lane converged, (LANES, n)."""
    state: Indices
    """Of each lane: 0 on its way, 1 converged, 2 empty, (LANES,)."""
    best: Array
    """The best of every lane so far, (LANES, n)."""
    best_error: Array
    """Their weighted errors, (LANES,)."""
    floor: Array
    """Least damping of each lane, (LANES,)."""
    mode: Array
    """Weights of the columns, and the damping, (4,)."""


class Job(NamedTuple):
    """The same by address, for kernels that are called and not inlined."""

    handle: Indices
    wanted: Array
    memory: Array


LAYOUT = Layout(
    Desk,
    lanes=LANES_LAYOUT,
    seen=floats(3, 4),
    spare=floats(3, 4),
    between=floats(3, 4),
    point=floats(9),
    distance=floats(DEEP),
    neighbour=whole(DEEP),
    stack=whole(64),
    bound=floats(64 + LEAF),
    seed=floats(DOF),
    found=floats(LANES, DOF),
    state=whole(LANES),
    best=floats(LANES, DOF),
    best_error=floats(LANES),
    floor=floats(LANES),
    mode=floats(4),
)
"""Where the desk of an arm stands in memory."""

desk_size, lay_desk = LAYOUT.size, LAYOUT.make


@view
def make_desk(memory: Array, dof: int, joints: int) -> Desk:
    """Lay a desk out in a memory of `desk_size` numbers."""
    desk: Desk = lay_desk(memory.ctypes.data, dof, joints)
    return desk
