"""The task of a call as kernels use it: views by address, without copies."""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np

from kinseek.kernels.arm.division import Division
from kinseek.kernels.arm.record import Record
from kinseek.kernels.arm.vectors import Vector
from kinseek.kernels.arrays import Array, ChainArrays, Indices
from kinseek.kernels.jit import counted, inlined
from kinseek.kernels.layout import Rows
from kinseek.kernels.pointers import ROW, floats1, integer_part, integers, part1

from .lanes import LANES
from .samples import Atlas

OPEN = 1e300
"""Limit of a joint that turns fully. It is infinite for a continuous joint, which may turn either way without end."""


class Tolerances(NamedTuple):
    """Tolerances, weights and budget of a call."""

    position: float
    """[m]"""
    orientation: float
    """[rad]"""
    position_weight: float
    """K_P, per [m]."""
    budget: float
    """Largest number of FK evaluations for one target."""
    nearest: float
    """1 to search for the nearest pose to a target that is missed, else 0."""
    axis_weights: Vector
    """K_A of the x, y and z columns, see `GoalArrays`."""


TOLERANCE = Record(Tolerances)
"""The array of tolerances that kernels take."""

read_tolerances, TOLERANCES = TOLERANCE.read, TOLERANCE.size
AXIS_WEIGHTS = TOLERANCE.first["axis_weights"]

Handle = Annotated[Indices, "*"]
"""A handle as an argument of a kernel; callers do not choose its length."""

Target = Annotated[Array, "rows", 4]
"""A rigid transform as an argument of a kernel, (3, 4) or (4, 4), lengths in [m]."""

Joints = Annotated[Array, "n"]
"""Joint values as an argument of a kernel, (n,), [rad] or [m]."""

POSITION_ERROR, ORIENTATION_ERROR, WEIGHTED_ERROR, EVALUATIONS = range(4)
"""Indices into a report on joint values: errors [m] and [rad], the weighted error, and FK evaluations. A result has these
four after its joint values, in the same order."""
REPORT = EVALUATIONS + 1
"""Length of a report."""


class Routines(NamedTuple):
    """Addresses of the routines of a task, see `one_goal.routines`; 0 if one is not needed.

    A goal with ranges uses other steps than a pose and the same search: its task contains other routines, see
    `with_ranges`.
    """

    iterate: int
    search: int
    ending: int
    far: int
    starts: int = 0
    judge: int = 0
    closed: int = 0
    """Set if the arm has a closed form."""


class Numbers(NamedTuple):
    """The integers of a task."""

    head: int
    """See `Division`."""
    tail: int
    columns: int
    lanes: int
    """LANES, as a number that is unknown to the compiler."""
    poses: int
    """See `Task.poses`."""
    exact: int
    """See `Task.exact`."""


class Lengths(NamedTuple):
    """The lengths of a task [m]."""

    direction: float
    """Of a direction among the samples."""
    radian: float
    """Of a radian in the refinement."""
    span: float
    """Largest distance of a point on the first axis and a point that the last joint does not move, see
    `robots.geometry.span_of`."""
    shoulder: Vector
    """The first point, in the base."""
    hand: Vector
    """The second point, in the tip."""


ROUTINE, NUMBER, LENGTH = Record(Routines), Record(Numbers), Record(Lengths)
"""The arrays of these three in a handle."""

read_routines, read_numbers, read_lengths = ROUTINE.read, NUMBER.read, LENGTH.read


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
    nearest: float
    """1 to search for the nearest pose to a target that is missed, else 0."""
    axis_weights: Array
    """K_A of the x, y and z columns, (3,), see `GoalArrays`."""
    structure: Array
    """Structure of the arm's geometry, see `structure.candidates.STRUCTURE`."""
    exact: int
    """1 if the arm has that structure up to rounding, else 0."""


class TaskRows(NamedTuple):
    """The arrays of a task in a handle; arrays named like a field of `Task` are that field."""

    chain: ChainArrays
    atlas: Atlas
    lower: Annotated[Array, "n"]
    upper: Annotated[Array, "n"]
    columns: Annotated[Array, 3]
    numbers: Annotated[Indices, NUMBER.size]
    """See `Numbers`."""
    lengths: Annotated[Array, LENGTH.size]
    """See `Lengths`."""
    links: Annotated[Array, "m+2", 12]
    """See `links.links_of`."""
    routines: Annotated[Indices, ROUTINE.size]
    """See `Routines`."""
    plain: Annotated[Array, TOLERANCES]
    """Tolerances of a plain pose, see `Tolerances`."""
    structure: Annotated[Array, "*"]
    """See `structure.candidates.STRUCTURE`."""


ROWS = Rows(TaskRows)
"""Declaration of the rows of a task's handle."""

ARRAYS = ROWS.count
NUMBERS, ROUTINES, PLAIN, LENGTHS = (ROWS.first[name] for name in ("numbers", "routines", "plain", "lengths"))


def task_numbers(division: Division, exact: bool) -> Indices:
    """The integers of a task for goals without ranges, see `Numbers`."""
    of_arm = Numbers(division.head, division.tail, division.columns, LANES, 0, int(exact))
    return NUMBER.numbers(of_arm, np.int64)


def with_ranges(task: TaskRows, poses: int, routines: Indices) -> TaskRows:
    """The same task for goals with ranges, with other steps.

    Starts are looked up at a number of poses, and residuals count rotation about every axis.
    """
    numbers = NUMBER.numbers(NUMBER.value(task.numbers)._replace(poses=poses), np.int64)
    return task._replace(numbers=numbers, columns=np.full(3, 0.5), routines=routines)


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
def routines_of(handle: Indices) -> Routines:
    """Addresses of the routines of a task."""
    addresses: Routines = read_routines(integers(handle, ROUTINES))
    return addresses


@inlined
def lengths_of(handle: Indices) -> Lengths:
    """The lengths of a task."""
    lengths: Lengths = read_lengths(floats1(handle, LENGTHS))
    return lengths


@inlined
def lanes_of(handle: Indices) -> int:
    """LANES, as a number that is unknown to the compiler."""
    count: int = read_numbers(integers(handle, NUMBERS)).lanes
    return count


rows_of = ROWS.make


@inlined
def task_of(handle: Indices, tolerances: Array) -> Task:
    """View a task through its handle.

    Args:
        handle: From `pointers.handle_of` of the arrays of `TaskRows`.
        tolerances: See `Tolerances`, (TOLERANCES,).
    """
    rows: TaskRows = rows_of(handle, 0)
    numbers, lengths, given = (
        read_numbers(rows.numbers),
        read_lengths(rows.lengths),
        read_tolerances(tolerances),
    )
    return Task(
        rows.chain,
        rows.links,
        rows.atlas,
        Division(numbers.head, numbers.tail, numbers.columns, lengths.direction),
        rows.lower,
        rows.upper,
        rows.columns,
        lengths.radian,
        numbers.poses,
        given.position,
        given.orientation,
        given.position_weight,
        given.budget,
        given.nearest,
        part1(tolerances.ctypes.data, AXIS_WEIGHTS, 3),
        rows.structure,
        numbers.exact,
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
