"""Goals farther than the length of the arm: the nearest pose directly, without a search for a solution.

A point on the axis of the first joint and a point that the last joint does not move cannot be farther apart than the sum
of the lengths of the links between them, see `robots.geometry.span_of`. A goal beyond that has no solution, and only the
nearest pose is sought. The search starts from the samples near the goal with the smallest errors, and then from flips of
the best result.
"""

from __future__ import annotations

import numpy as np

from kinseek.kernels.arm.forward import forward
from kinseek.kernels.arm.pose_error import weighted_error
from kinseek.kernels.arm.vectors import Vector, column, minus, norm
from kinseek.kernels.arrays import Array
from kinseek.kernels.jit import inlined
from kinseek.kernels.pointers import call, routine

from .descent import goal_of, keep_seed, lowest_row, start
from .ending import fill_from_flips, reweigh
from .lanes import LANES, lanes_forward
from .lanes_newton import MOST as DESCENT
from .lanes_newton import lanes_errors, minimise_lanes
from .memory import EMPTY, Scratch, scratch_of
from .seeds import copy_joints, fill_from_lookup, keep_joints, look_up, restart
from .task import Job, Joints, Target, Task, lengths_of, read_tolerances, routines_of, task_at

BEYOND = 1.1
"""A goal is far if its distance exceeds this multiple of the length. For nearer goals, whose remaining error may be
small, more is tried."""

ROUNDED = 1e-9
"""Allowance for the rounding of the length [m]; the length of an arm whose axes all intersect is 0."""

BESIDE = 24
"""Samples that are evaluated. The search starts from eight of them."""

STEPS = 4
"""Reweighted steps from the samples, and from the flips of the best, before Newton's method. Without them, twice as many
goals of a panda and a rizon4 got a pose that is up to 2 per cent worse."""

MOST = 2 * (STEPS + DESCENT) * LANES
"""Largest number of FK evaluations."""


@inlined
def is_far(job: Job, target: Array) -> bool:
    """Return True if a target, (3, 4), is farther away than `BEYOND` times the length of the links."""
    lengths, tolerances = lengths_of(job.handle), read_tolerances(job.tolerances)
    hand, apart, turn = lengths.hand, minus(column(target, 3), lengths.shoulder), tolerances.orientation
    x = apart.x + target[0, 0] * hand.x + target[0, 1] * hand.y + target[0, 2] * hand.z
    y = apart.y + target[1, 0] * hand.x + target[1, 1] * hand.y + target[1, 2] * hand.z
    z = apart.z + target[2, 0] * hand.x + target[2, 1] * hand.y + target[2, 2] * hand.z
    # A rotation by an angle moves the point at `hand` by at most the angle times |hand|, which is at most this sum.
    slack = tolerances.position + ROUNDED + turn * abs(hand.x) + turn * abs(hand.y) + turn * abs(hand.z)
    far: bool = norm(Vector(x, y, z)) > BEYOND * lengths.span + slack
    return far


@inlined
def nearest_to_far(job: Job, target: Array, q: Array) -> int:
    """Write the nearest pose to a target for which `is_far` holds into q, (n,); return FK evaluations."""
    spent: int = call(routines_of(job.handle).far, (job, target, q))
    return spent


@inlined
def keep_filled(task: Task, scratch: Scratch, target: Array, w: int) -> None:
    """Store the eight best of the configurations in the lanes, see `descent.keep_best`, which judges one after the other."""
    lanes = scratch.lanes
    lanes_forward(task.chain.leader, task.links, lanes, w)
    lanes_errors(goal_of(task, target), lanes, lanes.before, w)
    for l in range(LANES):
        if scratch.state[l] != EMPTY:
            for i in range(len(task.lower)):
                scratch.seed[i] = lanes.q[i, l]
            keep_seed(scratch, lanes.before[l])


@routine
def far_routine(job: Job, target: Target, q: Joints) -> int:
    """See `nearest_to_far`."""
    task = task_at(job)
    scratch, goal = scratch_of(job, task), goal_of(task, target)
    start(task, scratch, target)
    begin, found = 0, look_up(task, scratch, target, BESIDE)
    for _ in range(BESIDE):
        if begin == found:
            break
        begin, filled = fill_from_lookup(task, scratch, begin, found)
        if filled > 0:
            keep_filled(task, scratch, target, job.width)
    spent = 0
    for turn in range(2):
        if turn > 0:
            # The polished configurations would all be better than flips that are not polished. Only the best one stays.
            top = lowest_row(scratch.best_error)
            fill_from_flips(task, scratch)
            for l in range(LANES):
                scratch.best_error[l] = scratch.best_error[l] if l == top else np.inf
            keep_filled(task, scratch, target, job.width)
        for l in range(LANES):
            if scratch.best_error[l] == np.inf:  # Too few samples, or flips: restarts fill the other lanes.
                restart(task, LANES * turn + l, scratch.seed)
                forward(task.chain, scratch.seed, scratch.pose)
                scratch.best_error[l] = weighted_error(scratch.pose, goal)
                keep_joints(scratch.best, l, scratch.seed)
        spent += reweigh(job, task, scratch, target, STEPS)
        spent += minimise_lanes(job, target)
    copy_joints(scratch.best, lowest_row(scratch.best_error), q)
    return spent
