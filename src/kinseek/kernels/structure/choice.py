"""Order the candidates of a closed form by their distance from the reference joint values."""

from __future__ import annotations

import math

import numpy as np

from kinseek.kernels.arrays import Array
from kinseek.kernels.atlas.descent import descend_lanes, goal_of, start
from kinseek.kernels.atlas.lanes import LANES, Lanes
from kinseek.kernels.atlas.memory import ACTIVE, EMPTY, Scratch
from kinseek.kernels.atlas.one_goal import CORRECTIONS, finish
from kinseek.kernels.atlas.seeds import copy_joints, load_seed, turns_fully
from kinseek.kernels.atlas.task import ORIENTATION_ERROR, POSITION_ERROR, Job, Task
from kinseek.kernels.jit import inlined

from . import candidates as form
from .swept_joint import taken_off

EDGE = 1e-7
"""Distance [rad] beyond a limit that counts as at the limit, so that rounding does not add a full turn."""


@inlined
def place(task: Task, near: Array, close: bool, work: Array, w: int) -> None:
    """Move the candidates into the limits by full turns, and compute their distances from the reference.

    Args:
        task: The task.
        near: Reference joint values, (n,). With `close` they are the current ones, otherwise the middle of the ranges.
            Distances from the middle are divided by half the range of each joint.
        close: See `near`.
        work: The candidates, see `candidates.WORK`.
        w: LANES.
    """
    s, dof = form.read_structure(task.structure), len(task.lower)
    off = form.ERROR_PER_DEVIATION * s.deviation
    turn, rate, beside = 2.0 * math.pi, 0.5 / math.pi, form.BESIDE + off
    for l in range(w):
        lost = work[form.DUPLICATE, l] > 0.0 or work[form.INFEASIBILITY, l] > form.INFEASIBLE + off
        work[form.COST, l] = np.inf if lost else 0.0
    # The swept joint is within its limits, and the same in all lanes.
    for row in range(dof - 1 if s.swept > 0.0 else dof):
        i = form.joint_of(task.structure, row, dof)
        low, high, centre = task.chain.lower[i], task.chain.upper[i], near[i]
        half = 0.5 * (high - low)
        scale = 1.0 if close else 1.0 / max(half, 1e-12)
        full = turn if turns_fully(task, i) else 0.0
        if math.isinf(task.lower[i]):
            low, high = centre - math.pi, centre + math.pi
        # If the range of a joint is less than a full turn, at most one copy fits, except at both limits of nearly a full
        # turn.
        room = np.inf if full > 0.0 else EDGE
        # No branches, and all reads from other arrays come before the loop: LLVM vectorizes it only then.
        for l in range(w):
            value, cost = work[row, l], work[form.COST, l]
            middlemost = value - turn * np.floor((value - low - half) * rate + 0.5)
            value -= turn * np.floor((value - centre) * rate + 0.5)
            value = value if max(low - value, value - high) <= room else middlemost
            within = min(max(value, low), high)
            value = within if abs(value - within) <= EDGE else value
            value += full * np.ceil(max(low - value, 0.0) * rate)
            value -= full * np.ceil(max(value - high, 0.0) * rate)
            gap = scale * (value - centre)
            cost += gap * gap
            work[row, l] = value
            work[form.COST, l] = cost if max(low - value, value - high) <= beside else np.inf


@inlined
def order_candidates(task: Task, scratch: Scratch, given: float, near: Array, close: bool, w: int) -> bool:
    """Write the candidates for `scratch.displacement` into the scratch memory, for `take_candidate`.

    Args:
        task: The task.
        scratch: See above.
        given: The value of the swept joint.
        near: See `place`.
        close: See `place`.
        w: LANES.

    Returns:
        True if the candidates include every solution. False if an angle is undetermined, if an equation has a double or
        nearly double root, or if the tolerances are loose.
    """
    S, work = task.structure, scratch.candidates
    far = form.INFEASIBLE + form.ERROR_PER_DEVIATION * form.read_structure(S).deviation
    taken_off(S, scratch.displacement, given, scratch.rest)
    form.candidates(S, scratch.rest, far, work, w)
    sure = max(task.position_tolerance, task.orientation_tolerance) <= form.LOOSE
    for l in range(LANES):
        sure = sure and work[form.CONDITIONING, l] >= form.FREE and work[form.DISCRIMINANT, l] >= form.CLEAR
        work[form.GIVEN, l] = given
    place(task, near, close, work, w)
    return sure


@inlined
def take_candidate(task: Task, scratch: Scratch, q: Array) -> int:
    """Write the nearest remaining candidate into q, (n,), and return its lane, or -1 if there is none."""
    work, best, dof = scratch.candidates, 0, len(q)
    for l in range(1, LANES):
        best = l if work[form.COST, l] < work[form.COST, best] else best
    if work[form.COST, best] == np.inf:
        return -1
    work[form.COST, best] = np.inf
    for i in range(dof):
        q[i] = work[form.row_of(task.structure, i, dof), best]
    return best


@inlined
def first_that_reaches(task: Task, scratch: Scratch, target: Array, near: Array, q: Array) -> int:
    """Write the nearest candidate that reaches the target, (3, 4), checked by forward kinematics, into q, (n,).

    Args:
        task: The task.
        scratch: The candidates, as `place` leaves them. `report` receives the report on the last candidate checked.
        target: (3, 4), lengths in [m].
        near: See `place`.
        q: Receives the last candidate checked.

    Returns:
        The number of candidates checked, negated if none reaches the target.
    """
    judged, report = 0, scratch.report
    for _ in range(LANES):
        if take_candidate(task, scratch, q) < 0:
            break
        finish(task, scratch, goal_of(task, target), near, q, report)
        judged += 1
        position, orientation = report[POSITION_ERROR], report[ORIENTATION_ERROR]
        if position <= task.position_tolerance and orientation <= task.orientation_tolerance:
            return judged
    return -judged


@inlined
def take_start(task: Task, scratch: Scratch, q: Array) -> bool:
    """Write the nearest remaining candidate into q, (n,), clamped to the limits; return False if there is none."""
    if take_candidate(task, scratch, q) < 0:
        return False
    for i in range(len(q)):
        q[i] = min(max(q[i], task.lower[i]), task.upper[i])
    return True


@inlined
def clear_lanes(lanes: Lanes) -> None:
    """Set all lanes to zero, without a step: the previous contents of the memory must not enter computations."""
    for i in range(lanes.q.shape[0]):
        for l in range(LANES):
            lanes.q[i, l] = lanes.step[i, l] = 0.0
    for l in range(LANES):
        lanes.share[l] = lanes.before[l] = lanes.stubborn[l] = 0.0


@inlined
def first_that_converges(job: Job, task: Task, scratch: Scratch, target: Array, q: Array) -> int:
    """Refine the candidates of a nearby arm in parallel lanes; write the nearest that converges into q, (n,).

    `batch.run_lanes` refines the same candidates one at a time.

    Args:
        job: The task by address.
        task: The task.
        scratch: The candidates, as `place` leaves them.
        target: (3, 4), lengths in [m].
        q: Receives the solution, or the last candidate if there is none.

    Returns:
        The FK evaluations spent, negated if no candidate converges; 0 if there is no candidate.
    """
    start(task, scratch, target)
    clear_lanes(scratch.lanes)
    spent = 0
    # The first nearly always converges. The others are loaded into their lanes only if it does not.
    for most in (1, LANES):
        loaded = 0
        for l in range(LANES):
            scratch.state[l] = EMPTY
            if loaded < most and take_start(task, scratch, q):
                load_seed(scratch.lanes, l, q)
                scratch.state[l], loaded = ACTIVE, loaded + 1
        if loaded == 0:
            break
        lane, made = descend_lanes(job, task, scratch, CORRECTIONS, False)
        spent += (made + 1) * loaded
        if lane >= 0:
            copy_joints(scratch.found, lane, q)
            return spent
    return -spent
