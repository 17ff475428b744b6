"""Arms with joints to spare: samples of the answers at some poses, the best way through them, then all poses at once.

Samples stand at poses that the hand reaches after moving `APART`, for between them the answers move little. The way through
them with the least sum of squared steps says on which side of everything the arm passes; it is filled in between, every pose
is brought onto its target, and the self-motion of all of them is smoothed together. Where a step is still too large, more
samples are taken there.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from kinseek.branches.index import BranchIndex, index_of
from kinseek.branches.result import answers_of
from kinseek.deadline import Deadline
from kinseek.kernels.paths.programme import SQUARES
from kinseek.problem import Problem
from kinseek.robots.geometry import arm_length
from kinseek.solvers.atlas.index import wanted_of
from kinseek.solvers.threads import GoOn, spread

from .asked import Asked
from .between import apart
from .ends import best_valid, fill_missed, with_ends
from .joints import Turning
from .layers import Layers
from .nodes import Programme
from .smooth import Smoother

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Flags = NDArray[np.bool_]

COUNT = 60
"""Samples of the answers to a pose."""

APART = 0.25
"""The hand turns by so much [rad], or moves by as much of a third of the arm's length, between two sampled poses."""

FARTHEST = 25
"""Poses at most between two sampled ones."""

MORE, DENSER = 200, 0.5
"""Samples of a second attempt, and the share of the distance between sampled poses."""

COARSE, FINE = 12, 6
"""Passes of smoothing at most over the sampled poses, and over all."""


def sampled_poses(problem: Problem, apart_by: float) -> Indices:
    """Numbers of the poses at which answers are sampled, the first and the last among them."""
    poses = np.zeros((len(problem.goal.targets), 4, 4))
    poses[:, :3], poses[:, 3, 3] = problem.goal.targets, 1.0
    if len(poses) == 1:
        return np.zeros(1, dtype=np.int64)
    distance, turn = apart(poses[:-1], poses[1:])
    way = np.concatenate([[0.0], np.cumsum(distance * 3 / arm_length(problem.chain) + turn)])
    marks = np.floor(way / apart_by)
    places = np.flatnonzero(np.diff(marks) > 0) + 1
    keys = {0, len(poses) - 1, *places.tolist()}
    ordered = sorted(keys)
    for a, b in pairwise(ordered):
        keys |= set(range(a, b, FARTHEST))
    return np.array(sorted(keys), dtype=np.int64)


def sampled_layers(
    problem: Problem, keys: Indices, count: int, threads: int | None, advance: Callable[[int], object]
) -> Layers:
    """Spread samples of the answers to some targets, inside the limits."""
    index: BranchIndex = index_of(problem)
    wanted, dof = wanted_of(problem.goal), problem.chain.dof
    rows: list[Array] = [np.zeros((0, dof))] * len(keys)
    targets = np.zeros((len(keys), 4, 4))
    targets[:, :3], targets[:, 3, 3] = problem.goal.targets[keys], 1.0

    def work(begin: int, end: int, go_on: GoOn) -> None:
        for k in range(begin, end):
            if not go_on():
                return
            found = index.search(wanted, targets[k], index.view, count)
            if len(found):
                rows[k] = answers_of(found, dof).q

    spread(work, len(keys), 8, threads, Deadline(), advance)
    counts = np.array([len(row) for row in rows], dtype=np.int64)
    q = np.zeros((len(keys), max(int(counts.max(initial=1)), 1), dof))
    for k, row in enumerate(rows):
        q[k, : len(row)] = row
    return Layers(Turning(problem.chain).first_turn(q), counts)


def filled(q: Array, keys: Indices, count: int) -> Array:
    """Joint values for all poses from those at some, straight in between, (count, n)."""
    numbers = np.arange(count)
    return np.stack([np.interp(numbers, keys, column) for column in q.T], axis=1)


def unbroken(asked: Asked, q: Array) -> Flags:
    """Of each step of a path, (N - 1,): does no joint go too far?"""
    return np.asarray((np.abs(np.diff(q, axis=0)) <= asked.longest).all(axis=1))


def follow_samples(
    asked: Asked, threads: int | None, advance: Callable[[int], object]
) -> tuple[Array, Indices]:
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
    for start in [q[0], q[-1].copy()] if asked.start is None else [asked.start]:
        row = np.ascontiguousarray(start[None])
        Smoother(asked.problem, asked.weights).settle(row, np.ascontiguousarray(goal.targets[:1]))
        round_trip = replace(asked, problem=around, longest=longest, start=row[0], end=row[0], closed=False)
        way = _open_way(round_trip, threads, _silent)
        if best is None or _faults(round_trip, way) < _faults(round_trip, best):
            best = way
    assert best is not None
    gaps = Turning(asked.problem.chain).step(np.diff(best, axis=0))
    return best[:-1], np.flatnonzero((np.abs(gaps) > longest).any(axis=1))


def _open_way(asked: Asked, threads: int | None, advance: Callable[[int], object]) -> Array:
    """The better of two attempts, the second with more samples, if the first breaks."""
    best: Array | None = None
    for count, dense in ((COUNT, 1.0), (MORE, DENSER)):
        q = _attempt(asked, count, dense, threads, advance if best is None else _silent)
        if best is None or _faults(asked, q) < _faults(asked, best):
            best = q
        if not _faults(asked, best)[0]:
            break
    assert best is not None
    return best


def _silent(done: int) -> None:
    pass


def _faults(asked: Asked, q: Array) -> tuple[int, float]:
    """Breaks, and the sum of the squared steps."""
    return int((~unbroken(asked, q)).sum()), float((np.diff(q, axis=0) ** 2).sum())


def _attempt(
    asked: Asked, count: int, dense: float, threads: int | None, advance: Callable[[int], object]
) -> Array:
    problem, total = asked.problem, len(asked.problem.goal.targets)
    keys = sampled_poses(problem, APART * dense)
    layers = sampled_layers(problem, keys, count, threads, advance)
    part = replace(asked, problem=Problem(problem.mechanism, problem.goal.at(problem.goal.target[keys])))
    layers, ends = with_ends(part, fill_missed(part.problem, layers, threads))
    programme = Programme(part, layers, SQUARES)
    everything = np.full((1, problem.chain.dof), np.inf)
    programme.asked = replace(part, longest=everything, closed=False)
    q, _ = best_valid(programme, ends)
    smoother = Smoother(problem, asked.weights, asked.valid)
    return _completed(asked, smoother, q, keys, total)


def _completed(asked: Asked, smoother: Smoother, q: Array, keys: Indices, total: int) -> Array:
    """Fill in between sampled poses and smooth, first as a whole, then, where it jumps, every stretch by itself."""
    targets = np.ascontiguousarray(asked.problem.goal.targets)
    ends = np.zeros(total, dtype=np.bool_)
    ends[0], ends[-1] = asked.start is not None, asked.end is not None
    coarse = smoother.smooth(q, targets[keys], COARSE, ends[keys])
    whole = filled(coarse, keys, total)
    smoother.settle(whole, targets)
    whole = smoother.smooth(whole, targets, FINE, ends)
    jumps = np.flatnonzero(~unbroken(asked, whole))
    if not len(jumps):
        return whole
    # A jump pulls at both sides of it: each stretch is smoothed again from what the samples gave.
    rough = filled(q, keys, total)
    smoother.settle(rough, targets)
    cuts = [0, *(int(i) + 1 for i in jumps), total]
    parts = []
    for a, b in pairwise(cuts):
        part = whole[a:b]
        parts.append(smoother.smooth(part, targets[a:b], COARSE + FINE, ends[a:b]) if b - a > 1 else part)
    apart_q = np.concatenate(parts)
    return min(whole, apart_q, key=lambda some: _faults(asked, some))
