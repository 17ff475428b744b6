"""Refine many starts to solutions, eight at a time, without duplicates, and report them in order.

Each lane makes the damped Newton steps of `atlas.lanes` from its own start and takes the next start when it is done: when
it has converged, or when it does not get closer, or when it heads for a known solution.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from kinseek.kernels.arm.forward import forward
from kinseek.kernels.arm.pose_error import errors
from kinseek.kernels.arrays import Array, GoalArrays, Indices
from kinseek.kernels.atlas.batch import stand_still
from kinseek.kernels.atlas.descent import DAMPING, iterate, within
from kinseek.kernels.atlas.lanes import LANES, RESIDUAL2, Lanes
from kinseek.kernels.atlas.memory import Scratch, scratch_of
from kinseek.kernels.atlas.seeds import copy_joints, into_limits, keep_joints
from kinseek.kernels.atlas.task import ORIENTATION_ERROR, POSITION_ERROR, Job, Task, task_at
from kinseek.kernels.jit import counted, inlined, kernel

from .distance import joint_gap, plus_scaled, six_gaps, six_in_column, six_of, squared_gap, squares

SCORE = 2
"""Index of the squared distance after the joint values of a solution and the two errors of a report."""

ANSWER = SCORE + 1
"""Number of entries after the joint values of a solution."""

ANSWERS, SPENT, CONTINUUM = 0, 1, 2
"""Indices into the row after the solutions: their number, FK evaluations, and 1 if they belong to a continuum."""

EVALUATED, CONTINUA, WEAKEST, LATE, STRANDED = 0, 1, 2, 3, 4
"""Indices into the tally of a search: FK evaluations; solutions on a continuum; the smallest singular value of the scaled
Jacobian at any solution; solutions that only a late start led to; and starts that ended in a valley, see `VALLEY`."""

TALLY = STRANDED + 1
"""Length of a tally."""

SEEDED, SIBLING, SAMPLED = 0, 1, 2
"""Modes of `refine_all`: give up starts that lead to known solutions; never give up so; or accept every start within the
tolerances."""

STEPS, SIBLING_STEPS, MORE_STEPS = 12, 20, 20
"""Largest number of steps of a start and of a sibling, and of additional steps within the tolerances until the result is
exact. Not examined further."""

EXACT = 1e-22
"""Squared scaled error to converge to, so that solutions near a singularity can be distinguished."""

EQUAL, ALIKE = 1e-4, 0.1
"""Solutions closer than EQUAL [rad or m] count as one. At a singularity a start may get no closer than the tolerances.
Solutions closer than ALIKE therefore also count as one if the configuration half-way between them meets the
tolerances. Not examined further."""

PATIENCE, STRIKES, SLOW = 4, 3, 0.7
"""A start ends from step PATIENCE on, after STRIKES steps that each leave more than the fraction SLOW of the squared
error. Not examined further."""

VALLEY = 1e-5
"""A start that is given up with a squared scaled error below this lies in a valley: the arm is close to having a
self-motion there, so the pose hardly changes along a curve of joint values. Damping by the error then far exceeds the square
of the smallest singular value, and steps along the curve are short. Not examined further."""

SLIGHT = 1e-5
"""Damping of steps from starts in a valley, relative to the squared error. Not examined further."""

NEAR, HEADING, WITHIN_SIGHT = 0.1, 0.5, 0.6
"""A start ends if it is closer to a known solution than NEAR, or closer than WITHIN_SIGHT if the last step reduced the
distance to less than the fraction HEADING. Not examined further."""

IDLE = -1
"""Value of `Progress.start` for a lane without a start."""


class Metric(NamedTuple):
    """How solutions are compared, (n,) each."""

    centre: Array
    """The joint values from which distances are measured."""
    scale: Array
    """The weight of each joint."""
    rates: Array
    """1/(2π) for each joint that has the same pose after a full turn, else 0."""


@counted
def metric_of(rows: Array) -> Metric:
    """View three rows, (3, n), by name."""
    return Metric(rows[0], rows[1], rows[2])


class Search(NamedTuple):
    """What all parts of the search for the solutions of one target share."""

    job: Job
    target: Array
    """(4, 4), lengths in [m]."""
    metric: Metric
    """Solutions are sorted by weighted distance."""
    starts: Array
    """Joint values to start from, (most, n)."""
    rows: Array
    """Joint values of the solutions, (capacity, n)."""
    left: Array
    """Squared scaled errors that are left at the solutions, (capacity,)."""
    tally: Array
    """See `EVALUATED`, (TALLY,)."""


class Batch(NamedTuple):
    """Starts to refine."""

    begin: int
    """Index of the first."""
    end: int
    """One past the last."""
    late: int
    """From this start on a new solution is late."""
    mode: int
    """SEEDED, SIBLING or SAMPLED."""


class Progress(NamedTuple):
    """What the lanes refine, and how far they are."""

    start: Indices
    """Index of the start of each lane, or IDLE, (LANES,)."""
    made: Indices
    """Steps made from it, (LANES,)."""
    strikes: Indices
    """Steps that reduced the error little, see `STRIKES`, (LANES,)."""
    before: Array
    """Squared scaled error before the last step, (LANES,)."""
    heading: Array
    """1 for a lane that heads for a known solution, else 0, (LANES,)."""
    half: Array
    """Joint values half-way between two solutions, (n,)."""


@kernel
def refine_all(search: Search, batch: Batch, count: int) -> int:
    """Refine starts, one in each lane in turn; append new solutions; return the number of solutions.

    Args:
        search: The search, with its target and weights set in the memory; the tally counts FK evaluations and late
            solutions.
        batch: Which starts, and how.
        count: Number of known solutions.
    """
    job, tally = search.job, search.tally
    task = task_at(job)
    dof = len(task.lower)
    scratch = scratch_of(job, task)
    lanes = scratch.lanes
    progress = Progress(
        np.full(LANES, IDLE, dtype=np.int64),
        np.zeros(LANES, dtype=np.int64),
        np.zeros(LANES, dtype=np.int64),
        np.zeros(LANES),
        np.zeros(LANES),
        np.zeros(dof),
    )
    following, active, most = batch.begin, 0, SIBLING_STEPS if batch.mode == SIBLING else STEPS
    tally[STRANDED] = 0.0
    for l in range(LANES):
        stand_still(lanes, l)
    # An upper bound: every start has a limited number of steps, and one lane might process all starts in sequence.
    for _ in range((batch.end - batch.begin) * (most + MORE_STEPS) + 1):
        for l in range(LANES):
            if progress.start[l] == IDLE and following < batch.end:
                take_start(search, lanes, progress, following, l)
                following += 1
                active += 1
        if active == 0 or count == len(search.rows):
            break
        iterate(job, True)
        if batch.mode == SEEDED:
            head_for_known(search, lanes, progress, count, job.width)
        for l in range(LANES):
            if progress.start[l] == IDLE:
                continue
            tally[EVALUATED] += 1.0
            count_step(lanes, progress, l)
            error, reached = lanes.error[RESIDUAL2, l], within(task, lanes, l)
            if reached:
                exact = error < EXACT or batch.mode == SAMPLED
                done = exact or progress.made[l] >= most + MORE_STEPS
            else:
                done = is_futile(progress, most, l)
            if not done:
                continue
            if not reached and error < VALLEY and progress.heading[l] == 0.0:
                # In place of an earlier start, which is not needed any more.
                for i in range(dof):
                    search.starts[int(tally[STRANDED]), i] = lanes.q[i, l]
                tally[STRANDED] += 1.0
            if reached and count < len(search.rows):
                for i in range(dof):
                    scratch.seed[i] = lanes.q[i, l]
                known = -1
                if batch.mode != SAMPLED:
                    known = find_equal(task, scratch, search, count, error, progress.half)
                if known < 0:
                    tally[LATE] += 1.0 if progress.start[l] >= batch.late else 0.0
                if known < 0 or error < search.left[known]:
                    row = count if known < 0 else known
                    search.left[row] = error
                    keep_joints(search.rows, row, scratch.seed)
                count += 1 if known < 0 else 0
            progress.start[l] = IDLE
            active -= 1
    return count


@kernel
def refine_stranded(search: Search, count: int) -> int:
    """Refine again, with less damping, the starts that ended in a valley, see `VALLEY`; return the number of solutions."""
    many = int(search.tally[STRANDED])
    if many == 0:
        return count
    scratch = scratch_of(search.job, task_at(search.job))
    scratch.damping[0] = SLIGHT
    count = refine_all(search, Batch(0, many, many, SEEDED), count)
    scratch.damping[0] = DAMPING
    return count


@inlined
def take_start(search: Search, lanes: Lanes, progress: Progress, number: int, l: int) -> None:
    """Load a start into lane l."""
    for i in range(search.starts.shape[1]):
        lanes.q[i, l] = search.starts[number, i]
    stand_still(lanes, l)
    progress.start[l], progress.made[l], progress.strikes[l], progress.heading[l] = number, 0, 0, 0.0


@inlined
def count_step(lanes: Lanes, progress: Progress, l: int) -> None:
    """Count a step of lane l, and a strike if it reduced the error little."""
    error = lanes.error[RESIDUAL2, l]
    progress.made[l] += 1
    # The first step of a lane is empty, see `stand_still`.
    if progress.made[l] > 1 and error > SLOW * progress.before[l]:
        progress.strikes[l] += 1
    progress.before[l] = error


@inlined
def is_futile(progress: Progress, most: int, l: int) -> bool:
    """Return True if lane l, outside the tolerances, is to be given up; `most` is its largest number of steps."""
    made = progress.made[l]
    slow = made >= PATIENCE and progress.strikes[l] >= STRIKES
    leads_nowhere_new = made > 1 and progress.heading[l] > 0.0
    futile: bool = made >= most or slow or leads_nowhere_new
    return futile


@inlined
def head_for_known(search: Search, lanes: Lanes, progress: Progress, count: int, w: int) -> None:
    """Find lanes that are at one of the first `count` solutions, or moved much closer to one in their last step."""
    q, step, taken, heading = lanes.q, lanes.step, lanes.share, progress.heading
    dof, rates = search.rows.shape[1], six_of(search.metric.rates)
    for l in range(w):
        heading[l] = 0.0
    for j in range(count):
        known = six_of(search.rows[j])
        for l in range(w):
            gaps = six_gaps(six_in_column(q, dof, l), known, rates)
            now = squares(gaps)
            before = squares(plus_scaled(gaps, -taken[l], six_in_column(step, dof, l)))
            # At a row, or within sight of it and much closer than before.
            far = max(now - WITHIN_SIGHT * WITHIN_SIGHT, now - HEADING * HEADING * before)
            heading[l] = 1.0 if min(now - NEAR * NEAR, far) < 0.0 else heading[l]


@inlined
def find_equal(task: Task, scratch: Scratch, search: Search, count: int, error: float, half: Array) -> int:
    """Return which of the first `count` solutions equals the seed in the scratch memory, or -1.

    Args:
        task: The task.
        scratch: Its memory.
        search: The search.
        count: Number of solutions.
        error: Squared scaled error of the seed.
        half: Scratch memory, (n,).
    """
    q, rows, rates = scratch.seed, search.rows, search.metric.rates
    for j in range(count):
        gap = squared_gap(rates, rows, j, q)
        if gap < EQUAL * EQUAL:
            return j
        # Two exact solutions are distinguished by their distance alone.
        if gap < ALIKE * ALIKE and max(error, search.left[j]) > EXACT:
            for i in range(len(q)):
                half[i] = q[i] + 0.5 * joint_gap(rows[j, i], q[i], rates[i])
            position, orientation = errors_at(task, scratch, search.target, half)
            if position <= task.position_tolerance and orientation <= task.orientation_tolerance:
                return j
    return -1


@inlined
def errors_at(task: Task, scratch: Scratch, target: Array, q: Array) -> tuple[float, float]:
    """Position error [m] and orientation error [rad] of joint values, (n,), by plain FK."""
    forward(task.chain, q, scratch.pose)
    return errors(scratch.pose, GoalArrays(target, task.position_weight, task.axis_weights))


@kernel
def report_solutions(search: Search, rows: Array, count: int, endless: bool, result: Array) -> int:
    """Judge rows by plain FK, and write those that reach the target, sorted by their distance from the view's centre.

    Args:
        search: The search.
        rows: Joint values, (at least count, n).
        count: Number of rows.
        endless: Whether the solutions belong to a continuum.
        result: Receives joint values, position error [m], orientation error [rad] and squared scaled distance of each
            solution, and a last row, see `ANSWERS`, (at least count + 1, n + ANSWER).

    Returns:
        The number of rows of the result.
    """
    job, centre, scale = search.job, search.metric.centre, search.metric.scale
    task = task_at(job)
    dof, kept = len(task.lower), 0
    scratch = scratch_of(job, task)
    q = scratch.seed
    for j in range(count):
        copy_joints(rows, j, q)
        into_limits(task, q, centre)
        position, orientation = errors_at(task, scratch, search.target, q)
        if position > task.position_tolerance or orientation > task.orientation_tolerance:
            continue
        score = 0.0
        for i in range(dof):
            rate = 0.5 / math.pi if math.isinf(task.lower[i]) else 0.0
            gap = joint_gap(q[i], centre[i], rate)
            score += gap * gap * scale[i] * scale[i]
        at = kept
        while at > 0 and result[at - 1, dof + SCORE] > score:
            for i in range(dof + ANSWER):
                result[at, i] = result[at - 1, i]
            at -= 1
        keep_joints(result, at, q)
        result[at, dof + POSITION_ERROR], result[at, dof + ORIENTATION_ERROR] = position, orientation
        result[at, dof + SCORE] = score
        kept += 1
    result[count, ANSWERS], result[count, SPENT] = kept, search.tally[EVALUATED]
    result[count, CONTINUUM] = 1.0 if endless else 0.0
    return count + 1
