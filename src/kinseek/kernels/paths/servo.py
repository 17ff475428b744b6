"""Tracking steps: as near to the pose as limits and speeds allow within one period, with bounded work.

A joint at q that moves by at most r within a period reaches ``[max(q - r, lower), min(q + r, upper)]``. Damped Newton steps
look for the pose in these intervals; if they miss it, the weighted error is minimised there, see `go_nearer`.
"""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np

from kinseek.kernels.arm.forward import forward
from kinseek.kernels.arm.pose_error import distance, errors, is_rigid
from kinseek.kernels.arrays import Array, GoalArrays, Limits
from kinseek.kernels.atlas.descent import goal_of, reset_weights, within
from kinseek.kernels.atlas.lanes import LANES, RESIDUAL2
from kinseek.kernels.atlas.memory import Scratch, scratch_of
from kinseek.kernels.atlas.newton import Walk, minimise
from kinseek.kernels.atlas.task import TOLERANCES, Job, Task, handle_at, lanes_of, task_at
from kinseek.kernels.entry import OUT
from kinseek.kernels.jit import entry, inlined

from .projection import load_lane, project_lanes

STEPS = 6
"""Largest number of damped steps within a period: a bound on the work; one or two are usual."""

STARTS = 3
"""Number of lanes that start: at the current joint values, at these plus the last step, and half-way between."""

TRACKING, LAGGING, LIMIT, SINGULAR, NO_POSE = 0, 1, 2, 3, 4
"""Outcome of a step. NO_POSE: the target is not a rigid transform, and nothing has changed."""

NEAREST_STEPS = 40
"""Largest number of Newton steps within a period towards the nearest pose: a bound on the work. Not examined further."""

NEAR = 1e-3
"""Position error [m] below which it counts squared, and above which it counts linearly (Huber 1964). Not examined
further."""

INSIDE = 1e-12
"""Fraction of a joint's largest motion that stays unused, so that rounding never makes it too fast."""


class State(NamedTuple):
    """The state of a tracker, (n,) each, [rad] or [m]."""

    lower: Annotated[Array, "n", OUT]
    """Limits."""
    upper: Annotated[Array, "n", OUT]
    reach: Annotated[Array, "n", OUT]
    """The largest motion of each joint within a period."""
    now: Annotated[Array, "n", OUT]
    """The current joint values."""
    last: Annotated[Array, "n", OUT]
    """The last step."""
    low: Annotated[Array, "n", OUT]
    """The interval of joint values that can be reached in this period."""
    high: Annotated[Array, "n", OUT]
    reached: Annotated[Array, "n", OUT]
    """The joint values at which it last reached its pose."""
    drift: Annotated[Array, "n"]
    """By how much the starts move towards a preferred posture; steps to the pose keep what does not move the hand."""


@inlined
def go_nearer(task: Task, scratch: Scratch, target: Array, state: State) -> None:
    """Reduce the weighted error from the current joint values, within what this period allows; write `scratch.seed`.

    The weighted error ``K_P d + Σ K_c (1 - c·c_g)`` has a kink at d = 0, along which steps are tiny. Its majorant
    ``K_P d² / 2 d_0 + Σ K_c (1 - c·c_g)`` equals it at the present distance d_0 and is smooth (iteratively reweighted
    least squares, Weiszfeld 1937). When the majorant decreases, the error, squared below `NEAR`, decreases at least as
    much. A target at rest therefore never makes the arm oscillate: the arm stops where the error is smallest.
    Gauss-Newton steps overshoot there in every period, since the Jacobian is singular at the boundary of the workspace.
    """
    for d in range(len(task.lower)):
        scratch.seed[d] = min(max(state.now[d], state.low[d]), state.high[d])
    forward(task.chain, scratch.seed, scratch.pose)
    weight = task.position_weight / max(distance(scratch.pose, target), NEAR)
    squares, limits = GoalArrays(target, weight, task.axis_weights), Limits(state.low, state.high)
    minimise(task.chain, squares, limits, Walk(True, NEAREST_STEPS, 0.0), scratch.seed)


@inlined
def is_nearer(task: Task, scratch: Scratch, l: int, best: int) -> bool:
    """Return True if lane l is within the tolerances and another one is not, or has a smaller error and neither is."""
    error = scratch.lanes.error
    closer = within(task, scratch.lanes, l) or error[RESIDUAL2, l] < error[RESIDUAL2, best]
    return closer and not within(task, scratch.lanes, best)


@entry
def servo_step(
    address: int,
    tolerances: Annotated[Array, TOLERANCES],
    target: Annotated[Array, 4, 4],
    memory: Annotated[Array, "*"],
    state: State,
) -> tuple[float, float, int]:
    """Move as near to a pose as one period allows; the state receives the new joint values.

    A joint that is at an end of its interval and would move outward is held, and the others move without it. If the pose
    is not reached within the period, the weighted error is minimised, see `go_nearer`.

    Args:
        address: Address of the handle of the task, see `task_of`.
        tolerances: See `task_of`.
        target: (4, 4), lengths in [m].
        memory: As long as `memory.LAYOUT` for the arm.
        state: Of the tracker.

    Returns:
        Position error [m], orientation error [rad], and the outcome of the step, see `TRACKING`.
    """
    if not is_rigid(target):
        return np.inf, np.inf, NO_POSE
    handle = handle_at(address)
    job = Job(handle, tolerances, memory, lanes_of(handle))
    task = task_at(job)
    scratch, dof = scratch_of(job, task), len(task.lower)
    for k in range(len(memory)):
        memory[k] = 0.0  # Results must not depend on the previous contents, bit by bit.
    reset_weights(task, scratch)
    for d in range(dof):
        here, reach = state.now[d], state.reach[d] * (1.0 - INSIDE)
        # A joint outside its limits returns at its largest speed.
        lower, upper = state.lower[d], state.upper[d]
        state.low[d] = max(here - reach, lower) if here >= lower else min(here + reach, lower)
        state.high[d] = min(here + reach, upper) if here <= upper else max(here - reach, upper)
    starts = STARTS
    for d in range(dof):
        if state.drift[d] != 0.0:
            starts = 2 * STARTS
    for l in range(LANES):
        # If there is a preferred posture: with a motion towards it first, and without it.
        share, drift = min(l, STARTS - 1) / (STARTS - 1.0), 1.0
        if starts > STARTS and l >= STARTS:
            share, drift = min(l - STARTS, STARTS - 1) / (STARTS - 1.0), 0.0
        for d in range(dof):
            value = state.now[d] + share * state.last[d] + drift * state.drift[d]
            scratch.seed[d] = min(max(value, state.low[d]), state.high[d])
        load_lane(scratch, l, target, scratch.seed)
        scratch.state[l] = 0 if l < starts else 2
    project_lanes(job, Limits(state.low, state.high), STEPS)
    best = 0
    for l in range(1, starts):
        best = l if is_nearer(task, scratch, l, best) else best
    if within(task, scratch.lanes, best):
        for d in range(dof):
            scratch.seed[d] = scratch.lanes.q[d, best]
    else:
        go_nearer(task, scratch, target, state)
    fast, stopped = False, False
    for d in range(dof):
        value = scratch.seed[d]
        at_end = value <= state.low[d] or value >= state.high[d]
        at_limit = at_end and (value <= state.lower[d] or value >= state.upper[d])
        fast = fast or (at_end and not at_limit)
        stopped = stopped or at_limit
        state.last[d], state.now[d] = value - state.now[d], value
    forward(task.chain, state.now, scratch.pose)
    position, orientation = errors(scratch.pose, goal_of(task, target))
    if position <= task.position_tolerance and orientation <= task.orientation_tolerance:
        for d in range(dof):
            state.reached[d] = state.now[d]
        return position, orientation, TRACKING
    return position, orientation, LAGGING if fast else LIMIT if stopped else SINGULAR


@entry
def look_ahead(
    address: int,
    tolerances: Annotated[Array, TOLERANCES],
    targets: Annotated[Array, "k", 4, 4],
    place: float,
    turn: float,
    memory: Annotated[Array, "*"],
    state: State,
) -> tuple[int, int, int]:
    """Make one step after another, until the error of the hand exceeds the given bounds.

    Args:
        address: See `servo_step`.
        tolerances: See `servo_step`.
        targets: One pose per step, (k, 4, 4).
        place: Largest position error [m].
        turn: Largest orientation error [rad].
        memory: See `servo_step`.
        state: Of the tracker; it keeps the values after the last step.

    Returns:
        Index of the first lagging step, index of the step that exceeded the bounds, k for both if there is none, and the
        outcome of that step.
    """
    behind, count = -1, len(targets)
    for k in range(count):
        position, orientation, ended = servo_step(address, tolerances, targets[k], memory, state)
        if ended == TRACKING:
            behind = -1
            continue
        behind = k if behind < 0 else behind
        if not (position <= place and orientation <= turn):
            return behind, k, ended
    return count, count, TRACKING
