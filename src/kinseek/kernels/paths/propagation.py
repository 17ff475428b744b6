"""Branches of a redundant arm from one layer of solutions to the next, and further solutions along the self-motion."""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np

from kinseek.kernels.arrays import Array, Indices
from kinseek.kernels.atlas.descent import free_turn, reset_weights, within
from kinseek.kernels.atlas.lanes import (
    LANES,
    lanes_forward,
    lanes_gram,
    lanes_jacobian,
    lanes_solve,
)
from kinseek.kernels.atlas.memory import make_scratch, scratch_size
from kinseek.kernels.atlas.task import TOLERANCES, Handle, task_of
from kinseek.kernels.entry import OUT
from kinseek.kernels.jit import entry, inlined, noinline

from .projection import load_lane, settle
from .trace import trace_lanes
from .viterbi import COPIED, ROOM, STRAIGHT

TURN = 2.0 * math.pi

STEPS = 12
"""Largest number of steps that move a configuration next to a solution onto the pose."""

AGAIN = 0.6
"""Fraction of the distance `beside`. A start is skipped if a known solution is nearer than this."""

SHORT = 0.2
"""If the part of a direction along the self-motion is shorter than this, another direction is tried as well."""

LEANING = 0.37
"""Increment of the direction that is projected onto the self-motion, so that all its coordinates differ."""


@inlined
def crowded(q: Array, rows: Array, count: int, turning: Indices, near: float) -> bool:
    """Return True if any of the first rows is nearer than `near` in every joint, modulo full turns."""
    for k in range(count):
        close = True
        for j in range(len(q)):
            gap = q[j] - rows[k, j]
            if abs(gap) >= near:
                if turning[j] != STRAIGHT:
                    gap -= TURN * np.rint(gap * (1.0 / TURN))
                if abs(gap) >= near:
                    close = False
                    break
        if close:
            return True
    return False


@inlined
def into_first_turn(q: Array, lower: Array, upper: Array, turning: Indices) -> bool:
    """Move COPIED joints into the first turn of their range; return True if all joints are within their limits then."""
    inside = True
    for j in range(len(q)):
        if turning[j] == COPIED:
            base = lower[j] - ROOM
            q[j] -= TURN * np.floor((q[j] - base) / TURN)
        if turning[j] == STRAIGHT or turning[j] == COPIED:
            inside = inside and lower[j] - ROOM <= q[j] <= upper[j] + ROOM
    return inside


@inlined
def joined(
    one: Array, lower: Array, upper: Array, turning: Indices, apart: float, q: Array, count: int
) -> int:
    """Append a solution to q if there is room, it is within its limits and no other is near; return the number of rows."""
    if count == len(q) or not into_first_turn(one, lower, upper, turning):
        return count
    if crowded(one, q, count, turning, apart):
        return count
    for d in range(len(one)):
        q[count, d] = one[d]
    return count + 1


@inlined
def sign_of(A: Array) -> float:
    """Sign of the determinant of a square matrix, (m, m), which is overwritten."""
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


@noinline
def along_lanes(
    handle: Indices, tolerances: Array, memory: Array, q: Array, first: int, last: int, way: Array, w: int
) -> int:
    """Write the direction of the self-motion at solutions first … last-1, at most LANES, into `way`, (k, n).

    Its largest entry has magnitude 1. With one redundant joint the Jacobian extended by the direction has a positive
    determinant. The direction is therefore continuous along the self-motion, and changes its sign across a singularity.
    """
    task = task_of(handle, tolerances)
    dof = len(task.lower)
    scratch = make_scratch(memory, dof, len(task.chain.leader))
    lanes, free = scratch.lanes, free_turn(task)
    for l in range(LANES):
        for i in range(dof):
            lanes.q[i, l] = q[min(first + l, last - 1), i]
    lanes_forward(task.chain.leader, task.links, lanes, w)
    lanes_jacobian(task.chain.leader, task.links, lanes, free, w)
    best = np.zeros(LANES)
    for l in range(last - first, LANES):
        best[l] = 1.0
    found, one = np.zeros((LANES, dof)), np.zeros(dof)
    square = np.zeros((7, 7))
    whole = (dof == 7 and free == 0.0 and task.columns[0] > 0.0) or (dof == 6 and free == 1.0)
    for turn in range(2):
        least = 1.0
        for l in range(LANES):
            least = min(least, best[l])
        if turn == 1 and least > SHORT:
            break
        for r in range(6):
            for l in range(w):
                lanes.residual[r, l] = 0.0
        for i in range(dof):
            v = 1.0 + LEANING * i * (1.0 - 2.0 * ((i + turn * (i // 2)) % 2))
            for r in range(6):
                for l in range(w):
                    lanes.residual[r, l] += lanes.jacobian[i, r, l] * v
        lanes_gram(0.0, scratch.floor, lanes, w)
        lanes_solve(lanes, w)
        for l in range(last - first):
            size = 0.0
            for i in range(dof):
                d = 1.0 + LEANING * i * (1.0 - 2.0 * ((i + turn * (i // 2)) % 2))
                for r in range(6):
                    d -= lanes.jacobian[i, r, l] * lanes.residual[r, l]
                one[i] = d
                size = max(size, abs(d))
            if size > best[l]:
                best[l] = size
                for i in range(dof):
                    found[l, i] = one[i] / size
    for l in range(last - first):
        sense = 1.0
        if whole:
            for i in range(dof):
                for r in range(6):
                    square[r, i] = lanes.jacobian[i, r, l]
                square[6, i] = found[l, i]
            if dof == 6:
                # The unconstrained rotation about the tool's axis takes the place of one more joint.
                square[6, 6] = 0.0
                for r in range(3):
                    square[r, 6], square[3 + r, 6] = 0.0, lanes.pose[r, 0, l]
            sense = sign_of(square)
        for i in range(dof):
            way[first + l, i] = sense * found[l, i]
    memory[0] += 0.0  # Its last use, see `one_goal.solve_pose`.
    return last - first


BASE = 0
"""Index of the sum of squared steps in the report on a branch between two layers; it is infinite if the branch ends
before. The smallest and the largest motion of each joint from pose to pose follow."""


@entry
def propagate_layer(
    handle: Handle,
    tolerances: Annotated[Array, TOLERANCES],
    targets: Annotated[Array, "r", 3, 4],
    moments: Annotated[Array, "r"],
    longest: Annotated[Array, "n"],
    weights: Annotated[Array, "n"],
    q: Annotated[Array, "k", "n"],
    ahead: Annotated[Array, "k", "n", OUT],
    report: Annotated[Array, "k", "*", OUT],
    along: Annotated[Array, "k", "n", OUT],
    w: int,
) -> None:
    """Follow branches from solutions of the first target to the last target.

    Args:
        handle: The task, see `task_of`; its limits end a branch.
        tolerances: See `task_of`.
        targets: (r, 3, 4), lengths in [m].
        moments: Indices of their poses, (r,); poses between two of them are skipped.
        longest: Largest motion of each joint from one target to the next, (n,), [rad] or [m].
        weights: Weight of each joint in the cost, (n,).
        q: Solutions of the first target, (k, n).
        ahead: Receives the ends of their branches, (k, n).
        report: Receives a report on each branch, see `BASE`, (k, 1 + 2 n).
        along: Receives the directions of the self-motion at the ends, (k, n), see `along_lanes`.
        w: LANES.
    """
    task = task_of(handle, tolerances)
    rows, dof = len(targets), len(task.lower)
    ways, ends = np.zeros((rows, LANES, dof)), np.zeros(LANES, dtype=np.int64)
    memory = np.zeros(scratch_size(dof, len(task.chain.leader)))
    scratch = make_scratch(memory, dof, len(task.chain.leader))
    reset_weights(task, scratch)
    for first in range(0, len(q), LANES):
        many = min(LANES, len(q) - first)
        for l in range(many):
            for d in range(dof):
                ways[0, l, d] = q[first + l, d]
        trace_lanes(handle, tolerances, targets, 0, rows - 1, many, longest, ways, ends, w)
        for l in range(many):
            k, base = first + l, 0.0
            for d in range(dof):
                report[k, 1 + d], report[k, 1 + dof + d] = np.inf, -np.inf
            for i in range(ends[l]):
                span = moments[i + 1] - moments[i]
                for d in range(dof):
                    step = ways[i + 1, l, d] - ways[i, l, d]
                    base += weights[d] * weights[d] * step * step / span
                    report[k, 1 + d] = min(report[k, 1 + d], step / span)
                    report[k, 1 + dof + d] = max(report[k, 1 + dof + d], step / span)
            report[k, BASE] = base if ends[l] == rows - 1 else np.inf
            for d in range(dof):
                ahead[k, d] = ways[ends[l], l, d]
        along_lanes(handle, tolerances, memory, ahead, first, first + many, along, w)
    memory[0] = 0.0  # Its last use, see `one_goal.solve_pose`.


@entry
def spread_solutions(
    handle: Handle,
    tolerances: Annotated[Array, TOLERANCES],
    target: Annotated[Array, 3, 4],
    given: Annotated[Array, "m", "n"],
    first: int,
    lower: Annotated[Array, "n"],
    upper: Annotated[Array, "n"],
    turning: Annotated[Indices, "n"],
    apart: float,
    beside: float,
    q: Annotated[Array, "k", "n", OUT],
    along: Annotated[Array, "k", "n", OUT],
    w: int,
) -> int:
    """Spread solutions of one target: given ones, others next to them along the self-motion, then the other given ones.

    Args:
        handle: The task, see `task_of`.
        tolerances: See `task_of`.
        target: (3, 4), lengths in [m].
        given: Solutions, (m, n); those outside the limits are skipped.
        first: Number of given solutions that precede those found next to them.
        lower: Limits, (n,).
        upper: (n,)
        turning: See `viterbi.STRAIGHT`, (n,).
        apart: A solution nearer than this to another in every joint is skipped [rad or m].
        beside: Distance along the self-motion, to both sides, of further solutions [rad or m]; 0 for none.
        q: Receives the solutions, with COPIED joints in the first turn of their range, (k, n).
        along: Receives the directions of the self-motion there, (k, n), see `along_lanes`.
        w: LANES.

    Returns:
        The number of solutions.
    """
    task = task_of(handle, tolerances)
    dof, most = len(lower), len(q)
    memory = np.zeros(scratch_size(dof, len(task.chain.leader)))
    scratch = make_scratch(memory, dof, len(task.chain.leader))
    one = np.zeros(dof)
    reset_weights(task, scratch)
    count, traced = 0, 0
    for part in range(2):
        for k in range(0 if part == 0 else first, first if part == 0 else len(given)):
            for d in range(dof):
                one[d] = given[k, d]
            count = joined(one, lower, upper, turning, apart, q, count)
        if part == 1 or beside <= 0.0:
            continue
        filled = 0
        # Solutions found next to others are starts as well, until no new one is found.
        while traced < count < most:
            last = min(traced + LANES, count)
            along_lanes(handle, tolerances, memory, q, traced, last, along, w)
            for side in range(2):
                for k in range(traced, last):
                    for d in range(dof):
                        one[d] = q[k, d] + (1.0 - 2.0 * side) * beside * along[k, d]
                    if crowded(one, q, count, turning, AGAIN * beside):
                        continue
                    load_lane(scratch, filled, target, one)
                    scratch.state[filled] = 0
                    filled += 1
                    if filled == LANES:
                        count = settled(
                            handle, tolerances, memory, filled, lower, upper, turning, apart, q, count, one, w
                        )
                        filled = 0
            if filled > 0:
                count = settled(
                    handle, tolerances, memory, filled, lower, upper, turning, apart, q, count, one, w
                )
                filled = 0
            traced = last
    for k in range(traced, count, LANES):
        along_lanes(handle, tolerances, memory, q, k, min(k + LANES, count), along, w)
    memory[0] = 0.0  # Its last use, see `one_goal.solve_pose`.
    return count


@noinline
def settled(
    handle: Indices,
    tolerances: Array,
    memory: Array,
    filled: int,
    lower: Array,
    upper: Array,
    turning: Indices,
    apart: float,
    q: Array,
    count: int,
    one: Array,
    w: int,
) -> int:
    """Project the first lanes onto their targets, and append to q those that converge and are distinct."""
    task = task_of(handle, tolerances)
    dof = len(lower)
    scratch = make_scratch(memory, dof, len(task.chain.leader))
    for l in range(filled, LANES):
        scratch.state[l] = 2
    for d in range(dof):
        for l in range(LANES):
            k = min(l, filled - 1)
            scratch.lanes.q[d, l] = min(max(scratch.lanes.q[d, k], task.lower[d]), task.upper[d])
    for r in range(3):
        for c in range(4):
            for l in range(filled, LANES):
                scratch.lanes.target[r, c, l] = scratch.lanes.target[r, c, 0]
    settle(handle, tolerances, memory, task.lower, task.upper, STEPS, w)
    for l in range(filled):
        if not within(task, scratch.lanes, l):
            continue
        for d in range(dof):
            one[d] = scratch.lanes.q[d, l]
        count = joined(one, lower, upper, turning, apart, q, count)
    memory[0] += 0.0  # Its last use, see `one_goal.solve_pose`.
    return count
