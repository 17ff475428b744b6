"""Exhaustive search of a small grid of joint values: the inner loop of every tree search.

The tree is searched depth first, last joint fastest, as in the paper. Two measures make it fast without changing the
result. The pose of a prefix q_1 … q_s is computed once for all leaves below it. The last joints are tabulated once, so
that a leaf is a few products in SIMD lanes. With the prefix's pose P, the goal is transformed into its frame, G' = P⁻¹ G,
and compared with each tabulated pose of the tip in that frame.

All memory belongs to the caller, in bundles that are passed in and never returned: to return a bundle to Python, Numba
calls its class, a signal handler may raise there, and Numba does not check for it. A search of many leaves is divided
into parts, between which signals are handled and time limits are kept; the result is the same, bit for bit.

Plain loops replace shorter NumPy expressions (`a == b`, `.max()`, `a[i] = b[j]`), because each of these costs the first
run up to four seconds of compiling.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from kinseek.kernels.arm.forward import advance, advance_segment, copy_pose, identity
from kinseek.kernels.arrays import Array, ChainArrays, GoalArrays, Indices
from kinseek.kernels.jit import entry, inlined_with_wrapper, kernel

from .memory import MOST_LANES, Beam, NodeScratch, Window

PART = 1 << 22
"""Work of one part of a search in leaves, about ten milliseconds."""

_PREFIX, _TABLE = 16, 16
"""Approximate cost of the pose of a prefix, and of an entry of the table, in leaves."""

WHOLE, EARLY, PAUSED = 0, 1, 2
"""How a part of a search ended: everything is searched; a stop or the budget ended it; or it is to be continued."""


@inlined_with_wrapper
def clear(beam: Beam) -> None:
    """Empty a beam."""
    for k in range(len(beam.errors)):
        beam.errors[k] = np.inf


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
def tabulate(chain: ChainArrays, window: Window, s: int, scratch: NodeScratch) -> int:
    """Fill the lanes with the tip's pose for every combination of joints s … n-1; return their number."""
    dof, joints = len(window.counts), len(chain.prismatic)
    path, q, poses, T = scratch.path, scratch.q, scratch.poses, np.empty((3, 4))
    for d in range(s, dof):
        path[d] = 0
    identity(poses[s])
    lane = 0
    d = s
    while True:
        while d < dof:
            q[d] = window.values[d, path[d]]
            copy_pose(poses[d], poses[d + 1])
            advance_segment(chain, chain.start[d], chain.start[d + 1], q, poses[d + 1])
            d += 1
        copy_pose(poses[dof], T)
        advance(chain.fixed[joints], True, 0.0, T)
        for r in range(3):
            scratch.lanes[r, lane] = T[r, 0]
            scratch.lanes[3 + r, lane] = T[r, 1]
            scratch.lanes[6 + r, lane] = T[r, 3]
        lane += 1
        d = dof - 1
        while d >= s and path[d] + 1 == window.counts[d]:
            path[d] = 0
            d -= 1
        if d < s:
            return lane
        path[d] += 1


@inlined_with_wrapper
def lane_errors(P: Array, goal: GoalArrays, lanes: Array, count: int, errors: Array) -> float:
    """Write the weighted error of every tabulated leaf below the prefix pose P; return the smallest."""
    G = goal.target
    dx, dy, dz = G[0, 3] - P[0, 3], G[1, 3] - P[1, 3], G[2, 3] - P[2, 3]
    px = P[0, 0] * dx + P[1, 0] * dy + P[2, 0] * dz
    py = P[0, 1] * dx + P[1, 1] * dy + P[2, 1] * dz
    pz = P[0, 2] * dx + P[1, 2] * dy + P[2, 2] * dz
    kp, kx, ky = goal.position_weight, goal.axis_weights[0], goal.axis_weights[1]
    xx = kx * (P[0, 0] * G[0, 0] + P[1, 0] * G[1, 0] + P[2, 0] * G[2, 0])
    xy = kx * (P[0, 1] * G[0, 0] + P[1, 1] * G[1, 0] + P[2, 1] * G[2, 0])
    xz = kx * (P[0, 2] * G[0, 0] + P[1, 2] * G[1, 0] + P[2, 2] * G[2, 0])
    yx = ky * (P[0, 0] * G[0, 1] + P[1, 0] * G[1, 1] + P[2, 0] * G[2, 1])
    yy = ky * (P[0, 1] * G[0, 1] + P[1, 1] * G[1, 1] + P[2, 1] * G[2, 1])
    yz = ky * (P[0, 2] * G[0, 1] + P[1, 2] * G[1, 1] + P[2, 2] * G[2, 1])
    smallest = np.inf
    for j in range(count):
        ex, ey, ez = lanes[6, j] - px, lanes[7, j] - py, lanes[8, j] - pz
        x_dot = lanes[0, j] * xx + lanes[1, j] * xy + lanes[2, j] * xz
        y_dot = lanes[3, j] * yx + lanes[4, j] * yy + lanes[5, j] * yz
        error = kp * math.sqrt(ex * ex + ey * ey + ez * ez) + ((kx - x_dot) + (ky - y_dot))
        errors[j] = error
        smallest = min(smallest, error)
    return smallest


@inlined_with_wrapper
def offer(beam: Beam, error: float, nodes: Indices, q: Array) -> float:
    """Insert a leaf into the beam unless it is there already; return the largest error in the beam."""
    worst, twin = 0, False
    for k in range(len(beam.errors)):
        if abs(beam.errors[k] - error) <= 1e-12 * (1.0 + error):
            twin = twin or same_nodes(beam, k, nodes)
        if beam.errors[k] > beam.errors[worst]:
            worst = k
    if not twin and error < beam.errors[worst]:
        beam.errors[worst] = error
        for d in range(len(nodes)):
            beam.nodes[worst, d] = nodes[d]
            beam.q[worst, d] = q[d]
    return worst_error(beam)


@inlined_with_wrapper
def worst_error(beam: Beam) -> float:
    """Return the error a leaf must beat to enter a beam."""
    worst: float = beam.errors[0]
    for k in range(1, len(beam.errors)):
        worst = max(worst, beam.errors[k])
    return worst


@inlined_with_wrapper
def same_nodes(beam: Beam, k: int, nodes: Indices) -> bool:
    """Return whether place k of a beam holds these nodes."""
    same = True
    for d in range(len(nodes)):
        same = same and beam.nodes[k, d] == nodes[d]
    return same


@inlined_with_wrapper
def choose_lane(window: Window, s: int, lane: int, scratch: NodeScratch, nodes: Indices) -> None:
    """Write the leaf of a lane below the current prefix: nodes, and values in scratch.q."""
    for d in range(len(window.counts)):
        nodes[d] = window.nodes[d, scratch.path[d]]
        scratch.q[d] = window.values[d, scratch.path[d]]
    for d in range(len(window.counts) - 1, s - 1, -1):
        value = lane % window.counts[d]
        lane //= window.counts[d]
        nodes[d] = window.nodes[d, value]
        scratch.q[d] = window.values[d, value]


@inlined_with_wrapper
def nodes_until(counts: Indices, leaf: int) -> int:
    """Number of nodes that a depth-first search has expanded when it reaches leaf number `leaf`, itself included."""
    total, below = 0, 1
    for d in range(len(counts) - 1, -1, -1):
        total += leaf // below + 1
        below *= counts[d]
    return total


@entry
def search_part(
    chain: ChainArrays,
    goal: GoalArrays,
    window: Window,
    stop_below: float,
    tie: float,
    budget: int,
    begin: int,
    work: int,
    beam: Beam,
    scratch: NodeScratch,
) -> tuple[int, int, int]:
    """Search a window from a leaf on, last joint fastest, and keep the best leaves.

    Args:
        chain: The arm.
        goal: The goal.
        window: The values of each joint.
        stop_below: Stop at the first leaf in order whose error is below this.
        tie: Errors that differ by at most this are equal, and the first in order is kept; with 0 rounding decides.
        budget: Largest number of leaves, counted from the first of the window; the search stops before the next.
        begin: Leaf to begin at; if it is not 0, the scratch memory must be as the previous part left it.
        work: Work limit of this part, in leaves; it may be exceeded slightly.
        beam: The best leaves so far; a leaf replaces the worst only if it is strictly better, by more than `tie`.
        scratch: Memory from `make_node_scratch`.

    Returns:
        Leaves evaluated in order from the first of the window on; WHOLE, EARLY or PAUSED; and the remaining work.
    """
    dof, path, q, poses = len(window.counts), scratch.path, scratch.q, scratch.poses
    s = split_depth(chain, window.counts)
    leaves = skip = d = 0
    if begin == 0:
        lanes = tabulate(chain, window, s, scratch)
        work -= _TABLE * lanes
        for i in range(dof):
            path[i] = 0
    else:
        lanes = 1
        for i in range(s, dof):
            lanes *= window.counts[i]
        block = begin // lanes
        leaves, skip = block * lanes, begin - block * lanes
        for i in range(s - 1, -1, -1):
            path[i] = block % window.counts[i]
            block //= window.counts[i]
    nodes = np.empty(dof, dtype=np.int64)
    to_beat = worst_error(beam) - tie
    identity(poses[0])
    while leaves < budget:
        while d < s:
            q[d] = window.values[d, path[d]]
            copy_pose(poses[d], poses[d + 1])
            advance_segment(chain, chain.start[d], chain.start[d + 1], q, poses[d + 1])
            d += 1
        count = min(lanes, budget - leaves)
        smallest = lane_errors(poses[s], goal, scratch.lanes, count, scratch.errors)
        if smallest < to_beat or smallest < stop_below:
            for lane in range(skip, count):
                error = scratch.errors[lane]
                if error < to_beat:
                    choose_lane(window, s, lane, scratch, nodes)
                    to_beat = offer(beam, error, nodes, q) - tie
                    work -= len(beam.errors)
                if error < stop_below:
                    return leaves + lane + 1, EARLY, work
                if work <= 0 and lane + 1 < count:
                    return leaves + lane + 1, PAUSED, work
        skip = 0
        leaves += count
        work -= count + _PREFIX
        d = s - 1
        while d >= 0 and path[d] + 1 == window.counts[d]:
            path[d] = 0
            d -= 1
        if d < 0:
            return leaves, EARLY if count < lanes else WHOLE, work
        path[d] += 1
        if work <= 0 and leaves < budget:
            return leaves, PAUSED, work
    return leaves, EARLY, work


def search_window(
    chain: ChainArrays,
    goal: GoalArrays,
    window: Window,
    stop_below: float,
    budget: int,
    beam: Beam,
    scratch: NodeScratch,
    out_of_time: Callable[[], bool] = lambda: False,
    part: int = PART,
    tie: float = 0.0,
    done: Callable[[int], object] = lambda leaves: None,
) -> tuple[int, bool]:
    """Search a window part after part, and report the leaves so far to `done`; see `search_part`.

    Returns:
        Leaves evaluated in order up to the stop, and whether the search ended early.
    """
    leaves, ended = 0, PAUSED
    while ended == PAUSED and not (leaves and out_of_time()):
        leaves, ended, _ = search_part(
            chain, goal, window, stop_below, tie, budget, leaves, part, beam, scratch
        )
        done(leaves)
    return leaves, ended != WHOLE


@inlined_with_wrapper
def window_nodes(counts: Indices) -> int:
    """Nodes of the full tree over a window: Σ_d Π_{i ≤ d} counts_i, Eq. 1 of the paper where all are B."""
    total, level = 0, 1
    for d in range(len(counts)):
        level *= counts[d]
        total += level
    return total
