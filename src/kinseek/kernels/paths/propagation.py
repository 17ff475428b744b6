"""Branches of a redundant arm from one layer of solutions to the next, and further solutions along the self-motion.

The direction of the self-motion is the part of a vector v in the null space of the Jacobian, ``v - Jᵀ (J Jᵀ)⁻¹ J v``.
"""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

import numpy as np

from kinseek.kernels.arrays import Array, Indices, Limits
from kinseek.kernels.atlas import lanes as eight
from kinseek.kernels.atlas.descent import free_turn, reset_weights, within
from kinseek.kernels.atlas.lanes import LANES
from kinseek.kernels.atlas.memory import scratch_of
from kinseek.kernels.atlas.seeds import keep_joints
from kinseek.kernels.atlas.task import Job, task_at
from kinseek.kernels.entry import OUT
from kinseek.kernels.jit import entry, inlined, noinline

from .projection import load_lane, project_lanes
from .trace import Leg, trace
from .viterbi import COPIED, ROOM, STRAIGHT, BranchEnds, Turns

TURN = 2.0 * math.pi

STEPS = 12
"""Largest number of steps that move a configuration next to a solution onto the pose."""

AGAIN = 0.6
"""Fraction of the distance `beside`. A start is skipped if a known solution is nearer than this."""

SHORT = 0.2
"""If the part of a direction along the self-motion is shorter than this, another direction is tried as well."""

LEANING = 0.37
"""Increment of the direction that is projected onto the self-motion, so that all its coordinates differ."""


class Given(NamedTuple):
    """Known solutions of a target, and the distances of others."""

    q: Annotated[Array, "m", "n"]
    """Solutions, (m, n); those outside the limits are skipped."""
    first: int
    """How many of them precede the solutions that are found next to them."""
    apart: float
    """A solution nearer than this to another in every joint is skipped [rad or m]."""
    beside: float
    """Distance along the self-motion, to both sides, of further solutions [rad or m]; 0 for none."""


@inlined
def crowded(q: Array, rows: Array, count: int, kind: Indices, near: float) -> bool:
    """Return True if any of the first rows is nearer than `near` in every joint, modulo full turns."""
    for k in range(count):
        close = True
        for j in range(len(q)):
            gap = q[j] - rows[k, j]
            if abs(gap) >= near:
                if kind[j] != STRAIGHT:
                    gap -= TURN * np.rint(gap * (1.0 / TURN))
                if abs(gap) >= near:
                    close = False
                    break
        if close:
            return True
    return False


@inlined
def joined(one: Array, turns: Turns, apart: float, q: Array, count: int) -> int:
    """Append a solution to q if there is room, it is within its limits and no other is near; return the number of rows.

    COPIED joints are moved into the first turn of their range.
    """
    inside = count < len(q)
    for j in range(len(one)):
        low, high = turns.lower[j] - ROOM, turns.upper[j] + ROOM
        if turns.kind[j] == COPIED:
            one[j] -= TURN * np.floor((one[j] - low) / TURN)
        if turns.kind[j] == STRAIGHT or turns.kind[j] == COPIED:
            inside = inside and low <= one[j] <= high
    if not inside or crowded(one, q, count, turns.kind, apart):
        return count
    keep_joints(q, count, one)
    return count + 1


@inlined
def sign_of(A: Array) -> float:
    """Sign of the determinant of a square matrix, (m, m), which is overwritten (Gauss, with pivoting)."""
    m, sign = len(A), 1.0
    for k in range(m):
        p = k
        for i in range(k + 1, m):
            if abs(A[i, k]) > abs(A[p, k]):
                p = i
        if A[p, k] == 0.0:
            return 0.0
        if p != k:
            sign = -sign
            for j in range(m):
                A[p, j], A[k, j] = A[k, j], A[p, j]
        if A[k, k] < 0.0:
            sign = -sign
        for i in range(k + 1, m):
            factor = A[i, k] / A[k, k]
            for j in range(k, m):
                A[i, j] -= factor * A[k, j]
    return sign


@inlined
def leaning(i: int, turn: int) -> float:
    """Coordinate i of the direction that is projected in one of two turns, see `LEANING`."""
    return 1.0 + LEANING * i * (1.0 - 2.0 * ((i + turn * (i // 2)) % 2))


@noinline
def write_self_motions(job: Job, q: Array, first: int, last: int, along: Array) -> int:
    """Write the direction of the self-motion at solutions first … last-1, at most LANES, into `along`, (k, n).

    Its largest entry has magnitude 1. With one redundant joint the Jacobian extended by the direction has a positive
    determinant. The direction is therefore continuous along the self-motion, and changes its sign across a singularity.
    """
    task, w, many = task_at(job), job.width, last - first
    dof, scratch, free = len(task.lower), scratch_of(job, task), free_turn(task)
    lanes = scratch.lanes
    J, e = lanes.jacobian, lanes.residual
    for l in range(LANES):
        for i in range(dof):
            lanes.q[i, l] = q[min(first + l, last - 1), i]
    eight.lanes_forward(task.chain.leader, task.links, lanes, w)
    eight.lanes_jacobian(task.chain.leader, task.links, lanes, free, w)
    best, found, one, square = np.zeros(many), np.zeros((many, dof)), np.zeros(dof), np.zeros((7, 7))
    whole = (dof == 7 and free == 0.0 and task.columns[0] > 0.0) or (dof == 6 and free == 1.0)
    for turn in range(2):
        least = 1.0
        for l in range(many):
            least = min(least, best[l])
        if turn == 1 and least > SHORT:
            break
        for r in range(6):
            for l in range(w):
                e[r, l] = 0.0
        for i in range(dof):
            v = leaning(i, turn)
            for r in range(6):
                for l in range(w):
                    e[r, l] += J[i, r, l] * v
        eight.lanes_gram(0.0, scratch.floor, lanes, w)
        eight.lanes_solve(lanes, w)
        for l in range(many):
            size = 0.0
            for i in range(dof):
                d = leaning(i, turn)
                for r in range(6):
                    d -= J[i, r, l] * e[r, l]
                one[i] = d
                size = max(size, abs(d))
            if size > best[l]:
                best[l] = size
                for i in range(dof):
                    found[l, i] = one[i] / size
    for l in range(many):
        sense = 1.0
        if whole:
            for i in range(dof):
                for r in range(6):
                    square[r, i] = J[i, r, l]
                square[6, i] = found[l, i]
            if dof == 6:
                # The unconstrained rotation about the tool's axis takes the place of one more joint.
                square[6, 6] = 0.0
                for r in range(3):
                    square[r, 6], square[3 + r, 6] = 0.0, lanes.pose[r, 0, l]
            sense = sign_of(square)
        for i in range(dof):
            along[first + l, i] = sense * found[l, i]
    return many


@entry
def propagate_layer(
    job: Job,
    targets: Annotated[Array, "r", 3, 4],
    moments: Annotated[Array, "r"],
    longest: Annotated[Array, "n"],
    weights: Annotated[Array, "n"],
    q: Annotated[Array, "k", "n"],
    ends: BranchEnds,
) -> None:
    """Follow branches from solutions of the first target to the last target.

    Args:
        job: The task, whose limits end a branch, and memory for it.
        targets: (r, 3, 4), lengths in [m].
        moments: Indices of their poses, (r,); poses between two of them are skipped.
        longest: Largest motion of each joint from one target to the next, (n,), [rad] or [m].
        weights: Weight of each joint in the cost, (n,).
        q: Solutions of the first target, (k, n).
        ends: Receives where their branches lead.
    """
    last, dof = len(targets) - 1, len(longest)
    ways, reached = np.zeros((len(targets), LANES, dof)), np.zeros(LANES, dtype=np.int64)
    for first in range(0, len(q), LANES):
        many = min(LANES, len(q) - first)
        for l in range(many):
            for d in range(dof):
                ways[0, l, d] = q[first + l, d]
        trace(job, targets, Leg(0, last, many), longest, ways, reached)
        for l in range(many):
            k, cost = first + l, 0.0
            for d in range(dof):
                ends.q[k, d], ends.least[k, d], ends.most[k, d] = ways[reached[l], l, d], np.inf, -np.inf
            for i in range(reached[l]):
                span = moments[i + 1] - moments[i]
                for d in range(dof):
                    step = ways[i + 1, l, d] - ways[i, l, d]
                    cost += weights[d] * weights[d] * step * step / span
                    ends.least[k, d] = min(ends.least[k, d], step / span)
                    ends.most[k, d] = max(ends.most[k, d], step / span)
            ends.cost[k] = cost if reached[l] == last else np.inf
        write_self_motions(job, ends.q, first, first + many, ends.along)


@entry
def spread_solutions(
    job: Job,
    target: Annotated[Array, 3, 4],
    given: Given,
    turns: Turns,
    q: Annotated[Array, "k", "n", OUT],
    along: Annotated[Array, "k", "n", OUT],
) -> int:
    """Spread solutions of one target: given ones, others next to them along the self-motion, then the other given ones.

    Args:
        job: The task, and memory for it.
        target: (3, 4), lengths in [m].
        given: Known solutions, and the distances of others.
        turns: How the joints turn.
        q: Receives the solutions, with COPIED joints in the first turn of their range, (k, n).
        along: Receives the directions of the self-motion there, (k, n), see `write_self_motions`.

    Returns:
        The number of solutions.
    """
    task = task_at(job)
    scratch, count, traced = scratch_of(job, task), 0, 0
    reset_weights(task, scratch)
    for k in range(given.first):
        count = join_row(scratch.seed, given, k, turns, q, count)
    # Solutions found next to others are starts as well, until no new one is found.
    while given.beside > 0.0 and traced < count < len(q):
        last = min(traced + LANES, count)
        write_self_motions(job, q, traced, last, along)
        tried, many = 0, last - traced
        while tried < 2 * many:
            filled = 0
            while filled < LANES and tried < 2 * many:
                k, side = traced + tried % many, 1.0 if tried < many else -1.0
                tried += 1
                for d in range(q.shape[1]):
                    scratch.seed[d] = q[k, d] + side * given.beside * along[k, d]
                if not crowded(scratch.seed, q, count, turns.kind, AGAIN * given.beside):
                    load_lane(scratch, filled, target, scratch.seed)
                    filled += 1
            if filled > 0:
                count = join_projected(job, filled, turns, given.apart, q, count)
        traced = last
    for k in range(given.first, len(given.q)):
        count = join_row(scratch.seed, given, k, turns, q, count)
    for k in range(traced, count, LANES):
        write_self_motions(job, q, k, min(k + LANES, count), along)
    return count


@inlined
def join_row(one: Array, given: Given, k: int, turns: Turns, q: Array, count: int) -> int:
    """Append given solution k to q, see `joined`; `one` is memory, (n,)."""
    for d in range(len(one)):
        one[d] = given.q[k, d]
    return joined(one, turns, given.apart, q, count)


@noinline
def join_projected(job: Job, filled: int, turns: Turns, apart: float, q: Array, count: int) -> int:
    """Project the first lanes onto their targets, and append to q those that converge and are distinct."""
    task = task_at(job)
    scratch, lanes = scratch_of(job, task), scratch_of(job, task).lanes
    for l in range(LANES):
        for d in range(len(task.lower)):
            value = lanes.q[d, min(l, filled - 1)]
            lanes.q[d, l] = min(max(value, task.lower[d]), task.upper[d])
        if l >= filled:
            scratch.state[l] = 2
            for r in range(3):
                for c in range(4):
                    lanes.target[r, c, l] = lanes.target[r, c, 0]
    project_lanes(job, Limits(task.lower, task.upper), STEPS)
    for l in range(filled):
        if within(task, lanes, l):
            for d in range(len(task.lower)):
                scratch.seed[d] = lanes.q[d, l]
            count = joined(scratch.seed, turns, apart, q, count)
    return count
