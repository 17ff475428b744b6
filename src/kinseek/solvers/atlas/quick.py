"""Solve one goal with the least overhead in Python; the bits are those of `Atlas.solve`."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from kinseek.goal import Goal
from kinseek.kernels.arm.range_error import judge_ranges
from kinseek.kernels.arrays import Array
from kinseek.kernels.atlas.batch import solve_many
from kinseek.kernels.atlas.lanes import LANES
from kinseek.kernels.atlas.near import solve_goal
from kinseek.kernels.atlas.task import REPORT
from kinseek.kinds import Kind
from kinseek.robots.chain import SerialChain
from kinseek.solution import Solution, quick_solution

from .index import AtlasIndex, tolerance_numbers
from .solver import retries_missed


def can_solve_quickly(goal: Goal, near: Array | None) -> bool:
    """Return whether this is one goal without ranges, and with at most one start to be near to."""
    return (
        type(goal) is Goal
        and goal.target.ndim == 2
        and goal.ranges is None
        and (near is None or near.ndim == 1)
    )


def solve_quickly(chain: SerialChain, index: AtlasIndex, goal: Goal, near: Array | None) -> Solution | None:
    """Solve one goal.

    Args:
        chain: The arm.
        index: Its atlas for such goals.
        goal: One that `can_solve_quickly`.
        near: Joint values that the solution shall be near to, (n,), finite, [rad] or [m].

    Returns:
        None if a missed goal has to be searched again.
    """
    tolerances = _tolerances_as(goal, goal.form)
    moved = goal.base is not None or goal.form.turned
    # A target has the memory layout of the array it was created from.
    q, target = np.empty(chain.dof), goal.targets[0] if moved else np.ascontiguousarray(goal.target[:3])
    report = solve_goal(index.address, tolerances, target, q if near is None else near, near is not None, q)
    if not report[4] and retries_missed(goal, chain):
        return None
    return quick_solution(chain, goal, near, q, report)


def is_central(goal: Goal, near: Array | None) -> bool:
    """Return whether this is one goal with ranges that accept its target itself, to be solved without `near`."""
    ranged = type(goal) is Goal and goal.target.ndim == 2 and goal.ranges is not None
    return ranged and near is None and goal.accepts_target


def solve_central(chain: SerialChain, index: AtlasIndex, goal: Goal) -> Solution | None:
    """Solve the target of a goal with ranges itself, for which `is_central`; the bits are those of `solve_centres`.

    Returns:
        None if the fast search does not find it.
    """
    dof, left = chain.dof, np.empty(1, dtype=np.int64)
    row = np.empty((1, dof + REPORT))
    if solve_many(index.handle, central_tolerances(goal), goal.targets, row, left, 0, 1, LANES):
        return None
    weights = float(goal.position_weight), float(goal.orientation_weight)
    (measured,) = judge_ranges(index.arrays, row[:, :dof], goal.questions, *weights).tolist()
    success = measured[0] <= goal.position_tolerance and measured[1] <= goal.orientation_tolerance
    if not success:
        return None
    report = measured[0], measured[1], measured[2], int(row[0, -1]), True
    return quick_solution(chain, goal, None, row[0, :dof], report)


def central_tolerances(goal: Goal) -> Array:
    """Return the tolerances and weights of the pose or position that is looked for inside ranges, (TOLERANCES,)."""
    return _tolerances_as(goal, goal.seeded_as)


def _tolerances_as(goal: Goal, kind: Kind) -> Array:
    return _tolerances(
        goal.position_tolerance,
        goal.orientation_tolerance,
        goal.position_weight,
        goal.orientation_weight,
        kind.columns,
    )


@lru_cache(maxsize=64)
def _tolerances(
    position: float, orientation: float, weight: float, turn_weight: float, columns: int
) -> Array:
    """Return `tolerances_of` a goal with these numbers, (TOLERANCES,); the array must not be modified."""
    axis_weights = [turn_weight if column < min(columns, 2) else 0.0 for column in range(3)]
    return tolerance_numbers(position, orientation, weight, np.inf, axis_weights)
