"""Which of some candidates comes first: the one nearest to where the answer is wanted."""

from __future__ import annotations

import math

import numpy as np

from kinseek.kernels.arrays import Array
from kinseek.kernels.atlas.descent import goal_of
from kinseek.kernels.atlas.lanes import LANES
from kinseek.kernels.atlas.memory import Desk
from kinseek.kernels.atlas.one_goal import finish
from kinseek.kernels.atlas.seeds import turns_fully
from kinseek.kernels.atlas.task import ORIENTATION_ERROR, POSITION_ERROR, Task
from kinseek.kernels.jit import hidden

from .candidates import (
    AGAIN,
    BESIDE,
    CLEAR,
    DEVIATION,
    FOLD,
    FREE,
    GIVEN,
    LACK,
    LACKING,
    LOOSE,
    MIDDLE,
    SPREAD,
    WEAK,
    candidates,
    displacement,
    row_of,
)
from .front import taken_off
from .subproblems import TINY, dot

COST = MIDDLE
"""Row of the squared distance of a candidate from where it is wanted, infinite if it is none; its first use is over by
then."""


EDGE = 1e-7
"""Beyond a limit by no more than that [rad] is at it: rounding shall not turn a joint once round."""


CORRECTIONS, SHRINKS = 5, 0.5
"""Corrections of a candidate at most, and the part of what it is off that one of them may leave."""


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
        row = row_of(task.structure, i, dof)
        if row == GIVEN:  # It is inside its limits, and the same in all lanes.
            continue
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
def order_candidates(task: Task, desk: Desk, given: float, near: Array, close: bool, w: int) -> bool:
    """Write the candidates for what all joints make, in `desk.between`, into the desk, for `take_candidate`.

    Args:
        task: The task.
        desk: See above; receives what the joints behind one in front make in `spare`.
        given: The value of that joint.
        near: See `place`.
        close: See `place`.
        w: LANES.

    Returns:
        Do they tell of every answer? Not where an angle is left to choose, or an equation has one answer only or nearly
        one; nor under loose tolerances.
    """
    # Memory of a look-up, which comes later if at all.
    S, work = task.structure, desk.distance
    taken_off(S, desk.between, given, desk.spare)
    candidates(S, desk.spare, LACKING + SPREAD * S[DEVIATION], work, w)
    sure = max(task.position_tolerance, task.orientation_tolerance) <= LOOSE
    for l in range(LANES):
        sure = sure and work[WEAK * LANES + l] >= FREE and work[FOLD * LANES + l] >= CLEAR
        work[GIVEN * LANES + l] = given
    place(task, near, close, work, w)
    return sure


@hidden
def take_candidate(task: Task, desk: Desk, q: Array) -> int:
    """Write the nearest candidate that is left into q, (n,), and return its lane; -1 where there is none."""
    work, best, dof = desk.distance, 0, len(q)
    for l in range(1, LANES):
        best = l if work[COST * LANES + l] < work[COST * LANES + best] else best
    if work[COST * LANES + best] == np.inf:
        return -1
    work[COST * LANES + best] = np.inf
    for i in range(dof):
        q[i] = work[row_of(task.structure, i, dof) * LANES + best]
    return best


@hidden
def first_that_reaches(
    task: Task, desk: Desk, target: Array, near: Array, given: float, q: Array, w: int
) -> int:
    """Write the nearest candidate that reaches the target, (3, 4), by plain forward kinematics, into q, (n,).

    Of an arm that nearly has its structure the nearby arm is asked for another pose, as far off as it missed this one, until
    its answer is one of the arm itself.

    Args:
        task: The task.
        desk: The candidates, as `place` leaves them.
        target: (3, 4), lengths in [m].
        near: See `place`.
        given: The value of a joint in front.
        q: Receives the last candidate that was looked at.
        w: LANES.

    Returns:
        How many were judged, a corrected one as often as that; as many less than 0 if none reaches the target.
    """
    judged = 0
    for _ in range(LANES):
        lane = take_candidate(task, desk, q)
        if lane < 0:
            break
        off = judge(task, desk, target, near, q)
        judged += 1
        if off == 0.0:
            return judged
        if task.exact == 1:
            continue
        for r in range(3):
            for c in range(4):
                desk.seen[r, c] = target[r, c]
        for _ in range(CORRECTIONS):
            correct(task, desk, target, given, lane, near, q, w)
            before = off
            off = judge(task, desk, target, near, q)
            judged += 1
            if off == 0.0:
                return judged
            if off > SHRINKS * before:
                break
    return -judged


@hidden
def judge(task: Task, desk: Desk, target: Array, near: Array, q: Array) -> float:
    """Bring q, (n,), inside the limits; return how far it is from the target, (3, 4), 0 within the tolerances."""
    report = desk.bound  # Memory of a look-up; `batch.run_closed` reads it too.
    finish(task, desk, goal_of(task, target), near, q, report)
    position, orientation = report[POSITION_ERROR], report[ORIENTATION_ERROR]
    if position <= task.position_tolerance and orientation <= task.orientation_tolerance:
        return 0.0
    off: float = max(position / task.length, orientation, TINY)
    return off


@hidden
def correct(
    task: Task, desk: Desk, target: Array, given: float, lane: int, near: Array, q: Array, w: int
) -> None:
    """Ask the nearby arm for the pose in `desk.seen`, moved by as much as q, (n,), is off the target.

    Args:
        task: The task.
        desk: The pose of q stands in `spare`; what is asked for is kept in `seen`.
        target: (3, 4), lengths in [m].
        given: The value of a joint in front.
        lane: Whose answer is taken.
        near: See `place`.
        q: Receives the answer.
        w: LANES.
    """
    P, X, S, work, dof, turn = desk.spare, desk.seen, task.structure, desk.lanes.gram, len(q), 2.0 * math.pi
    for c in range(4):
        x, y, z = X[0, c], X[1, c], X[2, c]
        if c == 3:
            x, y, z = x - P[0, 3], y - P[1, 3], z - P[2, 3]
        a, b, d = (
            dot(P[0, 0], P[1, 0], P[2, 0], x, y, z),
            dot(P[0, 1], P[1, 1], P[2, 1], x, y, z),
            dot(P[0, 2], P[1, 2], P[2, 2], x, y, z),
        )
        for r in range(3):
            X[r, c] = dot(target[r, 0], target[r, 1], target[r, 2], a, b, d) + (
                target[r, 3] if c == 3 else 0.0
            )
    displacement(S, X, desk.spare)
    taken_off(S, desk.spare, given, desk.spare)
    candidates(S, desk.spare, LACKING + SPREAD * S[DEVIATION], work, w)
    for i in range(dof):
        row = row_of(S, i, dof)
        if row != GIVEN:
            gap = work[row * LANES + lane] - q[i]
            q[i] += gap - turn * np.rint(gap / turn)
