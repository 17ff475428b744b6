"""All solutions of an arm with one searched joint: sign changes of the residual, see `one_joint_residual`.

The joint is sampled. There is a solution between two samples with residuals of different signs. A branch ends where one
of its equations has a double root: two branches meet there in one curve, and the residual varies with the square root of
the distance from the end. Eight more samples are placed between the last samples and the end, so spaced that the residual
is smooth along them. The same is done where an equation nearly has a double root, and where the residual approaches zero
and turns back.

Arms that have such a joint get all solutions 3.0 to 4.7 times as fast as by the search from samples, one pose at a time,
and 3.3 to 5.4 times as fast in batches (jaco2_6, mpx3500 and irb5400, 3,000 and 20,000 random poses each).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from kinseek.kernels.arm.division import nearest_copy
from kinseek.kernels.arrays import Array, Indices
from kinseek.kernels.atlas.lanes import LANES
from kinseek.kernels.atlas.task import Task, task_of
from kinseek.kernels.jit import inlined, noinline
from kinseek.kernels.structure.candidates import displacement

from .one_joint_residual import (
    APART,
    AXIS,
    BEGIN,
    OTHER,
    PLACES,
    SAMPLES,
    SEARCHED,
    WAYS,
    ColumnLanes,
    Residuals,
    Roots,
    complete,
    cubic,
    interpolate,
    write_residuals,
)
from .refine_all import Search

SEGMENTS, ROOTS = 48, 48
"""Largest number of segments that are searched closely, and of solutions. Not examined further."""

ENDS, NEARLY, DIPS = 0, 1, 2
"""Kinds of segments: a branch ends; an equation nearly has a double root; the residual comes close to zero."""

BESIDE = 0.02
"""Largest distance of a start beyond a limit [rad], because starts are not exact. Not examined further."""

NARROW, LOW = 2.0, 0.2
"""Thresholds of closeness, for an equation and for the residual, relative to their second differences between samples.
Not examined further."""

FLAT, FREE = 1e-4, 2e-4
"""Residual between samples, and distance of the point from axis 1 relative to the arm's size, below which a joint is
undetermined. The solutions are then continua, within the tolerances."""


class SearchedStarts(NamedTuple):
    """What is known of the starts."""

    number: int
    """How many there are."""
    close: bool
    """Whether solutions may be close together."""
    unsure: bool
    """Whether there may be solutions that no start leads to."""


class Segment(NamedTuple):
    """A part of the joint's range that eight samples search closely."""

    kind: int
    row: int
    """The equation for ENDS and NEARLY: 0 for joint 1, else 1 + its solution; the way for DIPS."""
    begin: float
    end: float
    """Where the samples are densest, unless the kind is DIPS."""


class Close(NamedTuple):
    """Segments, roots, and which intervals are left to the segments."""

    covered: Array
    """1 for an interval between two samples of an equation that is searched closely, else 0, (3, SAMPLES)."""
    kind: Indices
    """Of each `Segment`, (SEGMENTS,)."""
    row: Indices
    begin: Array
    end: Array
    roots: Roots
    """(ROOTS,) each."""


@noinline
def write_searched_starts(search: Search, S: Array, table: Array) -> SearchedStarts:
    """Write starts that lead to every solution within the limits, or close to them, and say what is known of them.

    Args:
        search: The search.
        S: Numbers of the arm, see `one_joint_residual.BEGIN`.
        table: See `one_joint_residual.HEIGHT`, (PLACES, SAMPLES).
    """
    task, D, w = task_of(search.job.handle, search.job.tolerances), np.empty((3, 4)), search.job.width
    lanes = ColumnLanes(
        np.empty((PLACES, LANES)),
        Roots(np.empty(LANES), np.empty(LANES), np.empty(LANES)),
        np.empty((WAYS, LANES)),
        np.empty((3, LANES)),
        np.empty(LANES),
        np.empty((6, LANES)),
    )
    sampled = Residuals(np.empty((WAYS, SAMPLES)), np.empty((3, SAMPLES)), np.empty(SAMPLES))
    kinds, rows = np.empty(SEGMENTS, dtype=np.int64), np.empty(SEGMENTS, dtype=np.int64)
    roots = Roots(np.zeros(ROOTS), np.zeros(ROOTS), np.zeros(ROOTS))
    close = Close(np.zeros((3, SAMPLES)), kinds, rows, np.empty(SEGMENTS), np.empty(SEGMENTS), roots)
    displacement(S, search.target, D)
    write_residuals(S, D, table, sampled, lanes, w)
    segments = find_ends(S, sampled, close)
    count, segments, flat = find_roots(S, sampled, close, segments)
    free = np.inf
    for k in range(0, SAMPLES, LANES):
        free = min(free, sampled.reach[k])
    unsure, dips = segments > SEGMENTS or flat > 1 or free < FREE * FREE, 0
    segments = min(segments, SEGMENTS)
    if segments > 0:
        many = segments * LANES
        columns = np.empty((PLACES, many))
        closely = Residuals(np.empty((WAYS, many)), np.empty((3, many)), np.empty(many))
        for i in range(segments):
            segment = segment_at(close, i)
            for j in range(LANES):
                interpolate(S, table, sample_of(segment, float(j)), AXIS, columns, i * LANES + j)
        write_residuals(S, D, columns, closely, lanes, w)
        count, dips = find_close_roots(closely, close, segments, count)
    unsure = unsure or count > ROOTS
    count = min(count, ROOTS)
    # Branches are closed curves: the residual changes its sign an even number of times.
    once, around = 0, S[APART] * (SAMPLES - 1) >= 2.0 * math.pi
    for k in range(count):
        once += 1 if roots.value[k] < S[BEGIN] + 2.0 * math.pi else 0
    unsure = unsure or (around and once % 2 == 1)
    many = 0
    for begin in range(0, count, LANES):
        for l in range(LANES):
            k = min(begin + l, count - 1)
            lanes.root.value[l] = roots.value[k]
            lanes.root.sign1[l], lanes.root.sign3[l] = roots.sign1[k], roots.sign3[k]
            interpolate(S, table, roots.value[k], PLACES, lanes.table, l)
        complete(S, D, lanes, w)
        for l in range(min(LANES, count - begin)):
            many += 1 if place_start(task, S, lanes.joints, l, search.starts[many]) else 0
    return SearchedStarts(many, dips > 0, unsure)


@inlined
def place_start(task: Task, S: Array, joints: Array, l: int, q: Array) -> bool:
    """Write the joint values of lane l, within their limits, into q, (n,); return False if one is far beyond them."""
    lower, upper, fits = task.chain.lower, task.chain.upper, True
    for r in range(6):
        i = int(S[SEARCHED]) if r == 3 else int(S[OTHER]) if r == 4 else r
        q[i] = joints[r, l]
        if not math.isinf(task.lower[i]):
            value = nearest_copy(q[i], lower[i], upper[i], 0.5 * (lower[i] + upper[i]))
            fits = fits and lower[i] - BESIDE <= value <= upper[i] + BESIDE
            q[i] = min(max(value, lower[i]), upper[i])
    return fits


@inlined
def sample_of(segment: Segment, j: float) -> float:
    """Value of the joint at sample j of a segment, 0 … LANES - 1, or between two of them."""
    # u² because the residual varies with the square root of the distance from `end`.
    u = 1.0 - j / (LANES - 1)
    return segment.end + (segment.begin - segment.end) * (u if segment.kind == DIPS else u * u)


@inlined
def segment_at(close: Close, i: int) -> Segment:
    """Read segment i."""
    return Segment(close.kind[i], close.row[i], close.begin[i], close.end[i])


@inlined
def add_segment(segment: Segment, close: Close, count: int) -> int:
    """Store a segment if there is room; return the number of segments."""
    if count < SEGMENTS:
        close.kind[count], close.row[count] = segment.kind, segment.row
        close.begin[count], close.end[count] = segment.begin, segment.end
    return count + 1


@inlined
def add_root(value: float, way: int, close: Close, count: int) -> int:
    """Store a root if there is room; return the number of roots."""
    if count < ROOTS:
        close.roots.value[count] = value
        close.roots.sign1[count], close.roots.sign3[count] = 1.0 - 2.0 * (way // 2), 1.0 - 2.0 * (way % 2)
    return count + 1


@inlined
def crossing(y0: float, y1: float, y2: float, y3: float) -> float:
    """Zero between 1 and 2 of a cubic through values at 0, 1, 2 and 3; y1 and y2 have different signs.

    Newton's method, inside an interval that is halved where it fails.
    """
    low, high, x = 1.0, 2.0, 1.0 + y1 / (y1 - y2)
    for _ in range(6):
        w = cubic(x)
        y = w.w0 * y0 + w.w1 * y1 + w.w2 * y2 + w.w3 * y3
        a, b, c, d = x, x - 1.0, x - 2.0, x - 3.0
        slope = (
            -(c * d + b * d + b * c) / 6.0 * y0
            + 0.5 * (c * d + a * d + a * c) * y1
            - 0.5 * (b * d + a * d + a * b) * y2
            + (b * c + a * c + a * b) / 6.0 * y3
        )
        low, high = (x, high) if y * y1 > 0.0 else (low, x)
        step = x - y / slope if slope != 0.0 else low
        x = step if low < step < high else 0.5 * (low + high)
    return x


@inlined
def find_ends(S: Array, sampled: Residuals, close: Close) -> int:
    """Find ends of branches and near double roots of equations; return the number of segments.

    Args:
        S: Numbers of the arm.
        sampled: The residual at the samples.
        close: Receives segments and covered intervals.
    """
    count, last = 0, SAMPLES - 1
    for e in range(3):
        room = sampled.room[e]
        for k in range(last):
            if e > 0 and max(sampled.room[0, k], sampled.room[0, k + 1]) <= 0.0:
                continue
            if (room[k] > 0.0) != (room[k + 1] > 0.0):
                count = add_end(S, room, e, k, close, count)
            elif 0 < k < last - 1:
                count = add_near_double_root(S, room, e, k, close, count)
    return count


@inlined
def add_end(S: Array, room: Array, e: int, k: int, close: Close, count: int) -> int:
    """Add the segment at the end of a branch between samples k and k + 1; return the number of segments.

    Args:
        S: Numbers of the arm.
        room: Room of an equation, (SAMPLES,).
        e: The equation.
        k: The sample.
        close: Receives the segment and its covered intervals.
        count: Number of segments so far.
    """
    y1, y2 = room[k], room[k + 1]
    y0 = 2.0 * y1 - y2 if k == 0 else room[k - 1]
    y3 = 2.0 * y2 - y1 if k == SAMPLES - 2 else room[k + 2]
    end = S[BEGIN] + (k - 1 + crossing(y0, y1, y2, y3)) * S[APART]
    begin = k if y1 > 0.0 else k + 1
    # One sample more, if it exists, because the residual is steep there.
    further = begin - 1 if y1 > 0.0 else begin + 1
    close.covered[e, k] = 1.0
    if 0 <= further < SAMPLES and room[further] > 0.0 and close.covered[e, min(begin, further)] == 0.0:
        close.covered[e, min(begin, further)] = 1.0
        begin = further
    return add_segment(Segment(ENDS, e, S[BEGIN] + begin * S[APART], end), close, count)


@inlined
def add_near_double_root(S: Array, room: Array, e: int, k: int, close: Close, count: int) -> int:
    """Add the segments where an equation nearly has a double root, or has two, between samples k and k + 1.

    The extreme of the room is that of the parabola through four samples. See `add_end` for the arguments.
    """
    t0, dt, y1 = S[BEGIN], S[APART], room[k]
    s1, s2 = room[k + 1] - room[k - 1], room[k + 2] - y1
    # s1/2 and s2/2 are the slopes at k and k + 1. Interpolated linearly, the slope is 0 at k + x.
    # The room at sample t is then most + ½ bend (t - k - x)².
    bend = 0.5 * (s2 - s1)
    if s1 * s2 >= 0.0 or (bend > 0.0) != (y1 > 0.0):
        return count
    x = s1 / (s1 - s2)
    most = y1 + 0.25 * s1 * x
    if y1 > 0.0 and most < NARROW * bend:
        close.covered[e, k] = 1.0
        wide, kind = math.sqrt(max(-2.0 * most / bend, 0.0)), ENDS if most <= 0.0 else NEARLY
        left = Segment(kind, e, t0 + k * dt, t0 + (k + max(x - wide, 0.0)) * dt)
        right = Segment(kind, e, t0 + (k + 1) * dt, t0 + (k + min(x + wide, 1.0)) * dt)
        count = add_segment(right, close, add_segment(left, close, count))
    elif y1 <= 0.0 and most > 0.1 * bend:
        wide, middle = math.sqrt(2.0 * max(most / -bend, 0.1)), t0 + (k + x) * dt
        left, right = (
            Segment(ENDS, e, middle, t0 + (k + x - wide) * dt),
            Segment(ENDS, e, middle, t0 + (k + x + wide) * dt),
        )
        count = add_segment(right, close, add_segment(left, close, count))
    return count


@inlined
def find_roots(S: Array, sampled: Residuals, close: Close, segments: int) -> tuple[int, int, int]:
    """Find sign changes of the residual between samples, and segments where it may be zero between two samples.

    Args:
        S: Numbers of the arm.
        sampled: The residual at the samples.
        close: Has covered intervals; receives roots and more segments.
        segments: Number of segments so far.

    Returns:
        The number of roots, the number of segments, and the number of intervals in which the residual stays near zero.
    """
    count, flat, t0, dt = 0, 0, S[BEGIN], S[APART]
    for way in range(WAYS):
        e, y, room1, room3 = 1 + way // 2, sampled.value[way], sampled.room[0], sampled.room[1 + way // 2]
        for k in range(SAMPLES - 1):
            if min(room1[k], room1[k + 1], room3[k], room3[k + 1]) <= 0.0:
                continue
            if max(close.covered[0, k], close.covered[e, k]) > 0.0:
                continue
            y1, y2 = y[k], y[k + 1]
            flat += 1 if max(abs(y1), abs(y2)) < FLAT else 0
            if y1 * y2 <= 0.0:
                count = add_root(t0 + (k + y1 / (y1 - y2)) * dt, way, close, count)
            elif 0 < k < SAMPLES - 2:
                sign = 1.0 if y1 > 0.0 else -1.0
                s1, s2 = sign * (y2 - y[k - 1]), sign * (y[k + 2] - y1)
                if s1 < 0.0 < s2 and abs(y1) + 0.25 * s1 * s1 / (s1 - s2) < LOW * 0.5 * (s2 - s1):
                    dip = Segment(DIPS, way, t0 + k * dt, t0 + (k + 1) * dt)
                    segments = add_segment(dip, close, segments)
    return count, segments, flat


@inlined
def turns_back(a: float, b: float, c: float) -> bool:
    """Return True if the second of three samples is close to zero and the values turn back there."""
    sign = 1.0 if b > 0.0 else -1.0
    a, b, c = sign * a, sign * b, sign * c
    close: bool = min(a, c) >= b and b < LOW * (a - 2.0 * b + c)
    return close


@inlined
def find_close_roots(closely: Residuals, close: Close, segments: int, count: int) -> tuple[int, int]:
    """Add the roots in the segments; return the number of roots and of possible double roots.

    Args:
        closely: The residual at eight samples of each segment.
        close: Has the segments; receives roots.
        segments: Number of segments.
        count: Number of roots so far.
    """
    dips = 0
    for i in range(segments):
        segment = segment_at(close, i)
        for way in range(WAYS):
            near_joint3 = way // 2 == segment.row - 1
            if (way != segment.row) if segment.kind == DIPS else not (segment.row == 0 or near_joint3):
                continue
            equation = 1 + way // 2 if segment.kind == DIPS or segment.row == 0 else 0
            y, room, first = closely.value[way], closely.room[equation], i * LANES
            for j in range(LANES - 1):
                y1, y2 = y[first + j], y[first + j + 1]
                if max(room[first + j], room[first + j + 1]) <= 0.0:
                    continue
                if y1 * y2 <= 0.0:
                    share = y1 / (y1 - y2) if y1 != y2 else 0.0
                    count = add_root(sample_of(segment, j + share), way, close, count)
                elif j > 0 and turns_back(y[first + j - 1], y1, y2):
                    dips += 1
                    count = add_root(sample_of(segment, float(j)), way, close, count)
            last = first + LANES - 1
            joined = way + 2 if segment.row == 0 else way + 1
            begins = way < 2 if segment.row == 0 else way % 2 == 0
            if segment.kind == ENDS and begins and room[last] > 0.0:
                other = closely.value[joined]
                if y[last] * other[last] < 0.0:
                    count = add_root(segment.end, way, close, count)
                elif turns_back(y[last - 1], y[last], other[last - 1]):
                    count, dips = add_root(segment.end, way, close, count), dips + 1
    return count, dips
