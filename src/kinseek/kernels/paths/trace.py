"""Follow branches from pose to pose, up to eight in parallel, one in each lane.

The joint values at the next pose are predicted by a line or a parabola through the last ones, ``2 q₀ - q₋₁`` or
``3 q₀ - 3 q₋₁ + q₋₂``, whichever was closer the last time, and then projected onto the pose.
"""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

import numpy as np

from kinseek.kernels.arrays import Array, Indices, Limits
from kinseek.kernels.atlas.descent import reset_weights, within
from kinseek.kernels.atlas.lanes import LANES
from kinseek.kernels.atlas.memory import scratch_of
from kinseek.kernels.atlas.seeds import load_target
from kinseek.kernels.atlas.task import Job, task_at
from kinseek.kernels.entry import OUT
from kinseek.kernels.jit import entry, inlined

from .projection import load_lane, project_lanes

TURN = 2.0 * math.pi

STEPS = 12
"""Largest number of steps from the predicted joint values at the next pose."""

MET = 1e-5
"""Two rows closer than this in every joint [rad or m] are the same solution. Branches that cross at a singularity are
farther apart at the next pose, and rounding errors are smaller there."""

ENDED, JOINED, TAKEN = 0, 1, 2
"""How the tracing of a branch ended: it reached the last target or was lost; it met the end of another piece of the same
branch; or it met another branch that was there before, so that one of the two is lost."""


class Leg(NamedTuple):
    """Which branches are followed."""

    begin: int
    """Target from which they are followed."""
    end: int
    """Target up to which they are followed, forward or backward."""
    many: int
    """Number of branches."""


@entry
def trace(
    job: Job,
    targets: Annotated[Array, "k", 3, 4],
    leg: Leg,
    longest: Annotated[Array, "n"],
    q: Annotated[Array, "k", LANES, "n", OUT],
    ends: Annotated[Indices, LANES, OUT],
) -> None:
    """Follow branches from the solutions of one target to another target, forward or backward.

    A branch ends if the steps from its predicted values do not converge, or if a joint would move too far.

    Args:
        job: The task, whose limits end a branch, and memory for it.
        targets: (k, 3, 4), lengths in [m].
        leg: Which branches.
        longest: Largest motion of each joint from one target to the next, (n,), [rad] or [m].
        q: The row of the first target has its solutions, (k, LANES, n); receives joint values as far as the branches lead.
        ends: Receives the last target of each branch, (LANES,).
    """
    task, begin, many = task_at(job), leg.begin, leg.many
    dof, scratch = len(task.lower), scratch_of(job, task)
    reset_weights(task, scratch)
    curved, way, active = np.zeros(LANES), 1 if leg.end >= begin else -1, many
    for l in range(LANES):
        load_lane(scratch, l, targets[begin], q[begin, min(l, many - 1)])
        ends[l], scratch.state[l] = begin, 0 if l < many else 2
    for passed in range(abs(leg.end - begin)):
        if active == 0:
            break
        i = begin + way * passed
        j = i + way
        for l in range(many):
            if scratch.state[l] != 0:
                continue
            load_target(scratch.lanes, l, targets[j])
            for d in range(dof):
                value = q[i, l, d]
                if passed > 0:
                    value += q[i, l, d] - q[i - way, l, d]
                if passed > 1:
                    value += curved[l] * (q[i, l, d] - 2.0 * q[i - way, l, d] + q[i - 2 * way, l, d])
                scratch.lanes.q[d, l] = min(max(value, task.lower[d]), task.upper[d])
        project_lanes(job, Limits(task.lower, task.upper), STEPS)
        for l in range(many):
            if scratch.state[l] != 0:
                continue
            good, line, parabola = within(task, scratch.lanes, l), 0.0, 0.0
            for d in range(dof):
                value = scratch.lanes.q[d, l]
                q[j, l, d] = value
                good = good and abs(value - q[i, l, d]) <= longest[d]
                if passed > 1:
                    off = value - 2.0 * q[i, l, d] + q[i - way, l, d]
                    bend = q[i, l, d] - 2.0 * q[i - way, l, d] + q[i - 2 * way, l, d]
                    line, parabola = max(line, abs(off)), max(parabola, abs(off - bend))
            curved[l] = 1.0 if parabola < line or passed < 2 else 0.0
            if good:
                ends[l] = j
            else:
                scratch.state[l] = 2
                active -= 1


@inlined
def same(q: Array, other: Array, turns: Indices) -> bool:
    """Return True if two rows of joint values, (n,), are the same solution."""
    for d in range(len(q)):
        gap = q[d] - other[d]
        if turns[d] != 0:
            gap -= TURN * np.rint(gap * (1.0 / TURN))
        if abs(gap) >= MET:
            return False
    return True


@entry
def part_ways(
    rows: Annotated[Array, "k", "m", "n"],
    fresh: int,
    way: int,
    turns: Annotated[Indices, "n"],
    spans: Annotated[Indices, "m", 2, OUT],
    became: Annotated[Indices, "m", OUT],
) -> None:
    """End traced branches where they meet others: a step converged to the wrong branch there.

    Args:
        rows: Joint values of m branches at k targets, (k, m, n).
        fresh: First branch traced just now; earlier ones are known and keep their spans.
        way: 1 if they were traced forward, -1 backward.
        turns: 1 for joints for which full turns make no difference, else 0, (n,).
        spans: First and last target of each branch, (m, 2); fresh ones end before they meet another branch.
        became: Receives the outcome of each, see `ENDED`, (m,).
    """
    for l in range(fresh, len(spans)):
        begin, end = (spans[l, 0], spans[l, 1]) if way > 0 else (spans[l, 1], spans[l, 0])
        became[l] = ENDED
        for passed in range(1, abs(end - begin) + 1):
            j = begin + way * passed
            for b in range(l):
                if spans[b, 0] <= j <= spans[b, 1] and same(rows[j, l], rows[j, b], turns):
                    became[l] = TAKEN if spans[b, 0] <= j - way <= spans[b, 1] else JOINED
                    break
            if became[l] != ENDED:
                spans[l, 1 if way > 0 else 0] = j - way
                break
