"""Solve one goal with the least overhead in Python; the bits are those of `Atlas.solve`."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from kinseek.goal import Goal
from kinseek.kernels.arrays import Array
from kinseek.kernels.atlas.near import solve_goal
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
    tolerances = tolerances_as(goal, goal.form)
    moved = goal.base is not None or goal.form.turned
    # A target has the memory layout of the array it was created from.
    q, target = np.empty(chain.dof), goal.targets[0] if moved else np.ascontiguousarray(goal.target[:3])
    report = solve_goal(index.address, tolerances, target, q if near is None else near, near is not None, q)
    if not report[4] and retries_missed(goal, chain):
        return None
    return quick_solution(chain, goal, near, q, report)


def tolerances_as(goal: Goal, kind: Kind, budget: float = np.inf) -> Array:
    """Return the tolerances and weights of a goal for a search for a plain kind, (TOLERANCES,)."""
    return _tolerances(
        goal.position_tolerance,
        goal.orientation_tolerance,
        goal.position_weight,
        goal.orientation_weight,
        kind.columns,
        budget,
    )


@lru_cache(maxsize=64)
def _tolerances(
    position: float, orientation: float, weight: float, turn_weight: float, columns: int, budget: float
) -> Array:
    """Return `tolerances_of` a goal with these numbers, (TOLERANCES,); the array must not be modified."""
    axis_weights = [turn_weight if column < min(columns, 2) else 0.0 for column in range(3)]
    return tolerance_numbers(position, orientation, weight, axis_weights, budget=budget)
