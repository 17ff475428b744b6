"""Solve goals with free axes and ranges by the atlas.

The centre of the ranges is tried first, since it is found much faster; see `centres`. If it is out of reach, seeds are
spread over the ranges, and steps reduce what exceeds them. See `kernels.ranges.search`; `Atlas` calls this module for such
goals.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from kinseek.goal import Goal
from kinseek.kernels.arrays import Array, Indices
from kinseek.kernels.atlas.lanes import LANES
from kinseek.kernels.atlas.task import REPORT
from kinseek.kernels.ranges.search import solve_ranged
from kinseek.kernels.ranges.steps import POSES
from kinseek.problem import Problem
from kinseek.ranges import Ranges
from kinseek.robots.chain import SerialChain
from kinseek.robots.sampling import low_discrepancy
from kinseek.solution import Solution
from kinseek.support.deadline import Deadline
from kinseek.support.transforms import rotation_onto, rotations
from kinseek.virtual_joints import extended

from .centres import solve_centres
from .index import atlas_of, tolerances_of
from .rows import batch_solution

if TYPE_CHECKING:
    from kinseek.solvers.threads import GoOn

    from .solver import Atlas

TINY = 1e-300
"""Lower bound of a divisor: prevents division by zero for a vector of length zero."""

CLOSE = 100.0
"""Goals that are missed by at most this many tolerances are searched once more. Not examined further."""

_GROUP = 64
"""Targets whose poses are computed at once."""

_PIECE = 8
"""Targets that are solved in one piece: some ten milliseconds if they are hard."""


def solve_ranges(search: Atlas, problem: Problem) -> Solution:
    """Solve a goal with ranges, or a batch, on all threads."""
    goal, chain = problem.goal, problem.chain
    deadline = Deadline(problem.time_limit)
    index = atlas_of(chain, goal, search.samples)
    tolerances = tolerances_of(goal, problem.budget, problem.nearest)
    count = len(goal.targets)
    near = (chain.lower + chain.upper) / 2 if problem.near is None else problem.near
    nears = np.ascontiguousarray(np.broadcast_to(near, (*goal.shape, chain.dof))).reshape(-1, chain.dof)
    results, done = np.empty((count, chain.dof + REPORT)), np.zeros(count, dtype=bool)
    assert goal.ranges is not None
    questions, (fractions, turns) = goal.questions, deviations(goal.ranges, goal.swing, goal.cone)

    # With `near` the solution shall be near, and not at the centre; a budget limits the work of the search.
    central = problem.near is None and problem.budget is None

    def work(begin: int, end: int, go_on: GoOn) -> None:
        for first in range(begin, end, _GROUP):
            if not go_on():
                return
            some = np.arange(first, min(first + _GROUP, end))
            if central:
                centres = _centres(chain, goal, fractions, turns, some)
                solve_centres(problem, search.samples, centres, some, results, done)
                some = some[~done[some]]
            poses = seed_poses(chain, goal, fractions, turns, some)
            for piece in range(0, len(some), _PIECE):
                if not go_on():
                    return
                rows = some[piece : piece + _PIECE]
                found = np.empty((len(rows), results.shape[1]))
                solve_ranged(
                    index.range_handle,
                    tolerances,
                    questions[rows],
                    poses[piece : piece + _PIECE],
                    nears[rows],
                    problem.near is not None,
                    found,
                    LANES,
                )
                results[rows], done[rows] = found, True

    search.parallel_for(work, count, deadline)
    if problem.budget is None:
        _retry_close(search, problem, results, deadline)
    return batch_solution(problem, results, done)


def _centres(chain: SerialChain, goal: Goal, fractions: Array, turns: Array, some: Indices) -> Array:
    """Return the poses at the centres of the ranges of some targets, (k, 3, 4); see `seed_poses`."""
    if goal.accepts_target:
        return np.ascontiguousarray(goal.targets[some])
    return np.ascontiguousarray(seed_poses(chain, goal, fractions[:1], turns[:1], some)[:, 0])


def _retry_close(search: Atlas, problem: Problem, results: Array, deadline: Deadline) -> None:
    """Search narrow misses once more, by an arm with virtual joints for the ranges.

    Where only a corner of the ranges is reached, with joints at their limits, a step that is free inside the ranges turns
    back and forth; Newton's method for a plain pose converges.
    """
    goal, chain = problem.goal, problem.chain
    errors = results[:, chain.dof : -1]
    close = errors[:, 0] <= CLOSE * goal.position_tolerance
    close &= errors[:, 1] <= CLOSE * goal.orientation_tolerance
    for i in np.flatnonzero(close & ~goal.met(errors)):
        if deadline.passed:
            return
        one = problem.at(goal.target.reshape(-1, 4, 4)[i])
        more = extended(replace(one, near=None))
        near = more.with_virtual(results[i : i + 1, : chain.dof])[0]
        found = replace(search, progress=False, threads=1).solve(replace(more.problem, near=near))
        q = one.placed(found.q[more.own])
        measured = one.errors_of(q[None])
        results[i, -1] += found.evaluations
        if one.goal.met(measured)[0]:
            results[i, : chain.dof], results[i, chain.dof : -1] = q, measured[0]


@lru_cache(maxsize=64)
def deviations(
    ranges: Ranges, swing: tuple[float, float, float] | None, cone: float = 0.0
) -> tuple[Array, Array]:
    """Return deviations spread over ranges: fractions of x, y and z in [0, 1], (POSES, 3), and rotations, (POSES, 3, 3)."""
    open_axes = [i for i, (low, high) in enumerate(ranges) if low < high]
    if swing is not None:
        open_axes = [i for i in open_axes if i < 3] + ([3, 4, 5] if cone else [3])
    fractions = np.zeros((POSES, 6))
    fractions[:, open_axes] = low_discrepancy(POSES, len(open_axes)) if open_axes else 0.0
    turns = rotations(turn_vectors(ranges, swing, fractions))
    if swing is not None and cone:
        turns = rotations(tilt_vectors(swing, cone, fractions[:, 4:])) @ turns
    return fractions[:, :3], turns


def tilt_vectors(axis: tuple[float, float, float], cone: float, fractions: Array) -> Array:
    """Return rotation vectors that tilt an axis, spread evenly over a cone about it, the first zero, (POSES, 3)."""
    # Equal fractions of the height of a spherical cap are equal fractions of its area (Archimedes).
    half = np.sqrt(fractions[:, 0]) * math.sin(0.5 * cone)
    half[0] = 0.0
    angle, about = 2.0 * np.arcsin(half), 2.0 * np.pi * fractions[:, 1]
    across = rotation_onto(np.array([0.0, 0.0, 1.0]), np.array(axis))[:, :2]
    return np.asarray(angle[:, None] * (np.stack([np.cos(about), np.sin(about)], axis=1) @ across.T))


def seed_poses(chain: SerialChain, goal: Goal, fractions: Array, turns: Array, some: Indices) -> Array:
    """Return poses spread over the ranges about some targets, the first as near as they allow, (k, POSES, 3, 4)."""
    about, frames = goal.targets[some], goal.frames[some]
    low, high = place_ranges(chain, goal, about, frames)
    place = low[:, None] + fractions[None] * (high - low)[:, None]
    place[:, 0] = np.clip(0.0, low, high)
    poses = np.empty((len(about), len(turns), 3, 4))
    poses[..., 3:] = about[:, None, :, 3:] + _product(frames[:, None], place[..., None])
    back = _product(np.swapaxes(frames, 1, 2), about[:, :, :3])
    poses[..., :3] = _product(_product(frames[:, None], turns[None]), back[:, None])
    return poses


def place_ranges(chain: SerialChain, goal: Goal, about: Array, frames: Array) -> tuple[Array, Array]:
    """Return ranges of x, y and z about targets, (k, 3, 4), cut to the arm's reach: lower and upper ends, (k, 3) each."""
    ends = np.array(goal.ranges)[:3]
    tool = 0.0 if goal.tool is None else float(np.linalg.norm(goal.tool[:3, 3]))
    reach = chain.length + tool
    away = chain.fixed[0, :, 3] - about[:, :, 3]
    shoulder = _product(np.swapaxes(frames, 1, 2), away[..., None])[..., 0]
    low, high = np.maximum(ends[:, 0], shoulder - reach), np.minimum(ends[:, 1], shoulder + reach)
    none = low > high  # The range is out of reach: use its nearer end.
    nearer = np.clip(shoulder, ends[:, 0], ends[:, 1])
    return np.where(none, nearer, low), np.where(none, nearer, high)


def turn_vectors(ranges: Ranges, swing: tuple[float, float, float] | None, fractions: Array) -> Array:
    """Return rotation vectors spread over the ranges, the first as short as they allow, (POSES, 3)."""
    if swing is not None:
        angles = np.pi * (2.0 * fractions[:, 3] - 1.0)
        angles[0] = 0.0
        return np.asarray(angles[:, None] * np.array(swing))
    ends = np.array(ranges)[3:]
    vectors = ends[:, 0] + fractions[:, 3:] * (ends[:, 1] - ends[:, 0])
    vectors[0] = np.clip(0.0, ends[:, 0], ends[:, 1])
    lengths = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.asarray(vectors * np.minimum(1.0, np.pi / np.maximum(lengths, TINY)))


def _product(A: Array, B: Array) -> Array:
    """Return products of 3x3 matrices with matrices of three rows, written out: the bits are the same in every batch."""
    return np.asarray(sum(A[..., :, j : j + 1] * B[..., j : j + 1, :] for j in range(3)))
