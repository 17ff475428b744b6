"""A well-spread sample of the solutions of a redundant arm.

The number of starts is one and a half times the number of requested solutions. For an arm with a closed form distal to
one joint they are taken along every curve, see `curves`; for others they are the nearest samples. If limits leave too few
solutions, more starts are tried around those found. From all solutions, after one of each curve, the farthest from those
already chosen is chosen next (Gonzalez 1985).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from kinseek.kernels.arm.pose_error import is_rigid
from kinseek.kernels.arrays import Array, Indices
from kinseek.kernels.atlas.descent import start
from kinseek.kernels.atlas.lanes import LANES
from kinseek.kernels.atlas.memory import Scratch, make_scratch, scratch_size
from kinseek.kernels.atlas.one_goal import solve_pose
from kinseek.kernels.atlas.samples import coordinates
from kinseek.kernels.atlas.seeds import MARGIN, complete, keep_joints, kick, restart, see
from kinseek.kernels.atlas.task import EVALUATIONS, Job, Task, lanes_of, task_of
from kinseek.kernels.atlas.tree import Neighbours, nearest
from kinseek.kernels.jit import counted, inlined, noinline
from kinseek.kernels.structure.candidates import read_structure

from .curves import write_curve_starts
from .distance import joint_gap
from .refine_all import (
    EQUAL,
    EVALUATED,
    SAMPLED,
    TALLY,
    Batch,
    Search,
    metric_of,
    refine_all,
    report_solutions,
)

ROUNDS, KICK = 16, 1.5
"""Largest number of rounds of starts around known solutions, and their distance [rad or m], if a sample is too small. Not
examined further."""

CURVES = 128
"""Room for this many additional starts, one or two of each curve."""

MORE = 4 * LANES
"""Number of starts around known solutions in a round. Not examined further."""


class Choice(NamedTuple):
    """The solutions that are chosen, and memory for choosing them."""

    chosen: Array
    """Joint values of the chosen solutions, (most, n)."""
    columns: Array
    """All solutions, joint by joint, so that the innermost loop runs over solutions, (n, capacity)."""
    nearest: Array
    """Squared distance of each solution to the nearest chosen one, (capacity,)."""
    latest: Array
    """Squared distance to the one chosen last, (capacity,)."""


@noinline
def sample_branches(
    handle: Indices, tolerances: Array, target: Array, view: Array, number: int, result: Array
) -> int:
    """Find a well-spread sample of the solutions of one target for a redundant arm.

    Args:
        handle: The task, see `task_of`.
        tolerances: See `task_of`.
        target: (4, 4), lengths in [m].
        view: Rows of a `refine_all.Metric`, (3, n).
        number: Number of requested solutions.
        result: See `refine_all.report_solutions`, (at least number + 1, n + ANSWER).

    Returns:
        The number of rows; 0 if the target is not a rigid transform.
    """
    task = task_of(handle, tolerances)
    dof, joints = len(task.lower), len(task.chain.leader)
    if not is_rigid(target):
        return 0
    memory, swept = np.zeros(scratch_size(dof, joints)), read_structure(task.structure).swept > 0.0
    scratch, job = make_scratch(memory, dof, joints), Job(handle, tolerances, memory, lanes_of(handle))
    most = max(number + number // 2, MORE) + (CURVES if swept else 0)
    starts, rows, tally = np.empty((most, dof)), np.empty((most, dof)), np.zeros(TALLY)
    search = Search(job, target, metric_of(view), starts, rows, np.empty(most), tally)
    choice = Choice(np.empty((number, dof)), np.empty((dof, most)), np.empty(most), np.empty(most))
    start(task, scratch, target)
    first, many = 0, 0
    if swept:
        first, many = write_curve_starts(search, number)
    must = refine_all(search, Batch(0, first, first, SAMPLED), 0)
    if many == 0:
        many = write_nearest_samples(task, scratch, search)
    count = refine_all(search, Batch(first, many, many, SAMPLED), must)
    kept = choose_farthest(search, choice, count, must)
    for k in range(ROUNDS):
        if kept == number or (kept == 0 and k > 0):
            break
        if kept == 0:
            write_atlas_start(search, handle)
            many = 1
        else:
            many = MORE
            write_starts_around(task, scratch, search, choice.chosen, kept, k)
        must = min(must, kept)
        count = refine_all(search, Batch(0, many, many, SAMPLED), kept)
        kept = choose_farthest(search, choice, count, must)
    written = report_solutions(search, choice.chosen, kept, True, result)
    memory[0] = 0.0  # Its last use, see `one_goal.solve_pose`.
    return written


@counted
def write_nearest_samples(task: Task, scratch: Scratch, search: Search) -> int:
    """Complete the nearest samples of the atlas into the starts, nearest first; return their number."""
    most, many = len(search.starts), 0
    neighbours = Neighbours(
        np.empty(most), np.empty(most, dtype=np.int64), scratch.stack, scratch.bound, scratch.leaf
    )
    see(task, scratch, search.target)
    coordinates(scratch.seen, task.division, scratch.point)
    for k in range(nearest(task.atlas.tree, scratch.point, most, neighbours)):
        if complete(task, scratch, neighbours.place[k], MARGIN):
            keep_joints(search.starts, many, scratch.seed)
            many += 1
    return many


@counted
def write_atlas_start(search: Search, handle: Indices) -> Array:
    """Write the solution that the atlas of a task finds as the only start; return the result of `solve_pose`."""
    found, dof = (
        solve_pose(handle, search.job.tolerances, search.target, search.job.width),
        search.starts.shape[1],
    )
    search.tally[EVALUATED] += found[dof + EVALUATIONS]
    for i in range(dof):
        search.starts[0, i] = found[i]
    return found


@inlined
def write_starts_around(
    task: Task, scratch: Scratch, search: Search, chosen: Array, kept: int, round_number: int
) -> None:
    """Keep the chosen solutions alone, and write `MORE` starts around them."""
    for k in range(kept):
        for i in range(chosen.shape[1]):
            search.rows[k, i] = chosen[k, i]
    for k in range(MORE):
        restart(task, round_number * MORE + k, scratch.seed)
        kick(task, chosen, (round_number * MORE + k) % kept, KICK, scratch.seed)
        keep_joints(search.starts, k, scratch.seed)


@inlined
def choose_farthest(search: Search, choice: Choice, count: int, must: int) -> int:
    """Choose the solutions that are farthest from one another; return their number.

    Args:
        search: The search.
        choice: Receives them.
        count: Number of solutions.
        must: Number of first solutions that precede all others, also ordered by distance.
    """
    chosen, columns, rates, kept, last = choice.chosen, choice.columns, search.metric.rates, 0, 0
    for j in range(count):
        choice.nearest[j] = np.inf
        for i in range(len(columns)):
            columns[i, j] = search.rows[j, i]
    while kept < min(count, len(chosen)):
        keep_joints(chosen, kept, search.rows[last])
        kept += 1
        for j in range(count):
            choice.latest[j] = 0.0
        for i in range(len(columns)):
            here, rate = search.rows[last, i], rates[i]
            for j in range(count):
                gap = joint_gap(columns[i, j], here, rate)
                choice.latest[j] += gap * gap
        farthest = -1.0
        for j in range(count):
            choice.nearest[j] = min(choice.nearest[j], choice.latest[j])
        for some in (must, count):
            for j in range(some):
                if choice.nearest[j] > farthest:
                    farthest, last = choice.nearest[j], j
            if farthest >= EQUAL * EQUAL:
                break
        if farthest < EQUAL * EQUAL:
            break
    return kept
