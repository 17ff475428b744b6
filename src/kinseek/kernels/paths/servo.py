"""Tracking steps: as near to the pose as limits and speeds allow within one period, with bounded work."""

from __future__ import annotations

from typing import Annotated

import numpy as np

from kinseek.kernels.arm.forward import forward
from kinseek.kernels.arm.pose_error import distance, errors, is_rigid
from kinseek.kernels.arrays import Array, GoalArrays, Limits
from kinseek.kernels.atlas.descent import goal_of, reset_weights, within
from kinseek.kernels.atlas.lanes import LANES, RESIDUAL2
from kinseek.kernels.atlas.memory import Scratch, make_scratch, scratch_size
from kinseek.kernels.atlas.newton import Walk, minimise
from kinseek.kernels.atlas.task import TOLERANCES, Task, handle_at, lanes_of, task_of
from kinseek.kernels.entry import OUT
from kinseek.kernels.jit import entry, inlined, noinline

from .projection import load_lane, settle

STEPS = 6
"""Largest number of damped steps within a period: a bound on the work; one or two are usual."""

STARTS = 3
"""Number of lanes that start: at the current joint values, at these plus the last step, and half-way between."""

ROWS = 8
LOWER, UPPER, REACH, NOW, LAST, LOW, HIGH, REACHED = range(ROWS)
"""Rows of the state of a tracker, (ROWS, n): the limits; the largest motion of each joint within a period; the current
joint values; the last step; the interval of joint values that can be reached in this period; and the joint values at
which it last reached its pose."""

TRACKING, LAGGING, LIMIT, SINGULAR, NO_POSE = range(5)
"""Outcome of a step. NO_POSE: the target is not a rigid transform, and nothing has changed."""

NEAREST_STEPS = 40
"""Largest number of Newton steps within a period towards the nearest pose: a bound on the work. Not examined further."""

NEAR = 1e-3
"""Position error [m] below which it counts squared, and above which it counts linearly (Huber 1964). Not examined
further."""

INSIDE = 1e-12
"""Fraction of a joint's largest motion that stays unused, so that rounding never makes it too fast."""


@inlined
def go_nearer(task: Task, scratch: Scratch, target: Array, state: Array) -> None:
    """Reduce the weighted error from the current joint values, within what this period allows; write `scratch.seed`.

    The weighted error ``K_P d + Σ K_c (1 - c·c_g)`` has a kink at d = 0, along which steps are tiny. Its majorant
    ``K_P d² / 2 d_0 + Σ K_c (1 - c·c_g)`` equals it at the present distance d_0 and is smooth (iteratively reweighted
    least squares, Weiszfeld 1937). When the majorant decreases, the error, squared below `NEAR`, decreases at least as
    much. A target at rest therefore never makes the arm oscillate: the arm stops where the error is smallest.
    Gauss-Newton steps overshoot there in every period, since the Jacobian is singular at the boundary of the workspace.
    """
    for d in range(len(task.lower)):
        scratch.seed[d] = min(max(state[NOW, d], state[LOW, d]), state[HIGH, d])
    forward(task.chain, scratch.seed, scratch.spare)
    weight = task.position_weight / max(distance(scratch.spare, target), NEAR)
    squares = GoalArrays(target, weight, task.axis_weights)
    minimise(
        task.chain, squares, Limits(state[LOW], state[HIGH]), Walk(True, NEAREST_STEPS, 0.0), scratch.seed
    )


@noinline
def one_period(
    address: int, tolerances: Array, target: Array, memory: Array, state: Array
) -> tuple[float, float, int]:
    """Do the work of `servo_step`."""
    if not is_rigid(target):
        return np.inf, np.inf, NO_POSE
    handle = handle_at(address)
    task = task_of(handle, tolerances)
    dof, joints, w = len(task.lower), len(task.chain.leader), lanes_of(handle)
    for k in range(scratch_size(dof, joints)):
        memory[k] = 0.0  # Results must not depend on the previous contents, bit by bit.
    scratch = make_scratch(memory, dof, joints)
    reset_weights(task, scratch)
    for d in range(dof):
        here, reach = state[NOW, d], state[REACH, d] * (1.0 - INSIDE)
        # A joint outside its limits returns at its largest speed.
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
            and scratch.lanes.error[RESIDUAL2, l] < scratch.lanes.error[RESIDUAL2, best]
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


@entry
def servo_step(
    address: int,
    tolerances: Annotated[Array, TOLERANCES],
    target: Annotated[Array, 4, 4],
    memory: Annotated[Array, "*"],
    state: Annotated[Array, ROWS, "n", OUT],
) -> tuple[float, float, int]:
    """Move as near to a pose as one period allows; the row NOW of the state receives the new joint values.

    A joint that is at an end of its interval and would move outward is held, and the others move without it. If the pose
    is not reached within the period, the weighted error is minimised, see `go_nearer`.

    Args:
        address: Address of the handle of the task, see `task_of`.
        tolerances: See `task_of`.
        target: (4, 4), lengths in [m].
        memory: At least `scratch_size` numbers.
        state: See `LOWER`, (ROWS, n).

    Returns:
        Position error [m], orientation error [rad], and the outcome of the step, see `TRACKING`.
    """
    return one_period(address, tolerances, target, memory, state)


@entry
def look_ahead(
    address: int,
    tolerances: Annotated[Array, TOLERANCES],
    targets: Annotated[Array, "k", 4, 4],
    place: float,
    turn: float,
    memory: Annotated[Array, "*"],
    state: Annotated[Array, ROWS, "n", OUT],
) -> tuple[int, int, int]:
    """Make one step after another, until the error of the hand exceeds the given bounds.

    Args:
        address: See `servo_step`.
        tolerances: See `servo_step`.
        targets: One pose per step, (k, 4, 4).
        place: Largest position error [m].
        turn: Largest orientation error [rad].
        memory: See `servo_step`.
        state: See `servo_step`; it keeps the values after the last step.

    Returns:
        Index of the first lagging step, index of the step that exceeded the bounds, k for both if there is none, and the
        outcome of that step.
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
