"""Refine many starts to solutions, eight at a time, without duplicates."""

from __future__ import annotations

import math

import numpy as np

from kinseek.kernels.arm.forward import forward
from kinseek.kernels.arm.pose_error import errors
from kinseek.kernels.arrays import Array, GoalArrays, Indices
from kinseek.kernels.atlas.batch import stand_still
from kinseek.kernels.atlas.descent import iterate, within
from kinseek.kernels.atlas.lanes import LANES, RESIDUAL2, Lanes
from kinseek.kernels.atlas.memory import Scratch, make_scratch
from kinseek.kernels.atlas.seeds import MARGIN, complete, into_limits
from kinseek.kernels.atlas.task import ORIENTATION_ERROR, POSITION_ERROR, Job, Task, task_of
from kinseek.kernels.atlas.tree import Neighbours, nearest
from kinseek.kernels.jit import inlined, kernel

CENTRE, SCALE, RATES = range(3)
"""Rows of a view: the joint values from which distances are measured, the weight of each joint, and 1/(2π) for each joint
that has the same pose after a full turn, else 0, (n,) each."""


SCORE = 2
"""Index of the squared distance after the joint values of a solution and the two errors of a report."""


ANSWER = SCORE + 1
"""Number of entries after the joint values of a solution."""


ANSWERS, SPENT, CONTINUUM = range(3)
"""Indices into the row after the solutions: their number, FK evaluations, and 1 if they belong to a continuum."""


EVALUATED, CONTINUA, WEAKEST, LATE = range(4)
"""Indices into the tally of a search: FK evaluations; solutions on a continuum; the smallest singular value of the scaled
Jacobian at any solution; and solutions that only a late start led to."""


TALLY = LATE + 1
"""Length of a tally."""


SEEDED, SIBLING, SAMPLED = 0, 1, 2
"""Modes of `refine_all`: give up starts that lead to known solutions; never give up so; or accept every start within the
tolerances."""


STEPS, SIBLING_STEPS, MORE_STEPS = 12, 20, 20
"""Largest number of steps of a start and of a sibling, and of additional steps within the tolerances until the result is
exact."""


EXACT = 1e-22
"""Squared scaled error to converge to, so that solutions near a singularity can be distinguished."""


EQUAL, ALIKE = 1e-4, 0.1
"""Solutions closer than EQUAL [rad or m] count as one. At a singularity a start may get no closer than the tolerances.
Solutions closer than ALIKE therefore also count as one if the configuration half-way between them meets the
tolerances."""


PATIENCE, STRIKES, WORTH = 4, 3, 0.7
"""A start ends from step PATIENCE on, after STRIKES steps that each leave more than the fraction WORTH of the squared
error."""


NEAR, HEADING, WITHIN_SIGHT = 0.1, 0.5, 0.6
"""A start ends if it is closer to a known solution than NEAR, or closer than WITHIN_SIGHT if the last step reduced the
distance to less than the fraction HEADING."""


@inlined
def joint_gap(a: float, b: float, rate: float) -> float:
    """Difference of two joint values, the shorter way if `rate` is 1/(2π) and not 0."""
    gap: float = a - b
    gap -= 2.0 * math.pi * np.floor(gap * rate + 0.5)
    return gap


@inlined
def squared_gap(rates: Array, rows: Array, row: int, q: Array) -> float:
    """Squared distance between a row of joint values and q, modulo full turns."""
    total = 0.0
    for i in range(len(q)):
        gap = joint_gap(rows[row, i], q[i], rates[i])
        total += gap * gap
    return total


@inlined
def match(
    task: Task,
    scratch: Scratch,
    goal: GoalArrays,
    rates: Array,
    rows: Array,
    left: Array,
    count: int,
    error: float,
    q: Array,
    half: Array,
) -> int:
    """Return which of the first `count` rows equals q, or -1.

    Args:
        task: The task.
        scratch: Its memory.
        goal: The goal.
        rates: See `joint_gap`, (n,).
        rows: Solutions, (capacity, n).
        left: Their squared scaled errors, (capacity,).
        count: Number of solutions.
        error: Squared scaled error of q.
        q: Joint values, (n,).
        half: Scratch memory, (n,).
    """
    for j in range(count):
        gap = squared_gap(rates, rows, j, q)
        if gap < EQUAL * EQUAL:
            return j
        if gap < ALIKE * ALIKE and max(error, left[j]) > EXACT:
            for i in range(len(q)):
                half[i] = q[i] + 0.5 * joint_gap(rows[j, i], q[i], rates[i])
            forward(task.chain, half, scratch.spare)
            position, orientation = errors(scratch.spare, goal)
            if position <= task.position_tolerance and orientation <= task.orientation_tolerance:
                return j
    return -1


@inlined
def head_for_known(lanes: Lanes, rates: Array, rows: Array, count: int, heading: Array, w: int) -> None:
    """Find lanes that are at one of the first `count` rows, or moved much closer to one in their last step.

    Writes 1 for these, else 0, into `heading`, (LANES,). One loop over the lanes handles all joints, see
    `seeding.is_alike`; with fewer than six joints the last counts more than once.
    """
    q, step, dof = lanes.q, lanes.step, rows.shape[1]
    b, c, d = min(1, dof - 1), min(2, dof - 1), min(3, dof - 1)
    e, f = min(4, dof - 1), min(5, dof - 1)
    ra, rb, rc, rd, re, rf = rates[0], rates[b], rates[c], rates[d], rates[e], rates[f]
    for l in range(w):
        heading[l] = 0.0
    for j in range(count):
        xa, xb, xc, xd, xe, xf = rows[j, 0], rows[j, b], rows[j, c], rows[j, d], rows[j, e], rows[j, f]
        for l in range(w):
            ga, gb, gc = joint_gap(q[0, l], xa, ra), joint_gap(q[b, l], xb, rb), joint_gap(q[c, l], xc, rc)
            gd, ge, gf = joint_gap(q[d, l], xd, rd), joint_gap(q[e, l], xe, re), joint_gap(q[f, l], xf, rf)
            now = ga * ga + gb * gb + gc * gc + gd * gd + ge * ge + gf * gf
            share = lanes.share[l]
            ga, gb, gc = ga - share * step[0, l], gb - share * step[b, l], gc - share * step[c, l]
            gd, ge, gf = gd - share * step[d, l], ge - share * step[e, l], gf - share * step[f, l]
            before = ga * ga + gb * gb + gc * gc + gd * gd + ge * ge + gf * gf
            # At a row, or within sight of it and much closer than before.
            far = max(now - WITHIN_SIGHT * WITHIN_SIGHT, now - HEADING * HEADING * before)
            heading[l] = 1.0 if min(now - NEAR * NEAR, far) < 0.0 else heading[l]


@kernel
def refine_all(
    handle: Indices,
    tolerances: Array,
    memory: Array,
    target: Array,
    seeds: Array,
    surely: int,
    last: int,
    rows: Array,
    left: Array,
    count: int,
    rates: Array,
    mode: int,
    tally: Array,
    w: int,
) -> int:
    """Refine seeds 0 … last-1, one in each lane in turn; append new solutions; return the number of solutions.

    Args:
        handle: The task, see `task_of`.
        tolerances: See `task_of`.
        memory: The scratch memory, with target and weights set.
        target: (4, 4), lengths in [m].
        seeds: Joint values to start from, (k, n).
        surely: From this seed on a new solution is late.
        last: One past the last seed.
        rows: Solutions, (capacity, n).
        left: Their squared scaled errors, (capacity,).
        count: Number of known solutions.
        rates: See `joint_gap`, (n,).
        mode: SEEDED, SIBLING or SAMPLED.
        tally: EVALUATED increases by the FK evaluations spent, LATE by the number of late solutions, (TALLY,).
        w: LANES.
    """
    task, job = task_of(handle, tolerances), Job(handle, tolerances, memory, w)
    dof = len(task.lower)
    scratch = make_scratch(memory, dof, len(task.chain.leader))
    goal, lanes = GoalArrays(target, task.position_weight, task.axis_weights), scratch.lanes
    busy, made = np.zeros(LANES, dtype=np.int64), np.zeros(LANES, dtype=np.int64)
    strikes, own = np.zeros(LANES, dtype=np.int64), np.zeros(LANES, dtype=np.int64)
    before, half, heading = np.zeros(LANES), np.zeros(dof), np.zeros(LANES)
    number, active, most = 0, 0, SIBLING_STEPS if mode == SIBLING else STEPS
    exact = np.inf if mode == SAMPLED else EXACT
    for l in range(LANES):
        stand_still(lanes, l)
    # An upper bound: every start has a limited number of steps, and one lane might process all starts in sequence.
    for _ in range(last * (most + MORE_STEPS) + 1):
        for l in range(LANES):
            if busy[l] == 0 and number < last:
                for i in range(dof):
                    lanes.q[i, l] = seeds[number, i]
                stand_still(lanes, l)
                busy[l], made[l], strikes[l], own[l] = 1, 0, 0, number
                number += 1
                active += 1
        if active == 0 or count == len(rows):
            break
        iterate(job, True)
        if mode == SEEDED:
            head_for_known(lanes, rates, rows, count, heading, w)
        for l in range(LANES):
            if busy[l] == 0:
                continue
            tally[EVALUATED] += 1.0
            made[l] += 1
            error, done = lanes.error[RESIDUAL2, l], made[l] >= most
            if made[l] > 1 and error > WORTH * before[l]:
                strikes[l] += 1
            before[l] = error
            if within(task, lanes, l):
                done = error < exact or made[l] >= most + MORE_STEPS
                if done and count < len(rows):
                    for i in range(dof):
                        scratch.seed[i] = lanes.q[i, l]
                    j = -1
                    if mode != SAMPLED:
                        j = match(task, scratch, goal, rates, rows, left, count, error, scratch.seed, half)
                    if j < 0:
                        j = count
                        count += 1
                        left[j] = np.inf
                        tally[LATE] += 1.0 if own[l] >= surely else 0.0
                    if error < left[j]:
                        left[j] = error
                        for i in range(dof):
                            rows[j, i] = scratch.seed[i]
            elif not done:
                done = made[l] >= PATIENCE and strikes[l] >= STRIKES
                if mode == SEEDED and made[l] > 1 and not done:
                    done = heading[l] > 0.0
            if done:
                busy[l] = 0
                active -= 1
    memory[0] += 0.0  # Its last use, see `one_goal.solve_pose`.
    return count


@inlined
def starts(
    task: Task,
    scratch: Scratch,
    most: int,
    distance: Array,
    neighbour: Indices,
    seeds: Array,
) -> int:
    """Complete the `most` nearest samples into seeds, nearest first; return their number."""
    neighbours = Neighbours(distance, neighbour, scratch.stack, scratch.bound)
    found = nearest(task.atlas.tree, scratch.point, most, neighbours)
    many = 0
    for k in range(found):
        if complete(task, scratch, neighbour[k], MARGIN):
            for i in range(len(scratch.seed)):
                seeds[many, i] = scratch.seed[i]
            many += 1
    return many


@inlined
def sorted_rows(
    task: Task,
    scratch: Scratch,
    target: Array,
    rows: Array,
    count: int,
    centre: Array,
    scale: Array,
    result: Array,
) -> int:
    """Judge rows by plain FK, and write those that reach the target, sorted by their distance from `centre`.

    Each row of the result is q, position error [m], orientation error [rad] and squared scaled distance, (n + ANSWER,).
    """
    goal, dof, kept = GoalArrays(target, task.position_weight, task.axis_weights), len(centre), 0
    for j in range(count):
        for i in range(dof):
            scratch.seed[i] = rows[j, i]
        into_limits(task, scratch.seed, centre)
        forward(task.chain, scratch.seed, scratch.spare)
        position, orientation = errors(scratch.spare, goal)
        if position > task.position_tolerance or orientation > task.orientation_tolerance:
            continue
        score = 0.0
        for i in range(dof):
            gap = scratch.seed[i] - centre[i]
            if math.isinf(task.lower[i]):
                gap = joint_gap(scratch.seed[i], centre[i], 0.5 / math.pi)
            score += gap * gap * scale[i] * scale[i]
        at = kept
        while at > 0 and result[at - 1, dof + SCORE] > score:
            for i in range(dof + ANSWER):
                result[at, i] = result[at - 1, i]
            at -= 1
        for i in range(dof):
            result[at, i] = scratch.seed[i]
        result[at, dof + POSITION_ERROR], result[at, dof + ORIENTATION_ERROR] = position, orientation
        result[at, dof + SCORE] = score
        kept += 1
    return kept
