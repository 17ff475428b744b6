"""The task of a call as kernels use it: views by address, without copies."""

from __future__ import annotations

from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinseek.kernels.arm.division import Division
from kinseek.kernels.arrays import Array, ChainArrays, Indices
from kinseek.kernels.jit import counted, inlined
from kinseek.kernels.layout import Rows
from kinseek.kernels.pointers import ROW, floats1, integer_part, integers, part1

from .lanes import LANES
from .samples import Atlas

OPEN = 1e300
"""Limit of a joint that turns fully. It is infinite for a continuous joint, which may turn either way without end."""


POSITION, ORIENTATION, WEIGHT, BUDGET, AXES = range(5)
"""Indices into the tolerances, an array that is passed by its address: position tolerance [m], orientation tolerance
[rad], K_P, largest number of FK evaluations, and from AXES on K_A of the x, y and z columns."""

TOLERANCES = AXES + 3
"""Length of the tolerances; `Task` has them by name."""

Handle = Annotated[Indices, "*"]
"""A handle as an argument of a kernel; callers do not choose its length."""

Target = Annotated[Array, "rows", 4]
"""A rigid transform as an argument of a kernel, (3, 4) or (4, 4), lengths in [m]."""

Joints = Annotated[Array, "n"]
"""Joint values as an argument of a kernel, (n,), [rad] or [m]."""

POSITION_ERROR, ORIENTATION_ERROR, WEIGHTED_ERROR, EVALUATIONS = range(4)
"""Indices into a report on joint values: errors [m] and [rad], the weighted error, and FK evaluations. A result has these
four after its joint values, in the same order."""

ITERATE, SEARCH, ENDING, STARTS, JUDGE, CLOSED, DISTANT = range(7)
"""Indices of the routines of a task, see `one_goal.routines`; the entry is 0 if one is not needed. CLOSED is set if the arm
has a closed form.

A goal with ranges uses other steps than a pose and the same search: its task contains other routines, see `with_ranges`.
"""

HEAD, TAIL, COLUMNS, WIDTH, POSES, EXACT = range(6)
"""Indices into the integers of a task: those of the division, LANES, `Task.poses`, and `Task.exact`."""

DIRECTION, RADIAN, SPAN, SHOULDER, HAND = 0, 1, 2, 3, 6
"""Indices into the lengths of a task [m]. The length of a direction among the samples. The length of a radian in the
refinement. The largest distance of a point on the first axis and a point that the last joint does not move. And these
two points, in the base and in the tip, three numbers each; see `robots.geometry.span_of`."""

MEASURES = HAND + 3
"""Number of lengths of a task."""


class Task(NamedTuple):
    """Data that all goals of a call share."""

    chain: ChainArrays
    links: Array
    """The chain in the format of the lanes, see `links.links_of`."""
    atlas: Atlas
    division: Division
    lower: Array
    """Limits of the refinement, (n,): at least OPEN for a joint that turns fully, so that it never stops."""
    upper: Array
    columns: Array
    """Weights of the columns in the refinement, (3,): ½ each for a pose, (1, 0, 0) for a direction, 0 for a position."""
    length: float
    """Length of a radian in the refinement [m]."""
    poses: int
    """Poses at which starts are looked up for a goal with ranges; 0 for a goal without ranges."""
    position_tolerance: float
    """[m]"""
    orientation_tolerance: float
    """[rad]"""
    position_weight: float
    """K_P, per [m]."""
    budget: float
    """Largest number of FK evaluations for one target."""
    axis_weights: Array
    """K_A of the x, y and z columns, (3,), see `GoalArrays`."""
    structure: Array
    """Structure of the arm's geometry, see `structure.candidates.KIND`."""
    exact: int
    """1 if the arm has that structure up to rounding, else 0."""


class TaskRows(NamedTuple):
    """The arrays of a task in a handle; arrays named like a field of `Task` are that field."""

    chain: ChainArrays
    atlas: Atlas
    lower: Annotated[Array, "n"]
    upper: Annotated[Array, "n"]
    columns: Annotated[Array, 3]
    numbers: Annotated[Indices, EXACT + 1]
    """See `HEAD` and those beside it, (6,)."""
    lengths: Annotated[Array, MEASURES]
    """See `DIRECTION` and those beside it, (MEASURES,), [m]."""
    links: Annotated[Array, "m+2", 12]
    """See `links.links_of`."""
    routines: Annotated[Indices, DISTANT + 1]
    """Addresses of routines that kernels call, see `ITERATE`, (7,)."""
    plain: Annotated[Array, TOLERANCES]
    """Tolerances of a plain pose, (TOLERANCES,)."""
    structure: Annotated[Array, "*"]
    """See `structure.candidates.KIND`."""


ROWS = Rows(TaskRows)
"""Declaration of the rows of a task's handle."""


ARRAYS = ROWS.count


NUMBERS, ROUTINES, PLAIN, WEIGHTS, LENGTHS = (
    ROWS.first[name] for name in ("numbers", "routines", "plain", "columns", "lengths")
)


def task_numbers(division: Division, exact: bool) -> Indices:
    """The integers of a task for goals without ranges, see `HEAD`, (6,)."""
    numbers = np.zeros(EXACT + 1, dtype=np.int64)
    numbers[HEAD], numbers[TAIL], numbers[COLUMNS] = division.head, division.tail, division.columns
    numbers[WIDTH], numbers[EXACT] = LANES, exact
    return numbers


def task_lengths(division: Division, radian: float, span: Array) -> Array:
    """The lengths of a task, see `DIRECTION`, (MEASURES,); `span` has those from SPAN on, (7,)."""
    return np.array([division.length, radian, *span])


def with_ranges(arrays: list[NDArray[Any]], poses: int, routines: Indices) -> list[NDArray[Any]]:
    """The same task for goals with ranges, with other steps.

    Starts are looked up at a number of poses, and residuals count rotation about every axis.
    """
    changed, numbers = list(arrays), arrays[NUMBERS].copy()
    numbers[POSES] = poses
    changed[NUMBERS], changed[ROUTINES], changed[WEIGHTS] = numbers, routines, np.full(3, 0.5)
    return changed


@counted
def handle_at(address: int) -> Indices:
    """View a handle by its own address."""
    seen: Indices = integer_part(address, 0, ARRAYS * ROW)
    return seen


@counted
def plain_tolerances(handle: Indices) -> Array:
    """Tolerances and weights of a plain pose, (TOLERANCES,)."""
    seen: Array = floats1(handle, PLAIN)
    return seen


@inlined
def routine_at(handle: Indices, k: int) -> int:
    """Address of routine k."""
    address: int = integers(handle, ROUTINES)[k]
    return address


@inlined
def lanes_of(handle: Indices) -> int:
    """LANES, as a number that is unknown to the compiler."""
    count: int = integers(handle, NUMBERS)[WIDTH]
    return count


rows_of = ROWS.make


@inlined
def task_of(handle: Indices, tolerances: Array) -> Task:
    """View a task through its handle.

    Args:
        handle: From `pointers.handle_of` of the arrays of `TaskRows`.
        tolerances: See `POSITION` and the other indices, (TOLERANCES,).
    """
    rows: TaskRows = rows_of(handle, 0)
    numbers, lengths = rows.numbers, rows.lengths
    division = Division(numbers[HEAD], numbers[TAIL], numbers[COLUMNS], lengths[DIRECTION])
    return Task(
        rows.chain,
        rows.links,
        rows.atlas,
        division,
        rows.lower,
        rows.upper,
        rows.columns,
        lengths[RADIAN],
        numbers[POSES],
        tolerances[POSITION],
        tolerances[ORIENTATION],
        tolerances[WEIGHT],
        tolerances[BUDGET],
        part1(tolerances.ctypes.data, AXES, 3),
        rows.structure,
        numbers[EXACT],
    )


class Job(NamedTuple):
    """The task by address, for kernels that are called and not inlined, and the memory of the call."""

    handle: Handle
    tolerances: Annotated[Array, TOLERANCES]
    memory: Annotated[Array, "*"]
    """See `memory.LAYOUT`."""
    width: int
    """LANES, as a number that is unknown to the compiler."""


@inlined
def task_at(job: Job) -> Task:
    """The task of a job."""
    return task_of(job.handle, job.tolerances)
