"""The solution nearest to given joint values: a walk from there, then the other starts of the atlas."""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np

from kinseek.kernels.arm.pose_error import LARGEST, is_rigid
from kinseek.kernels.arrays import Array
from kinseek.kernels.entry import OUT
from kinseek.kernels.jit import entry, exact, inlined, noinline

from .descent import DEEP_STEPS, descend_lanes, keep_closest, start
from .far import is_far
from .lanes import LANES
from .memory import ACTIVE, EMPTY, Scratch, scratch_of, scratch_size
from .one_goal import NEAREST, closed_answer, outcome, solve_target
from .seeds import MORE, fill_from_lookup, load_seed, look_up, turns_fully
from .task import TOLERANCES, Job, Target, Task, handle_at, lanes_of, task_at, task_of

FAR = 1e4
"""Angle [rad] beyond which a walk starts from the same angle within the first turn, because sines lose digits there."""

CLOSE = 0.2
"""A solution this close to the reference [rad or m] ends the search for a closer one."""


@inlined
def load_near(task: Task, scratch: Scratch, near: Array) -> None:
    """Load joint values, (n,), into the first lane, clamped to the limits where these apply."""
    for i in range(len(near)):
        low, high = task.chain.lower[i], task.chain.upper[i]
        if not turns_fully(task, i):
            scratch.seed[i] = min(max(near[i], low), high)
        elif abs(near[i]) < FAR:
            scratch.seed[i] = near[i]
        else:
            scratch.seed[i] = near[i] - 2.0 * math.pi * np.rint(near[i] / (2.0 * math.pi))
    load_seed(scratch.lanes, 0, scratch.seed)


@noinline
def walk_near(job: Job, target: Array, near: Array, q: Array) -> int:
    """Find the solution nearest to `near`, (n,), among all that are found; write q, (n,).

    If none is found, the result is that of `solve_target`. A walk from `near` comes first; if it ends close by, there is
    no look-up.

    Returns:
        FK evaluations spent.
    """
    task = task_at(job)
    scratch = scratch_of(job, task)
    if is_far(job, target):
        return solve_target(job, target, task.budget, q)
    tried = closed_answer(job, target, task.budget, near, NEAREST, q)
    if tried > 0:
        return tried
    start(task, scratch, target)
    load_near(task, scratch, near)
    for l in range(LANES):
        scratch.state[l] = ACTIVE if l == 0 else EMPTY
    if tried < 0:
        # The nearest closed-form solution is one more start.
        load_seed(scratch.lanes, 1, q)
        scratch.state[1] = ACTIVE
    closest, spent, begin, found, looked_up = np.inf, -tried, 0, 0, False
    for _ in range(MORE + 2):  # The walk from `near`, then passes that each use at least one sample.
        if spent + (DEEP_STEPS + 1) * LANES > task.budget:
            break
        _, made = descend_lanes(job, task, scratch, DEEP_STEPS, True)
        spent += (made + 1) * LANES
        closest = keep_closest(task, scratch, near, closest, q)
        if not looked_up:
            if closest < CLOSE * CLOSE:
                break
            looked_up = True
            found = look_up(task, scratch, target, MORE)
        if begin == found:
            break
        begin, _ = fill_from_lookup(task, scratch, begin, found)
    if closest == np.inf:
        spent += solve_target(job, target, task.budget - spent, q)
    return spent


@exact
def all_finite(values: Array) -> bool:
    """Return True if all values are finite and none is beyond `LARGEST`."""
    strange = 0
    for i in range(len(values)):
        strange += 0 if abs(values[i]) <= LARGEST else 1
    return strange == 0


@entry
def solve_goal(
    address: int,
    tolerances: Annotated[Array, TOLERANCES],
    target: Target,
    near: Annotated[Array, "n"],
    close: bool,
    q: Annotated[Array, "n", OUT],
) -> tuple[float, float, float, int, bool]:
    """Do the same as `one_goal.solve_plain` for any goal without ranges, with `close` near a reference.

    Args:
        address: As there; the task's kind is that of the goal.
        tolerances: See `task.Tolerances`.
        target: A rigid transform, (3, 4), or a matrix that has to be checked, (4, 4), lengths in [m].
        near: Reference joint values, (n,); read only with `close`.
        close: See `near`.
        q: As there.

    Returns:
        As there; evaluations are -1 also if the reference is not finite.
    """
    if not ((len(target) == 3 or is_rigid(target)) and (not close or all_finite(near))):
        return 0.0, 0.0, 0.0, -1, False
    handle = handle_at(address)
    task = task_of(handle, tolerances)
    memory = np.zeros(scratch_size(len(task.lower), len(task.chain.leader)))
    job = Job(handle, tolerances, memory, lanes_of(handle))
    spent = walk_near(job, target, near, q) if close else solve_target(job, target, task.budget, q)
    status = outcome(job, target, near, close, spent, q)
    memory[0] = 0.0  # Its last use, see `one_goal.solve_pose`.
    return status
