"""Search from the atlas for a solution of a goal with free axes and ranges.

The search is that of whole poses, see `kernels.atlas.one_goal`. Routines that differ are called by address: the step, in
`steps`, the choice of starts, and the judgement. Starts are looked up at poses spread over the ranges. Goals that these
do not solve get a second, deeper look-up and low-discrepancy restarts. Goals that are still missed get the best pose
found, polished under the goal's weights.
"""

from __future__ import annotations

from typing import Annotated

import numpy as np

from kinseek.kernels.arm.forward import copy_pose, forward
from kinseek.kernels.arm.range_error import QUESTION, deviation, range_errors, range_weighted
from kinseek.kernels.arrays import Array
from kinseek.kernels.atlas.descent import POLISH_STEPS, judge_by_ranges
from kinseek.kernels.atlas.ending import reweigh
from kinseek.kernels.atlas.lanes import LANES
from kinseek.kernels.atlas.memory import ACTIVE, EMPTY, scratch_of, scratch_size
from kinseek.kernels.atlas.near import load_near
from kinseek.kernels.atlas.one_goal import routines, search_near
from kinseek.kernels.atlas.seeds import MARGIN, MORE, complete, into_limits, load_seed, look_up
from kinseek.kernels.atlas.task import (
    EVALUATIONS,
    ORIENTATION_ERROR,
    POSITION_ERROR,
    REPORT,
    TOLERANCES,
    WEIGHTED_ERROR,
    Handle,
    Job,
    Joints,
    Routines,
    Target,
    task_at,
    task_of,
)
from kinseek.kernels.entry import OUT
from kinseek.kernels.jit import entry
from kinseek.kernels.pointers import part1, part2, routine

from .steps import POSES, range_scratch_of, range_scratch_size, range_step_routine


@routine
def range_starts_routine(job: Job, near: Joints, close: bool, begin: int, most: int) -> int:
    """See `one_goal.fill_from_ranges`.

    None of the `most` nearest samples is used twice: if the ranges are narrow, the next nearest is used instead.
    """
    task = task_at(job)
    scratch, ranges = scratch_of(job, task), range_scratch_of(job, task)
    used, first = ranges.used, 0
    if close and begin == 0:
        first = 1
        load_near(task, scratch, near)
        scratch.state[0] = ACTIVE
    for l in range(first, LANES):
        scratch.state[l] = EMPTY
    for l in range(first, LANES):
        if begin >= POSES:
            break
        found, taken = look_up(task, scratch, ranges.poses[begin], most), -1
        for k in range(found):
            i, fresh = scratch.neighbour[k], True
            for j in range(len(used)):
                fresh = fresh and used[j] != i
            if fresh and complete(task, scratch, i, MARGIN):
                taken = i
                load_seed(scratch.lanes, l, scratch.seed)
                scratch.state[l] = ACTIVE
                break
        used[begin if most == MORE else POSES + begin] = taken
        begin += 1
    return begin


@routine
def range_judge_routine(job: Job, q: Joints, report: Annotated[Array, "*"]) -> int:
    """See `descent.judge_by_ranges`."""
    task = task_at(job)
    scratch, ranges = scratch_of(job, task), range_scratch_of(job, task)
    forward(task.chain, q, scratch.pose)
    deviation(scratch.pose, ranges.question, ranges.out)
    place, turn = range_errors(ranges.out, ranges.question)
    report[POSITION_ERROR], report[ORIENTATION_ERROR] = place, turn
    report[WEIGHTED_ERROR] = range_weighted(task.position_weight, task.axis_weights[0], place, turn)
    return 0


@routine
def range_ending_routine(job: Job, target: Target) -> int:
    """Do the same as `ending_routine` for a goal with ranges.

    Only the reweighted steps are made, because Newton's method is implemented for poses only.
    """
    task = task_at(job)
    return reweigh(job, task, scratch_of(job, task), target, POLISH_STEPS)


def range_routines() -> Routines:
    """The routines for goals with ranges, see `task.with_ranges`."""
    return routines()._replace(
        iterate=range_step_routine.address,
        starts=range_starts_routine.address,
        judge=range_judge_routine.address,
        ending=range_ending_routine.address,
    )


@entry
def solve_ranged(
    handle: Handle,
    tolerances: Annotated[Array, TOLERANCES],
    questions: Annotated[Array, "k", QUESTION],
    poses: Annotated[Array, "k", POSES, 3, 4],
    near: Annotated[Array, "k", "n"],
    close: bool,
    results: Annotated[Array, "k", "n+4", OUT],
    w: int,
) -> None:
    """Solve goals with ranges, one after the other.

    Args:
        handle: The task, see `task.with_ranges`.
        tolerances: See `task_of`; the first of the K_A counts.
        questions: See `range_error.FRAME`, (k, QUESTION).
        poses: Poses at which starts are looked up, (k, POSES, 3, 4), the most promising of each goal first.
        near: Reference joint values of each goal, to which continuous joints are moved by full turns, (k, n).
        close: True to choose the solution nearest to `near` of all that are found.
        results: Receives joint values, position error [m], orientation error [rad], weighted error and FK evaluations,
            (k, n + 4).
        w: LANES.
    """
    task = task_of(handle, tolerances)
    dof, joints = len(task.lower), len(task.chain.leader)
    memory = np.zeros(scratch_size(dof, joints) + range_scratch_size(dof, joints))
    job = Job(handle, tolerances, memory, w)
    ranges = range_scratch_of(job, task)
    address, width = results.ctypes.data, dof + REPORT
    for i in range(len(questions)):
        # The memory is cleared between goals, so that results do not depend on the rest of the batch, bit by bit.
        for k in range(len(memory)):
            memory[k] = 0.0
        for k in range(QUESTION):
            ranges.question[k] = questions[i, k]
        for k in range(POSES):
            copy_pose(poses[i, k], ranges.poses[k])
        for k in range(len(ranges.used)):
            ranges.used[k] = -1
        row = i * width
        q, report = part1(address, row, dof), part1(address, row + dof, REPORT)
        target = part2(questions.ctypes.data, i * QUESTION, 3, 4)  # A question begins with its target.
        report[EVALUATIONS] = search_near(job, target, task.budget, near[i], close, q)
        into_limits(task, q, near[i])
        judge_by_ranges(job, q, report)
    memory[0] = 0.0  # Its last use, see `one_goal.solve_pose`.
