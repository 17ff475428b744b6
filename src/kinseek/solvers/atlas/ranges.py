"""Solve goals with free axes and ranges by the atlas: seeds are spread over the ranges, and steps reduce what exceeds them.

See `kernels.ranges.search`; `Atlas` calls this module for such goals.
"""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from kinseek.goal import Goal
from kinseek.kernels.arrays import Array
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
from kinseek.support.transforms import rotations

from .index import atlas_of, tolerances_of
from .rows import batch_solution

if TYPE_CHECKING:
    from kinseek.solvers.threads import GoOn

    from .solver import Atlas

TINY = 1e-300
"""Lower bound of a divisor: prevents division by zero for a vector of length zero."""

_GROUP = 64
"""Targets whose poses are computed at once."""

_PIECE = 8
"""Targets that are solved in one piece: some ten milliseconds if they are hard."""


def solve_ranges(search: Atlas, problem: Problem) -> Solution:
    """Solve a goal with ranges, or a batch, on all threads."""
    goal, chain = problem.goal, problem.chain
    deadline = Deadline(problem.time_limit)
    index = atlas_of(chain, goal, search.samples)
    tolerances = tolerances_of(goal, problem.budget)
    count = len(goal.targets)
    near = (chain.lower + chain.upper) / 2 if problem.near is None else problem.near
    nears = np.ascontiguousarray(np.broadcast_to(near, (*goal.shape, chain.dof))).reshape(-1, chain.dof)
    results, done = np.empty((count, chain.dof + REPORT)), np.zeros(count, dtype=bool)
    assert goal.ranges is not None
    questions, (fractions, turns) = goal.questions, deviations(goal.ranges, goal.swing)

    def work(begin: int, end: int, go_on: GoOn) -> None:
        for first in range(begin, end, _GROUP):
            last = min(first + _GROUP, end)
            poses = seed_poses(chain, goal, fractions, turns, slice(first, last))
            for piece in range(first, last, _PIECE):
                if not go_on():
                    return
                until = min(piece + _PIECE, last)
                solve_ranged(
                    index.range_handle,
                    tolerances,
                    questions[piece:until],
                    poses[piece - first : until - first],
                    nears[piece:until],
                    problem.near is not None,
                    results,
                    piece,
                    LANES,
                )
                done[piece:until] = True

    search.parallel_for(work, count, deadline)
    return batch_solution(problem, results, done)


@lru_cache(maxsize=64)
def deviations(ranges: Ranges, swing: tuple[float, float, float] | None) -> tuple[Array, Array]:
    """Return deviations spread over ranges: fractions of x, y and z in [0, 1], (POSES, 3), and rotations, (POSES, 3, 3)."""
    open_axes = [i for i, (low, high) in enumerate(ranges) if low < high]
    if swing is not None:
        open_axes = [i for i in open_axes if i < 3] + [3]
    fractions = np.zeros((POSES, 6))
    fractions[:, open_axes] = low_discrepancy(POSES, len(open_axes)) if open_axes else 0.0
    return fractions[:, :3], rotations(turn_vectors(ranges, swing, fractions))


def seed_poses(chain: SerialChain, goal: Goal, fractions: Array, turns: Array, targets: slice) -> Array:
    """Return poses spread over the ranges about each target, the first as near to it as they allow, (k, POSES, 3, 4)."""
    about, frames = goal.targets[targets], goal.frames[targets]
    low, high = place_ranges(chain, goal, about, frames)
    place = low[:, None] + fractions[None] * (high - low)[:, None]
    place[:, 0] = np.clip(0.0, low, high)
    poses = np.empty((len(about), POSES, 3, 4))
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
