"""The answer nearest to where the arm is: a walk from there, then whatever else the atlas leads to."""

from __future__ import annotations

import math

import numpy as np

from .arrays import Array, GoalArrays, Indices
from .atlas import nearest_copy
from .desk import Job, Task, desk_size, make_desk, task_of
from .jit import hidden, kernel
from .lanes import LANES
from .pointers import part1
from .refine import (
    DEEP_STEPS,
    MORE,
    copy_joints,
    descend_lanes,
    fill_from_lookup,
    finish,
    load_seed,
    look_up,
    solve_pose,
    start,
    turns_fully,
)

CLOSE = 0.1
"""An answer this close to where the user wants it [rad or m] ends the search for a closer one."""


@hidden
def joint_distance(task: Task, q: Array, near: Array) -> float:
    """Squared distance of two joint vectors, a continuous joint measured the short way round."""
    total = 0.0
    for i in range(len(q)):
        gap = q[i] - near[i]
        if math.isinf(task.lower[i]):
            gap -= 2.0 * math.pi * np.round(gap / (2.0 * math.pi))
        elif turns_fully(task, i):
            gap = nearest_copy(q[i], task.chain.lower[i], task.chain.upper[i], near[i]) - near[i]
        total += gap * gap
    return total


@kernel
def solve_near(handle: Indices, wanted: Array, target: Array, near: Array, w: int) -> Array:
    """Answer one target by what is nearest to `near`, (n,), among all that is found; else as `solve_pose`.

    First a walk from `near` itself: if it ends close by, there is no lookup at all.
    """
    task = task_of(handle, wanted)
    dof, joints = len(task.lower), len(task.chain.leader)
    result, memory = np.empty(dof + 4), np.zeros(desk_size(dof, joints))
    desk, job = make_desk(memory, dof, joints), Job(handle, wanted, memory)
    address = result.ctypes.data
    q, report = part1(address, 0, dof), part1(address, dof, 4)
    start(task, desk, target)
    for i in range(dof):
        low, high = task.chain.lower[i], task.chain.upper[i]
        desk.seed[i] = near[i] if turns_fully(task, i) else min(max(near[i], low), high)
    load_seed(desk.lanes, 0, desk.seed)
    for l in range(LANES):
        desk.state[l] = 0 if l == 0 else 2
    closest, spent, begin, found, looked_up = np.inf, 0, 0, 0, False
    while True:
        if spent + (DEEP_STEPS + 1) * LANES > wanted[3]:
            break
        _, made = descend_lanes(job, task, desk, DEEP_STEPS, True, w)
        spent += (made + 1) * LANES
        for l in range(LANES):
            if desk.state[l] == 1:
                copy_joints(desk.found, l, desk.seed)
                far = joint_distance(task, desk.seed, near)
                if far < closest:
                    closest = far
                    copy_joints(desk.found, l, q)
        if not looked_up:
            if closest < CLOSE * CLOSE:
                break
            looked_up = True
            found = look_up(task, desk, target, MORE)
        if begin == found:
            break
        begin, _ = fill_from_lookup(task, desk, begin, found)
    if closest == np.inf:
        rest = wanted.copy()
        rest[3] = max(wanted[3] - spent, 0.0)
        other = solve_pose(handle, rest, target, w)
        for i in range(dof):
            q[i] = other[i]
        spent += int(other[dof + 3])
    report[3] = spent
    finish(task, desk, GoalArrays(target, task.wanted[2], task.axis_weights), near, q, report)
    memory[0] = 0.0  # Its last use, see `solve_pose`.
    return result


@kernel
def solve_many_near(
    handle: Indices, wanted: Array, targets: Array, near: Array, results: Array, begin: int, end: int, w: int
) -> None:
    """`solve_near` for targets begin … end-1, each with its row of near, (k, n)."""
    for i in range(begin, end):
        results[i] = solve_near(handle, wanted, targets[i], near[i], w)
