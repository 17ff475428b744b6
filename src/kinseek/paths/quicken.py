"""Shorten the duration of a path along its self-motion: the poses stay, and they are passed sooner.

The unknowns are the time steps from pose to pose, ``d exp(y)``, and the coefficients c of cubic B-splines that displace the
joints along the self-motion. The sum of the time steps is minimised, with a logarithmic barrier for each limit: the speeds
and accelerations of the joints, by finite differences, and the ends of their ranges. Each pass makes a few Newton steps, in
which second derivatives of the motion are left out, projects the joints onto the poses, and lowers the barrier (*Boyd,
Vandenberghe 2004, sections 9.5 and 11.3*). The durations that decide are those of the proved time law.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinseek.derivatives import constraint_jacobian, freedom
from kinseek.kernels.paths.band import solve_band
from kinseek.robots.mechanism import Mechanism
from kinseek.support.deadline import TimeUp
from kinseek.timing.limits import Limits
from kinseek.timing.timed import Way, timed
from kinseek.virtual_joints import extended

from .joints import Turning
from .request import PathRequest
from .smooth import Smoother
from .steps import faulty

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

PASSES, NEWTON_STEPS = 8, 2
"""Most passes, and Newton steps of each."""

BARRIER, LOWERED = 0.3, 0.5
"""Weight of the barrier in the first pass, relative to the mean time step and divided by the number of joints, and the
factor from pass to pass. Weights of 1 and 2, factors of 0.6 to 0.75 and twice as many passes were no better on 24 paths."""

INTERVALS, POSES_EACH = 24, 3
"""Most intervals of the B-splines, and least poses in each. On 24 paths 6, 12 and 24 intervals shortened the motion by 5, 6
and 8 percent (median)."""

MOST_POSES = 2000
"""Longer paths stay as they are: that many intervals would have to grow with them."""

STEP, LOG_STEP = 0.3, 0.5
"""Largest motion of a joint in a pass [rad or m], and largest y."""

HALVINGS = 12
"""Most halvings of a Newton step until it improves."""

SHARES = (1.0, 0.5, 0.2)
"""Parts of a displacement that are tried until all poses are reached again without a break."""

INSIDE = 1.002
"""Factor on the time steps that keeps the motion inside the barriers."""

LEAST_GAP = 1e-3
"""Distance from the end of its range [rad or m] below which the barrier of a joint does not grow any more."""

SMALL = 200_000
"""Multiplications in one call of BLAS: OpenBLAS uses several threads above 262,144. With one thread the bits do not depend
on their number, and no thread waits for another one on a busy machine."""

DAMPING = 1e-6
"""Levenberg's damping of the displacement, relative to the mean diagonal element."""


class Shares(NamedTuple):
    """Shares of the limits that a motion uses, and derivatives with respect to y."""

    velocity: Array
    """Of the k steps, (k, n); its derivative is its negative."""
    acceleration: Array
    """At the k + 1 poses, (k + 1, n); the arm rests before the first and after the last."""
    by_before: Array
    """Derivative of the acceleration by y of the step before, (k + 1, n); 0 at the first pose."""
    by_after: Array
    """Derivative of the acceleration by y of the step after, (k + 1, n); 0 at the last pose."""


class Displacement(NamedTuple):
    """How coefficients c displace the joints, all (..., m)."""

    joints: Array
    """(k + 1, all joints, m)"""
    own: Array
    """The arm's own joints: the change of each step, (k, n, m)."""


def shares_of(moves: Array, durations: Array, limits: Limits) -> Shares:
    """Return the shares of the limits that steps, (k, n), in given times, (k,), use."""
    rest = np.zeros((1, moves.shape[1]))
    speeds = np.concatenate([rest, moves / durations[:, None], rest])
    before, after = np.append(0.0, durations)[:, None], np.append(durations, 0.0)[:, None]
    span = (before + after) * limits.acceleration
    share = 2.0 * np.diff(speeds, axis=0) / span
    scaled = share * limits.acceleration
    return Shares(
        speeds[1:-1] / limits.velocity,
        share,
        (2.0 * speeds[:-1] - scaled * before) / span,
        (-2.0 * speeds[1:] - scaled * after) / span,
    )


def stretch(moves: Array, durations: Array, limits: Limits) -> float:
    """Return the factor on all durations, (k,), at which steps, (k, n), just keep the limits."""
    shares = shares_of(moves, durations, limits)
    return float(max(np.abs(shares.velocity).max(), np.sqrt(np.abs(shares.acceleration).max())))


def aligned_null_spaces(J: Array, count: int) -> Array:
    """Return `count` orthonormal directions of the self-motion at each pose, (N, r, n) -> (N, n, count).

    Each basis is the one nearest to that of the pose before (orthogonal Procrustes problem, *Schönemann 1966*).
    """
    bases = np.swapaxes(np.linalg.svd(J, full_matrices=True)[2][:, -count:], 1, 2)
    left, _, right = np.linalg.svd(np.swapaxes(bases[1:], 1, 2) @ bases[:-1])
    turns = np.concatenate([np.eye(count)[None], left @ right])
    for i in range(1, len(turns)):
        turns[i] = turns[i] @ turns[i - 1]
    return np.asarray(bases @ turns)


def b_splines(shares: Array, intervals: int) -> Array:
    """Return cubic B-splines on equal intervals of [0, 1] at points, (N,), as (N, intervals + 3)."""
    first = np.clip((shares * intervals).astype(np.int64), 0, intervals - 1)
    t, rows = shares * intervals - first, np.arange(len(shares))
    values = np.zeros((len(shares), intervals + 3))
    pieces = ((1 - t) ** 3, 3 * t**3 - 6 * t**2 + 4, -3 * t**3 + 3 * t**2 + 3 * t + 1, t**3)
    for k, piece in enumerate(pieces):
        values[rows, first + k] = piece / 6.0
    return values


class Quickener:
    """Shorten the duration of a path of an arm with self-motion, for a goal without ranges."""

    def __init__(self, request: PathRequest, mechanism: Mechanism, own: slice, limits: Limits) -> None:
        """Take an open path.

        Args:
            request: The path; its start and end, if given, stay.
            mechanism: The arm itself.
            own: Its joints among those of the request.
            limits: Its limits.
        """
        self.request, self.own, self.limits, self.mechanism = request, own, limits, mechanism
        self.smoother, self.freedom = Smoother(request), freedom(request.problem)

    def quickened(self, q: Array) -> Array:
        """Return the path, (N, n), with the shortest duration found; if there is none, or the time is up, the given one."""
        # Poses with equal joint values are passed at the same time.
        kept = np.append(True, (np.diff(q, axis=0) != 0.0).any(axis=1))
        places = np.cumsum(kept) - 1
        best, steps = self._timed(q[kept])
        if not self.freedom or not 3 <= len(steps) + 1 <= MOST_POSES:
            return q
        rows, result = q[kept], q
        targets = np.ascontiguousarray(self.request.problem.goal.targets[kept])
        steps = steps * (stretch(self._moves(rows), steps, self.limits) * INSIDE)
        barrier = BARRIER
        with suppress(TimeUp):
            for _ in range(PASSES):
                self.request.deadline.check()
                rows, steps, moved = self._pass(rows, targets, steps, barrier, places)
                if not moved:
                    break
                duration, _ = self._timed(rows)
                if duration < best:
                    best, result = duration, rows[places]
                barrier *= LOWERED
        return result

    def _timed(self, rows: Array) -> tuple[float, Array]:
        """Return the duration of the fastest motion through joint values and its time steps, (k,), [s]."""
        own = np.ascontiguousarray(rows[:, self.own])
        goal = self.request.problem.goal
        near = (goal.position_tolerance, goal.orientation_tolerance)
        way = Way(self.mechanism, None, own, np.zeros(0, dtype=np.int64), None, 0.0, near)
        trajectory = timed(way, self.limits, (0.0, 0.0))
        return trajectory.duration, np.maximum(np.diff(trajectory.pose_times), 1e-9)

    def _moves(self, rows: Array) -> Array:
        return np.asarray(np.diff(rows[:, self.own], axis=0))

    def _pass(
        self, rows: Array, targets: Array, steps: Array, barrier: float, places: NDArray[np.int64]
    ) -> tuple[Array, Array, bool]:
        """Return joint values and time steps after a pass, and whether the pass succeeded."""
        displacement = self._displacement(rows, steps)
        if not displacement.joints.shape[2]:
            return rows, steps, False
        y, c = self._minimised(rows, steps, displacement, barrier)
        away = _times(displacement.joints, c)
        for share in SHARES:
            moved = rows + share * away
            if self.smoother.project(moved, targets).all():
                self._restore_ends(rows, moved)
                if not faulty(self.request, moved[places]).any():
                    steps = steps * np.exp(y)
                    room = stretch(self._moves(moved), steps, self.limits) * INSIDE
                    return moved, steps * max(room, 1.0), True
        return rows, steps, False

    def _restore_ends(self, rows: Array, moved: Array) -> None:
        for fixed, i in ((self.request.start, 0), (self.request.end, -1)):
            if fixed is not None:
                moved[i] = rows[i]

    def _displacement(self, rows: Array, steps: Array) -> Displacement:
        """Return B-splines in time, in every direction of the self-motion."""
        J = constraint_jacobian(self.request.problem, rows)
        J[:, :3] /= self.smoother.scale
        times = np.append(0.0, np.cumsum(steps))
        intervals = min(INTERVALS, max(len(steps) // POSES_EACH, 1))
        splines = b_splines(times / times[-1], intervals)
        # Three splines are not zero at an end; without them the displacement is zero there.
        first = 0 if self.request.start is None else 3
        splines = splines[:, first : splines.shape[1] - (0 if self.request.end is None else 3)]
        bases = aligned_null_spaces(J, self.freedom)
        joints = np.einsum("ijr,ik->ijkr", bases, splines)
        joints = joints.reshape(*rows.shape, splines.shape[1] * self.freedom)
        return Displacement(joints, np.diff(joints[:, self.own], axis=0))

    def _minimised(
        self, rows: Array, steps: Array, displacement: Displacement, barrier: float
    ) -> tuple[Array, Array]:
        """Return y, (k,), and c, (m,), after some Newton steps from 0."""
        y, c = np.zeros(len(steps)), np.zeros(displacement.joints.shape[2])
        moves = self._moves(rows)
        weight = barrier * steps.sum() / (len(rows) * moves.shape[1])

        def merit(y: Array, c: Array) -> float:
            durations = steps * np.exp(y)
            shares = shares_of(moves + _times(displacement.own, c), durations, self.limits)
            used = np.concatenate([shares.velocity, shares.acceleration])
            if (np.abs(used) >= 1.0).any():
                return np.inf
            gaps, _ = self._gaps(rows + _times(displacement.joints, c))
            return float(durations.sum() - weight * (np.log1p(-(used**2)).sum() + np.log(gaps).sum()))

        for _ in range(NEWTON_STEPS):
            self.request.deadline.check()
            durations = steps * np.exp(y)
            step_y, step_c = self._newton(rows, moves, durations, displacement, c, weight)
            far = np.abs(_times(displacement.joints, c + step_c)).max()
            share = min(1.0, STEP / max(far, 1e-12), LOG_STEP / max(np.abs(step_y).max(), 1e-12))
            before = merit(y, c)
            for _ in range(HALVINGS):
                if merit(y + share * step_y, c + share * step_c) < before:
                    break
                share *= 0.5
            else:
                break
            y, c = y + share * step_y, c + share * step_c
        return y, c

    def _gaps(self, q: Array) -> tuple[Array, Flags]:
        """Return distances from both ends of the ranges of joints with limits, (2, N, j), and their flags, (n,)."""
        limited = np.isfinite(self.smoother.lower) & np.isfinite(self.smoother.upper)
        q, lower, upper = q[:, limited], self.smoother.lower[limited], self.smoother.upper[limited]
        return np.maximum(np.stack([q - lower, upper - q]), LEAST_GAP), limited

    def _newton(
        self, rows: Array, moves: Array, durations: Array, displacement: Displacement, c: Array, weight: float
    ) -> tuple[Array, Array]:
        """Return a Newton step for y, (k,), and c, (m,); second derivatives of the shares are left out."""
        by_c = displacement.own / durations[:, None, None]
        shares = shares_of(moves + _times(displacement.own, c), durations, self.limits)
        rest = np.zeros((1, *by_c.shape[1:]))
        span = np.append(0.0, durations) + np.append(durations, 0.0)
        changes = np.diff(np.concatenate([rest, by_c, rest]), axis=0)
        velocity_c = by_c / self.limits.velocity[:, None]
        acceleration_c = 2.0 * changes / (span[:, None] * self.limits.acceleration)[..., None]
        slope_v, bend_v = _barrier(shares.velocity, weight)
        slope_a, bend_a = _barrier(shares.acceleration, weight)
        before, after = shares.by_before, shares.by_after
        # The step i lies before the pose i + 1 and after the pose i.
        slope_y = durations - (slope_v * shares.velocity).sum(axis=1)
        slope_y += (slope_a * after).sum(axis=1)[:-1] + (slope_a * before).sum(axis=1)[1:]
        diagonal = durations + (bend_v * shares.velocity**2).sum(axis=1)
        diagonal += (bend_a * after**2).sum(axis=1)[:-1] + (bend_a * before**2).sum(axis=1)[1:]
        beside = (bend_a * before * after).sum(axis=1)[1:]
        mixed = -np.einsum("ij,ijk->ik", bend_v * shares.velocity, velocity_c)
        mixed += np.einsum("ij,ijk->ik", (bend_a * after)[:-1], acceleration_c[:-1])
        mixed += np.einsum("ij,ijk->ik", (bend_a * before)[1:], acceleration_c[1:])
        gaps, limited = self._gaps(rows + _times(displacement.joints, c))
        bound = displacement.joints[:, limited]
        slope_c = np.einsum("ij,ijk->k", slope_v, velocity_c) + np.einsum(
            "ij,ijk->k", slope_a, acceleration_c
        )
        slope_c += weight * np.einsum("ij,ijk->k", 1.0 / gaps[1] - 1.0 / gaps[0], bound)
        square = _weighted_square(velocity_c, bend_v) + _weighted_square(acceleration_c, bend_a)
        square += _weighted_square(bound, weight * (1.0 / gaps**2).sum(axis=0))
        square += (DAMPING * np.trace(square) / len(square) + 1e-9) * np.eye(len(square))
        # The time steps are eliminated: their part of the system is tridiagonal.
        solved = _tridiagonal(diagonal, beside, np.concatenate([mixed, slope_y[:, None]], axis=1))
        reduced = _inner(mixed, solved)
        step_c = (reduced[:, -1] - slope_c)[None]
        solve_band((square - reduced[:, :-1])[None], np.zeros_like(step_c), step_c)
        step_c = step_c[0]
        return -solved[:, -1] - _times(solved[:, :-1], step_c), step_c


def _barrier(shares: Array, weight: float) -> tuple[Array, Array]:
    """Return the first two derivatives of ``-weight log(1 - s²)``."""
    room = 1.0 - shares**2
    return 2.0 * weight * shares / room, 2.0 * weight * (1.0 + shares**2) / room**2


def _weighted_square(A: Array, weights: Array) -> Array:
    """Return the sum of ``w a aᵀ`` over vectors, (..., m), with weights, (...), as (m, m)."""
    flat = A.reshape(-1, A.shape[-1])
    return _inner(flat, weights.reshape(-1, 1) * flat)


def _inner(A: Array, B: Array) -> Array:
    """Return ``Aᵀ B``, (k, m) and (k, p) -> (m, p), in small parts; see `SMALL`."""
    total = np.zeros((A.shape[1], B.shape[1]))
    size = max(SMALL // max(total.size, 1), 1)
    for begin in range(0, len(A), size):
        total += A[begin : begin + size].T @ B[begin : begin + size]
    return total


def _times(A: Array, c: Array) -> Array:
    """Return ``A c``, (..., m) and (m,) -> (...), without BLAS; see `SMALL`."""
    return np.asarray(np.einsum("...m,m->...", A, c))


def _tridiagonal(diagonal: Array, beside: Array, columns: Array) -> Array:
    """Solve a symmetric tridiagonal system, (k,) and (k,), for some right-hand sides, (k, m)."""
    solved = np.empty_like(columns)
    coupling = -beside[:, None]
    for j in range(columns.shape[1]):
        x = np.ascontiguousarray(columns[:, j, None])
        solve_band(diagonal[:, None, None].copy(), coupling, x)
        solved[:, j] = x[:, 0]
    return solved


def quickened(request: PathRequest, q: Array, limits: Limits) -> Array:
    """Return the joint values of a path, (N, n), after its duration was shortened along the self-motion."""
    if len(q) < 3:
        return q
    part, own = request.without_ranges()
    rows = q if part is request else extended(request.problem, inside=True).with_virtual(q)
    if part.closed:
        # The motion back to the first pose belongs to the path; both its ends stay.
        back = rows[-1] + Turning(part.problem.chain).way(rows[0] - rows[-1])
        part = replace(part.returning(0, back), start=rows[0])
        rows = rows if len(part) == len(rows) else np.concatenate([rows, back[None]])
    better = Quickener(part, request.problem.mechanism, own, limits).quickened(rows)
    return better[: len(q), own]
