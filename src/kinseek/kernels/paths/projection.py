"""Project eight configurations onto their targets from nearby, within limits that the caller gives."""

from __future__ import annotations

from typing import Annotated

import numpy as np

from kinseek.kernels.arrays import Array, Indices
from kinseek.kernels.atlas.descent import LONGEST, free_turn, reset_weights
from kinseek.kernels.atlas.lanes import (
    LANES,
    RESIDUAL2,
    lanes_forward,
    lanes_gram,
    lanes_hold,
    lanes_jacobian,
    lanes_move,
    lanes_residual,
    lanes_solve,
)
from kinseek.kernels.atlas.memory import Scratch, make_scratch, scratch_size
from kinseek.kernels.atlas.task import TOLERANCES, Handle, task_of
from kinseek.kernels.entry import OUT
from kinseek.kernels.jit import entry, inlined, noinline

EXACT = 1e-18
"""Squared scaled error to converge to. It is far below the tolerances, because the next step starts from the result."""


@noinline
def settle(
    handle: Indices, tolerances: Array, memory: Array, lower: Array, upper: Array, steps: int, w: int
) -> int:
    """Move the lanes with state 0 onto their targets by at most `steps` damped steps; return the steps made.

    Args:
        handle: The task, see `task_of`.
        tolerances: See `task_of`.
        memory: The scratch memory, with targets, weights, states and joint values set.
        lower: Limits of every step, (n,); infinite if there are none.
        upper: (n,)
        steps: Largest number of steps.
        w: LANES.
    """
    task = task_of(handle, tolerances)
    scratch = make_scratch(memory, len(lower), len(task.chain.leader))
    lanes, turn, made = scratch.lanes, free_turn(task), 0
    lanes_forward(task.chain.leader, task.links, lanes, w)
    lanes_residual(lanes, scratch.columns, w)
    for _ in range(steps):
        away = 0
        for l in range(LANES):
            if scratch.state[l] == 0 and lanes.error[RESIDUAL2, l] > EXACT:
                away += 1
        if away == 0:
            break
        lanes_jacobian(task.chain.leader, task.links, lanes, turn, w)
        lanes_hold(lower, upper, lanes, w)
        lanes_gram(scratch.damping[0], scratch.floor, lanes, w)
        lanes_solve(lanes, w)
        lanes_move(lower, upper, LONGEST, lanes, w)
        lanes_forward(task.chain.leader, task.links, lanes, w)
        lanes_residual(lanes, scratch.columns, w)
        made += 1
    memory[0] += 0.0  # Its last use, see `one_goal.solve_pose`.
    return made


@inlined
def load_lane(scratch: Scratch, lane: int, target: Array, q: Array) -> None:
    """Set the target, (3, 4), and the start, (n,), of one lane."""
    for r in range(3):
        for c in range(4):
            scratch.lanes.target[r, c, lane] = target[r, c]
    for i in range(len(q)):
        scratch.lanes.q[i, lane] = q[i]


@entry
def project_onto_poses(
    handle: Handle,
    tolerances: Annotated[Array, TOLERANCES],
    targets: Annotated[Array, "k", 3, 4],
    lower: Annotated[Array, "n"],
    upper: Annotated[Array, "n"],
    steps: int,
    q: Annotated[Array, "k", "n", OUT],
    left: Annotated[Array, "k", OUT],
    w: int,
) -> None:
    """Project joint values that are close to a solution onto it, each row onto its own target, eight at a time.

    Args:
        handle: The task, see `task_of`.
        tolerances: See `task_of`.
        targets: (k, 3, 4), lengths in [m].
        lower: Limits of every step, (n,); infinite if there are none.
        upper: (n,)
        steps: Largest number of steps.
        q: Joint values within the limits, (k, n), replaced by the final ones.
        left: Receives the remaining squared scaled errors, (k,).
        w: LANES.
    """
    task = task_of(handle, tolerances)
    dof, joints = len(lower), len(task.chain.leader)
    memory = np.zeros(scratch_size(dof, joints))
    scratch = make_scratch(memory, dof, joints)
    reset_weights(task, scratch)
    count = len(q)
    for first in range(0, count, LANES):
        for l in range(LANES):
            k = min(first + l, count - 1)
            load_lane(scratch, l, targets[k], q[k])
            scratch.state[l] = 0
        settle(handle, tolerances, memory, lower, upper, steps, w)
        for l in range(min(LANES, count - first)):
            left[first + l] = scratch.lanes.error[RESIDUAL2, l]
            for i in range(dof):
                q[first + l, i] = scratch.lanes.q[i, l]
    memory[0] = 0.0  # Its last use, see `one_goal.solve_pose`.
