"""Missed poses of a path: where they are, and how the arm continues over them.

A missed pose has no solution, and the nearest solution may jump from one pose to the next, e.g. by a turn of the wrist or to
the other bend of the elbow. So over a run of missed poses the arm continues from its current joint values, and its hand
follows the nearest poses. The joints jump only if no continuous motion does that.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kinseek.kernels.arm.forward import forward_many
from kinseek.kernels.atlas.lanes import LANES
from kinseek.kernels.paths.projection import project_onto_poses
from kinseek.kernels.paths.viterbi import STRAIGHT
from kinseek.problem import Problem
from kinseek.solvers.atlas.solver import Atlas
from kinseek.support.deadline import Deadline
from kinseek.support.turns import TURN

from .joints import Turning
from .path import intervals
from .request import PathRequest
from .smooth import Smoother

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Flags = NDArray[np.bool_]

STEPS = 40
"""Most steps to bring the hand onto the nearest pose; near the boundary of the workspace each step halves the error. Not
examined further."""

START_OFFSET = 0.02
"""Offset of the additional starts, [rad] or [m], see `_starts`. Without them the joints of a gen3 jump 154 times instead of
68 on twelve made paths that lie partly out of reach. The program of this trial is not in the repository; other values were
not examined."""

SHARE, NEAR = 0.02, 1e-12
"""The hand counts as at the nearest pose if its distance from it is at most `SHARE` of that pose's own error, or if the
squared scaled error is less than `NEAR`. Not examined further."""


def nearest_to(
    problem: Problem, poses: Indices, threads: int | None, deadline: Deadline
) -> tuple[Array, Flags]:
    """Find joint values that reach some poses, (k,), or that put the hand nearest to them.

    Returns:
        Joint values, (k, n), and flags of the missed poses, (k,); if the time is up, only for the first of them.
    """
    goal = problem.goal.at(problem.goal.target[poses])
    found = Atlas(threads=threads).solve(Problem(problem.mechanism, goal, time_limit=deadline.left))
    late = np.flatnonzero(found.out_of_time)
    count = int(late[0]) if len(late) else len(poses)
    return found.q[:count], ~np.asarray(found.success)[:count]


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
        self.smoother = Smoother(request)
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
