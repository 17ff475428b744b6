"""A well-spread sample of the solutions of a redundant arm."""

from __future__ import annotations

import numpy as np

from kinseek.kernels.arm.pose_error import is_rigid
from kinseek.kernels.arrays import Array, Indices
from kinseek.kernels.atlas.descent import start
from kinseek.kernels.atlas.lanes import LANES
from kinseek.kernels.atlas.memory import make_scratch, scratch_size
from kinseek.kernels.atlas.one_goal import solve_pose
from kinseek.kernels.atlas.samples import coordinates
from kinseek.kernels.atlas.seeds import kick, restart, see
from kinseek.kernels.atlas.task import EVALUATIONS, task_of
from kinseek.kernels.jit import inlined, noinline
from kinseek.kernels.structure.candidates import SWEPT, WORK

from . import curves
from .refine_all import (
    ANSWERS,
    CENTRE,
    CONTINUUM,
    EQUAL,
    EVALUATED,
    RATES,
    SAMPLED,
    SCALE,
    SPENT,
    TALLY,
    joint_gap,
    refine_all,
    sorted_rows,
    starts,
)

SAMPLE_ROUNDS, SAMPLE_KICK = 16, 1.5
"""Largest number of rounds of starts around known solutions, and their distance [rad or m], if a sample is too small."""


CURVES = 128
"""Room for this many additional starts, one or two of each curve."""


@noinline
def sample_branches(
    handle: Indices, tolerances: Array, target: Array, view: Array, number: int, result: Array, w: int
) -> int:
    """Find a well-spread sample of the solutions of one target for a redundant arm.

    The number of starts is one and a half times the number of requested solutions. For an arm with a closed form distal
    to one joint they are taken along every curve, see `curves`; for others they are the nearest samples. If limits leave
    too few solutions, more starts are tried around those found. From all solutions, after one of each curve, the farthest
    from those already chosen is chosen next (Gonzalez 1985).

    Args:
        handle: The task, see `task_of`.
        tolerances: See `task_of`.
        target: (4, 4), lengths in [m].
        view: See `refine_all.CENTRE`, (3, n).
        number: Number of requested solutions.
        result: Receives the rows, (at least number + 1, n + ANSWER), see `find_branches`.
        w: LANES.

    Returns:
        As `find_branches`.
    """
    task = task_of(handle, tolerances)
    dof, joints = len(task.lower), len(task.chain.leader)
    if not is_rigid(target):
        return 0
    memory = np.zeros(scratch_size(dof, joints))
    scratch = make_scratch(memory, dof, joints)
    swept = task.structure[SWEPT] > 0.0
    most = max(number + number // 2, 4 * LANES) + (CURVES if swept else 0)
    rows, chosen, seeds = np.empty((most, dof)), np.empty((number, dof)), np.empty((most, dof))
    columns, left = np.empty((dof, most)), np.empty(most)
    distance, neighbour, tally = np.empty(2 * most), np.empty(most, dtype=np.int64), np.zeros(TALLY)
    start(task, scratch, target)
    first, many, count = 0, 0, 0
    if swept:
        size = curves.GRID + curves.SPARE + number
        first, many = curves.swept_starts(
            task,
            scratch,
            target,
            number,
            np.empty(size),
            np.empty((size, curves.REPORT, LANES)),
            np.empty(size, dtype=np.int64),
            np.empty(WORK),
            np.empty(curves.UNDER),
            seeds,
            w,
        )
        count = refine_all(
            handle,
            tolerances,
            memory,
            target,
            seeds,
            first,
            first,
            rows,
            left,
            0,
            view[RATES],
            SAMPLED,
            tally,
            w,
        )
        seeds = seeds[first:]
    if many == 0:
        see(task, scratch, target)
        coordinates(scratch.seen, task.division, scratch.point)
        many = starts(task, scratch, most, distance, neighbour, seeds)
    must, many = count, many - first
    count = refine_all(
        handle,
        tolerances,
        memory,
        target,
        seeds,
        many,
        many,
        rows,
        left,
        count,
        view[RATES],
        SAMPLED,
        tally,
        w,
    )
    kept = 0
    for rounds in range(SAMPLE_ROUNDS + 1):
        kept = spread(view[RATES], rows, count, must, columns, chosen, distance)
        if kept == number or rounds == SAMPLE_ROUNDS or (kept == 0 and rounds > 0):
            break
        many, count = 4 * LANES, kept
        if count == 0:
            other = solve_pose(handle, tolerances, target, w)
            tally[EVALUATED] += other[dof + EVALUATIONS]
            for i in range(dof):
                seeds[0, i] = other[i]
            many = 1
        else:
            for k in range(count):
                for i in range(dof):
                    rows[k, i] = chosen[k, i]
            must = min(must, kept)
            for k in range(many):
                restart(task, rounds * many + k, scratch.seed)
                kick(task, rows, (rounds * many + k) % count, SAMPLE_KICK, scratch.seed)
                for i in range(dof):
                    seeds[k, i] = scratch.seed[i]
        count = refine_all(
            handle,
            tolerances,
            memory,
            target,
            seeds,
            many,
            many,
            rows,
            left,
            count,
            view[RATES],
            SAMPLED,
            tally,
            w,
        )
    result[kept, ANSWERS] = sorted_rows(
        task, scratch, target, chosen, kept, view[CENTRE], view[SCALE], result
    )
    result[kept, SPENT], result[kept, CONTINUUM] = tally[EVALUATED], 1.0
    memory[0] = 0.0  # Its last use, see `one_goal.solve_pose`.
    return kept + 1


@inlined
def spread(
    rates: Array, rows: Array, count: int, must: int, columns: Array, chosen: Array, distance: Array
) -> int:
    """Copy the rows that are farthest from one another into `chosen`, the first `must` rows first; return their number.

    Args:
        rates: See `joint_gap`, (n,).
        rows: Solutions, (capacity, n).
        count: Number of rows.
        must: Number of first rows that precede all others, also ordered by distance.
        columns: Scratch memory, (n, capacity), joint by joint, so that the innermost loop runs over solutions.
        chosen: Receives rows, (most, n).
        distance: Scratch memory, (2 · capacity,).
    """
    kept, last = 0, 0
    for j in range(count):
        distance[j] = np.inf
        for i in range(rows.shape[1]):
            columns[i, j] = rows[j, i]
    while kept < min(count, len(chosen)):
        for j in range(count):
            distance[count + j] = 0.0
        for i in range(rows.shape[1]):
            chosen[kept, i] = rows[last, i]
            here, rate = rows[last, i], rates[i]
            for j in range(count):
                gap = joint_gap(columns[i, j], here, rate)
                distance[count + j] += gap * gap
        kept += 1
        farthest = -1.0
        for j in range(count):
            distance[j] = min(distance[j], distance[count + j])
        for some in (must, count):
            for j in range(some):
                if distance[j] > farthest:
                    farthest, last = distance[j], j
            if farthest >= EQUAL * EQUAL:
                break
        if farthest < EQUAL * EQUAL:
            break
    return kept
