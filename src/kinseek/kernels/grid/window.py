"""Exhaustive search of a window, a small grid of joint values: the inner loop of every tree search.

The tree is searched depth first, last joint fastest, as in the paper. Two measures make it fast without changing the
result. The pose P of a prefix q_1 … q_s is computed once for all leaves below it. The last joints are tabulated once, so
that a leaf is a few products in SIMD lanes: the goal is transformed into the frame of the prefix, G' = P⁻¹ G, and compared
with each tabulated pose of the tip in that frame.

A search of many leaves is divided into parts, between which signals are handled and time limits are kept; the result is
the same, bit for bit.

Plain loops replace shorter NumPy expressions (`a == b`, `.max()`, `a[i] = b[j]`), because each of these costs the first
run up to four seconds of compiling.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from kinseek.kernels.arm.forward import advance, advance_segment, copy_pose, identity
from kinseek.kernels.arm.vectors import Vector, column, dot, minus, rotated_back, scaled
from kinseek.kernels.arrays import Array, ChainArrays, GoalArrays, Indices
from kinseek.kernels.jit import inlined, inlined_with_wrapper, kernel

from .memory import MOST_LANES, Beam, WindowScratch

PART = 1 << 22
"""Work of one part of a search in leaves, about ten milliseconds."""

_PREFIX, _TABLE = 16, 16
"""Approximate cost of the pose of a prefix, and of an entry of the table, in leaves."""

EVERYTHING = 1 << 62
"""More leaves than any search evaluates."""

FINISHED, STOPPED, PAUSED = 0, 1, 2
"""How a search ended: everything within the budget is searched; a leaf was good enough; or it is to be continued."""


class Limits(NamedTuple):
    """When a search of a window ends, and which leaves are better."""

    stop_below: float
    """Stop at the first leaf in order whose weighted error is below this; -1 never stops."""
    tie: float
    """Errors that differ by at most this are equal, and the first in order is kept; with 0 rounding decides."""
    leaves: int
    """Number of leaves to evaluate, from the first of the window on."""
    work: int
    """Work of this part in leaves; it may be exceeded slightly."""


class Searched(NamedTuple):
    """State of a search of a window."""

    leaf: int
    """Number of leaves that are evaluated, in order: the next one's number."""
    ended: int
    """FINISHED, STOPPED or PAUSED."""
    work: int
    """Work that is left, in leaves."""
    to_beat: float
    """Weighted error that a leaf must beat to enter the beam."""


@kernel
def search_window(
    chain: ChainArrays, goal: GoalArrays, limits: Limits, begin: int, beam: Beam, scratch: WindowScratch
) -> Searched:
    """Search the window in `scratch` from leaf `begin` on, and keep the best leaves.

    Args:
        chain: The arm.
        goal: The goal.
        limits: When to end.
        begin: Leaf to begin at; if it is not 0, the scratch memory must be as the previous part left it.
        beam: The best leaves so far; a leaf replaces the worst only if it is strictly better, by more than a tie.
        scratch: The window, and memory.
    """
    counts, path = scratch.window.counts, scratch.path
    s = split_depth(chain, counts)
    lanes, last = leaf_count(counts, s), limits.leaves
    work = limits.work
    if begin == 0:
        tabulate(chain, s, scratch)
        work -= _TABLE * lanes
    state = Searched(begin, FINISHED, work, worst_error(beam) - limits.tie)
    # The previous part may have ended between two leaves of one prefix.
    skip = begin % lanes
    write_path(begin // lanes, counts, s, path)
    identity(scratch.poses[0])
    d = 0
    while state.leaf < last:
        pose_along(chain, d, s, scratch)
        count = min(lanes, last - state.leaf + skip)
        smallest = lane_errors(scratch.poses[s], goal, count, scratch)
        after = state.leaf + count - skip
        if smallest < state.to_beat or smallest < limits.stop_below:
            state = keep_better(scratch.errors[skip:count], s, limits, state, beam, scratch)
            if state.ended != FINISHED:
                return state
        work, skip = state.work - count - _PREFIX, 0
        ended = PAUSED if work <= 0 and after < last else FINISHED
        state = Searched(after, ended, work, state.to_beat)
        if ended == PAUSED:
            return state
        d = next_branch(path, counts, 0, s)
    return state


@inlined_with_wrapper
def split_depth(chain: ChainArrays, counts: Indices) -> int:
    """Choose the number s of joints in the prefix; the other n - s are tabulated.

    The cost is the number of inner nodes above and below. The table must fit and must be the same for every prefix, so no
    joint of the suffix may mimic one of the prefix. If nothing can be tabulated, s is n, with one lane.
    """
    dof = len(counts)
    nodes, above, below, lanes = 1.0, 0.0, 0.0, 1.0
    for d in range(dof):
        nodes *= counts[d]
        above += nodes
    best, best_cost = dof, np.inf
    for s in range(dof - 1, -1, -1):
        above -= nodes
        nodes /= counts[s]
        below = counts[s] * (1.0 + below)
        lanes *= counts[s]
        pure = lanes <= MOST_LANES
        for k in range(chain.start[s], len(chain.leader)):
            pure = pure and chain.leader[k] >= s
        if pure and above + below < best_cost:
            best, best_cost = s, above + below
    return best


@kernel
def tabulate(chain: ChainArrays, s: int, scratch: WindowScratch) -> None:
    """Fill the lanes with the tip's pose for every combination of joints s … n-1."""
    counts, path = scratch.window.counts, scratch.path
    dof, joints = len(counts), len(chain.prismatic)
    tip = scratch.poses[dof]
    for d in range(s, dof):
        path[d] = 0
    identity(scratch.poses[s])
    lane, d = 0, s
    while d >= s:
        pose_along(chain, d, dof, scratch)
        advance(chain.fixed[joints], True, 0.0, tip)
        for r in range(3):
            scratch.lanes[0, r, lane] = tip[r, 0]
            scratch.lanes[1, r, lane] = tip[r, 1]
            scratch.lanes[2, r, lane] = tip[r, 3]
        lane += 1
        d = next_branch(path, counts, s, dof)


@inlined
def pose_along(chain: ChainArrays, first: int, last: int, scratch: WindowScratch) -> None:
    """Compute the poses along the current path behind joints first … last-1."""
    q, poses = scratch.path_q, scratch.poses
    for d in range(first, last):
        q[d] = scratch.window.values[d, scratch.path[d]]
        copy_pose(poses[d], poses[d + 1])
        advance_segment(chain, chain.start[d], chain.start[d + 1], q, poses[d + 1])


@inlined
def next_branch(path: Indices, counts: Indices, first: int, last: int) -> int:
    """Advance the path of joints first … last-1, last fastest; return the first joint that changed, first - 1 at the end."""
    d = last - 1
    while d >= first and path[d] + 1 == counts[d]:
        path[d] = 0
        d -= 1
    if d >= first:
        path[d] += 1
    return d


@inlined
def write_path(number: int, counts: Indices, last: int, path: Indices) -> None:
    """Write the path of a number of joints 0 … last-1: its digits, where joint d has the base counts[d]."""
    for d in range(last - 1, -1, -1):
        path[d] = number % counts[d]
        number //= counts[d]


@inlined
def leaf_count(counts: Indices, first: int) -> int:
    """Return the number of combinations of joints first … n-1, at most EVERYTHING."""
    leaves = 1
    for d in range(first, len(counts)):
        leaves = product(leaves, counts[d])
    return leaves


@inlined
def product(a: int, b: int) -> int:
    """Return a · b for positive numbers, at most EVERYTHING."""
    return EVERYTHING if a > EVERYTHING // b else a * b


@inlined
def lane_errors(P: Array, goal: GoalArrays, count: int, scratch: WindowScratch) -> float:
    """Write the weighted error of every tabulated leaf below the prefix pose P; return the smallest.

    ``K_P |p - p'| + K_x (1 - x·x') + K_y (1 - y·y')`` with the columns of the goal G' in the frame of the prefix.
    """
    G, lanes = goal.target, scratch.lanes
    kp, kx, ky = goal.position_weight, goal.axis_weights[0], goal.axis_weights[1]
    position = rotated_back(P, minus(column(G, 3), column(P, 3)))
    x_axis = scaled(kx, rotated_back(P, column(G, 0)))
    y_axis = scaled(ky, rotated_back(P, column(G, 1)))
    smallest = np.inf
    for j in range(count):
        away = minus(lane_vector(lanes, 2, j), position)
        x_dot, y_dot = dot(lane_vector(lanes, 0, j), x_axis), dot(lane_vector(lanes, 1, j), y_axis)
        error = kp * math.sqrt(dot(away, away)) + ((kx - x_dot) + (ky - y_dot))
        scratch.errors[j] = error
        smallest = min(smallest, error)
    return smallest


@inlined
def lane_vector(lanes: Array, c: int, j: int) -> Vector:
    """Column x, y or p, for c = 0, 1, 2, of tabulated tip j."""
    return Vector(lanes[c, 0, j], lanes[c, 1, j], lanes[c, 2, j])


@inlined
def keep_better(
    errors: Array, s: int, limits: Limits, state: Searched, beam: Beam, scratch: WindowScratch
) -> Searched:
    """Keep the best of the next leaves.

    Args:
        errors: Weighted errors of these leaves, (k,).
        s: Number of joints in the prefix that they share, whose path is in `scratch`.
        limits: When to end.
        state: State of the search.
        beam: The best leaves so far.
        scratch: The window, and memory.
    """
    leaf, work, to_beat = state.leaf, state.work, state.to_beat
    for i in range(len(errors)):
        error = errors[i]
        if error < to_beat:
            write_leaf(scratch, s, leaf + i)
            to_beat = offer(beam, error, scratch.leaf_nodes, scratch.leaf_q) - limits.tie
            work -= len(beam.errors)
        if error < limits.stop_below:
            return Searched(leaf + i + 1, STOPPED, work, to_beat)
        if work <= 0 and i + 1 < len(errors):
            return Searched(leaf + i + 1, PAUSED, work, to_beat)
    return Searched(leaf + len(errors), FINISHED, work, to_beat)


@inlined
def write_leaf(scratch: WindowScratch, s: int, leaf: int) -> None:
    """Write the nodes and the joint values of a leaf into `scratch`; the path has those of joints 0 … s-1."""
    window, nodes, q = scratch.window, scratch.leaf_nodes, scratch.leaf_q
    counts = window.counts
    for d in range(len(counts) - 1, -1, -1):
        i = scratch.path[d]
        if d >= s:
            i = leaf % counts[d]
            leaf //= counts[d]
        nodes[d] = window.nodes[d, i]
        q[d] = window.values[d, i]


@inlined_with_wrapper
def offer(beam: Beam, error: float, nodes: Indices, q: Array) -> float:
    """Insert a leaf into the beam unless it is there already; return the largest error in the beam."""
    worst, present = 0, False
    for k in range(len(beam.errors)):
        # A leaf has the same error in every window up to rounding, so nodes are compared only if errors agree.
        if abs(beam.errors[k] - error) <= 1e-12 * (1.0 + error):
            present = present or same_nodes(beam, k, nodes)
        if beam.errors[k] > beam.errors[worst]:
            worst = k
    if not present and error < beam.errors[worst]:
        beam.errors[worst] = error
        for d in range(len(nodes)):
            beam.nodes[worst, d] = nodes[d]
            beam.q[worst, d] = q[d]
    return worst_error(beam)


@inlined
def worst_error(beam: Beam) -> float:
    """Return the error a leaf must beat to enter a beam."""
    worst: float = beam.errors[0]
    for k in range(1, len(beam.errors)):
        worst = max(worst, beam.errors[k])
    return worst


@inlined
def same_nodes(beam: Beam, k: int, nodes: Indices) -> bool:
    """Return whether place k of a beam holds these nodes."""
    same = True
    for d in range(len(nodes)):
        same = same and beam.nodes[k, d] == nodes[d]
    return same


@inlined
def clear(beam: Beam) -> None:
    """Empty a beam."""
    for k in range(len(beam.errors)):
        beam.errors[k] = np.inf


@inlined_with_wrapper
def nodes_expanded(counts: Indices, leaves: int) -> int:
    """Nodes that a depth-first search has expanded when it has evaluated so many leaves: Σ_d ⌈leaves / Π_{i > d} counts_i⌉.

    For all leaves of a window with B values a joint this is Eq. 1 of the paper.
    """
    total, below = 0, 1
    for d in range(len(counts) - 1, -1, -1):
        total += (leaves - 1) // below + 1
        below = product(below, counts[d])
    return total
