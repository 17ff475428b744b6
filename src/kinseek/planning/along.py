"""Joint values at which a goal holds that has to hold all along a motion, such as an upright tool."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kinseek.errors import InvalidProblem
from kinseek.goal import Goal
from kinseek.kernels.arrays import Limits
from kinseek.kernels.paths.projection import project_onto_poses
from kinseek.problem import Problem
from kinseek.robots.chain import SerialChain
from kinseek.solvers.atlas.index import atlas_of, tolerances_of
from kinseek.virtual_joints import extended

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

STEPS = 12
"""Newton steps of a projection at most. Not examined further."""


class Along:
    """A goal with free axes or ranges, as a set of joint values.

    Args:
        chain: The arm.
        goal: The goal.

    Raises:
        InvalidProblem: Several targets, or ranges about axes that the goal does not fix.
    """

    def __init__(self, chain: SerialChain, goal: Goal) -> None:
        """Add joints for the ranges of the goal, see `kinseek.virtual_joints`."""
        if not isinstance(goal, Goal) or goal.shape:
            raise InvalidProblem(f"along must be a Goal with one target, got {goal!r:.80}")
        self._problem = Problem(chain, goal)
        self._more = extended(self._problem)
        more = self._more.problem
        self._index, self._tolerances = atlas_of(more.chain, more.goal), tolerances_of(more.goal)
        self._limits = Limits(more.chain.lower.copy(), more.chain.upper.copy())
        self._target = np.ascontiguousarray(more.goal.targets[:1])

    def projected(self, q: Array) -> tuple[Array, Flags]:
        """Return joint values near others, (k, n), at which the goal holds, and whether they were found, (k,)."""
        rows = self._more.with_virtual(q) if self._problem.goal.ranges is not None else q.copy()
        targets = np.repeat(self._target, len(rows), axis=0)
        project_onto_poses(
            self._index.job(self._tolerances), targets, self._limits, STEPS, rows, np.empty(len(rows))
        )
        own = np.ascontiguousarray(rows[:, self._more.own])
        return own, self.holds(own)

    def holds(self, q: Array) -> Flags:
        """Return where the goal holds within its tolerances, (k, n) -> (k,)."""
        goal = self._problem.goal.at(np.repeat(self._problem.goal.target[None], len(q), axis=0))
        errors = goal.measure(Problem(self._problem.chain, goal).arrays, np.ascontiguousarray(q))
        # NaN: that part of the goal is free.
        position, orientation = np.nan_to_num(errors[:, :2]).T
        return np.asarray((position <= goal.position_tolerance) & (orientation <= goal.orientation_tolerance))

    def require(self, q: Array, name: str) -> None:
        """Check that the goal holds at joint values, (n,).

        Raises:
            InvalidProblem: It does not.
        """
        if not self.holds(q[None])[0]:
            errors = self._problem.goal.measure(self._problem.arrays, q[None])[0]
            raise InvalidProblem(
                f"{name} must fulfil along=, and is off by {errors[0]:.3g} m and {errors[1]:.3g} rad: "
                "arm.ik(along, near=q) finds joint values nearby that do"
            )
