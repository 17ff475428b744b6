"""Arms with joints to spare: many branches followed side by side, the best way among them, then all poses at once.

The way is planned on some of the poses, chosen by how far the hand goes, and filled in between them. At the first pose
answers are sampled all over the self-motion. Each is followed with the least motion of the joints from layer to layer; at
each layer answers beside them, along the self-motion, keep them well spread, and a few fresh samples join them. So the best
way through all of them (see `kernels.paths.programme.link`) keeps to branches, and changes from one to another sideways, by
little at a time. What it leaves of corners is smoothed away, on the poses of the plan first, then on all. Where a step is
still too large, or hits something, that part of the path is planned again, more finely; if that does not help, all of it is,
at last with a layer at every pose, and once more without the places where that plan broke.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from kinseek.branches.order import cost_of
from kinseek.deadline import Deadline
from kinseek.problem import Problem
from kinseek.solvers.threads import GoOn, spread

from .asked import Asked
from .between import apart, beyond_a_step
from .joints import Turning
from .plan import Barred, Effort, Planner, between_rows, gone_of, smoother_of
from .smooth import Row, Smoother

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Flags = NDArray[np.bool_]
Advance = Callable[[int], object]

COARSE = Effort(0.25, 3, 100, 4, 200, 0.1)
FINE = Effort(0.2, 2, 150, 4, 250, 0.08)
EACH = Effort(0.0, 4, 150, 4, 400, 0.08)
"""All poses are rows: near a singularity what lies between two rows is not known well enough to fill it in."""

STEP = Effort(0.0, 1, 150, 4, 400, 0.08)
"""All poses are layers: from one to the next nothing lies that a way sideways could miss, such as a singularity at which
curves of answers part, and join anew."""

PLANS = ((COARSE, EACH), (FINE, EACH), (EACH, STEP), (STEP, STEP), (STEP, STEP))
"""How a path is planned, and then its parts around breaks, until there are none."""

AROUND = (3.0, 8.0)
"""Before and behind a break so much of the hand's way is planned anew."""

FIRST_PASSES, LAST_PASSES = 10, 4
"""Passes of smoothing at most, on the rows of the plan and on all poses."""

POWERS, POWER_PASSES, EASED = (6, 12), 20, 4.0
"""Where steps are still too large, powers of the steps' lengths whose sum is made small instead, in so many passes at most,
on so much of the hand's way before and behind."""


def unbroken(asked: Asked, q: Array) -> Flags:
    """Of each step of a path, (N - 1,): does no joint go too far?"""
    return np.asarray((np.abs(np.diff(q, axis=0)) <= asked.longest * (1 + 1e-9)).all(axis=1))


def mendable(asked: Asked, q: Array) -> Flags:
    """Of each step of a path, (N - 1,): is it a break that joints could pass, or does it hit something?"""
    goal = asked.problem.goal
    distance, turn = apart(goal.target[:-1], goal.target[1:])
    distance, turn = distance - 2 * goal.position_tolerance, turn - 2 * goal.orientation_tolerance
    torn, turned = beyond_a_step(asked.problem.chain, asked.longest, distance, turn)
    if goal.columns == 3:
        torn = torn | turned
    return np.asarray(_faulty(asked, q) & (~torn | (goal.ranges is not None)))


def follow_samples(asked: Asked, threads: int | None, advance: Advance) -> tuple[Array, Indices]:
    """Joint values for every pose of a path that leaves joints to spare, (N, n), and its breaks."""
    q = _open_way(asked, threads, advance)
    if not asked.closed or len(q) == 1:
        return q, np.flatnonzero(~unbroken(asked, q))
    goal, best = asked.problem.goal, None
    around = Problem(asked.problem.mechanism, goal.at(np.concatenate([goal.target, goal.target[:1]])))
    longest = asked.longest
    if len(longest) > 1:
        longest = np.concatenate([longest, longest[-1:]])
    # One more pose leads back: to where the open way begins, or on from where it ends.
    for start in [q[0], q[-1]] if asked.start is None else [asked.start]:
        row = np.ascontiguousarray(start[None])
        smoother_of(asked).settle(row, np.ascontiguousarray(goal.targets[:1]))
        round_trip = replace(asked, problem=around, longest=longest, start=row[0], end=row[0], closed=False)
        way = _open_way(round_trip, threads, _silent)
        if best is None or _faults(round_trip, way) < _faults(round_trip, best):
            best = way
    assert best is not None
    gaps = Turning(asked.problem.chain).way(np.diff(best, axis=0))
    return best[:-1], np.flatnonzero((np.abs(gaps) > longest).any(axis=1))


def _silent(done: int) -> None:
    pass


def _open_way(asked: Asked, threads: int | None, advance: Advance) -> Array:
    """The best of a few plans, each made if those before it break, and parts of each planned anew around its breaks."""
    best: Array | None = None
    barred: list[Barred] = []
    for effort, finer in PLANS:
        q = _planned(asked, effort, threads, advance if best is None else _silent, barred)
        if effort is STEP:
            barred += [Barred(int(i), q[i]) for i in np.flatnonzero(_faulty(asked, q))]
        q = _mended(asked, q, finer, threads)
        if best is None or _faults(asked, q) < _faults(asked, best):
            best = q
        if not mendable(asked, best).any():
            break
    assert best is not None
    return best


def _mended(asked: Asked, q: Array, effort: Effort, threads: int | None) -> Array:
    """Parts of a path around its breaks planned anew, where that mends them."""
    gone = gone_of(asked.problem)
    for around in AROUND:
        windows = _around(asked, q, gone, around)
        parts = [_part(asked, q, first, last) for first, last in windows]
        made = [np.zeros(0)] * len(parts)

        def plan(
            first: int, end: int, go_on: GoOn, parts: list[Asked] = parts, made: list[Array] = made
        ) -> None:
            for k in range(first, end):
                made[k] = _planned(parts[k], effort, 1, _silent)

        spread(plan, len(parts), 1, threads, Deadline())
        for (first, last), part, new in zip(windows, parts, made, strict=True):
            old = q[first : last + 1]
            if _faults(part, new) < _faults(part, old):
                # Where an endless joint has turned the other way round, what follows goes along.
                q = np.concatenate([q[:first], new, q[last + 1 :] + (new[-1] - old[-1])])
    return q


def _part(asked: Asked, q: Array, first: int, last: int) -> Asked:
    """From one pose of a path to another, both as they are, but for the ends of the whole that are open."""
    goal = asked.problem.goal
    longest = asked.longest if len(asked.longest) == 1 else asked.longest[first:last]
    return replace(
        asked,
        problem=Problem(asked.problem.mechanism, goal.at(goal.target[first : last + 1])),
        start=asked.start if first == 0 else q[first],
        end=asked.end if last == len(q) - 1 else q[last],
        longest=longest,
        closed=False,
    )


def _smoothed(asked: Asked, smoother: Smoother, q: Array, row: Row, passes: int) -> Array:
    """Made short; with a cost of the user as long as cost and squared steps together become less."""
    if asked.cost is None:
        return smoother.smooth(q, row, passes, 2)
    for _ in range(passes):
        better = smoother.smooth(q, row, 1, 2)
        if _cost(asked, better, row.spans) >= _cost(asked, q, row.spans):
            break
        q = better
    return q


def _cost(asked: Asked, q: Array, spans: Array) -> float:
    """Squared steps, and what the user says that poses cost."""
    squares = float((np.diff(q, axis=0) ** 2 / spans).sum())
    if asked.cost is None:
        return squares
    return squares + float((cost_of(asked.cost, q)[1:] * spans[:, 0]).sum())


def _faulty(asked: Asked, q: Array) -> Flags:
    """Of each step, (N - 1,): is it a break, or does it hit something?"""
    whole = unbroken(asked, q)
    if asked.valid is not None:
        whole[whole] = asked.valid.free_ways(q[:-1][whole], q[1:][whole])
    return ~whole


def _faults(asked: Asked, q: Array) -> tuple[int, float]:
    """Breaks, steps that are not free among them, and what the path costs."""
    return int(_faulty(asked, q).sum()), _cost(asked, q, np.ones((len(q) - 1, 1)))


def _planned(
    asked: Asked, effort: Effort, threads: int | None, advance: Advance, barred: Sequence[Barred] = ()
) -> Array:
    planner = Planner(asked, effort, barred)
    smoother, rows = planner.smoother, planner.rows
    if len(rows) == 1:
        only = planner.layer(0, planner.sample(0, effort.samples), np.zeros((0, planner.dof)))[0][:1]
        return only if asked.start is None else asked.start[None]
    some, all_of_them = _row(asked, rows), _row(asked, np.arange(rows[-1] + 1))
    q = _put(asked, smoother, planner.plan(advance, threads), some)
    q = _smoothed(asked, smoother, q, some, FIRST_PASSES)
    if len(rows) < len(all_of_them.targets):
        q = _put(asked, smoother, between_rows(rows, q), all_of_them)
    q = _smoothed(asked, smoother, q, all_of_them, LAST_PASSES)
    for power in POWERS:
        for first, last in _around(asked, q, planner.gone, EASED):
            part = _row(_part(asked, q, first, last), np.arange(last + 1 - first))
            q[first : last + 1] = smoother.smooth(q[first : last + 1], part, POWER_PASSES, power)
    return q


def _around(asked: Asked, q: Array, gone: Array, way: float) -> list[tuple[int, int]]:
    """First and last pose of each part of a path that holds its breaks, and so much of the hand's way at both sides."""
    parts: list[tuple[int, int]] = []
    for i in np.flatnonzero(mendable(asked, q)).tolist():
        first = int(np.searchsorted(gone, gone[i] - way))
        last = min(int(np.searchsorted(gone, gone[i + 1] + way)), len(q) - 1)
        if parts and first <= parts[-1][1]:
            first = parts.pop()[0]
        parts.append((first, last))
    return parts


def _row(asked: Asked, rows: Indices) -> Row:
    """Some poses of a path, the first and the last among them."""
    fixed = np.zeros(len(rows), dtype=np.bool_)
    fixed[0], fixed[-1] = asked.start is not None, asked.end is not None
    spans = np.diff(rows)
    if len(asked.longest) == 1:
        longest = asked.longest * spans[:, None]
    else:
        longest = np.add.reduceat(asked.longest, rows[:-1], axis=0)
    targets = np.ascontiguousarray(asked.problem.goal.targets[rows])
    return Row(targets, fixed, spans.astype(np.float64)[:, None], longest)


def _put(asked: Asked, smoother: Smoother, q: Array, row: Row) -> Array:
    """Bring rows onto their targets; those that are fixed are what was asked for."""
    if asked.start is not None:
        q[0] = asked.start
    if asked.end is not None:
        q[-1] = asked.end + Turning(asked.problem.chain).whole_turns(q[-1] - asked.end)
    moved = q.copy()
    smoother.onto(moved, row.targets)
    moved[row.fixed] = q[row.fixed]
    return moved
