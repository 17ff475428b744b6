"""All solutions of an arm with one searched joint: sign changes of the residual, see `one_joint_residual`.

The joint is sampled. There is a solution between two samples with residuals of different signs. A branch ends where one
of its equations has a double root: two branches meet there in one curve, and the residual varies with the square root of
the distance from the end. Eight more samples are placed between the last samples and the end, so spaced that the residual
is smooth along them. The same is done where an equation nearly has a double root, and where the residual approaches zero
and turns back.
"""

from __future__ import annotations

import math

import numpy as np

from kinseek.kernels.arm.division import nearest_copy
from kinseek.kernels.arrays import Array, Indices
from kinseek.kernels.atlas.lanes import LANES
from kinseek.kernels.atlas.task import task_of
from kinseek.kernels.jit import inlined, noinline
from kinseek.kernels.structure.candidates import displacement

from .one_joint_residual import (
    APART,
    AXIS,
    BEGIN,
    LANE_ROWS,
    OTHER,
    PLACES,
    SAMPLES,
    SEARCHED,
    between,
    complete,
    write_residuals,
)

SEGMENTS, ROOTS = 48, 48
"""Largest number of places that are searched closely, and of solutions."""


ENDS, NEARLY, DIPS = range(3)
"""Kinds of these places: a branch ends; an equation nearly has a double root; the residual comes close to zero."""


BESIDE = 0.02
"""Largest distance of a start beyond a limit [rad], because starts are not exact."""


NARROW, LOW = 2.0, 0.2
"""Thresholds of closeness, for an equation and for the residual, relative to their second differences between samples."""


FLAT, FREE = 1e-4, 2e-4
"""Residual between samples, and distance of the point from axis 1 relative to the arm's size, below which a joint is
undetermined. The solutions are then continua, within the tolerances."""


MANY, TWINS, UNSURE = range(3)
"""Indices into the report on starts: their number; 1 if solutions may be close together, else 0; and 1 if there may be
solutions that no start leads to, else 0."""


@inlined
def crossing(y0: float, y1: float, y2: float, y3: float) -> float:
    """Zero between 1 and 2 of a cubic through values at 0, 1, 2 and 3; y1 and y2 have different signs."""
    low, high, at_low = 1.0, 2.0, y1
    x = 1.0 + y1 / (y1 - y2)
    for _ in range(6):
        a, b, c, d = x, x - 1.0, x - 2.0, x - 3.0
        y = -b * c * d / 6.0 * y0 + 0.5 * a * c * d * y1 - 0.5 * a * b * d * y2 + a * b * c / 6.0 * y3
        slope = (
            -(c * d + b * d + b * c) / 6.0 * y0
            + 0.5 * (c * d + a * d + a * c) * y1
            - 0.5 * (b * d + a * d + a * b) * y2
            + (b * c + a * c + a * b) / 6.0 * y3
        )
        low, high = (x, high) if y * at_low > 0.0 else (low, x)
        step = x - y / slope if slope != 0.0 else low
        x = step if low < step < high else 0.5 * (low + high)
    return x


@inlined
def segment(kind: int, row: int, begin: float, end: float, segments: Array, count: int) -> int:
    """Store a place to search; return the number of places."""
    if count < SEGMENTS:
        segments[count, 0], segments[count, 1], segments[count, 2], segments[count, 3] = kind, row, begin, end
    return count + 1


@inlined
def find_places(S: Array, seen: Array, covered: Array, segments: Array) -> int:
    """Find ends of branches and near double roots of equations; return the number of places.

    Args:
        S: Numbers of the arm.
        seen: See `write_residuals`.
        covered: Receives 1 for an interval of an equation that is searched closely, else 0, (3, samples).
        segments: Receives for each place its kind, the index of the equation, and the begin and the end of its eight
            samples, which are densest at the end, (SEGMENTS, 4).
    """
    many, count, t0, dt = seen.shape[1], 0, S[BEGIN], S[APART]
    for e in range(3):
        for k in range(many):
            covered[e, k] = 0.0
    for e in range(3):
        for k in range(many - 1):
            if e > 0 and max(seen[4, k], seen[4, k + 1]) <= 0.0:
                continue
            y0, y1, y2, y3 = (
                seen[4 + e, max(k - 1, 0)],
                seen[4 + e, k],
                seen[4 + e, k + 1],
                seen[4 + e, min(k + 2, many - 1)],
            )
            if (y1 > 0.0) != (y2 > 0.0):
                y0 = 2.0 * y1 - y2 if k == 0 else y0
                y3 = 2.0 * y2 - y1 if k == many - 2 else y3
                at = t0 + (k - 1 + crossing(y0, y1, y2, y3)) * dt
                begin = k if y1 > 0.0 else k + 1
                # One sample more, if it exists, because the residual is steep there.
                further = begin - 1 if y1 > 0.0 else begin + 1
                covered[e, k] = 1.0
                if (
                    0 <= further < many
                    and seen[4 + e, further] > 0.0
                    and covered[e, min(begin, further)] == 0.0
                ):
                    covered[e, min(begin, further)] = 1.0
                    begin = further
                count = segment(ENDS, e, t0 + begin * dt, at, segments, count)
                continue
            s1, s2 = y2 - y0, y3 - y1
            bend = 0.5 * (s2 - s1)
            if k == 0 or k == many - 2 or s1 * s2 >= 0.0 or (bend > 0.0) != (y1 > 0.0):
                continue
            x = s1 / (s1 - s2)
            most = y1 + 0.25 * s1 * x
            if y1 > 0.0 and most < NARROW * bend:
                covered[e, k] = 1.0
                wide = math.sqrt(max(-2.0 * most / bend, 0.0))
                kind = ENDS if most <= 0.0 else NEARLY
                count = segment(kind, e, t0 + k * dt, t0 + (k + max(x - wide, 0.0)) * dt, segments, count)
                count = segment(
                    kind, e, t0 + (k + 1) * dt, t0 + (k + min(x + wide, 1.0)) * dt, segments, count
                )
            elif y1 <= 0.0 and most > 0.1 * bend:
                wide = math.sqrt(2.0 * max(most / -bend, 0.1))
                count = segment(ENDS, e, t0 + (k + x) * dt, t0 + (k + x - wide) * dt, segments, count)
                count = segment(ENDS, e, t0 + (k + x) * dt, t0 + (k + x + wide) * dt, segments, count)
    return count


@inlined
def root(value: float, branch: int, roots: Array, count: int) -> int:
    """Store a root; return the number of roots."""
    if count < ROOTS:
        roots[0, count], roots[1, count], roots[2, count] = (
            value,
            1.0 - 2.0 * (branch // 2),
            1.0 - 2.0 * (branch % 2),
        )
    return count + 1


@inlined
def find_roots(
    S: Array, seen: Array, covered: Array, segments: Array, places: int, roots: Array
) -> tuple[int, int, int]:
    """Find sign changes of the residual between samples, and places where it may be zero between two samples.

    Args:
        S: Numbers of the arm.
        seen: See `write_residuals`.
        covered: See `find_places`.
        segments: See `find_places`; receives more places.
        places: Number of places so far.
        roots: Receives the value of the joint and two signs of each root, (3, ROOTS).

    Returns:
        The number of roots, the number of places, and the number of intervals in which the residual stays near zero.
    """
    many, count, flat, t0, dt = seen.shape[1], 0, 0, S[BEGIN], S[APART]
    for b in range(4):
        e = 5 + b // 2
        for k in range(many - 1):
            if min(seen[4, k], seen[4, k + 1], seen[e, k], seen[e, k + 1]) <= 0.0:
                continue
            if max(covered[0, k], covered[e - 4, k]) > 0.0:
                continue
            y1, y2 = seen[b, k], seen[b, k + 1]
            flat += 1 if max(abs(y1), abs(y2)) < FLAT else 0
            if y1 * y2 <= 0.0:
                count = root(t0 + (k + y1 / (y1 - y2)) * dt, b, roots, count)
            elif 0 < k < many - 2:
                sign = 1.0 if y1 > 0.0 else -1.0
                s1, s2 = sign * (y2 - seen[b, k - 1]), sign * (seen[b, k + 2] - y1)
                if s1 < 0.0 < s2 and abs(y1) + 0.25 * s1 * s1 / (s1 - s2) < LOW * 0.5 * (s2 - s1):
                    places = segment(DIPS, b, t0 + k * dt, t0 + (k + 1) * dt, segments, places)
    return count, places, flat


@inlined
def turns_back(a: float, b: float, c: float) -> bool:
    """Return True if the second of three samples is close to zero and the values turn back there."""
    sign = 1.0 if b > 0.0 else -1.0
    a, b, c = sign * a, sign * b, sign * c
    close: bool = min(a, c) >= b and b < LOW * (a - 2.0 * b + c)
    return close


@inlined
def look_closely(
    S: Array, close: Array, segments: Array, places: int, roots: Array, count: int
) -> tuple[int, int]:
    """Add the roots at the places that are searched closely; return the number of roots and of possible double roots.

    Args:
        S: Numbers of the arm.
        close: See `write_residuals`, eight samples of each place, (8, places * LANES).
        segments: See `find_places`.
        places: Number of places.
        roots: See `find_roots`.
        count: Number of roots so far.
    """
    last, dips = LANES - 1, 0
    for i in range(places):
        kind, row, begin, end, o = (
            int(segments[i, 0]),
            int(segments[i, 1]),
            segments[i, 2],
            segments[i, 3],
            i * LANES,
        )
        for b in range(4):
            if (kind == DIPS and b != row) or (kind != DIPS and row > 0 and b // 2 != row - 1):
                continue
            e = 5 + b // 2 if row == 0 or kind == DIPS else 4
            for j in range(last):
                if max(close[e, o + j], close[e, o + j + 1]) <= 0.0:
                    continue
                y1, y2 = close[b, o + j], close[b, o + j + 1]
                if y1 * y2 <= 0.0:
                    u = 1.0 - (j + (y1 / (y1 - y2) if y1 != y2 else 0.0)) / last
                    count = root(end + (begin - end) * (u if kind == DIPS else u * u), b, roots, count)
                elif j > 0 and turns_back(close[b, o + j - 1], y1, y2):
                    dips += 1
                    u = 1.0 - j / last
                    count = root(end + (begin - end) * (u if kind == DIPS else u * u), b, roots, count)
            if (
                kind == ENDS
                and ((row == 0 and b < 2) or (row > 0 and b % 2 == 0))
                and close[e, o + last] > 0.0
            ):
                k = b + 2 if row == 0 else b + 1
                y1, y2 = close[b, o + last], close[k, o + last]
                if y1 * y2 < 0.0:
                    count = root(end, b, roots, count)
                elif turns_back(close[b, o + last - 1], y1, close[k, o + last - 1]):
                    count, dips = root(end, b, roots, count), dips + 1
    return count, dips


@noinline
def searched_starts(
    handle: Indices,
    tolerances: Array,
    S: Array,
    table: Array,
    target: Array,
    seeds: Array,
    report: Indices,
    w: int,
) -> None:
    """Write starts that lead to every solution within the limits, or close to them, into seeds.

    Args:
        handle: The task, see `task_of`.
        tolerances: See `task_of`.
        S: Numbers of the arm, see `one_joint_residual.BEGIN`.
        table: See `HEIGHT`, (PLACES, SAMPLES).
        target: (4, 4), lengths in [m].
        seeds: Receives joint values, (at least ROOTS, n).
        report: See `MANY`, (3,).
        w: LANES.
    """
    task, D, dips = task_of(handle, tolerances), np.empty((3, 4)), 0
    seen, covered, segments = np.empty((8, SAMPLES)), np.empty((3, SAMPLES)), np.empty((SEGMENTS, 4))
    roots, work = np.zeros((3, ROOTS)), np.empty(LANE_ROWS * LANES)
    displacement(S, target, D)
    write_residuals(S, D, table, SAMPLES, seen, work, w)
    places = find_places(S, seen, covered, segments)
    count, places, flat = find_roots(S, seen, covered, segments, places, roots)
    free = np.inf
    for k in range(0, SAMPLES, LANES):
        free = min(free, seen[7, k])
    unsure = places > SEGMENTS or flat > 1 or free < FREE * FREE
    places = min(places, SEGMENTS)
    if places > 0:
        column = np.empty((PLACES, places * LANES))
        close = np.empty((8, places * LANES))
        for i in range(places):
            for j in range(LANES):
                u = 1.0 - j / (LANES - 1)
                u = u if segments[i, 0] == DIPS else u * u
                between(
                    S,
                    table,
                    segments[i, 3] + (segments[i, 2] - segments[i, 3]) * u,
                    AXIS,
                    column,
                    i * LANES + j,
                )
        write_residuals(S, D, column, places * LANES, close, work, w)
        count, dips = look_closely(S, close, segments, places, roots, count)
    unsure = unsure or count > ROOTS
    count = min(count, ROOTS)
    # Branches are closed curves: the residual changes its sign an even number of times.
    once, around = 0, S[APART] * (SAMPLES - 1) >= 2.0 * math.pi
    for k in range(count):
        once += 1 if roots[0, k] < S[BEGIN] + 2.0 * math.pi else 0
    unsure = unsure or (around and once % 2 == 1)
    at, many, lower, upper = np.empty((PLACES, ROOTS)), 0, task.chain.lower, task.chain.upper
    for k in range((count + LANES - 1) // LANES * LANES):
        between(S, table, roots[0, min(k, count - 1)], PLACES, at, k)
    for begin in range(0, count, LANES):
        complete(S, D, at, begin, roots, work, w)
        for l in range(min(LANES, count - begin)):
            fits = True
            for r in range(6):
                i = r
                if r == 3:
                    i = int(S[SEARCHED])
                elif r == 4:
                    i = int(S[OTHER])
                value = work[r * LANES + l]
                if not math.isinf(task.lower[i]):
                    value = nearest_copy(value, lower[i], upper[i], 0.5 * (lower[i] + upper[i]))
                    fits = fits and lower[i] - BESIDE <= value <= upper[i] + BESIDE
                    value = min(max(value, lower[i]), upper[i])
                seeds[many, i] = value
            many += 1 if fits else 0
    report[MANY], report[TWINS], report[UNSURE] = many, 1 if dips > 0 else 0, 1 if unsure else 0
