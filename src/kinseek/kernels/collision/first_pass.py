"""The first pass over joint values in a scene: balls and boxes around groups for eight q at a time, then parts, q by q."""

from __future__ import annotations

import math

import numpy as np

from kinseek.kernels.arm.forward import FAR
from kinseek.kernels.arrays import Array, Flags, Indices
from kinseek.kernels.entry import F64, FLAG, I64
from kinseek.kernels.jit import entry, inlined

from .cell import (
    LANES,
    Cell,
    Here,
    cell_of,
    enter,
    lanes_frames,
    load_lanes,
    make_here,
    memory_for,
    place,
)
from .gaps import (
    DOUBT,
    FREE,
    TOUCH,
    ball_gap,
    depth_below,
    gap_below,
    glance,
    near_core,
    settle,
    straddle,
    way_into,
)


@inlined
def keep(memory: Array) -> None:
    """Use a memory for the last time: views by address do not hold it, and Numba gives back what is not used any more."""
    memory[0] = 0.0


PART_OF_TURN = 0.5 / math.pi


@inlined
def lanes_balls(cell: Cell, here: Here, moving: bool, w: int) -> None:
    """Middles of the balls of all groups that move, or of all that stand, at the eight q."""
    W = LANES
    for g in range(len(cell.group)):
        p, B = cell.group[g], here.balls[g]
        if (cell.joint[p] > 0) != moving:
            continue
        T, x, y, z = here.frames[cell.joint[p]], cell.ball[p, 0], cell.ball[p, 1], cell.ball[p, 2]
        for r in range(3):
            o = 4 * r * W
            for l in range(w):
                B[r * W + l] = T[o + l] * x + T[o + W + l] * y + T[o + 2 * W + l] * z + T[o + 3 * W + l]


@inlined
def lanes_inside(cell: Cell, here: Here, w: int) -> bool:
    """Are all of the eight q inside the limits?"""
    outside = 0
    for i in range(len(cell.chain.lower)):
        q, low, high = here.lanes[i], cell.chain.lower[i], cell.chain.upper[i]
        for l in range(w):
            outside += 1 if q[l] < low or q[l] > high else 0
    return outside == 0


@inlined
def lanes_near(cell: Cell, here: Here, least: float, w: int) -> None:
    """Note for each of the eight q which meetings have to be looked at: whose groups the balls do not show to be free."""
    inside = lanes_inside(cell, here, w)
    W, gaps, counts = LANES, here.gaps, here.counts
    for l in range(W):
        counts[l], here.hits[l] = 0, 0
    for m in range(len(cell.meeting)):
        if inside and cell.apart_inside[m] > least:
            break
        if cell.apart[m] > least:
            continue
        G, H = here.balls[cell.meeting[m, 0]], here.balls[cell.meeting[m, 1]]
        g, h = cell.group[cell.meeting[m, 0]], cell.group[cell.meeting[m, 1]]
        reach = cell.ball[g, 3] + cell.ball[h, 3] + cell.widest[m] + least
        square = reach * reach
        some = 0
        for l in range(w):
            dx, dy, dz = G[l] - H[l], G[W + l] - H[W + l], G[2 * W + l] - H[2 * W + l]
            some += 1 if dx * dx + dy * dy + dz * dz <= square else 0
        if some == 0:
            continue
        for l in range(w):
            dx, dy, dz = G[l] - H[l], G[W + l] - H[W + l], G[2 * W + l] - H[2 * W + l]
            gaps[l] = dx * dx + dy * dy + dz * dz - square
        if cell.joint[g] == 0:  # What stands: its core is the same for all of them.
            place(cell, here, g)
            M, ex, ey, ez = here.into[g], cell.half[g, 0], cell.half[g, 1], cell.half[g, 2]
            reach = cell.ball[h, 3] + cell.thick[g] + cell.widest[m] + least
            square = reach * reach
            m0, m1, m2, m3, m4, m5 = M[0], M[1], M[2], M[3], M[4], M[5]
            m6, m7, m8, m9, m10, m11 = M[6], M[7], M[8], M[9], M[10], M[11]
            for l in range(w):
                x, y, z = H[l], H[W + l], H[2 * W + l]
                dx = max(abs(m0 * x + m1 * y + m2 * z + m3) - ex, 0.0)
                dy = max(abs(m4 * x + m5 * y + m6 * z + m7) - ey, 0.0)
                dz = max(abs(m8 * x + m9 * y + m10 * z + m11) - ez, 0.0)
                gaps[l] = max(gaps[l], dx * dx + dy * dy + dz * dz - square)
        if cell.chart_of[m] >= 0:
            look_up(cell, here, m, least, w)
        for l in range(W):
            here.near[l, counts[l]] = m
            counts[l] += 1 if gaps[l] <= 0.0 else 0


@inlined
def look_up(cell: Cell, here: Here, m: int, least: float, w: int) -> None:
    """Mark in `Here.gaps` where the chart of a meeting tells enough, and in `Here.hits` where it tells that groups touch."""
    axes, chart, gaps, hits = cell.chart_axes[cell.chart_of[m]], cell.chart, here.gaps, here.hits
    j, k, rows, columns, first = axes[0], axes[1], axes[2], axes[3], axes[4]
    one, other = here.lanes[cell.chain.leader[j]], here.lanes[cell.chain.leader[k]]
    for l in range(w):
        u = (cell.chain.multiplier[j] * one[l] + cell.chain.offset[j]) * PART_OF_TURN
        v = (cell.chain.multiplier[k] * other[l] + cell.chain.offset[k]) * PART_OF_TURN
        # From 0 on: what is made an integer of NaN may be anything, and such a q is in doubt later.
        row = max(min(int((u - np.floor(u)) * rows), rows - 1), 0)
        column = max(min(int((v - np.floor(v)) * columns), columns - 1), 0)
        bound = chart[first + row * columns + column]
        gaps[l] = 1.0 if bound > least or bound < 0.0 else gaps[l]
        hits[l] = 1 if bound < 0.0 else hits[l]


@inlined
def look_closer(cell: Cell, here: Here, m: int) -> float:
    """What the chart of a meeting tells of the q that is looked at, down to the smallest part of its cell."""
    axes, chart, below, l = cell.chart_axes[cell.chart_of[m]], cell.chart, cell.below, here.now[0]
    j, k, rows, columns, first = axes[0], axes[1], axes[2], axes[3], axes[4]
    one, other = here.lanes[cell.chain.leader[j], l], here.lanes[cell.chain.leader[k], l]
    u = (cell.chain.multiplier[j] * one + cell.chain.offset[j]) * PART_OF_TURN
    v = (cell.chain.multiplier[k] * other + cell.chain.offset[k]) * PART_OF_TURN
    u, v = (u - np.floor(u)) * rows, (v - np.floor(v)) * columns
    row, column = min(int(u), rows - 1), min(int(v), columns - 1)
    at = first + row * columns + column
    while below[at] > 0:
        # What is left of a cell, in parts of it: one joint's is cut into four, two joints' into two by two.
        u, v = u - row, v - column
        if j == k:
            u, v = 0.0, 4.0 * v
            row, column = 0, min(int(v), 3)
            at = first + below[at] + column
        else:
            u, v = 2.0 * u, 2.0 * v
            row, column = min(int(u), 1), min(int(v), 1)
            at = first + below[at] + 2 * row + column
    bound: float = chart[at]
    return bound


@inlined
def glance_at_meeting(cell: Cell, here: Here, m: int, clearance: float, least: float, left: int) -> int:
    """Add pairs of two groups that are left to be decided to so many others, and count all; -1 where some touch."""
    if cell.chart_of[m] >= 0:
        bound = look_closer(cell, here, m)
        if bound > least:
            return left
        if bound < 0.0:
            return -1
    g, h = cell.group[cell.meeting[m, 0]], cell.group[cell.meeting[m, 1]]
    first, last = cell.meeting[m, 2], cell.meeting[m, 3]
    if last - first > 1:
        # What is free of all that holds the parts is free of each.
        way_into(cell, here, h, g)
        if near_core(cell.rough[h], here.spot, cell.half[g], least + cell.widest[m] + cell.thick[g]) == 0:
            return left
    for n in range(first, last):
        a, b, pad = cell.pair[n, 0], cell.pair[n, 1], cell.pad[n]
        if last - first > 1 and ball_gap(cell, here, a, b) > least + pad:
            continue
        found = glance(cell, here, a, b, least + pad, clearance + pad + cell.rounding[0])
        if found == TOUCH:
            return -1
        if found == DOUBT:
            here.left[left] = n
            left += 1
    return left


@inlined
def settle_left(
    cell: Cell, here: Here, left: int, clearance: float, least: float, steps: int, doubts: Flags
) -> int:
    """The verdict on so many pairs, where all others are free; those in doubt are noted, if that is asked."""
    verdict = FREE
    for each in range(left):
        n = here.left[each]
        a, b, pad = cell.pair[n, 0], cell.pair[n, 1], cell.pad[n]
        found = settle(cell, here, a, b, least + pad, clearance + pad + cell.rounding[0], steps)
        if found == TOUCH:
            return TOUCH
        if found == DOUBT:
            verdict = DOUBT
            if len(doubts) > 0:
                doubts[cell.pair[n, 2]] = True
    return verdict


@inlined
def is_far(q: Array) -> bool:
    """Is a joint value beyond those at which the quick sine is good to the last bits, or no number?"""
    far = False
    for i in range(len(q)):
        far = far or not abs(q[i]) <= FAR
    return far


@inlined
def is_number(q: Array) -> bool:
    """Is every joint value finite?"""
    finite = True
    for i in range(len(q)):
        finite = finite and abs(q[i]) < np.inf
    return finite


@entry(
    returns=I64,
    handle=I64["*"],
    q=F64["k", "n"],
    clearance=F64,
    least=F64,
    steps=I64,
    w=I64,
    verdicts=I64["k"].out,
    doubts=FLAG["*", "*"].out,
)
def sort_out(
    handle: Indices,
    q: Array,
    clearance: float,
    least: float,
    steps: int,
    w: int,
    verdicts: Indices,
    doubts: Flags,
) -> int:
    """Sort joint values into those that are free for sure, those that touch for sure, and the others.

    Args:
        handle: The scene, see `cell.ROWS`.
        q: (k, n) [rad] or [m]
        clearance: What is nearer than this, padding taken off, touches [m].
        least: What is farther apart than this is free [m].
        steps: How long to look for a plane between two parts, or for a point in both.
        w: `LANES`.
        verdicts: `FREE`, `TOUCH` or `DOUBT`, (k,).
        doubts: Pairs that are in doubt, False before, (k, pair); or (0, 0), and they are not told.

    Returns:
        How many are in doubt.
    """
    cell = cell_of(handle, 0)
    memory = np.empty(memory_for(cell))
    here = make_here(cell, memory)
    nowhere = np.empty(0, dtype=np.bool_)
    in_doubt = 0
    lanes_balls(cell, here, False, w)
    for first in range(0, len(q), LANES):
        load_lanes(q, first, here.lanes)
        lanes_frames(cell.chain, here, w)
        lanes_balls(cell, here, True, w)
        lanes_near(cell, here, least, w)
        for l in range(min(LANES, len(q) - first)):
            k, verdict = first + l, FREE
            told = doubts[k] if len(doubts) > 0 else nowhere
            enter(here, l)
            if is_far(q[k]):
                verdict = DOUBT
                told[:] = True
            elif here.hits[l] == 1:
                verdict = TOUCH
            else:
                # What is cheap goes first: where spheres show that two parts touch, nothing has to be decided.
                left = 0
                for each in range(here.counts[l]):
                    if left >= 0:
                        left = glance_at_meeting(cell, here, here.near[l, each], clearance, least, left)
                verdict = TOUCH if left < 0 else settle_left(cell, here, left, clearance, least, steps, told)
            verdicts[k] = verdict
            in_doubt += 1 if verdict == DOUBT else 0
    keep(memory)
    return in_doubt


@entry(handle=I64["*"], q=F64["k", "n"], steps=I64, w=I64, bounds=F64["k", "*"].out)
def bound_pairs(handle: Indices, q: Array, steps: int, w: int, bounds: Array) -> None:
    """Bounds from below on the distance of every pair, (k, pair) [m]; where one is below 0 it says nothing.

    Args:
        handle: The scene, see `cell.ROWS`.
        q: (k, n) [rad] or [m]
        steps: How long to look for a better one where a pair may be the nearest of all; with 0 spheres alone tell.
        w: `LANES`.
        bounds: Is filled.
    """
    cell = cell_of(handle, 0)
    memory = np.empty(memory_for(cell))
    here = make_here(cell, memory)
    for first in range(0, len(q), LANES):
        load_lanes(q, first, here.lanes)
        lanes_frames(cell.chain, here, w)
        for l in range(min(LANES, len(q) - first)):
            enter(here, l)
            k, nearest = first + l, 1e300
            if not is_number(q[k]):
                bounds[k, :] = -1.0
                continue
            for m in range(len(cell.meeting)):
                g, h = cell.group[cell.meeting[m, 0]], cell.group[cell.meeting[m, 1]]
                apart = ball_gap(cell, here, g, h)
                for n in range(cell.meeting[m, 2], cell.meeting[m, 3]):
                    a, b, pad = cell.pair[n, 0], cell.pair[n, 1], cell.pad[n]
                    bound = apart
                    if steps == 0 or apart - pad < nearest:
                        bound = max(bound, gap_below(cell, here, a, b))
                        if steps > 0 and bound - pad < nearest:
                            straddle(cell, here, a, b, 1e300, -1e300, steps)
                            bound = max(bound, here.spot[9])
                            if cell.within[a] == a and cell.within[b] == b:
                                nearest = min(nearest, here.spot[10] - pad)
                    bounds[k, cell.pair[n, 2]] = bound - pad - cell.rounding[0]
    keep(memory)


@entry(handle=I64["*"], q=F64["k", "n"], bounds=F64["k", "*"], w=I64, depths=F64["k"].out)
def bound_depths(handle: Indices, q: Array, bounds: Array, w: int, depths: Array) -> None:
    """So far at least the parts of one pair, at every q another perhaps, have to move to be free of each other, (k,) [m].

    Args:
        handle: The scene, see `cell.ROWS`.
        q: (k, n) [rad] or [m]
        bounds: Of `bound_pairs`; what they show to be apart is not looked at.
        w: `LANES`.
        depths: Is filled; where one is below 0 it says nothing.
    """
    cell = cell_of(handle, 0)
    memory = np.empty(memory_for(cell))
    here = make_here(cell, memory)
    for first in range(0, len(q), LANES):
        load_lanes(q, first, here.lanes)
        lanes_frames(cell.chain, here, w)
        for l in range(min(LANES, len(q) - first)):
            enter(here, l)
            depth = -1e300
            for n in range(len(cell.pair)):
                if bounds[first + l, cell.pair[n, 2]] <= 0.0:
                    depth = max(depth, depth_below(cell, here, cell.pair[n, 0], cell.pair[n, 1]))
            depths[first + l] = depth - cell.rounding[0]
    keep(memory)
