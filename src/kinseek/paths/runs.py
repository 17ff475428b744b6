"""Paths with missed poses: the runs between them are planned separately, and the nearest poses join them.

A missed pose has no solution, and the nearest solution may jump from one pose to the next, e.g. by a turn of the wrist or to
the other bend of the elbow. If missed poses are planned like other poses, each jump is a break, and each break makes the
planner start again. So the atlas finds the missed poses first, and no later stage plans them. Over a run of missed poses the
arm continues from its current joint values, and its hand follows the nearest poses. The joints jump only if no continuous
motion does that.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from kinseek.kernels.arm.forward import forward_many
from kinseek.kernels.atlas.lanes import LANES
from kinseek.kernels.paths.projection import project_onto_poses
from kinseek.kernels.paths.viterbi import STRAIGHT
from kinseek.problem import Problem
from kinseek.solvers.atlas.solver import Atlas
from kinseek.support.deadline import TimeUp
from kinseek.support.turns import TURN

from .joints import Turning
from .path import intervals
from .plan import smoother_of
from .redundant import PLANS, faults, follow_samples
from .request import PathRequest
from .smooth import ON_POSE

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Advance = Callable[[int], object]

SAMPLED, LOOK_AHEAD = 4000, 400
"""Most poses that are followed together, and the number of poses of look-ahead beyond them."""

STEPS = 40
"""Most steps to bring the hand onto the nearest pose; near the boundary of the workspace each step halves the error. Not
examined further."""

START_OFFSET = 0.02
"""Offset of the additional starts, [rad] or [m], see `_starts`. Not examined further."""

SHARE, NEAR = 0.02, 1e-12
"""The hand counts as at the nearest pose if its distance from it is at most `SHARE` of that pose's own error, or if the
squared scaled error is less than `NEAR`. Not examined further."""


def follow_runs(request: PathRequest, threads: int | None, advance: Advance) -> Array:
    """Return joint values for every pose of a redundant arm's path, (N, n); if the time is up, for its first poses."""
    problem = request.problem
    found = Atlas(threads=threads).solve(
        Problem(problem.mechanism, problem.goal, time_limit=request.deadline.left)
    )
    late = np.flatnonzero(found.out_of_time)
    count = int(late[0]) if len(late) else len(request)
    if not count:
        return np.zeros((0, request.problem.chain.dof))
    request, nearest = request.part(0, count), found.q[:count]
    missed = ~np.asarray(found.success)[:count]
    _look_beside(request, nearest, missed)
    return _joined(request, missed, nearest, threads, advance)


def bridged(request: PathRequest, q: Array, missed: Flags) -> Array:
    """Continue a planned path, (N, n), over its missed poses from the arm's current joint values; keep the rest.

    Joint values after a run of missed poses may change by full turns of joints without limits.
    """
    if not missed.any():
        return q
    bridge, q = Bridge(request, q), q.copy()
    for first, last in intervals(missed):
        if first == 0 and last + 1 < len(q) and request.start is None:
            bridge.fill(q, range(last, -1, -1), q[last + 1])
            continue
        here = bridge.fill(q, range(first, last + 1), q[max(first - 1, 0)])
        if last + 1 < len(q):
            q[last + 1 :] += bridge.turning.whole_turns(here - q[last + 1])
    return q


class Bridge:
    """Continue a path over missed poses."""

    def __init__(self, request: PathRequest, nearest: Array) -> None:
        """Take a path and joint values for each pose, (N, n); at missed poses these put the hand nearest to the pose."""
        self.request, self.nearest, self.turning = request, nearest.copy(), Turning(request.problem.chain)
        self.smoother = smoother_of(request)
        goal = request.problem.goal
        self.targets = np.ascontiguousarray(forward_many(request.problem.arrays, self.nearest)[:, :3])
        """Poses of the hand there, as kernels take targets, (N, 3, 4)."""
        self.room = np.maximum(SHARE**2 * self._settled(goal.targets, self.nearest.copy(), 0), NEAR)
        """Squared scaled error up to which the hand counts as at the pose, (N,)."""
        self.beside_here = _starts(request.problem.chain.dof)

    def fill(self, q: Array, poses: range, here: Array) -> Array:
        """Write joint values for some poses into a path, (N, n), one after the other from the current joint values, (n,).

        Returns:
            The last joint values, (n,).
        """
        for i in poses:
            if self.request.deadline.passed:
                q[i] = here
                continue
            there, left = self.onto(self.targets[i], here, self.room[i])
            here = q[i] = there if left <= self.room[i] else self.turned(self.nearest[i], here)
        return here

    def onto(self, target: Array, here: Array, room: float) -> tuple[Array, float]:
        """Bring the hand onto a target, (3, 4), up to a squared scaled error: return joint values, (n,), and the error."""
        rows = np.clip(here + self.beside_here, self.smoother.lower, self.smoother.upper)
        left = self._settled(np.repeat(target[None], LANES, axis=0), rows, STEPS)
        # Take the closest one that arrived; if none did, the one with the least error.
        far = np.abs(rows - here).max(axis=1)
        best = (
            int(np.lexsort((far, left))[0])
            if left.min() > room
            else int(np.argmin(np.where(left <= room, far, np.inf)))
        )
        return rows[best], float(left[best])

    def _settled(self, targets: Array, q: Array, steps: int) -> Array:
        """Improve q, (k, n), in place by steps towards targets, (k, 3, 4); return the remaining errors, (k,)."""
        smoother, left = self.smoother, np.empty(len(q))
        project_onto_poses(smoother.index.job(smoother.tolerances), targets, smoother.limits, steps, q, left)
        return left

    def turned(self, q: Array, here: Array) -> Array:
        """Shift joint values, (n,), by the full turns that bring them closest to others inside the limits."""
        return np.asarray(self.beside(q[None], here)[0])

    def beside(self, rows: Array, here: Array) -> Array:
        """Shift all rows, (k, n), by the full turns that bring the first of them closest to current joint values, (n,)."""
        if not len(rows):
            return rows
        turns = np.where(self.turning.kind == STRAIGHT, 0.0, TURN * np.round((here - rows[0]) / TURN))
        low, high = rows.min(axis=0) + turns, rows.max(axis=0) + turns
        inside = (low >= self.turning.open_lower) & (high <= self.turning.open_upper)
        return np.asarray(rows + np.where(inside, turns, 0.0))


def _starts(dof: int) -> Array:
    """Return start offsets from the current joint values, (LANES, n), [rad] or [m]: zero, and small ones in all directions.

    The kernel processes `LANES` starts in any case. At the boundary of the workspace a single start may not converge.
    """
    signs = (np.arange(1, LANES)[:, None] >> (np.arange(dof) % 3)) % 2 * 2.0 - 1.0
    return np.concatenate([np.zeros((1, dof)), START_OFFSET * signs])


def _look_beside(request: PathRequest, nearest: Array, missed: Flags) -> None:
    """Search for solutions of missed poses from those of adjacent poses: in rare cases the atlas overlooks one."""
    smoother = smoother_of(replace(request, valid=None))
    targets = np.ascontiguousarray(request.problem.goal.targets)
    for way in (1, -1):
        some = np.flatnonzero(missed)
        while len(some):
            beside = some - way
            some = some[(beside >= 0) & (beside < len(missed))]
            # Only poses beside a solved one have a start; the front then moves on over the run of missed poses.
            some = some[~missed[some - way]]
            q = nearest[some - way]
            smoother.project(q, targets[some])
            goal = request.problem.goal.at(request.problem.goal.target[some])
            there = goal.met(goal.measure(request.problem.arrays, q))
            some, q = some[there], q[there]
            nearest[some], missed[some] = q, False
            some = some + way
            some = some[(some >= 0) & (some < len(missed))]
            some = some[missed[some]]


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
