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
from .redundant import PLANS, follow_samples, silent
from .request import PathRequest
from .smooth import ON_POSE
from .steps import faulty

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
    if not missed.any():
        return _reached(request, threads, advance)
    return _joined(request, missed, nearest, threads, advance)


def _joined(
    request: PathRequest, missed: Flags, nearest: Array, threads: int | None, advance: Advance
) -> Array:
    """Plan each run between missed poses separately, and join the runs by the nearest poses."""
    bridge, q = Bridge(request, nearest), nearest.copy()
    here, end = request.start if missed[0] else None, 0
    for first, last in intervals(~missed):
        part = request.part(first, last + 1)
        if request.closed and first > 0 and last + 1 == len(request) and not missed[0]:
            part = request.returning(first, q[0])
        if here is None:
            rows = _reached(part, threads, advance)
        else:
            here = bridge.fill(q, range(end, first), here)
            rows = _continued(part, bridge, here, threads, advance)
        rows = rows[: last + 1 - first]
        q[first : first + len(rows)] = rows
        if len(rows) < last + 1 - first:
            return q[: first + len(rows)]
        if here is None:
            bridge.fill(q, range(first - 1, -1, -1), rows[0])
        here, end = rows[-1], last + 1
    bridge.fill(q, range(end, len(q)), nearest[0] if here is None else here)
    return q


def _continued(
    part: PathRequest, bridge: Bridge, here: Array, threads: int | None, advance: Advance
) -> Array:
    """Plan a run of reached poses from the current joint values, (n,), if this leads on without a break."""
    start, left = bridge.onto(np.ascontiguousarray(part.problem.goal.targets[0]), here, ON_POSE)
    begun = bridge.nearest[:0]
    with suppress(TimeUp):
        if left <= ON_POSE and (part.valid is None or part.valid(start)):
            from_here = replace(part, start=start)
            # If one plan from here breaks, the run starts elsewhere.
            begun = (
                _reached(from_here, threads, advance)
                if _is_long(part)
                else follow_samples(from_here, threads, advance, PLANS[:1])[0]
            )
            if len(begun) == len(part) and not faulty(part, begun).any():
                return begun
    rows = _reached(part, threads, advance)
    if len(rows) < len(begun):  # The time was up.
        rows = begun
    return rows if part.end is not None else bridge.beside(rows, here)


def _is_long(request: PathRequest) -> bool:
    """Return whether a path has more poses than a window with its look-ahead and the beginning of the next."""
    return len(request) > SAMPLED + 1 + LOOK_AHEAD


def _reached(request: PathRequest, threads: int | None, advance: Advance) -> Array:
    """Plan a path whose poses all have solutions; where none is allowed, they are treated like missed poses."""
    # A path with only a given end is planned from there on.
    backward = request.end is not None and request.start is None
    way = request.backward() if backward else request
    q, refused = np.zeros((0, request.problem.chain.dof)), np.zeros(0, dtype=np.bool_)
    if _is_long(way) and not way.closed:
        q = _in_windows(way, threads, advance)
    else:
        with suppress(TimeUp):
            q, refused = follow_samples(way, threads, advance)
    if backward:
        # If the time was up, the result is for the last poses, not for the first.
        q, refused = (
            (np.ascontiguousarray(q[::-1]), refused[::-1]) if len(q) == len(way) else (q[:0], refused[:0])
        )
    return _joined(request, refused, q, threads, advance) if refused.any() else q


def _in_windows(request: PathRequest, threads: int | None, advance: Advance) -> Array:
    """Plan a long path in windows: each begins where the one before ended, and looks ahead beyond the next beginning."""
    q = np.empty((len(request), request.problem.chain.dof))
    known = 0
    for begin in range(0, len(request), SAMPLED):
        part = request.part(begin, begin + SAMPLED + 1 + LOOK_AHEAD)
        rows = _reached(replace(part, start=q[begin]) if begin else part, threads, silent)
        known = begin + min(len(rows), SAMPLED + 1)
        q[begin:known] = rows[: known - begin]
        if len(rows) < len(part):
            break
        advance(SAMPLED)
    return q[:known]
