"""The first pass over joint values in a scene: balls around groups for eight q at a time, then pairs of parts, q by q."""

from __future__ import annotations

import numpy as np

from kinseek.kernels.arrays import Array, Flags, Indices
from kinseek.kernels.entry import F64, FLAG, I64
from kinseek.kernels.jit import entry, hidden

from .cell import CELL, LANES, Cell, Here, enter, lanes_frames, make_here, place
from .gaps import DOUBT, FREE, TOUCH, ball_gap, gap_below, is_clear, settle, straddle


@hidden
def load_lanes(q: Array, first: int, lanes: Array) -> None:
    """Eight q from row `first` on, (n, LANES); beyond the end the last one again."""
    for l in range(LANES):
        k = min(first + l, len(q) - 1)
        for i in range(q.shape[1]):
            lanes[i, l] = q[k, i]


@hidden
def lanes_balls(cell: Cell, frames: Array, balls: Array, w: int) -> None:
    """Middles of the balls of all groups, (group, 3 · LANES)."""
    W = LANES
    for g in range(len(cell.group)):
        p, B = cell.group[g], balls[g]
        T, x, y, z = frames[cell.joint[p]], cell.ball[p, 0], cell.ball[p, 1], cell.ball[p, 2]
        for l in range(w):
            B[l] = T[l] * x + T[W + l] * y + T[2 * W + l] * z + T[3 * W + l]
            B[W + l] = T[4 * W + l] * x + T[5 * W + l] * y + T[6 * W + l] * z + T[7 * W + l]
            B[2 * W + l] = T[8 * W + l] * x + T[9 * W + l] * y + T[10 * W + l] * z + T[11 * W + l]


@hidden
def settle_meeting(
    cell: Cell, here: Here, m: int, clearance: float, least: float, steps: int, verdict: int, doubts: Flags
) -> int:
    """The verdict, where some groups have been looked at and two more are; pairs in doubt are noted."""
    g, h = cell.group[cell.meeting[m, 0]], cell.group[cell.meeting[m, 1]]
    first, last = cell.meeting[m, 2], cell.meeting[m, 3]
    place(cell, here, g)
    place(cell, here, h)
    if last - first > 1:
        # What is free of all that holds the parts is free of each.
        most = least + cell.widest[m]
        if is_clear(cell, here, g, h, most) or straddle(cell, here, g, h, most, -1e300, steps) == FREE:
            return verdict
    for n in range(first, last):
        a, b, pad = cell.pair[n, 0], cell.pair[n, 1], cell.pad[n]
        place(cell, here, a)
        place(cell, here, b)
        if ball_gap(cell, here, a, b) > least + pad:
            continue
        found = settle(cell, here, a, b, least + pad, clearance + pad + cell.rounding, steps)
        if found == TOUCH:
            return TOUCH
        if found == DOUBT:
            verdict = DOUBT
            doubts[cell.pair[n, 2]] = True
    return verdict


@entry(
    cell=CELL,
    q=F64["k", "n"],
    clearance=F64,
    least=F64,
    steps=I64,
    w=I64,
    verdicts=I64["k"].out,
    doubts=FLAG["k", "pair"].out,
)
def sort_out(
    cell: Cell, q: Array, clearance: float, least: float, steps: int, w: int, verdicts: Indices, doubts: Flags
) -> None:
    """Sort joint values into those that are free for sure, those that touch for sure, and the others.

    Args:
        cell: The scene.
        q: (k, n) [rad] or [m]
        clearance: What is nearer than this, padding taken off, touches [m].
        least: What is farther apart than this is free [m].
        steps: How long to look for a plane between two parts, or for a point in both.
        w: `LANES`.
        verdicts: `FREE`, `TOUCH` or `DOUBT`, (k,).
        doubts: Pairs that are in doubt, False before, (k, pair).
    """
    chain, W = cell.chain, LANES
    lanes, frames = np.empty((q.shape[1], W)), np.empty((len(chain.leader) + 1, 12 * W))
    balls, gaps = np.empty((len(cell.group), 3 * W)), np.empty(W)
    meetings = len(cell.meeting)
    near, counts = np.empty((W, meetings), dtype=np.int64), np.empty(W, dtype=np.int64)
    here = make_here(cell)
    for first in range(0, len(q), W):
        load_lanes(q, first, lanes)
        lanes_frames(chain, lanes, frames, w)
        lanes_balls(cell, frames, balls, w)
        for l in range(W):
            counts[l] = 0
        for m in range(meetings):
            g, h = cell.meeting[m, 0], cell.meeting[m, 1]
            reach = cell.ball[cell.group[g], 3] + cell.ball[cell.group[h], 3] + cell.widest[m] + least
            square, G, H = reach * reach, balls[g], balls[h]
            some = 0
            for l in range(w):
                dx, dy, dz = G[l] - H[l], G[W + l] - H[W + l], G[2 * W + l] - H[2 * W + l]
                gap = dx * dx + dy * dy + dz * dz - square
                gaps[l] = gap
                some += 1 if gap <= 0.0 else 0
            if some > 0:
                for l in range(W):
                    if gaps[l] <= 0.0:
                        near[l, counts[l]] = m
                        counts[l] += 1
        for l in range(min(W, len(q) - first)):
            k, verdict = first + l, FREE
            if counts[l] > 0:
                enter(cell, here, frames, l)
            for each in range(counts[l]):
                if verdict != TOUCH:
                    m = near[l, each]
                    verdict = settle_meeting(cell, here, m, clearance, least, steps, verdict, doubts[k])
            verdicts[k] = verdict


@entry(cell=CELL, q=F64["k", "n"], steps=I64, w=I64, bounds=F64["k", "pair"].out)
def bound_pairs(cell: Cell, q: Array, steps: int, w: int, bounds: Array) -> None:
    """Bounds from below on the distance of every pair, (k, pair) [m]; where one is below 0 it says nothing.

    Args:
        cell: The scene.
        q: (k, n) [rad] or [m]
        steps: How long to look for a better one where a pair may be the nearest of all; with 0 spheres alone tell.
        w: `LANES`.
        bounds: Is filled.
    """
    chain, W = cell.chain, LANES
    lanes, frames = np.empty((q.shape[1], W)), np.empty((len(chain.leader) + 1, 12 * W))
    here = make_here(cell)
    for first in range(0, len(q), W):
        load_lanes(q, first, lanes)
        lanes_frames(chain, lanes, frames, w)
        for l in range(min(W, len(q) - first)):
            enter(cell, here, frames, l)
            k, nearest = first + l, 1e300
            for m in range(len(cell.meeting)):
                g, h = cell.group[cell.meeting[m, 0]], cell.group[cell.meeting[m, 1]]
                place(cell, here, g)
                place(cell, here, h)
                apart = ball_gap(cell, here, g, h)
                for n in range(cell.meeting[m, 2], cell.meeting[m, 3]):
                    a, b, pad = cell.pair[n, 0], cell.pair[n, 1], cell.pad[n]
                    bound = apart
                    if steps == 0 or apart - pad < nearest:
                        place(cell, here, a)
                        place(cell, here, b)
                        bound = max(bound, gap_below(cell, here, a, b))
                        if steps > 0 and bound - pad < nearest:
                            straddle(cell, here, a, b, 1e300, -1e300, steps)
                            bound = max(bound, here.spot[9])
                            if cell.within[a] == a and cell.within[b] == b:
                                nearest = min(nearest, here.spot[10] - pad)
                    bounds[k, cell.pair[n, 2]] = bound - pad - cell.rounding
