"""Follow branches from pose to pose, up to eight in parallel, one in each lane."""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np

from kinseek.kernels.arrays import Array, Indices
from kinseek.kernels.atlas.descent import reset_weights, within
from kinseek.kernels.atlas.lanes import LANES
from kinseek.kernels.atlas.memory import make_scratch, scratch_size
from kinseek.kernels.atlas.task import TOLERANCES, Handle, task_of
from kinseek.kernels.entry import OUT
from kinseek.kernels.jit import entry, inlined, noinline

from .projection import load_lane, settle

TURN = 2.0 * math.pi

STEPS = 12
"""Largest number of steps from the predicted joint values at the next pose."""

MET = 1e-5
"""Two rows closer than this in every joint [rad or m] are the same solution. Branches that cross at a singularity are
farther apart at the next pose, and rounding errors are smaller there."""

ENDED, JOINED, TAKEN = 0, 1, 2
"""How the tracing of a branch ended: it reached the last target or was lost; it met the end of another piece of the same
branch; or it met another branch that was there before, so that one of the two is lost."""


@noinline
def trace_lanes(
    handle: Indices,
    tolerances: Array,
    targets: Array,
    begin: int,
    end: int,
    many: int,
    longest: Array,
    q: Array,
    ends: Indices,
    w: int,
) -> int:
    """Do the work of `trace`; return the number of branches that reach the end."""
    task = task_of(handle, tolerances)
    dof, joints = len(task.lower), len(task.chain.leader)
    memory = np.zeros(scratch_size(dof, joints))
    scratch = make_scratch(memory, dof, joints)
    reset_weights(task, scratch)
    curved = np.zeros(LANES)
    way = 1 if end >= begin else -1
    active = many
    for l in range(LANES):
        ends[l] = begin
        scratch.state[l] = 0 if l < many else 2
        load_lane(scratch, l, targets[begin], q[begin, min(l, many - 1)])
    for passed in range(abs(end - begin)):
        if active == 0:
            break
        i = begin + way * passed
        j = i + way
        for l in range(many):
            if scratch.state[l] != 0:
                continue
            for r in range(3):
                for c in range(4):
                    scratch.lanes.target[r, c, l] = targets[j, r, c]
            for d in range(dof):
                value = q[i, l, d]
                if passed > 0:
                    value += q[i, l, d] - q[i - way, l, d]
                if passed > 1:
                    value += curved[l] * (q[i, l, d] - 2.0 * q[i - way, l, d] + q[i - 2 * way, l, d])
                scratch.lanes.q[d, l] = min(max(value, task.lower[d]), task.upper[d])
        settle(handle, tolerances, memory, task.lower, task.upper, STEPS, w)
        for l in range(many):
            if scratch.state[l] != 0:
                continue
            good = within(task, scratch.lanes, l)
            line, parabola = 0.0, 0.0
            for d in range(dof):
                value = scratch.lanes.q[d, l]
                q[j, l, d] = value
                good = good and abs(value - q[i, l, d]) <= longest[d]
                if passed > 1:
                    off = value - 2.0 * q[i, l, d] + q[i - way, l, d]
                    bend = q[i, l, d] - 2.0 * q[i - way, l, d] + q[i - 2 * way, l, d]
                    line = max(line, abs(off))
                    parabola = max(parabola, abs(off - bend))
            curved[l] = 1.0 if parabola < line or passed < 2 else 0.0
            if good:
                ends[l] = j
            else:
                scratch.state[l] = 2
                active -= 1
    memory[0] = 0.0  # Its last use, see `one_goal.solve_pose`.
    return active


@entry
def trace(
    handle: Handle,
    tolerances: Annotated[Array, TOLERANCES],
    targets: Annotated[Array, "k", 3, 4],
    begin: int,
    end: int,
    many: int,
    longest: Annotated[Array, "n"],
    q: Annotated[Array, "k", LANES, "n", OUT],
    ends: Annotated[Indices, LANES, OUT],
    w: int,
) -> None:
    """Follow branches from the solutions of target `begin` to target `end`, forward or backward.

    A line or a parabola through the last poses, whichever was closer the last time, predicts each branch, and a few steps
    move it onto the pose. A branch ends if these do not converge, or if a joint would move too far.

    Args:
        handle: The task, see `task_of`; its limits end a branch.
        tolerances: See `task_of`.
        targets: (k, 3, 4), lengths in [m].
        begin: Target from which the branches are followed.
        end: Target up to which they are followed.
        many: Number of branches.
        longest: Largest motion of each joint from one target to the next, (n,), [rad] or [m].
        q: Row `begin` has the solutions of that target, (k, LANES, n); receives joint values as far as the branches lead.
        ends: Receives the last target of each branch, (LANES,).
        w: LANES.
    """
    trace_lanes(handle, tolerances, targets, begin, end, many, longest, q, ends, w)


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
