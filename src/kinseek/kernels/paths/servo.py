"""Steps of a tracker: as near to the pose as limits and speeds allow within one period, with bounded work each."""

from __future__ import annotations

import numpy as np

from kinseek.kernels.arm.forward import forward
from kinseek.kernels.arm.pose_error import distance, errors, is_rigid
from kinseek.kernels.arrays import Array, GoalArrays
from kinseek.kernels.atlas.descent import goal_of, reset_weights, within
from kinseek.kernels.atlas.lanes import LANES
from kinseek.kernels.atlas.memory import Scratch, make_scratch, scratch_size
from kinseek.kernels.atlas.newton import settle as descend
from kinseek.kernels.atlas.task import TOLERANCES, Task, handle_at, lanes_of, task_of
from kinseek.kernels.entry import F64, I64
from kinseek.kernels.jit import entry, inlined, noinline

from .projection import load_lane, settle

STEPS = 6
"""Damped steps within a period at most: a bound on the work, not on what is usual, which is one or two."""

STARTS = 3
"""Lanes that start: where the arm is, where its last step would lead it again, and half-way between."""

ROWS = 8
LOWER, UPPER, REACH, NOW, LAST, LOW, HIGH, REACHED = range(ROWS)
"""Rows of the state of a tracker, (ROWS, n): limits, how far each joint may go within a period, where it is, its last step,
between which values it may end now, and where it was when it last reached its pose."""

TRACKING, LAGGING, LIMIT, SINGULAR, NO_POSE = range(5)
"""How a step ended; NO_POSE: the target is no rigid transform, and nothing has changed."""

NEAREST_STEPS = 40
"""Newton steps within a period at most towards the nearest pose: a bound on the work. Not examined further."""

NEAR = 1e-3
"""Closer than this the position error counts squared [m], farther off linearly (Huber 1964). Not examined further."""

INSIDE = 1e-12
"""Part of a joint's way within a period that is left unused, so that rounding never makes it too fast."""


@inlined
def go_nearer(task: Task, scratch: Scratch, target: Array, state: Array) -> None:
    """Walk down the weighted error from where the arm is, within what the joints may do in this period, into `scratch.seed`.

    The weighted error ``K_P d + Σ K_c (1 - c·c_g)`` has a kink at d = 0, along which steps are tiny. Its majorant
    ``K_P d² / 2 d_0 + Σ K_c (1 - c·c_g)`` touches it at the present distance d_0 and is smooth (iteratively reweighted least
    squares, Weiszfeld 1937). As the majorant falls the error, squared closer than `NEAR`, falls at least as much. So a
    target at rest never makes the arm go back and forth: it comes to rest where the error is least. Gauss-Newton steps
    overshoot there in every period, since the Jacobian is singular at the end of the reach.
    """
    for d in range(len(task.lower)):
        scratch.seed[d] = min(max(state[NOW, d], state[LOW, d]), state[HIGH, d])
    forward(task.chain, scratch.seed, scratch.spare)
    weight = task.position_weight / max(distance(scratch.spare, target), NEAR)
    squares = GoalArrays(target, weight, task.axis_weights)
    descend(task.chain, squares, True, NEAREST_STEPS, 0.0, state[LOW], state[HIGH], scratch.seed)


@noinline
def one_period(
    address: int, tolerances: Array, target: Array, memory: Array, state: Array
) -> tuple[float, float, int]:
    """What `servo_step` does."""
    if not is_rigid(target):
        return np.inf, np.inf, NO_POSE
    handle = handle_at(address)
    task = task_of(handle, tolerances)
    dof, joints, w = len(task.lower), len(task.chain.leader), lanes_of(handle)
    for k in range(scratch_size(dof, joints)):
        memory[k] = 0.0  # The same bits whatever came before.
    scratch = make_scratch(memory, dof, joints)
    reset_weights(task, scratch)
    for d in range(dof):
        here, reach = state[NOW, d], state[REACH, d] * (1.0 - INSIDE)
        # From outside its limits a joint comes back, as fast as it may.
        lower, upper = state[LOWER, d], state[UPPER, d]
        state[LOW, d] = max(here - reach, lower) if here >= lower else min(here + reach, lower)
        state[HIGH, d] = min(here + reach, upper) if here <= upper else max(here - reach, upper)
    for l in range(LANES):
        share = min(l, STARTS - 1) / (STARTS - 1.0)
        load_lane(scratch, l, target, state[NOW])
        scratch.state[l] = 0 if l < STARTS else 2
        for d in range(dof):
            value = state[NOW, d] + share * state[LAST, d]
            scratch.lanes.q[d, l] = min(max(value, state[LOW, d]), state[HIGH, d])
    settle(handle, tolerances, memory, state[LOW], state[HIGH], STEPS, w)
    best = 0
    for l in range(1, STARTS):
        reached = within(task, scratch.lanes, l) and not within(task, scratch.lanes, best)
        if reached or (
            not within(task, scratch.lanes, best)
            and scratch.lanes.error[3 * LANES + l] < scratch.lanes.error[3 * LANES + best]
        ):
            best = l
    if within(task, scratch.lanes, best):
        for d in range(dof):
            scratch.seed[d] = scratch.lanes.q[d, best]
    else:
        go_nearer(task, scratch, target, state)
    fast, stopped = False, False
    for d in range(dof):
        value = scratch.seed[d]
        at_end = value <= state[LOW, d] or value >= state[HIGH, d]
        at_limit = at_end and (value <= state[LOWER, d] or value >= state[UPPER, d])
        fast = fast or (at_end and not at_limit)
        stopped = stopped or at_limit
        state[LAST, d] = value - state[NOW, d]
        state[NOW, d] = value
    forward(task.chain, state[NOW], scratch.spare)
    position, orientation = errors(scratch.spare, goal_of(task, target))
    ended = SINGULAR
    if position <= task.position_tolerance and orientation <= task.orientation_tolerance:
        ended = TRACKING
        for d in range(dof):
            state[REACHED, d] = state[NOW, d]
    elif fast:
        ended = LAGGING
    elif stopped:
        ended = LIMIT
    memory[0] = 0.0  # Its last use, see `one_goal.solve_pose`.
    return position, orientation, ended


@entry(
    returns=(F64, F64, I64),
    address=I64,
    tolerances=F64[TOLERANCES],
    target=F64[4, 4],
    memory=F64["*"],
    state=F64[ROWS, "n"].out,
)
def servo_step(
    address: int, tolerances: Array, target: Array, memory: Array, state: Array
) -> tuple[float, float, int]:
    """Go as near to a pose as one period allows; the row NOW of the state becomes where the joints are then.

    A joint that stands at an end of what it may do, and is pushed outward, is taken out, and the others go on without it.
    If the pose is not reached within the period, the weighted error is walked down, see `go_nearer`.

    Args:
        address: Address of the handle of the task, see `task_of`.
        tolerances: See `task_of`.
        target: (4, 4), lengths in [m].
        memory: At least `scratch_size` numbers.
        state: See `LOWER`, (ROWS, n).

    Returns:
        Position error [m], orientation error [rad], and how the step ended, see `TRACKING`.
    """
    return one_period(address, tolerances, target, memory, state)


@entry(
    returns=(I64, I64, I64),
    address=I64,
    tolerances=F64[TOLERANCES],
    targets=F64["k", 4, 4],
    place=F64,
    turn=F64,
    memory=F64["*"],
    state=F64[ROWS, "n"].out,
)
def look_ahead(
    address: int, tolerances: Array, targets: Array, place: float, turn: float, memory: Array, state: Array
) -> tuple[int, int, int]:
    """Make one step after another, until the hand is farther off than it may be.

    Args:
        address: See `servo_step`.
        tolerances: See `servo_step`.
        targets: One pose a step, (k, 4, 4).
        place: How far off the hand may be [m].
        turn: How far turned off [rad].
        memory: See `servo_step`.
        state: See `servo_step`; it stays where the last step ended.

    Returns:
        At which step it fell behind, at which it was too far off, k for both if it never was, and how that step ended.
    """
    behind, count = -1, len(targets)
    for k in range(count):
        position, orientation, ended = one_period(address, tolerances, targets[k], memory, state)
        if ended == TRACKING:
            behind = -1
            continue
        if behind < 0:
            behind = k
        if not (position <= place and orientation <= turn):
            return behind, k, ended
    return count, count, TRACKING
