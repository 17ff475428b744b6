"""The task of a call as kernels see it: views by address, nothing copied."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinseek.kernels.arm.division import Division
from kinseek.kernels.arm.links import links_of
from kinseek.kernels.arrays import Array, ChainArrays, Indices
from kinseek.kernels.jit import view
from kinseek.kernels.layout import Rows
from kinseek.kernels.pointers import ROW, floats1, integer_part, integers, part1

from .lanes import LANES
from .samples import Atlas
from .tree import Tree

OPEN = 1e300
"""Limit of a joint that turns fully; infinite if it is continuous, for then both ways round count."""


WANTED = 7
"""Numbers that say what is wanted, see `task_of`."""


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


class Job(NamedTuple):
    """The same by address, for kernels that are called and not inlined."""

    handle: Indices
    wanted: Array
    memory: Array
