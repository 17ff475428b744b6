"""Project eight configurations onto their targets from nearby, within limits that the caller gives.

Each step is the damped Newton step of `atlas.lanes`, ``dq = Jᵀ (J Jᵀ + λ I)⁻¹ e``.
"""

from __future__ import annotations

from typing import Annotated

from kinseek.kernels.arrays import Array, Limits
from kinseek.kernels.atlas import lanes as eight
from kinseek.kernels.atlas.descent import LONGEST, free_turn, reset_weights
from kinseek.kernels.atlas.lanes import LANES, RESIDUAL2
from kinseek.kernels.atlas.memory import Scratch, scratch_of
from kinseek.kernels.atlas.seeds import load_seed, load_target
from kinseek.kernels.atlas.task import Job, task_at
from kinseek.kernels.entry import OUT
from kinseek.kernels.jit import entry, inlined, noinline

EXACT = 1e-18
"""Squared scaled error to converge to. It is far below the tolerances, because the next step starts from the result."""


@noinline
def project_lanes(job: Job, limits: Limits, steps: int) -> int:
    """Move the lanes with state 0 onto their targets by at most `steps` damped steps; return the steps made.

    Args:
        job: The task, and the scratch memory with targets, weights, states and joint values set.
        limits: Limits of every step, infinite if there are none.
        steps: Largest number of steps.
    """
    task, w = task_at(job), job.width
    scratch = scratch_of(job, task)
    lanes, chain, turn, made = scratch.lanes, task.chain, free_turn(task), 0
    eight.lanes_forward(chain.leader, task.links, lanes, w)
    eight.lanes_residual(lanes, scratch.columns, w)
    for _ in range(steps):
        away = 0
        for l in range(LANES):
            if scratch.state[l] == 0 and lanes.error[RESIDUAL2, l] > EXACT:
                away += 1
        if away == 0:
            break
        eight.lanes_jacobian(chain.leader, task.links, lanes, turn, w)
        eight.lanes_hold(limits.lower, limits.upper, lanes, w)
        eight.lanes_gram(scratch.damping[0], scratch.floor, lanes, w)
        eight.lanes_solve(lanes, w)
        eight.lanes_move(limits.lower, limits.upper, LONGEST, lanes, w)
        eight.lanes_forward(chain.leader, task.links, lanes, w)
        eight.lanes_residual(lanes, scratch.columns, w)
        made += 1
    return made


@inlined
def load_lane(scratch: Scratch, lane: int, target: Array, q: Array) -> None:
    """Set the target, (3, 4), and the start, (n,), of one lane, and its state to 0."""
    load_target(scratch.lanes, lane, target)
    load_seed(scratch.lanes, lane, q)
    scratch.state[lane] = 0


@entry
def project_onto_poses(
    job: Job,
    targets: Annotated[Array, "k", 3, 4],
    limits: Limits,
    steps: int,
    q: Annotated[Array, "k", "n", OUT],
    left: Annotated[Array, "k", OUT],
) -> None:
    """Project joint values that are close to a solution onto it, each row onto its own target, eight at a time.

    Args:
        job: The task, and memory for it.
        targets: (k, 3, 4), lengths in [m].
        limits: Limits of every step, infinite if there are none.
        steps: Largest number of steps.
        q: Joint values within the limits, (k, n), replaced by the final ones.
        left: Receives the remaining squared scaled errors, (k,).
    """
    task = task_at(job)
    scratch, count = scratch_of(job, task), len(q)
    reset_weights(task, scratch)
    for first in range(0, count, LANES):
        for l in range(LANES):
            k = min(first + l, count - 1)
            load_lane(scratch, l, targets[k], q[k])
        project_lanes(job, limits, steps)
        for l in range(min(LANES, count - first)):
            left[first + l] = scratch.lanes.error[RESIDUAL2, l]
            for i in range(q.shape[1]):
                q[first + l, i] = scratch.lanes.q[i, l]
