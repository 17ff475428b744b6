"""One answer of an arm with a closed form: of its candidates the one nearest to where it is wanted."""

from __future__ import annotations

import math

import numpy as np

from kinseek.kernels.arrays import Array
from kinseek.kernels.atlas.descent import FIRST_STEPS, descend_lanes, goal_of, start
from kinseek.kernels.atlas.lanes import LANES
from kinseek.kernels.atlas.memory import Desk, desk_size, make_desk
from kinseek.kernels.atlas.one_goal import MIDMOST, NEAREST, SEED, finish
from kinseek.kernels.atlas.seeds import copy_joints, load_seed, middle, turns_fully
from kinseek.kernels.atlas.task import (
    ORIENTATION_ERROR,
    POSITION_ERROR,
    WANTED,
    Job,
    Task,
    handle_at,
    task_of,
)
from kinseek.kernels.jit import hidden, routine
from kinseek.kernels.pointers import part1, part2

from .candidates import (
    AGAIN,
    BACKWARD,
    BESIDE,
    CLEAR,
    DEVIATION,
    FOLD,
    FREE,
    KIND,
    LACK,
    LACKING,
    LOOSE,
    MIDDLE,
    NONE,
    SPREAD,
    WEAK,
    candidates,
    displacement,
    set_signs,
)

COST = MIDDLE
"""Row of the squared distance of a candidate from where it is wanted, infinite if it is none; its first use is over by
then."""


EDGE = 1e-7
"""Beyond a limit by no more than that [rad] is at it: rounding shall not turn a joint once round."""


@hidden
def place(task: Task, near: Array, close: bool, work: Array, w: int) -> None:
    """Bring the candidates into the limits by full turns, and measure how far each is from where it is wanted.

    Args:
        task: The task.
        near: Where the answer is wanted, (n,): with `close` where the arm is, else the middle of the ranges, from which
            each joint is measured in half its range.
        close: See `near`.
        work: The candidates, see `candidates.LACK`, (WORK,).
        w: LANES.
    """
    W, dof, off = LANES, len(task.lower), SPREAD * task.structure[DEVIATION]
    turn, rate = 2.0 * math.pi, 0.5 / math.pi
    for l in range(w):
        lost = work[AGAIN * W + l] > 0.0 or work[LACK * W + l] > LACKING + off
        work[COST * W + l] = np.inf if lost else 0.0
    for i in range(dof):
        row = dof - 1 - i if task.structure[BACKWARD] > 0.0 else i
        low, high, centre = task.chain.lower[i], task.chain.upper[i], near[i]
        half = 0.5 * (high - low)
        scale = 1.0 if close else 1.0 / max(half, 1e-12)
        full = 1.0 if turns_fully(task, i) else 0.0
        if math.isinf(task.lower[i]):
            low, high = centre - math.pi, centre + math.pi
        for l in range(w):
            value = work[row * W + l]
            middlemost = value - turn * np.floor((value - low - half) * rate + 0.5)
            value -= turn * np.floor((value - centre) * rate + 0.5)
            # Of an angle whose range holds no full turn at most one copy fits, but at both limits of nearly a full turn.
            fits = full > 0.0 or low - EDGE <= value <= high + EDGE
            value = value if fits else middlemost
            value = low if low - EDGE <= value < low else high if high < value <= high + EDGE else value
            value += full * turn * np.ceil(max(low - value, 0.0) * rate)
            value -= full * turn * np.ceil(max(value - high, 0.0) * rate)
            gap = scale * (value - near[i])
            beside = max(low - value, value - high) <= BESIDE + off
            work[row * W + l] = value
            work[COST * W + l] = work[COST * W + l] + gap * gap if beside else np.inf


@hidden
def order_candidates(task: Task, desk: Desk, target: Array, near: Array, close: bool, w: int) -> bool:
    """Write the candidates for a target, (3, 4), into the desk, for `take_candidate`; see `place`.

    Returns:
        Do they tell of every answer? Not where an angle is left to choose, or an equation has one answer only or nearly
        one; nor under loose tolerances.
    """
    # Memory of a look-up, which comes later if at all.
    work, off = desk.distance, SPREAD * task.structure[DEVIATION]
    set_signs(work)
    displacement(task.structure, target, desk.spare)
    candidates(task.structure, desk.spare, LACKING + off, work, w)
    sure = max(task.position_tolerance, task.orientation_tolerance) <= LOOSE
    for l in range(LANES):
        sure = sure and work[WEAK * LANES + l] >= FREE and work[FOLD * LANES + l] >= CLEAR
    place(task, near, close, work, w)
    return sure


@hidden
def take_candidate(task: Task, desk: Desk, q: Array) -> bool:
    """Write the nearest candidate that is left into q, (n,); say whether there was one."""
    work, best, dof = desk.distance, 0, len(q)
    for l in range(1, LANES):
        best = l if work[COST * LANES + l] < work[COST * LANES + best] else best
    if work[COST * LANES + best] == np.inf:
        return False
    work[COST * LANES + best] = np.inf
    for i in range(dof):
        row = dof - 1 - i if task.structure[BACKWARD] > 0.0 else i
        q[i] = work[row * LANES + best]
    return True


@hidden
def reaches(task: Task, desk: Desk, target: Array, near: Array, q: Array) -> bool:
    """Bring q, (n,), inside the limits; does it reach the target, (3, 4), by plain forward kinematics?"""
    report = desk.bound  # Memory of a look-up; `batch.run_closed` reads it too.
    finish(task, desk, goal_of(task, target), near, q, report)
    position, orientation = report[POSITION_ERROR], report[ORIENTATION_ERROR]
    reached: bool = position <= task.position_tolerance and orientation <= task.orientation_tolerance
    return reached


@hidden
def limit(task: Task, q: Array) -> None:
    """Bring a start, (n,), inside the limits of the refinement."""
    for i in range(len(q)):
        q[i] = min(max(q[i], task.lower[i]), task.upper[i])


@hidden
def as_start(task: Task, desk: Desk, number: int, q: Array) -> int:
    """Write candidate `number` into q, (n,), inside the limits of the refinement; 0 where there are no more."""
    for _ in range(number + 1):
        if not take_candidate(task, desk, q):
            return 0
    limit(task, q)
    return 1


@hidden
def refined(job: Job, task: Task, desk: Desk, target: Array, q: Array, w: int) -> int:
    """Refine all candidates side by side; see `closed_routine`."""
    start(task, desk, target)
    many = 0
    for l in range(LANES):
        desk.state[l] = 2
        if take_candidate(task, desk, q):
            limit(task, q)
            load_seed(desk.lanes, l, q)
            desk.state[l], many = 0, many + 1
    if many == 0:
        return 0
    lane, made = descend_lanes(job, task, desk, FIRST_STEPS, False, w)
    spent = (made + 1) * LANES
    if lane < 0:
        return -spent
    copy_joints(desk.found, lane, q)
    return spent


@routine("int64(int64, int64, int64, int64, int64, int64, int64, int64)")
def closed_routine(
    handle_address: int,
    wanted_address: int,
    memory_address: int,
    target_address: int,
    near_address: int,
    asked: int,
    q_address: int,
    w: int,
) -> int:
    """Answer one target, (3, 4), by the candidate that comes first of those that reach it; write q, (n,).

    Where the arm has its structure only nearly, the candidates are refined side by side, and the nearest is not told.

    Args:
        handle_address: As `one_goal.search_routine`.
        wanted_address: As there.
        memory_address: As there; the desk is as a look-up leaves it.
        target_address: As there.
        near_address: Where the arm is, (n,), if the nearest answer is asked for.
        asked: MIDMOST: the answer nearest to the middle of the ranges comes first; NEAREST: that nearest to `near`; SEED
            and more: so many candidates are passed over, and the next is written as it is, inside the limits.
        q_address: Receives joint values, (n,).
        w: LANES.

    Returns:
        FK evaluations spent. Where no candidate reaches the target, or another answer may be nearer, as many less than 0; q
        is then the last that was looked at. 0 where there is no candidate. Of a start 1 where there is one.
    """
    handle, wanted = handle_at(handle_address), part1(wanted_address, 0, WANTED)
    task = task_of(handle, wanted)
    dof, joints = len(task.lower), len(task.chain.leader)
    memory = part1(memory_address, 0, desk_size(dof, joints))
    target, q, near = part2(target_address, 0, 3, 4), part1(q_address, 0, dof), part1(near_address, 0, dof)
    # Of a nearby arm the closed form may lack an answer at a limit, and with it the nearest.
    if task.structure[KIND] == NONE or (asked == NEAREST and task.exact == 0):
        return 0
    desk = make_desk(memory, dof, joints)
    if asked != NEAREST:
        middle(task, desk.best[0])
        near = desk.best[0]
    sure = order_candidates(task, desk, target, near, asked == NEAREST, w)
    if asked >= SEED:
        return as_start(task, desk, asked - SEED, q)
    if task.exact == 0:
        return refined(Job(handle, wanted, memory), task, desk, target, q, w)
    for tried in range(1, LANES + 1):
        if not take_candidate(task, desk, q):
            return 1 - tried
        if reaches(task, desk, target, near, q):
            # One that was refused may have an answer beside it.
            return tried if asked == MIDMOST or (sure and tried == 1) else -tried
    return -LANES
