"""From the atlas to an answer for a goal with free axes and ranges.

Seeds are looked up at poses spread over the ranges, and refined eight at a time by the steps of `box_steps`. What they do
not solve gets a second, deeper lookup and low-discrepancy restarts; what is then still missed gets the best pose found,
polished under the goal's weights. As `refine` does for whole poses.
"""

from __future__ import annotations

import math

import numpy as np

from kinseek.kernels.arm.forward import forward
from kinseek.kernels.arm.range_error import box_errors, box_weighted, deviation
from kinseek.kernels.arrays import Array, Indices
from kinseek.kernels.jit import called, hidden, kernel
from kinseek.kernels.pointers import part1

from .descent import (
    DAMPING,
    DEEP_STEPS,
    PERSIST_STEPS,
    POLISH_STEPS,
    RESTART_STEPS,
    keep_seed,
    lowest,
    lowest_row,
)
from .ending import promise
from .lanes import LANES
from .memory import DEEP, Desk, desk_size, make_desk
from .near import keep_closest, load_near
from .range_steps import ROWS, iterate_box
from .samples import complete_seed
from .seeds import (
    MARGIN,
    MORE,
    MORE_RESTARTS,
    RESTARTS,
    copy_joints,
    into_limits,
    kick,
    load_seed,
    load_seed_row,
    look_up,
    middle,
    restart,
)
from .task import Job, Task, task_of


@called
def judge_pose(task: Task, desk: Desk, question: Array, rows: Array, q: Array) -> tuple[float, float]:
    """Errors of q, (n,), by plain forward kinematics: [m] and [rad]."""
    forward(task.chain, q, desk.spare)
    out = rows[ROWS : ROWS + 6]
    deviation(desk.spare, question, out, rows[ROWS + 6 :])
    return box_errors(out, question)


@hidden
def reset_box(task: Task, desk: Desk) -> None:
    """Scale residuals so that metres and radians compare."""
    desk.mode[3] = DAMPING
    for l in range(LANES):
        desk.floor[l] = 1e-11
        desk.lanes.weight[l] = 1.0 / task.length
        desk.lanes.weight[LANES + l] = 1.0


@hidden
def descend_box(
    job: Job, task: Task, desk: Desk, question: Array, rows: Array, steps: int, everyone: bool, w: int
) -> tuple[int, int]:
    """Refine the eight lanes; the first lane that converged, or -1, and the steps made; as `refine.descend_lanes`."""
    lanes, dof = desk.lanes, len(task.lower)
    position, orientation = task.wanted[0] ** 2, task.wanted[1] ** 2
    for made in range(steps + 1):
        iterate_box(job.handle, job.wanted, job.memory, question, rows, made > 0, w)
        waiting, first = 0, -1
        for l in range(LANES):
            if desk.state[l] == 0 and lanes.error[l] <= position and lanes.error[LANES + l] <= orientation:
                desk.state[l] = 1
                for i in range(dof):
                    desk.found[l, i] = lanes.q[i, l]
            if desk.state[l] == 0:
                waiting += 1
            elif desk.state[l] == 1 and first < 0:
                first = l
                if waiting == 0 and not everyone:
                    return first, made
        if waiting == 0 or made == steps:
            return first, made
    return -1, steps  # Never: the last step returns.


@called
def keep_best_box(task: Task, desk: Desk, question: Array, rows: Array) -> None:
    """Remember the eight best configurations seen, no two alike; as `refine.keep_best`."""
    dof = len(task.lower)
    for l in range(LANES):
        if desk.state[l] == 2:
            continue
        for i in range(dof):
            desk.seed[i] = desk.lanes.q[i, l]
        place, turn = judge_pose(task, desk, question, rows, desk.seed)
        error = box_weighted(task.wanted[2], task.axis_weights[0], place, turn)
        keep_seed(desk, error)


@called
def fill_box(task: Task, desk: Desk, poses: Array, begin: int, first: int, most: int, used: Indices) -> int:
    """Put the samples nearest to poses from number `begin` on into the lanes from `first` on; return the next number.

    No sample of the `most` nearest is used twice: where the ranges are narrow, the next nearest stands in.
    """
    for l in range(first, LANES):
        desk.state[l] = 2
    for l in range(first, LANES):
        if begin >= len(poses):
            break
        found, taken = look_up(task, desk, poses[begin], most), -1
        for k in range(found):
            i, fresh = desk.neighbour[k], True
            for j in range(len(used)):
                fresh = fresh and used[j] != i
            if fresh and complete_seed(
                task.atlas, task.division, desk.seen, i, task.chain.lower, task.chain.upper, MARGIN, desk.seed
            ):
                taken = i
                load_seed(desk.lanes, l, desk.seed)
                desk.state[l] = 0
                break
        used[begin if most == MORE else len(poses) + begin] = taken
        begin += 1
    return begin


@called
def polish_box(job: Job, task: Task, desk: Desk, question: Array, rows: Array, w: int) -> int:
    """Minimise the weighted error itself from the eight best; FK evaluations spent; as `refine.polish`."""
    lanes, dof, floor, W = desk.lanes, len(task.lower), desk.floor, LANES
    weight_p, weight_o = task.wanted[2], task.axis_weights[0]
    desk.mode[3] = 0.0
    for l in range(LANES):
        floor[l] = 0.1 * (weight_p * task.length + weight_o)
        desk.state[l] = 0
        load_seed_row(lanes, l, desk.best)
        lanes.weight[W + l] = math.sqrt(weight_o)
    for step in range(POLISH_STEPS):
        iterate_box(job.handle, job.wanted, job.memory, question, rows, step > 0, w)
        for l in range(LANES):
            place, turn = math.sqrt(lanes.error[l]), math.sqrt(lanes.error[W + l])
            error = box_weighted(task.wanted[2], task.axis_weights[0], place, turn)
            far = math.sqrt(weight_p / max(place, 1e-9))
            scale = far / lanes.weight[l]
            lanes.weight[l] = far
            turned = 1.0
            if error <= desk.best_error[l]:
                if desk.state[l] == 0:
                    floor[l] = max(0.3 * floor[l], 1e-9)
                desk.state[l] = 0
                desk.best_error[l] = error
                for i in range(dof):
                    desk.best[l, i] = lanes.q[i, l]
            else:
                floor[l] *= 4.0
                desk.state[l] = 1
                load_seed_row(lanes, l, desk.best)
                scale, turned = 0.0, 0.0  # This lane stands still once, and steps anew from its best.
            for r in range(3):
                lanes.residual[r * W + l] *= scale
                lanes.residual[(3 + r) * W + l] *= turned
    return POLISH_STEPS * LANES


@called
def answer_box(
    job: Job,
    task: Task,
    desk: Desk,
    question: Array,
    rows: Array,
    poses: Array,
    used: Indices,
    near: Array,
    close: bool,
    q: Array,
    w: int,
) -> int:
    """Answer one question; write q, (n,), and return the FK evaluations spent; as `refine.solve_target`."""
    lanes = desk.lanes
    reset_box(task, desk)
    for l in range(LANES):
        desk.best_error[l] = np.inf
    for k in range(len(used)):
        used[k] = -1
    spent, rounds, begin, persisted, number, restarts, closest = 0, 0, 0, 0, 0, RESTARTS, np.inf
    # Each pass takes at least one of the poses, the first time or the second, or eight restarts, or persists; see
    # `refine.PASSES`.
    for _ in range(2 * len(poses) + MORE_RESTARTS // LANES + 3):
        if begin < len(poses):
            first = 1 if close and begin == 0 else 0
            begin = fill_box(task, desk, poses, begin, first, MORE if persisted == 0 else DEEP, used)
            if first == 1:
                load_near(task, desk, near)
                desk.state[0] = 0
            steps = DEEP_STEPS if persisted == 0 else PERSIST_STEPS
        elif persisted == 0 or (persisted == 1 and number >= restarts):
            persisted += 1
            if persisted == 2 and spent + POLISH_STEPS * LANES <= task.wanted[3]:
                spent += polish_box(job, task, desk, question, rows, w)
                reset_box(task, desk)
            if lowest(desk.best_error) > promise(task):
                continue
            if persisted == 1:
                restarts, begin = (
                    MORE_RESTARTS,
                    0,
                )  # The next nearest samples, and this time nobody is called back early.
            for l in range(LANES):
                desk.state[l] = 0 if desk.best_error[l] < np.inf else 2
                load_seed_row(lanes, l, desk.best)
            steps = PERSIST_STEPS
        elif number < restarts:
            for l in range(LANES):
                restart(task, number + l, desk.seed)
                if restarts == MORE_RESTARTS and number % (2 * LANES) == 0:
                    kick(task, desk.best, l, 0.5 if number % (4 * LANES) == 0 else 1.5, desk.seed)
                load_seed(lanes, l, desk.seed)
                desk.state[l] = 0
            number += LANES
            steps = RESTART_STEPS
        else:
            break
        if spent + (steps + 1) * LANES > task.wanted[3]:
            break
        lane, made = descend_box(job, task, desk, question, rows, steps, close, w)
        spent += (made + 1) * LANES
        rounds += 1
        if lane >= 0 and not close:
            copy_joints(desk.found, lane, q)
            return spent
        closest = keep_closest(task, desk, near, closest, q)
        if closest < np.inf and begin >= len(poses):
            return spent
        keep_best_box(task, desk, question, rows)
    if closest < np.inf:
        return spent
    if rounds == 0:
        middle(task, q)
        return spent
    copy_joints(desk.best, lowest_row(desk.best_error), q)
    return spent


@kernel
def solve_boxes(
    handle: Indices,
    wanted: Array,
    questions: Array,
    poses: Array,
    near: Array,
    close: bool,
    results: Array,
    begin: int,
    w: int,
) -> None:
    """Answer goals with ranges, one after the other.

    Args:
        handle: The task, see `task_of`.
        wanted: See `task_of`; the first of the K_A counts.
        questions: See `deviation.QUESTION`, (k, 37).
        poses: Where to look seeds up, (k, m, 3, 4), the first of each goal the most promising.
        near: Of each goal, joint values that continuous joints are turned towards, (k, n).
        close: Shall answers be the nearest to `near` of all that are found?
        results: Receives joint values, position error [m], orientation error [rad], weighted error and FK evaluations
            from row `begin` on, (…, n + 4).
        begin: Row of the first goal.
        w: LANES.
    """
    task = task_of(handle, wanted)
    dof, joints = len(task.lower), len(task.chain.leader)
    memory, rows = np.zeros(desk_size(dof, joints)), np.zeros(ROWS + 33)
    used = np.zeros(
        2 * poses.shape[1], dtype=np.int64
    )  # Samples that poses have taken, the first time and the second.
    desk, job = make_desk(memory, dof, joints), Job(handle, wanted, memory)
    address = results.ctypes.data
    for i in range(len(questions)):
        for k in range(len(memory)):
            memory[k] = (
                0.0  # Nothing of one goal is left for the next: the same bits whatever else is in the batch.
            )
        row, question = (begin + i) * (dof + 4), questions[i]
        q, report = part1(address, row, dof), part1(address, row + dof, 4)
        report[3] = answer_box(job, task, desk, question, rows, poses[i], used, near[i], close, q, w)
        into_limits(task, q, near[i])
        report[0], report[1] = judge_pose(task, desk, question, rows, q)
        report[2] = box_weighted(task.wanted[2], task.axis_weights[0], report[0], report[1])
    memory[0] = 0.0  # Its last use, see `refine.solve_pose`.
