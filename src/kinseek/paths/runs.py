"""Paths with missed poses: the runs between them are planned separately, and the nearest poses join them.

If missed poses were planned like other poses, each jump between the nearest solutions would be a break, and each break makes
the planner of a redundant arm start again. So the atlas finds the missed poses first, and no later stage plans them.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from kinseek.support.deadline import TimeUp

from .bridge import Bridge, nearest_to
from .path import intervals
from .redundant import PLANS, faults, follow_samples
from .request import PathRequest
from .smooth import ON_POSE

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Advance = Callable[[int], object]

SAMPLED, LOOK_AHEAD = 4000, 400
"""Most poses that are followed together, and the number of poses of look-ahead beyond them."""


def follow_runs(request: PathRequest, threads: int | None, advance: Advance) -> Array:
    """Return joint values for every pose of a redundant arm's path, (N, n); if the time is up, for its first poses."""
    nearest, missed = nearest_to(request.problem, np.arange(len(request)), threads, request.deadline)
    if not len(nearest):
        return nearest
    request = request.part(0, len(nearest))
    return _joined(request, missed, nearest, threads, advance)


def _joined(
    request: PathRequest, missed: Flags, nearest: Array, threads: int | None, advance: Advance
) -> Array:
    """Plan each run between missed poses separately, and join the runs by the nearest poses."""
    if not missed.any():
        q, refused = _whole(request, threads, advance)
        if not refused.any() or len(q) < len(request):
            return q
        # Poses at which no solution is allowed are treated like missed ones, and the rest is planned without them.
        missed, nearest = refused, q
    bridge, q = Bridge(request, nearest), nearest.copy()
    here, end = request.start if missed[0] else None, 0
    for first, last in intervals(~missed):
        here = None if here is None else bridge.fill(q, range(end, first), here)
        back = None if missed[0] else q[0]
        rows = _run(request, first, last, bridge, here, back, threads, advance)
        q[first : first + len(rows)] = rows
        if len(rows) < last + 1 - first:
            return q[: first + len(rows)]
        if here is None:
            bridge.fill(q, range(first - 1, -1, -1), rows[0])
        here, end = rows[-1], last + 1
    bridge.fill(q, range(end, len(q)), nearest[0] if here is None else here)
    return q


def _run(
    request: PathRequest,
    first: int,
    last: int,
    bridge: Bridge,
    here: Array | None,
    back: Array | None,
    threads: int | None,
    advance: Advance,
) -> Array:
    """Plan a run of reached poses from the current joint values, (n,), if this leads on without a break.

    Args:
        request: The whole path.
        first: Index of the first pose of the run.
        last: Index of the last pose of the run.
        bridge: Continues over the missed poses of the path.
        here: Joint values after the missed poses before the run, (n,); None if there are none.
        back: Joint values at the first pose of the path, (n,); None if it is missed.
        threads: See `follow_runs`.
        advance: See `follow_runs`.
    """
    part, count = request.part(first, last + 1), last + 1 - first
    if request.closed and first > 0 and last + 1 == len(request) and back is not None:
        part = request.returning(first, back)
    none = np.zeros(len(part), dtype=np.bool_)
    if here is None:
        return _joined(part, none, bridge.nearest[:0], threads, advance)[:count]
    target = np.ascontiguousarray(part.problem.goal.targets[0])
    start, left = bridge.onto(target, here, ON_POSE)
    begun = bridge.nearest[:0]
    try:
        if left <= ON_POSE and (part.valid is None or part.valid(start)):
            begun = _begun(replace(part, start=start), threads, advance)
            if len(begun) == len(part) and not faults(part, begun)[0]:
                return begun[:count]
        rows = _joined(part, none, bridge.nearest[:0], threads, advance)
        if len(rows) < len(begun):
            rows = begun
    except TimeUp:
        rows = begun
    return (rows if part.end is not None else bridge.beside(rows, here))[:count]


def _begun(part: PathRequest, threads: int | None, advance: Advance) -> Array:
    """Plan a run once from the current joint values; if the plan breaks, the run starts elsewhere."""
    if len(part) <= SAMPLED + LOOK_AHEAD:
        return follow_samples(part, threads, advance, PLANS[:1])[0]
    return _joined(part, np.zeros(len(part), dtype=np.bool_), part.longest[:0], threads, advance)


def _whole(request: PathRequest, threads: int | None, advance: Advance) -> tuple[Array, Flags]:
    """Like `follow_samples`, but plan a long path in windows, and a path with only a given end from there on."""
    none = np.zeros((0, request.problem.chain.dof))
    if request.end is not None and request.start is None:
        q, refused = _whole(request.backward(), threads, advance)
        if len(q) < len(request):  # The result is for the last poses, not for the first.
            return none, refused[:0]
        return np.ascontiguousarray(q[::-1]), refused[::-1]
    try:
        if len(request) <= SAMPLED + LOOK_AHEAD or request.closed:
            return follow_samples(request, threads, advance)
    except TimeUp:
        return none, np.zeros(0, dtype=np.bool_)
    q = np.empty((len(request), request.problem.chain.dof))
    known = 0
    for begin in range(0, len(request), SAMPLED):
        # Each window begins where the one before ended, and looks ahead beyond the beginning of the next.
        part = request.part(begin, min(begin + SAMPLED + 1 + LOOK_AHEAD, len(request)))
        part = replace(part, start=q[begin]) if begin else part
        rows = none
        with suppress(TimeUp):
            rows, refused = follow_samples(part, threads, _silent)
            if refused.any():
                rows = _joined(part, refused, rows, threads, _silent)
        stop = begin + min(len(rows), SAMPLED + 1)
        q[begin:stop] = rows[: stop - begin]
        known = max(known, stop)
        if len(rows) < len(part):
            break
        advance(SAMPLED)
    return q[:known], np.zeros(known, dtype=np.bool_)


def _silent(done: int) -> None:
    pass
