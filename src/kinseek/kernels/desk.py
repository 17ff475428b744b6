"""The task of a call and the memory it works on, as kernels see them: views by address, nothing copied."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .arrays import Array, ChainArrays, Indices
from .atlas import Atlas, Division
from .jit import hidden, view
from .lanes import LANES, Lanes, lanes_size, make_lanes
from .links import links_of
from .neighbours import LEAF, Tree
from .pointers import ROW, flags, floats1, floats2, floats3, integer_part, integers, part1, part2

OPEN = 1e300
"""Limit of a joint that turns fully; infinite if it is continuous, for then both ways round count."""

ARRAYS = 24
"""Arrays of a task, see `task_arrays`."""

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
    """The arrays of a task in the order in which `task_of` reads them; `wanted` is that of a plain pose.

    `routines` are the addresses of what kernels call, see `refine.routines`.
    """
    numbers = np.array([division.head, division.tail, division.columns, LANES], dtype=np.int64)
    lengths = np.array([division.length, length])
    sorted_samples = [*atlas.tree, *atlas[1:]]
    others = (lower, upper, columns, numbers, lengths, links_of(chain), routines, wanted)
    return [np.ascontiguousarray(array) for array in (*chain, *sorted_samples, *others)]


@view
def handle_at(address: int) -> Indices:
    """View a handle by its own address."""
    seen: Indices = integer_part(address, 0, ARRAYS * ROW)
    return seen


@view
def plain_wanted(handle: Indices) -> Array:
    """Tolerances and weights of a plain pose, see `task_of`."""
    seen: Array = floats1(handle, ARRAYS - 1)
    return seen


@view
def routine_at(handle: Indices, k: int) -> int:
    """Address of routine k."""
    address: int = integers(handle, ARRAYS - 2)[k]
    return address


@view
def lanes_of(handle: Indices) -> int:
    """LANES, as a number that the compiler cannot know."""
    count: int = integers(handle, 19)[3]
    return count


@view
def task_of(handle: Indices, wanted: Array) -> Task:
    """View a task by its handle.

    Args:
        handle: From `pointers.handle_of` of `task_arrays`.
        wanted: Position tolerance [m], orientation tolerance [rad], K_P, most FK evaluations, and K_A of the three
            columns, (7,).
    """
    chain = ChainArrays(
        floats3(handle, 0),
        flags(handle, 1),
        integers(handle, 2),
        floats1(handle, 3),
        floats1(handle, 4),
        integers(handle, 5),
        floats1(handle, 6),
        floats1(handle, 7),
    )
    tree = Tree(floats3(handle, 8), integers(handle, 9), floats1(handle, 10), integers(handle, 11))
    atlas = Atlas(tree, floats2(handle, 12), floats3(handle, 13), floats2(handle, 14), floats2(handle, 15))
    numbers, lengths = integers(handle, 19), floats1(handle, 20)
    division = Division(numbers[0], numbers[1], numbers[2], lengths[0])
    address = wanted.ctypes.data
    return Task(
        chain,
        floats2(handle, 21),
        atlas,
        division,
        floats1(handle, 16),
        floats1(handle, 17),
        floats1(handle, 18),
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


@hidden
def desk_size(dof: int, joints: int) -> int:
    """Numbers that a desk takes in memory."""
    return (
        lanes_size(dof, joints)
        + 12
        + 12
        + 12
        + 9
        + 2 * DEEP
        + 64
        + 64
        + LEAF
        + dof
        + 2 * LANES * dof
        + 3 * LANES
        + 4
    )


@view
def make_desk(memory: Array, dof: int, joints: int) -> Desk:
    """Lay a desk out in a memory of `desk_size` numbers."""
    address = memory.ctypes.data
    o = lanes_size(dof, joints)
    rest = o + 45 + 2 * DEEP + 128 + LEAF
    return Desk(
        make_lanes(address, dof, joints),
        part2(address, o, 3, 4),
        part2(address, o + 12, 3, 4),
        part2(address, o + 24, 3, 4),
        part1(address, o + 36, 9),
        part1(address, o + 45, DEEP),
        integer_part(address, o + 45 + DEEP, DEEP),
        integer_part(address, o + 45 + 2 * DEEP, 64),
        part1(address, o + 45 + 2 * DEEP + 64, 64 + LEAF),
        part1(address, rest, dof),
        part2(address, rest + dof, LANES, dof),
        integer_part(address, rest + dof * (1 + LANES), LANES),
        part2(address, rest + dof * (1 + LANES) + LANES, LANES, dof),
        part1(address, rest + dof * (1 + 2 * LANES) + LANES, LANES),
        part1(address, rest + dof * (1 + 2 * LANES) + 2 * LANES, LANES),
        part1(address, rest + dof * (1 + 2 * LANES) + 3 * LANES, 4),
    )
