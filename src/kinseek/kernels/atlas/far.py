"""Goals farther than the length of the arm: the nearest pose directly, without a search for a solution.

A point on the axis of the first joint and a point that the last joint does not move cannot be farther apart than the sum
of the lengths of the links between them, see `robots.geometry.span_of`. A goal beyond that has no solution, and only the
nearest pose is sought. The search starts from the samples near the goal with the smallest errors, and then from flips of
the best result.
"""

from __future__ import annotations

import math

import numpy as np

from kinseek.kernels.arm.forward import forward
from kinseek.kernels.arm.pose_error import weighted_error
from kinseek.kernels.arrays import Array, Limits
from kinseek.kernels.jit import inlined
from kinseek.kernels.pointers import call, floats1, routine

from .descent import farthest_joint, goal_of, keep_best, lowest, lowest_row, start
from .ending import fill_from_flips, reweigh
from .lanes import LANES
from .memory import Scratch, scratch_of
from .newton import DOWNHILL, WALK, minimise
from .seeds import copy_joints, fill_from_lookup, keep_joints, look_up, restart
from .task import (
    DISTANT,
    HAND,
    LENGTHS,
    ORIENTATION,
    POSITION,
    SHOULDER,
    SPAN,
    Job,
    Joints,
    Target,
    Task,
    routine_at,
    task_at,
)

BEYOND = 1.1
"""A goal is far if its distance exceeds this multiple of the length. For nearer goals, whose remaining error may be
small, more is tried."""

ROUNDED = 1e-9
"""Allowance for the rounding of the length [m]; the length of an arm whose axes all intersect is 0."""

BESIDE = 24
"""Samples that are evaluated. The search starts from eight of them."""

STEPS, STEPS_AFTER = 8, 6
"""Reweighted steps from the samples, and from the flips of the best."""

WORTH = 3.0
"""A configuration whose error after these steps exceeds the smallest by this factor is not refined further. With 1.2, and
a stop after four walks without improvement, a rizon4 got a pose that is 0.1 to 7 per cent worse for one goal in six."""

TWIN = 0.1
"""Two configurations closer than this in every joint [rad or m] converge to the same result."""

SETTLED = 3
"""State of a lane whose walk has ended, see `Scratch.state`."""

MOST = (STEPS + STEPS_AFTER + 2 * WALK) * LANES
"""Largest number of FK evaluations."""


@inlined
def is_far(job: Job, target: Array) -> bool:
    """Return True if a target, (3, 4), is farther away than `BEYOND` times the length of the links."""
    lengths, tolerances = floats1(job.handle, LENGTHS), job.tolerances
    total, slack = 0.0, tolerances[POSITION] + ROUNDED
    for r in range(3):
        gap = target[r, 3] - lengths[SHOULDER + r]
        for c in range(3):
            gap += target[r, c] * lengths[HAND + c]
        total += gap * gap
        slack += tolerances[ORIENTATION] * abs(lengths[HAND + r])
    far: bool = math.sqrt(total) > BEYOND * lengths[SPAN] + slack
    return far


@inlined
def nearest_to_far(job: Job, target: Array, q: Array) -> int:
    """Write the nearest pose to a target for which `is_far` holds into q, (n,); return FK evaluations."""
    spent: int = call(routine_at(job.handle, DISTANT), (job, target, q))
    return spent


@inlined
def settle_best(task: Task, scratch: Scratch, target: Array) -> int:
    """Walk from the best of the eight to a minimum, in order of their errors; return FK evaluations."""
    goal, limits, spent = goal_of(task, target), Limits(task.lower, task.upper), 0
    for _ in range(LANES):
        least, row = lowest(scratch.best_error), -1
        for l in range(LANES):
            fresh = scratch.state[l] != SETTLED
            if fresh and (row < 0 or scratch.best_error[l] < scratch.best_error[row]):
                row = l
        if row < 0 or scratch.best_error[row] > WORTH * least:
            break
        copy_joints(scratch.best, row, scratch.seed)
        twin = False
        for l in range(LANES):
            twin = twin or (
                scratch.state[l] == SETTLED and farthest_joint(scratch.best, l, scratch.seed) < TWIN
            )
        scratch.state[row] = SETTLED
        if twin:
            continue
        spent += minimise(task.chain, goal, limits, DOWNHILL, scratch.seed)
        forward(task.chain, scratch.seed, scratch.spare)
        error = weighted_error(scratch.spare, goal)
        if error < scratch.best_error[row]:
            scratch.best_error[row] = error
            keep_joints(scratch.best, row, scratch.seed)
    return spent


@routine
def far_routine(job: Job, target: Target, q: Joints) -> int:
    """See `nearest_to_far`."""
    task = task_at(job)
    scratch, goal = scratch_of(job, task), goal_of(task, target)
    largest = max(goal.axis_weights[0], goal.axis_weights[1], goal.axis_weights[2])
    start(task, scratch, target)
    begin, found = 0, look_up(task, scratch, target, BESIDE)
    for _ in range(BESIDE):
        if begin == found:
            break
        begin, filled = fill_from_lookup(task, scratch, begin, found)
        if filled > 0:
            keep_best(job, task, scratch, target)
    top, spent = -1, 0
    for turn in range(2):
        if turn > 0:
            top = lowest_row(scratch.best_error)
            fill_from_flips(task, scratch)
            for l in range(LANES):
                scratch.best_error[l] = scratch.best_error[l] if l == top else np.inf
            keep_best(job, task, scratch, target)
        for l in range(LANES):
            if scratch.best_error[l] == np.inf:  # Too few samples, or flips: restarts fill the other lanes.
                restart(task, LANES * turn + l, scratch.seed)
                forward(task.chain, scratch.seed, scratch.spare)
                scratch.best_error[l] = weighted_error(scratch.spare, goal)
                keep_joints(scratch.best, l, scratch.seed)
        spent += reweigh(job, task, scratch, target, largest, STEPS if turn == 0 else STEPS_AFTER)
        if top >= 0:
            scratch.state[top] = SETTLED
        spent += settle_best(task, scratch, target)
    copy_joints(scratch.best, lowest_row(scratch.best_error), q)
    return spent
